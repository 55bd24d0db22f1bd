"""``cylconn replay`` of a recording with several connectors: all of them, groups together."""

from __future__ import annotations

import argparse
import time

from cylconn_ros.cli import scenes as scene_files
from cylconn_ros.cli.progress import Progress
from cylconn_ros.cli.replay_report import conclude, lacking, report
from cylconn_ros.errors import CommandError
from cylconn_ros.recording import connector_part
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.writer import RunWriter
from cylconn_ros.replay.compare import Comparison
from cylconn_ros.replay.together import ReplayTogether
from cylconn_ros.scene import parameter_file
from cylconn_ros.scene.scene import Scene


def run(bag: Bag, options: argparse.Namespace) -> int:
    """Replay; 0 if all samples were processed and, with --compare, the outputs agree.

    Raises CommandError for an option that needs one connector.
    """
    names = connector_part.names(bag.metadata)
    for option, given in (
        ("--closed-loop", options.closed_loop),
        ("--params", options.params is not None),
        ("--remap", options.remap),
    ):
        if given:
            raise CommandError(
                f"{bag.path}: holds several connectors, {', '.join(names)}: {option} needs one "
                "that is solved alone; choose it with --connector NAME"
            )
    if options.output is not None and options.output.exists():
        raise CommandError(f"{options.output} exists; a run is never overwritten")
    replay = ReplayTogether(bag, {name: _scene(bag, name, options) for name in names})
    comparison = _comparison(replay, options) if options.compare else None
    for name, member in replay.members.items():
        print(f"model       {name}: {member.pipeline.connector.model}")
    start = time.perf_counter(), time.process_time()
    with Progress(f"replay {bag.path.name}") as progress:
        _process(replay, comparison, options, progress)
    elapsed = time.perf_counter() - start[0], time.process_time() - start[1]
    passed = not lacking(bag)
    for name, member in replay.members.items():
        print(f"{name}:")
        report(member, *elapsed)
        passed &= not member.problem()
    passed &= conclude(comparison, options.tolerance, options.output)
    return 0 if passed else 1


def _scene(bag: Bag, name: str, options: argparse.Namespace) -> Scene:
    """The scene of the parameters recorded for a connector, changed by each --set."""
    metadata = connector_part.select(bag.metadata, name).metadata
    if "parameters" not in metadata:
        raise CommandError(f"{bag.path}: no parameters were stored with it")
    parameters = parameter_file.parameters_of(metadata["parameters"])
    parameters.update(scene_files.changed_parameters(options.set))
    return Scene.from_parameters(parameters)


def _comparison(replay: ReplayTogether, options: argparse.Namespace) -> Comparison:
    kinds, timing = {}, {}
    for member in replay.members.values():
        kinds.update({member.names[name]: kind for name, kind in member.outputs.items()})
        timing.update(member.timing)
    recorded = {topic: kind for topic, kind in kinds.items() if topic in replay.bag.types}
    if not recorded:
        raise CommandError(f"{replay.bag.path}: holds no outputs to compare with")
    return Comparison(recorded, timing, options.tolerance, replay.bag.definitions)


def _process(
    replay: ReplayTogether, comparison: Comparison | None, options: argparse.Namespace,
    progress: Progress,
) -> None:  # fmt: skip
    """Process the recording; write and compare the outputs as requested."""
    writer = None
    if options.output is not None:
        members = replay.members
        texts = {
            **replay.bag.metadata,
            "parameters": parameter_file.dump_several({n: m.scene for n, m in members.items()}),
        }
        for member in members.values():
            texts |= member.provenance()
        compression = next(iter(replay.members.values())).scene.record.compression
        writer = RunWriter(options.output, replay.topics(), texts, compression)
    inputs = replay.input_topics
    try:
        for topic, log_time, data, replayed in replay.messages():
            progress(replay.bag.done, replay.bag.size)
            if writer is not None and (replayed or topic in inputs):
                writer.write(topic, data, log_time, log_time)
            if comparison is not None and topic in comparison.topics:
                (comparison.replayed if replayed else comparison.recorded)(topic, data)
        progress(1, 1)
    finally:
        if writer is not None:
            writer.close()
