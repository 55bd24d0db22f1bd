"""``cylconn simulate`` for several connectors: groups that share bodies, or single ones.

A group is simulated together (simulation/group.py); its run can be kept as a recorded run with the
topics of the node.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import cylconn_ros
from cylconn_ros.cli import checks
from cylconn_ros.cli import scenes as scene_files
from cylconn_ros.cli.info import describe
from cylconn_ros.cli.progress import Progress
from cylconn_ros.connector.outputs import column
from cylconn_ros.connector.summary import FIELDS, summarise
from cylconn_ros.core import layout
from cylconn_ros.errors import CommandError
from cylconn_ros.messages.topic_names import topic
from cylconn_ros.reference import group_answers, library
from cylconn_ros.scene import parameter_file, shared_bodies
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.group import GroupRun, simulate_group

_MOTIONS = (
    (layout.A_POSE, layout.A_LOAD, layout.FORCE_A),
    (layout.B_POSE, layout.B_LOAD, layout.FORCE_B),
)


class _Topic(NamedTuple):
    """A recorded topic: its name and type, and the encoder of its rows."""

    name: str
    kind: str
    writer: Any
    rows: np.ndarray


class _Commands(NamedTuple):
    """The messages of one topic that commands what changes over time."""

    commands: Any
    name: str

    def write(self, stamp: int, k: int) -> bytes:
        """The message for sample k."""
        return dict(self.commands.write(stamp, k))[self.name]


def run(path: Path, scenes: Mapping[str, Scene], options: argparse.Namespace) -> int:
    """Simulate all connectors of ``path``; 1 if a sample was refused, not solved or not exact.

    Raises CommandError for an output that several connectors cannot have.
    """
    if options.plot is not None:
        raise CommandError(
            f"--plot {options.plot}: draws one connector; keep the run with -o NAME, and use "
            "cylconn report NAME"
        )
    if options.output is not None and options.output.suffix:
        raise CommandError(
            f"{options.output}: must have no suffix (recorded run) for several connectors"
        )
    scenes = scene_files.all_overridden(path, scenes, options)
    runs: dict[tuple[str, ...], GroupRun] = {}
    for names in shared_bodies.groups(scenes):
        group = [scenes[name] for name in names]
        with Progress(f"simulate {path.stem}") as bar:
            bar.note("preparing (the first run compiles the physics)")
            result = simulate_group(group, scene_files.steps(group[0]) + 1, bar)
        runs[tuple(names)] = result
    passed = True
    for together, result in runs.items():
        passed &= _show(together, result)
    if not any(getattr(options, each) for each in ("duration", "steps", "set")):
        passed &= _compare(path, scenes, runs)
    if options.output is not None:
        record(runs, scenes, options.output)
        print(f"kept        {options.output}\nnext: cylconn info {options.output}")
    else:
        print("next: keep the run with -o NAME")
    return 0 if passed else 1


def _show(names: Sequence[str], result: GroupRun) -> bool:
    """Print the run of a group; False if a sample was refused or not solved."""
    well = True
    for c, name in enumerate(names):
        found = summarise(result.time, {each: column(result.outs[:, c], each) for each in FIELDS})
        print(f"{name}: {result.group.connectors[c].model}")
        print("\n".join(describe(found)))
        well &= not found.refused and not found.problem
    energy = result.energy
    print(f"energy      {energy[0]:.6g} J at the start, {energy[-1]:.6g} J at the end")
    flags = result.outs[:, :, layout.FLAGS].astype(np.int64)
    unsolved = int(((flags & layout.NOT_CONVERGED) != 0).any(axis=1).sum())
    if unsolved:
        print(f"NOT SOLVED  {unsolved} samples: see residual")
    if ((flags & layout.CONTRADICTORY) != 0).any():
        print(
            f"CONTRADICTORY  {', '.join(names)} hold their bodies against each other: nothing is "
            "left to slide or spin, or offsets cannot all be met; check that the axes are parallel"
        )
    return well and not unsolved


def _compare(
    path: Path, scenes: Mapping[str, Scene], runs: Mapping[tuple[str, ...], GroupRun]
) -> bool:
    """Print the comparison with a bundled scene's reference values; False if one is missed."""
    if scene_files.bundled().get(path.stem) != path or path.stem not in group_answers.GROUPS:
        return True
    print(f"reference   {group_answers.GROUPS[path.stem].source}")
    try:
        compared = library.compare_group(path.stem, scenes, next(iter(runs.values())))
    except ImportError as error:
        print(checks.not_computed(error))
        return True
    return checks.show(checks.comparisons(compared))


def _messages_of(
    name: str, scene: Scene, result: GroupRun, c: int, shared: Collection[str]
) -> tuple[dict[str, str], list[_Topic]]:
    """Topics of a connector by the names of a single one, and what is written to each."""
    from cylconn_ros.messages.cdr_encoder import JointStateWriter, StampedWriter, StateWriter
    from cylconn_ros.messages.commands.command_writer import CommandWriter

    kinds = {"pose": "PoseStamped", "twist": "TwistStamped", "load": "WrenchStamped"}
    own: dict[str, str] = {}
    found = []
    outs, method = result.outs[:, c], result.group.connectors[c].method
    for side, body, (motion, load, wrench) in zip("ab", scene.bodies, _MOTIONS, strict=True):
        of = f"body_{side}"
        below = f"/{body.frame}" if body.frame in shared else f"/{topic(name, of)}"
        parts = (("pose", motion, 7), ("twist", motion + 7, 6), ("load", load, 6))
        for kind, at, size in parts if body.kind != "fixed" else ():
            own[f"{of}/{kind}"] = full = f"{below}/{kind}"
            rows = result.samples[:, c, at : at + size]
            writer = StampedWriter(scene.world_frame, size)
            found.append(_Topic(full, f"geometry_msgs/msg/{kinds[kind]}", writer, rows))
        frame = scene.world_frame if scene.wrench.axes == "world" else body.frame
        own[f"{of}/wrench"] = full = f"/{topic(name, of)}/wrench"
        rows = outs[:, wrench : wrench + 6]
        found.append(_Topic(full, "geometry_msgs/msg/WrenchStamped", StampedWriter(frame), rows))
    commands = CommandWriter(scene)
    for name_of, kind in commands.topics.items():
        own[name_of] = full = f"/connector/{name}/{name_of[2:]}"
        found.append(_Topic(full, kind, _Commands(commands, name_of), np.empty((0, 0))))
    own["~/state"] = full = f"/connector/{name}/state"
    states = StateWriter(scene.body_a.frame, method)
    found.append(_Topic(full, "cylconn_ros/msg/ConnectorState", states, outs))
    own["~/joint_state"] = full = f"/connector/{name}/joint_state"
    joints = JointStateWriter(scene.body_a.frame, ("slide", "spin"))
    found.append(_Topic(full, "sensor_msgs/msg/JointState", joints, outs))
    return own, found


def record(
    runs: Mapping[tuple[str, ...], GroupRun], scenes: Mapping[str, Scene], output: Path
) -> None:
    """Write the messages of the node as a recorded run; log times are the stamps."""
    from cylconn_ros.recording.metadata import TopicInfo
    from cylconn_ros.recording.writer import RunWriter

    topics: dict[str, _Topic] = {}
    connectors = {}
    for names, result in runs.items():
        for c, name in enumerate(names):
            own, written = _messages_of(name, scenes[name], result, c, shared_bodies.shared(scenes))
            for each in written:
                topics.setdefault(each.name, each)
            connectors[name] = {
                "method": result.group.connectors[c].method,
                "model": result.group.connectors[c].model,
                "topics": own,
                "together": ", ".join(other for other in names if other != name),
            }
    metadata = {
        "version": cylconn_ros.__version__,
        "method": "impulse",
        "model": "; ".join(f"{name}: {one['model']}" for name, one in connectors.items()),
        "parameters": parameter_file.dump_several(scenes),
        "connectors": json.dumps(connectors),
    }
    first = next(iter(scenes.values()))
    infos = [TopicInfo(each.name, each.kind) for each in topics.values()]
    with RunWriter(output, infos, metadata, first.record.compression) as writer:
        for k, time in enumerate(next(iter(runs.values())).time):
            stamp = round(time * 1e9)
            for each in topics.values():
                writer.write(each.name, _encoded(each, stamp, k), stamp, stamp)


def _encoded(each: _Topic, stamp: int, k: int) -> Any:
    """The message of a topic for sample k."""
    if isinstance(each.writer, _Commands):
        return each.writer.write(stamp, k)
    row = each.rows[k]
    if each.kind != "sensor_msgs/msg/JointState":
        return each.writer.write(stamp, row)
    return each.writer.write(
        stamp,
        (row[layout.LENGTH], row[layout.ANGLE]),
        (row[layout.VELOCITY], row[layout.ANGULAR_VELOCITY]),
        (row[layout.FORCE], row[layout.MOMENT]),
    )
