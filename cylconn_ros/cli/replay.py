"""Run a recording through the connector again, with the same or with other parameters.

The wrench is computed for the recorded motion, which other parameters do not change. To see how the
bodies would move, use --closed-loop: it starts from the first recorded state and simulates forward
with the recorded loads and commands.

BAG is a recorded run, or any rosbag2 directory, .mcap or .db3 file with suitable topics: poses and
twists, or Odometry with --set input=odometry. The parameters are those of the recording, overridden
by --params and then by each --set.

--compare compares the outputs with the recorded ones and reports where they diverge. The exit code
is then 1 if a field differs by more than --tolerance of its largest value. With the recorded
parameters, the outputs are bit for bit identical on the same machine and version.

All connectors of a recording are replayed; those that share bodies are solved together. --connector
chooses one that is solved alone.

For example: cylconn replay RUN --set friction.coefficient=0.3 -o other_mu

Next: show a kept run with cylconn info NAME.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cylconn_ros
from cylconn_ros.cli import closed_loop, replay_several, scenes
from cylconn_ros.cli.checks import add_connector, add_recording
from cylconn_ros.cli.progress import Progress
from cylconn_ros.cli.replay_report import conclude, lacking, report
from cylconn_ros.errors import CommandError, SceneError
from cylconn_ros.recording import connector_part
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.writer import RunWriter
from cylconn_ros.replay.batches import Batch
from cylconn_ros.replay.compare import Comparison
from cylconn_ros.replay.replay import Replay
from cylconn_ros.scene import multiple, parameter_file
from cylconn_ros.scene.scene import Scene


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_recording(parser, "bag", "BAG")
    add_connector(parser)
    parser.add_argument(
        "--closed-loop", action="store_true",
        help="simulate forward from the first recorded state, and print what changes",
    )  # fmt: skip
    parser.add_argument(
        "-o", "--output", metavar="NAME", type=Path, help="keep the run (new directory)"
    )
    parser.add_argument("--params", metavar="FILE", type=Path, help="parameter file (ROS 2 YAML)")
    scenes.add_set(parser)
    parser.add_argument(
        "--remap", metavar="INPUT:=TOPIC", action="append", default=[],
        help="recorded topic of an input, e.g. body_b/odom:=/robot/odom; can be repeated",
    )  # fmt: skip
    parser.add_argument("--compare", action="store_true", help="compare with the recorded outputs")
    parser.add_argument(
        "--tolerance", metavar="T", type=float, default=0.0,
        help="relative difference that --compare allows (0: none)",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Replay; 0 if all samples were processed and, with --compare, the outputs agree."""
    bag = Bag(options.bag, options.connector)
    connector_part.refuse_coupled(
        bag.metadata,
        options.connector,
        "it cannot be replayed alone; replay all of them, without --connector",
    )
    if connector_part.names(bag.metadata):
        return replay_several.run(bag, options)
    scene = _scene(bag, options)
    if options.closed_loop:
        return closed_loop.run(bag, scene, _scene(bag, options, changed=False), options)
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
            bag.definitions,
        )
    if comparison is None and options.output is None:
        replay.pipeline.wanted = lambda _: False  # no output is used
    print(f"model       {replay.pipeline.connector.model}")
    if options.set or (options.params is not None and "parameters" in bag.metadata):
        print("replay      computes the wrench for the recorded motion, which stays the same; "
              "--closed-loop lets the motion follow")  # fmt: skip
    start = time.perf_counter(), time.process_time()
    with Progress(f"replay {bag.path.name}") as progress:
        _process(replay, comparison, options.output, progress)
    report(replay, time.perf_counter() - start[0], time.process_time() - start[1])
    passed = not lacking(bag) and not replay.problem()
    passed &= conclude(comparison, options.tolerance, options.output)
    return 0 if passed else 1


def _process(
    replay: Replay, comparison: Comparison | None, output: Path | None, progress: Progress
) -> None:
    """Process the recording; write and compare the outputs as requested."""
    writer = None
    if output is not None:
        texts = {
            "version": cylconn_ros.__version__,
            "node": replay.node,
            "method": replay.pipeline.connector.method,
            "model": replay.pipeline.connector.model,
            "parameters": parameter_file.dump(replay.scene),
            "connectors": json.dumps({multiple.ONE: {"topics": {**replay.inputs, **replay.names}}}),
            **replay.provenance(),
        }
        writer = RunWriter(output, replay.topics(), texts, replay.scene.record.compression)
    try:
        for part in replay.parts():
            progress(replay.bag.done, replay.bag.size)
            if isinstance(part, Batch):
                if writer is not None:
                    writer.write_batch(
                        part.to_record(writer.channels, replay.input_topics, replay.names)
                    )
                if comparison is not None:
                    for name, topic in replay.names.items():
                        if topic in comparison.topics:
                            part.compare(topic, part.rows(name), comparison)
                continue
            topic, log_time, data, replayed = part
            if writer is not None and (replayed or topic in replay.input_topics):
                writer.write(topic, data, log_time, log_time)
            if comparison is not None and topic in comparison.topics:
                (comparison.replayed if replayed else comparison.recorded)(topic, data)
        progress(1, 1)
    finally:
        if writer is not None:
            writer.close()


def _scene(bag: Bag, options: argparse.Namespace, changed: bool = True) -> Scene:
    """The scene of the recorded parameters, overridden by --params, then by each --set.

    ``changed`` False: the recorded parameters, or without those the ones of --params.
    """
    parameters: dict[str, Any] = {}
    node = bag.metadata.get("node", "/connector")
    if "parameters" in bag.metadata:
        parameters.update(_stored(bag, parameter_file.parameters_of))
    if options.params is not None and (changed or not parameters):
        namespace, _, name = node.rpartition("/")
        parameters.update(
            parameter_file.scene_part(
                parameter_file.load_parameters(options.params, name, namespace or "/")
            )
        )
    if changed:
        parameters.update(scenes.changed_parameters(options.set))
    if not parameters:
        raise CommandError(f"{bag.path}: no parameters were stored with it; give --params FILE")
    try:
        return Scene.from_parameters(parameters)
    except SceneError:  # is it the recording, or what was given?
        if "parameters" in bag.metadata:
            _stored(bag, lambda text: Scene.from_parameters(parameter_file.parameters_of(text)))
        raise


def _stored(bag: Bag, read: Callable[[str], Any]) -> Any:
    """``read`` of the recorded parameters; its SceneError names the recording."""
    try:
        return read(bag.metadata["parameters"])
    except SceneError as error:
        raise CommandError(f"{bag.path}: parameters stored with it: {error}") from None


def _renamed(texts: list[str]) -> dict[str, str]:
    """Recorded topics by input, from the values of --remap."""
    renamed = {}
    for text in texts:
        name, sign, topic = text.partition(":=")
        if not sign or not name or not topic:
            raise CommandError(
                f"--remap {text}: must be INPUT:=TOPIC, as in body_b/odom:=/robot/odom"
            )
        renamed[name] = topic
    return renamed
