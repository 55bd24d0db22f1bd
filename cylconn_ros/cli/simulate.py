"""Simulate a scene in this process, without ROS, with the plant and connector of the nodes.

SCENE is a parameter file or the name of a bundled scene (demo, coast, incline, …). The run includes
its end: a run of 1 s ends with the state at 1 s. A bundled scene is compared with its exact or
reference solution (docs/reference/scenes.md), unless --duration, --steps or --set change it. --set
changes parameters; the changes of end, stop time and greatest forces are printed. With -o the run
is kept: NAME.npz holds arrays, any other NAME becomes a recorded run (rosbag2) with the messages of
the nodes.

For example: cylconn simulate coast -o coast_run --plot coast.png

Next: show a kept run with cylconn info NAME, or make a page of it with cylconn report NAME.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import cylconn_ros
from cylconn_ros.cli import changes, checks, scenes, simulate_several
from cylconn_ros.cli.info import describe
from cylconn_ros.cli.progress import Progress
from cylconn_ros.connector.over_time import OverTime
from cylconn_ros.connector.start import start_warnings
from cylconn_ros.connector.summary import RunSummary, summarise
from cylconn_ros.core import layout
from cylconn_ros.errors import CommandError
from cylconn_ros.methods.traits import TRAITS
from cylconn_ros.reference import library
from cylconn_ros.scene import multiple, parameter_file
from cylconn_ros.scene.scene import Scene, load_all
from cylconn_ros.simulation.simulate import Run, simulate

_PICTURES = (".png", ".svg", ".pdf")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("scene", metavar="SCENE", help="parameter file, or name of a scene")
    scenes.add_overrides(parser)
    scenes.add_set(parser)
    parser.add_argument("-o", "--output", type=Path, metavar="NAME", help="keep the run (new file)")
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="draw the run: .png, .svg or .pdf"
    )


def run(options: argparse.Namespace) -> int:
    """Simulate, keep and draw; 1 if a sample was refused, or the run is not usable or not exact."""
    path = scenes.find(options.scene)
    _check_names(options.output, options.plot)
    loaded = load_all(path)
    if multiple.ONE not in loaded:
        return simulate_several.run(path, loaded, options)
    scene = scenes.overridden(path, loaded[multiple.ONE], options)
    with Progress(f"simulate {path.stem}") as bar:
        bar.note("preparing (the first run compiles the physics)")
        result = simulate(scene, progress=bar)
    print(f"model       {result.connector.model}")
    if result.accuracy is not None:
        print(f"computed    {result.accuracy} (tolerance {scene.tolerance:g})")
    for warning in start_warnings(result.connector):
        print(f"warning     {warning}")
    state = fields(result)
    found = summarise(result.time, state)
    print("\n".join(describe(found)))
    print(
        f"energy      {result.energy[0]:.6g} J at the start, {result.energy[-1]:.6g} J at the end"
    )
    if options.set:
        _show_changes(path, options, found, float(result.time[-1]))
    changed = options.duration is not None or options.steps is not None or bool(options.set)
    passed = changed or _compare(path, result)
    if options.output is not None:
        keep(result, scene, options.output)
        print(f"kept        {options.output}")
    if options.plot is not None:
        _draw(result, state, path.stem, found.stop_time, options.plot)
        print(f"picture     {options.plot}")
    if options.output is None:
        print("next: keep the run with -o NAME, draw it with --plot FILE.png")
    elif options.output.suffix == ".npz":
        print(f"next: numpy.load('{options.output}')")
    else:
        print(f"next: cylconn info {options.output}")
    return 0 if passed and not found.refused and not found.problem else 1


def _show_changes(
    path: Path, options: argparse.Namespace, found: RunSummary, duration: float
) -> None:
    """Simulate the scene without --set for as long, too, and print what changed."""
    unchanged: dict[str, Any] = {"set": [], "steps": None, "duration": duration}
    options = argparse.Namespace(**{**vars(options), **unchanged})
    with Progress(f"simulate {path.stem} unchanged") as bar:
        bar.note("for comparison")
        result = simulate(scenes.load_with_overrides(path, options), progress=bar)
    before = summarise(result.time, fields(result))
    print("\n".join(changes.table(("unchanged", "with --set"), before, found)))


def _compare(path: Path, result: Run) -> bool:
    """Print the comparison with the scene's reference values; False if one is missed.

    Values of a method of lower order are printed without a limit.
    """
    if scenes.bundled().get(path.stem) != path or path.stem not in library.LIBRARY:
        return True
    print(f"reference   {library.LIBRARY[path.stem].source}")
    try:
        compared = library.compare(path.stem, result)
    except ImportError as error:
        print(checks.not_computed(error))
        return True
    lines = checks.comparisons(compared)
    if not TRAITS[result.connector.method].second_order:
        lines = [dataclasses.replace(line, bound="", ok=None) for line in lines]
    return checks.show(lines)


def fields(result: Run) -> dict[str, np.ndarray]:
    """Fields of ConnectorState by name, one row per sample."""
    return columns(result.outs)


def columns(outs: np.ndarray) -> dict[str, np.ndarray]:
    """Fields of ConnectorState by name of outputs (n, NOUT)."""
    state, at = {}, layout.STATE.start
    for name, width in layout.STATE_FIELDS:
        state[name] = outs[:, at] if width == 1 else outs[:, at : at + width]
        at += width
    enums = {
        "regime": layout.REGIME,
        "stop": layout.STOP,
        "lock": layout.LOCK,
        "status": layout.STATUS,
        "flags": layout.FLAGS,
    }
    state.update({name: outs[:, k].astype(np.int64) for name, k in enums.items()})
    return state


def _check_names(output: Path | None, plot: Path | None) -> None:
    """Raise CommandError before the simulation if a file cannot be written afterwards."""
    if plot is not None and plot.suffix not in _PICTURES:
        raise CommandError(f"{plot}: a picture must end in one of {', '.join(_PICTURES)}")
    if plot is not None and importlib.util.find_spec("matplotlib") is None:
        raise CommandError("--plot needs matplotlib: pip install '.[demo]'")
    if output is not None:
        if output.suffix not in ("", ".npz"):
            raise CommandError(
                f"{output}: must end in .npz (arrays) or have no suffix (recorded run)"
            )
        if output.exists():
            raise CommandError(f"{output} exists; a run is never overwritten")


def keep(result: Run, scene: Scene, output: Path) -> None:
    """Keep a run as arrays (.npz) or as a recorded run."""
    metadata = {
        "version": cylconn_ros.__version__,
        "method": result.connector.method,
        "model": result.connector.model,
        "parameters": parameter_file.dump(result.connector.scene),
    }
    if output.suffix == ".npz":
        arrays: dict[str, Any] = {"time": result.time, "motion": result.states, "out": result.outs}
        arrays.update(fields(result), **{name: np.array(text) for name, text in metadata.items()})
        try:
            output.parent.mkdir(parents=True, exist_ok=True)
            with output.open("xb") as file:
                np.savez_compressed(file, **arrays)
        except OSError as error:
            raise CommandError(f"{output}: {error.strerror or error}") from None
    else:
        _record(result, scene, output, metadata)


def _record(result: Run, scene: Scene, output: Path, metadata: Mapping[str, str]) -> None:
    """Write the messages of the nodes as a recorded run; log times are the stamps."""
    from cylconn_ros.messages.cdr_encoder import JointStateWriter, StampedWriter, StateWriter
    from cylconn_ros.messages.commands import joint_command
    from cylconn_ros.messages.commands.command_writer import CommandWriter
    from cylconn_ros.recording.metadata import TopicInfo
    from cylconn_ros.recording.writer import RunWriter

    world = scene.world_frame
    topics = []
    messages = []  # (topic, writer, rows)
    loads = {}  # constant: sent once, as the plant node does
    changing, commands = OverTime(scene), CommandWriter(scene)
    for name, body, motion, wrench, load in (
        ("/body_a", scene.body_a, layout.A_POSE, layout.FORCE_A, scene.plant.body_a.load),
        ("/body_b", scene.body_b, layout.B_POSE, layout.FORCE_B, scene.plant.body_b.load),
    ):
        if body.kind != "fixed" and any(load):
            topics.append(TopicInfo(f"{name}/load", "geometry_msgs/msg/WrenchStamped"))
            if changing.loads_change:
                at = 0 if name == "/body_a" else 6
                of = np.array([changing.loads(k)[at : at + 6] for k in range(len(result.time))])
                messages.append((f"{name}/load", StampedWriter(world), of))
            else:
                loads[f"{name}/load"] = StampedWriter(world).write(0, np.array(load))
        if body.kind != "fixed":
            topics.append(TopicInfo(f"{name}/pose", "geometry_msgs/msg/PoseStamped"))
            topics.append(TopicInfo(f"{name}/twist", "geometry_msgs/msg/TwistStamped"))
            poses, twists = StampedWriter(world, 7), StampedWriter(world)
            messages.append((f"{name}/pose", poses, result.states[:, motion : motion + 7]))
            messages.append((f"{name}/twist", twists, result.states[:, motion + 7 : motion + 13]))
        frame = world if scene.wrench.axes == "world" else body.frame
        topics.append(TopicInfo(f"{name}/wrench", "geometry_msgs/msg/WrenchStamped"))
        wrenches = StampedWriter(frame)
        messages.append((f"{name}/wrench", wrenches, result.outs[:, wrench : wrench + 6]))
    topics.append(TopicInfo("/connector/state", "cylconn_ros/msg/ConnectorState"))
    topics.append(TopicInfo("/connector/joint_state", "sensor_msgs/msg/JointState"))
    resolved = {name: f"/connector/{name[2:]}" for name in commands.topics}
    topics += [TopicInfo(resolved[name], kind) for name, kind in commands.topics.items()]
    states = StateWriter(scene.body_a.frame, result.connector.method)
    joints = JointStateWriter(scene.body_a.frame, joint_command.names(scene))
    with RunWriter(output, topics, metadata, scene.record.compression) as writer:
        for topic, data in loads.items():
            writer.write(topic, data, 0, 0)
        for k, time in enumerate(result.time):
            stamp = round(time * 1e9)
            for name, data in commands.write(stamp, k):
                writer.write(resolved[name], data, stamp, stamp)
            for topic, message, rows in messages:
                writer.write(topic, message.write(stamp, rows[k]), stamp, stamp)
            out = result.outs[k]
            writer.write("/connector/state", states.write(stamp, out), stamp, stamp)
            pairs = (
                (out[layout.LENGTH], out[layout.ANGLE]),
                (out[layout.VELOCITY], out[layout.ANGULAR_VELOCITY]),
                (out[layout.FORCE], out[layout.MOMENT]),
            )
            writer.write("/connector/joint_state", joints.write(stamp, *pairs), stamp, stamp)


def _draw(
    result: Run, state: Mapping[str, np.ndarray], name: str, stop_time: float, path: Path
) -> None:
    from cylconn_ros.report.picture import draw_run, save_run

    period = result.connector.scene.period
    figure = draw_run(
        result.time,
        state,
        f"Scene {name}",
        f"method {result.connector.method}, period {period * 1e3:g} ms, in one process",
        stop_time=stop_time,
    )
    try:
        save_run(figure, path)
    except OSError as error:
        raise CommandError(f"{path}: {error.strerror or error}") from None
