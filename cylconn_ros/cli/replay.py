"""Run a recording through the connector again: to the same outputs, or to "what if".

BAG is a recorded run of ours, or any rosbag2 directory, .mcap or .db3 file whose topics fit,
written by anybody: poses and twists, or Odometry with --set input=odometry. Parameters are those
that were recorded, then those of --params, then each --set.

--compare puts the outputs beside the recorded ones and says where they first part; the exit code
is then 1 if a field differs by more than --tolerance of its greatest size. With the recorded
parameters they are the same bit for bit on the same machine and version.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import yaml

import cylconn_ros
from cylconn_ros.cli.checks import add_connector
from cylconn_ros.cli.progress import Progress
from cylconn_ros.errors import CommandError
from cylconn_ros.recording import connector_part
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.writer import RunWriter
from cylconn_ros.replay.batches import Stretch
from cylconn_ros.replay.compare import Comparison, Topic
from cylconn_ros.replay.replay import Replay
from cylconn_ros.scene import multiple, parameter_file
from cylconn_ros.scene.scene import Scene

_SHOWN = 6  # fields a topic


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("bag", metavar="BAG", type=Path, help="recorded directory or file")
    add_connector(parser)
    parser.add_argument("-o", "--output", metavar="NAME", type=Path, help="keep the run (new)")
    parser.add_argument("--params", metavar="FILE", type=Path, help="parameter file (ROS 2 YAML)")
    parser.add_argument(
        "--set", metavar="NAME=VALUE", action="append", default=[],
        help="one parameter, friction.coefficient=0.3; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--remap", metavar="INPUT:=TOPIC", action="append", default=[],
        help="the recorded topic of an input, body_b/odom:=/robot/odom; may be repeated",
    )  # fmt: skip
    parser.add_argument("--compare", action="store_true", help="with the recorded outputs")
    parser.add_argument(
        "--tolerance", metavar="T", type=float, default=0.0,
        help="relative difference that --compare lets pass (0: none)",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Replay; 0 if all went well and, with --compare, nothing parts."""
    bag = Bag(options.bag, options.connector)
    connector_part.refuse_together(bag.texts, options.connector, "it cannot be replayed alone")
    if connector_part.names(bag.texts):
        known = ", ".join(connector_part.names(bag.texts))
        raise CommandError(f"{bag.path}: holds several connectors, {known}: choose one with "
                           "--connector NAME")  # fmt: skip
    scene = _scene(bag, options)
    replay = Replay(bag, scene, _renamed(options.remap))
    if options.output is not None and options.output.exists():
        raise CommandError(f"{options.output} exists; a run is never overwritten")
    comparison = None
    if options.compare:
        kinds = {replay.names[name]: kind for name, kind in replay.outputs.items()}
        if not any(topic in bag.types for topic in kinds):
            raise CommandError(f"{bag.path}: holds no outputs to compare with")
        comparison = Comparison(
            {topic: kind for topic, kind in kinds.items() if topic in bag.types},
            replay.timing,
            options.tolerance,
        )
    if comparison is None and options.output is None:
        replay.answering.wanted = lambda _: False  # nobody looks at states
    print(f"model       {replay.answering.connector.model}")
    began = time.perf_counter(), time.process_time()
    with Progress(f"replay {bag.path.name}") as progress:
        _go(replay, comparison, options.output, progress)
    _tell(replay, time.perf_counter() - began[0], time.process_time() - began[1])
    well = not bag.damage and replay.counts.answers > 0
    if comparison is not None:
        well &= _show(comparison.result(), options.tolerance)
    if options.output is not None:
        print(f"kept        {options.output}  (next: cylconn info {options.output})")
    elif not options.compare:
        print("next: keep the run with -o NAME, or put it beside the recorded one with --compare")
    return 0 if well else 1


def _go(
    replay: Replay, comparison: Comparison | None, output: Path | None, progress: Progress
) -> None:
    writer = None
    if output is not None:
        texts = {
            "version": cylconn_ros.__version__,
            "node": replay.node,
            "method": replay.answering.connector.method,
            "model": replay.answering.connector.model,
            "parameters": parameter_file.dump(replay.scene),
            "connectors": json.dumps({multiple.ONE: {"topics": {**replay.inputs, **replay.names}}}),
            "replayed": f"from {replay.bag.path.name}",
        }
        writer = RunWriter(output, replay.topics(), texts, replay.scene.record.compression)
    try:
        for part in replay.parts():
            progress(replay.bag.done, replay.bag.size)
            if isinstance(part, Stretch):
                if writer is not None:
                    writer.write_each(part.to_record(writer.channels, replay.taken, replay.names))
                if comparison is not None:
                    _compare(replay, part, comparison)
                continue
            topic, log_time, data, replayed = part
            if writer is not None and (replayed or topic in replay.taken):
                writer.write(topic, data, log_time, log_time)
            if comparison is not None and topic in comparison.topics:
                (comparison.replayed if replayed else comparison.recorded)(topic, data)
        progress(1, 1)
    finally:
        if writer is not None:
            writer.close()


def _compare(replay: Replay, stretch: Stretch, comparison: Comparison) -> None:
    """Put the answers of a stretch beside what was recorded in it."""
    for name, topic in replay.names.items():
        if topic not in comparison.topics:
            continue
        answers, (size, which) = stretch.rows(name), stretch.recorded(topic)
        if size == answers.shape[1]:
            comparison.both(topic, stretch.block.rows(which, size), answers)
            continue
        for k in which.tolist():
            (message,) = stretch.block.messages(k, k + 1)
            comparison.recorded(topic, message.data)
        for row in answers:
            comparison.replayed(topic, row.tobytes())


def _scene(bag: Bag, options: argparse.Namespace) -> Scene:
    """The recorded parameters, then those of the file, then each given alone."""
    parameters: dict[str, Any] = {}
    node = bag.texts.get("node", "/connector")
    if "parameters" in bag.texts:
        parameters.update(parameter_file.parameters_of(bag.texts["parameters"]))
    if options.params is not None:
        namespace, _, name = node.rpartition("/")
        parameters.update(
            parameter_file.scene_part(
                parameter_file.load_parameters(options.params, name, namespace or "/")
            )
        )
    for text in options.set:
        name, equals, value = text.partition("=")
        if not equals:
            raise CommandError(f"--set {text}: must be NAME=VALUE")
        try:
            parameters[name.strip()] = parameter_file.parse(value)
        except yaml.YAMLError as error:
            raise CommandError(f"--set {text}: {error}") from None
    if not parameters:
        raise CommandError(f"{bag.path}: no parameters were stored with it; give --params FILE")
    return Scene.from_parameters(parameters)


def _renamed(texts: list[str]) -> dict[str, str]:
    renamed = {}
    for text in texts:
        name, sign, topic = text.partition(":=")
        if not sign or not name or not topic:
            raise CommandError(f"--remap {text}: must be INPUT:=TOPIC, body_b/odom:=/robot/odom")
        renamed[name] = topic
    return renamed


def _tell(replay: Replay, seconds: float, busy: float) -> None:
    counts, health = replay.counts, replay.answering.health
    print(
        f"messages    {counts.read} read, {counts.used} used, {counts.outputs} recorded outputs, "
        f"{counts.foreign} of other topics"
    )
    for name, topic in replay.inputs.items():
        print(f"  {name:<14} {counts.by_topic.get(topic, 0):>9}  {topic}")
    share, busy = (1e6 * t / counts.used if counts.used else 0.0 for t in (seconds, busy))
    print(
        f"answers     {counts.answers} in {seconds:.2f} s, {share:.2f} us an input message "
        f"({busy:.2f} us of CPU time)"
    )
    unused = {
        "undecodable": health.undecodable,
        "not finite": health.not_finite,
        "bad quaternion": health.bad_quaternion,
        "without a period": health.no_period,
        "off the period": health.off_period,
        "commands refused": health.refused,
        "failed": health.failed,
        **replay.unmatched(),
    }
    if any(unused.values()):
        print("unusual     " + ", ".join(f"{n} {what}" for what, n in unused.items() if n))
    if health.undecodable:
        print(f"            {health.undecodable_text}")
    if replay.bag.damage:
        print(f"DAMAGED     {replay.bag.damage}; the rest was used")
    if not counts.answers:
        print("NO ANSWER   no sample was complete: pose and twist must carry the same stamp "
              "(stamp_tolerance)")  # fmt: skip


def _show(topics: list[Topic], tolerance: float) -> bool:
    """Print how the replay compares; whether nothing parts."""
    for topic in topics:
        verdict = "identical" if not topic.different else f"{topic.different} differ"
        missing = f", {topic.only_recorded} only recorded" if topic.only_recorded else ""
        more = f", {topic.only_replayed} only replayed" if topic.only_replayed else ""
        print(f"{topic.name}: {topic.same + topic.different} compared, {verdict}{missing}{more}")
        for d in topic.differences[:_SHOWN]:
            mark = "BEYOND" if d.beyond else "within"
            print(
                f"  {mark}  {d.field}: up to {d.worst:.3g} ({d.relative:.1e} of its size), first "
                f"at {d.first * 1e-9:.6f} s: recorded {d.recorded}, replayed {d.replayed}"
            )
        if len(topic.differences) > _SHOWN:
            print(f"  and {len(topic.differences) - _SHOWN} more fields")
    well = all(topic.well for topic in topics)
    print("the same" if well and not tolerance else
          f"the same to {tolerance:g}" if well else "NOT THE SAME")  # fmt: skip
    return well
