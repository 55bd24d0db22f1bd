"""What a replay costs: reading a recording and answering its samples, by the input message.

Each recording holds a second of motion again and again, friction slipping throughout, so that no
sample is cheaper than in a motion worth recording.
"""

from __future__ import annotations

import dataclasses
import tempfile
import time
from pathlib import Path

import numpy as np

from cylconn_ros.bench.common.results import Findings, Measurement, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Spread
from cylconn_ros.bench.step_cost.kernel import SHAFT, Stretch, stretches
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.messages.pipeline import OUTPUTS, Answering
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.recording.writer import RunWriter
from cylconn_ros.replay.replay import Item, Replay
from cylconn_ros.ros.plant.exchange import Exchange, PlantCounts
from cylconn_ros.scene.scene import Scene

INPUTS, ALL, ODOMETRY = "inputs alone", "with its outputs", "odometry"
_CPU, _WALL, _STEP = "CPU time a message", "time a message", "of it the compiled step"
_LIMIT = 1.5  # us
_MESSAGES, _QUICK = 500_000, 5_000


def measure(settings: Settings) -> Findings:
    """Recordings of a sleeve on a fixed shaft and of two free bodies, of several kinds."""
    found = Findings()
    messages, rounds = (_QUICK, 2) if settings.quick else (_MESSAGES, 7)
    # a second of motion, also in the short form: what is left out of it is messages
    kinds = dataclasses.replace(settings, quick=False)
    for stretch in stretches(kinds):
        for kind in (INPUTS, ALL, ODOMETRY):
            if kind == ODOMETRY and stretch.name != SHAFT:
                continue
            with tempfile.TemporaryDirectory() as folder:
                scene = stretch.scene
                if kind == ODOMETRY:
                    scene = dataclasses.replace(scene, input="odometry")
                bag = record(Path(folder) / "run", stretch, scene, messages, kind == ALL)
                _time(found, stretch, kind, bag, scene, rounds)
    return found


def _time(
    found: Findings, stretch: Stretch, kind: str, path: Path, scene: Scene, rounds: int
) -> None:
    """Replay a recording some times."""
    cpu, wall = [], []
    for _ in range(rounds + 1):
        replay = Replay(Bag(path), scene)
        replay.answering.wanted = lambda _: False
        began, busy = time.perf_counter(), time.process_time()
        single = sum(isinstance(part, Item) for part in replay.parts())
        cpu.append((time.process_time() - busy) / replay.counts.used)
        wall.append((time.perf_counter() - began) / replay.counts.used)
    counts = replay.counts
    note = (
        f"{counts.used} messages, {counts.answers} samples, {counts.outputs} recorded outputs; "
        f"{single} messages one by one"
    )
    name = f"{stretch.name}, {kind}"
    spread = Spread.of(cpu[1:])  # the first finds nothing warm
    for quantity, values in ((_CPU, cpu), (_WALL, wall)):
        found.measurements.append(
            Measurement.of("replay", name, quantity, Spread.of(values[1:]), "µs", scale=1e6,
                           note=note)
        )  # fmt: skip
    connector = Connector(scene)
    connector.run(stretch.samples)
    began = time.process_time()
    for _ in range(20):
        connector.reset()
        connector.run(stretch.samples)
    step = (time.process_time() - began) / (20 * len(stretch.samples))
    share = counts.answers / counts.used
    found.measurements.append(
        Measurement("replay", name, _STEP, 1e6 * step * share, "µs", note=note)
    )
    if kind != ALL:
        found.targets.append(
            Target(f"{name}: reading and evaluating a message", 1e6 * spread.median, _LIMIT, "µs")
        )


def record(path: Path, stretch: Stretch, scene: Scene, messages: int, outputs: bool) -> Path:
    """Write a recording of at least so many input messages, as the nodes would."""
    answering, exchange = Answering(scene), Exchange(scene, PlantCounts())
    replay_names = {name: f"/{name.replace('~', 'connector')}" for name in answering.inputs}
    topics = [TopicInfo(replay_names[n], given.type) for n, given in answering.inputs.items()]
    outs: list[tuple[str, str]] = []
    if outputs:
        outs = [(f"/{name.replace('~', 'connector')}", kind) for name, kind in OUTPUTS]
        topics += [TopicInfo(name, kind) for name, kind in outs]
    period, count, k = round(scene.period * 1e9), 0, 0
    with RunWriter(path, topics, {}) as writer:
        while count < messages:
            stamp, sample = period * (k + 1), stretch.samples[k % len(stretch.samples)]
            for name, data in exchange.messages(stamp, np.ascontiguousarray(sample[layout.MOTION])):
                writer.write(replay_names[name], data, stamp, stamp)
                count += 1
                answer = answering.inputs[name].receive(data) if outputs else None
                if answer is not None:
                    for (topic, _), answered in zip(outs, answer[1:], strict=True):
                        assert answered is not None
                        writer.write(topic, answered, stamp, stamp)
            k += 1
    return path
