"""Replay benchmark: cost of reading a recording and processing its samples, per input message.

Each recording repeats a second of motion in which friction slips throughout, so no sample is
cheaper than in a real motion.
"""

from __future__ import annotations

import dataclasses
import tempfile
import time
from pathlib import Path

import numpy as np

from cylconn_ros.bench.common.results import Findings, Measurement, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Spread, run_interleaved
from cylconn_ros.bench.step_cost.kernel import SHAFT, StepCase, step_cases
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.messages.pipeline import OUTPUTS, MessagePipeline
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.recording.writer import RunWriter
from cylconn_ros.replay.replay import Item, Replay
from cylconn_ros.ros.plant.exchange import Exchange, PlantCounts
from cylconn_ros.scene import parameter_file
from cylconn_ros.scene.scene import Scene

INPUTS, ALL, ODOMETRY = "inputs only", "inputs and outputs", "odometry"
_CPU, _WALL, _STEP = "CPU time a message", "time a message", "of which compiled step"
_LIMIT = 1.5  # µs
_MESSAGES, _QUICK = 500_000, 5_000
_STEP_REPETITIONS = 20


def measure(settings: Settings) -> Findings:
    """Replay recordings of a sleeve on a fixed shaft and of two free bodies, of several kinds."""
    found = Findings()
    messages, rounds = (_QUICK, 2) if settings.quick else (_MESSAGES, 7)
    # The motion always lasts a second; the short form has fewer messages.
    for case in step_cases(dataclasses.replace(settings, quick=False)):
        for kind in (INPUTS, ALL, ODOMETRY):
            if kind == ODOMETRY and case.name != SHAFT:
                continue
            with tempfile.TemporaryDirectory() as folder:
                scene = case.scene
                if kind == ODOMETRY:
                    scene = dataclasses.replace(scene, input="odometry")
                path = record(Path(folder) / "run", case, scene, messages, kind == ALL)
                timing = _time(path, case, scene, rounds)
            name = f"{case.name}, {kind}"
            _add(found, name, timing)
            if kind != ALL:
                cost = 1e6 * Spread.of(timing.cpu).median
                found.targets.append(
                    Target(f"{name}: reading and evaluating a message", cost, _LIMIT, "µs")
                )
    return found


@dataclasses.dataclass(frozen=True)
class Timing:
    """Time per input message of a recording, one value a round, s.

    Attributes
    ----------
        cpu, wall: of the whole replay. step: CPU time of the compiled step alone.
        note: numbers of messages and samples.
    """

    cpu: list[float]
    wall: list[float]
    step: list[float]
    note: str


def _time(path: Path, case: StepCase, scene: Scene, rounds: int) -> Timing:
    """Time the replay and, in turns with it, the compiled step alone."""
    replays: list[tuple[Replay, int]] = []

    def replay() -> tuple[float, float]:
        one = Replay(Bag(path), scene)
        one.pipeline.wanted = lambda _: False
        began, busy = time.perf_counter(), time.process_time()
        single = sum(isinstance(part, Item) for part in one.parts())
        used = time.process_time() - busy, time.perf_counter() - began
        replays[:] = [(one, single)]
        return used[0] / one.counts.used, used[1] / one.counts.used

    connector = Connector(scene)

    def step() -> tuple[float, float]:
        busy = time.process_time()
        for _ in range(_STEP_REPETITIONS):
            connector.reset()
            connector.run(case.samples)
        per_sample = (time.process_time() - busy) / (_STEP_REPETITIONS * len(case.samples))
        return per_sample, per_sample

    turns = {_CPU: replay, _STEP: step}
    run_interleaved(turns, 1)  # warm-up
    found = run_interleaved(turns, rounds)
    counts, single = replays[0][0].counts, replays[0][1]
    note = (
        f"{counts.used} messages, {counts.responses} samples, {counts.outputs} recorded outputs; "
        f"{single} messages processed singly"
    )
    cpu, wall = zip(*found[_CPU], strict=True)
    samples_per_message = counts.responses / counts.used
    steps = [per_sample * samples_per_message for per_sample, _ in found[_STEP]]
    return Timing(list(cpu), list(wall), steps, note)


def _add(found: Findings, name: str, timing: Timing) -> None:
    for quantity, values in ((_CPU, timing.cpu), (_WALL, timing.wall), (_STEP, timing.step)):
        spread = Spread.of(values)
        found.measurements.append(
            Measurement.of("replay", name, quantity, spread, "µs", scale=1e6, note=timing.note)
        )


def record(path: Path, case: StepCase, scene: Scene, messages: int, outputs: bool) -> Path:
    """Write a recording with at least ``messages`` input messages, as the node writes it.

    ``outputs``: also record the outputs of the connector. Returns the recording's directory.
    """
    pipeline, exchange = MessagePipeline(scene), Exchange(scene, PlantCounts())
    input_topics = {name: _resolved(name) for name in pipeline.inputs}
    topics = [TopicInfo(input_topics[n], given.type) for n, given in pipeline.inputs.items()]
    output_topics = [_resolved(name) for name, _ in OUTPUTS] if outputs else []
    if outputs:
        topics += [TopicInfo(_resolved(name), kind) for name, kind in OUTPUTS]
    metadata = {"parameters": parameter_file.dump(scene), "method": Connector(scene).method}
    period, count, k = round(scene.period * 1e9), 0, 0
    with RunWriter(path, topics, metadata) as writer:
        while count < messages:
            stamp, sample = period * (k + 1), case.samples[k % len(case.samples)]
            for name, data in exchange.messages(stamp, np.ascontiguousarray(sample[layout.MOTION])):
                writer.write(input_topics[name], data, stamp, stamp)
                count += 1
                response = pipeline.inputs[name].receive(data) if outputs else None
                if response is not None:
                    for topic, message in zip(output_topics, response[1:], strict=True):
                        assert message is not None
                        writer.write(topic, message, stamp, stamp)
            k += 1
    return path


def _resolved(name: str) -> str:
    return f"/{name.replace('~', 'connector')}"
