"""Batched replay gives the messages, bytes and counts of the replay message by message."""

from __future__ import annotations

import dataclasses
import functools
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from paths import BAGS
from pipelines import make
from scenes import bundled

from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.nodes import replay_cost
from cylconn_ros.connector.synchronizer import QUANTITIES
from cylconn_ros.core import layout
from cylconn_ros.messages import statistics
from cylconn_ros.messages.cdr_encoder import JointStateWriter, OdometryWriter, StampedWriter
from cylconn_ros.messages.pipeline import OUTPUTS
from cylconn_ros.messages.prefix_decoder import PrefixDecoder
from cylconn_ros.recording.bag import Bag, Message
from cylconn_ros.recording.files.storage import Topics
from cylconn_ros.recording.mcap import kernels, message_block
from cylconn_ros.recording.mcap.message_block import MessageBlock, RawMessage
from cylconn_ros.replay import batches
from cylconn_ros.replay.batches import Batch
from cylconn_ros.replay.replay import Item, Replay
from cylconn_ros.scene import parameter_file
from cylconn_ros.scene.inputs import ODOMETRY, POSE, TWIST, WRENCH
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.simulate import simulate

NAMES = sorted(path.name for path in BAGS.iterdir() if path.is_dir())
MS = 1_000_000
STEPS = 60
TOPICS = {
    **{f"/{name}": POSE if name.endswith("pose") else TWIST for name in QUANTITIES},
    "/body_a/odom": ODOMETRY, "/body_b/odom": ODOMETRY, "/body_b/load": WRENCH,
    "/connector/command": "sensor_msgs/msg/JointState", "/other": "std_msgs/msg/String",
}  # fmt: skip
NUMBERS = {topic: 3 * k + 1 for k, topic in enumerate(TOPICS)}  # channel numbers, not contiguous
OFFSETS = (layout.A_POSE, layout.A_TWIST, layout.B_POSE, layout.B_TWIST)


class BagInMemory:
    """A bag of given messages, in blocks of given sizes."""

    def __init__(self, messages: list[tuple[str, bytes]], sizes: list[int]) -> None:
        self.path, self.types = Path("memory"), TOPICS
        self.metadata: dict[str, str] = {}
        self.names: dict[str, str] = {}
        self.found = [
            RawMessage(NUMBERS[topic], 10**18 + k, 7, data)
            for k, (topic, data) in enumerate(messages)
        ]
        self.sizes = sizes
        self.topics = Topics({number: topic for topic, number in NUMBERS.items()})

    def messages(self) -> Iterator[Message]:
        for channel, log_time, _, data in self.found:
            yield Message(self.topics[channel], log_time, data)

    def blocks(self) -> Iterator[tuple[Topics, MessageBlock]]:
        at, k = 0, 0
        while at < len(self.found):
            size = self.sizes[k % len(self.sizes)]
            yield self.topics, message_block.from_messages(self.found[at : at + size])
            at, k = at + size, k + 1


def result_of(replay: Replay, items: Iterator[Item]) -> tuple[list[Item], dict[str, Any]]:
    """All messages without computing time, and the whole state of the replay afterwards."""
    found = []
    for item in items:
        timing = replay.timing.get(item.topic)
        data = item.data
        if timing is not None and item.replayed:
            data = data[: timing.start] + data[timing.stop :]
        found.append(item._replace(data=data))
    pipeline = replay.pipeline
    matcher, last = pipeline.matcher, pipeline.zero()
    health = dataclasses.asdict(pipeline.health)
    health["numbers"] = np.delete(health["numbers"], statistics.WORST_TIME).tobytes()
    state = {
        "counts": replay.counts, "matcher": matcher.counts, "received": matcher.received,
        "sample": matcher.sample.tobytes(), "last": matcher.last_stamp, "health": health,
        "memory": pipeline.connector.memory.tobytes(), "zero": last,
        "loads": list(pipeline.loads.current(matcher.last_stamp)),
        "out": np.delete(pipeline.out, layout.COMPUTING_TIME).tobytes(),
    }  # fmt: skip
    return found, state


def items_of(replay: Replay, batch: Batch) -> list[Item]:
    """The messages of a batch one by one; its messages to record must be the same."""
    items, topics = [], batch.topics
    rows = [(replay.names[name], batch.rows(name)) for name, _ in OUTPUTS]
    closing = batch.closing.tolist()
    published = replay.names.values()
    for k, found in enumerate(batch.block.messages(batch.begin, batch.end), batch.begin):
        topic = topics[found.channel]
        if topic in replay.input_topics or topic in published:
            items.append(Item(topic, found.log_time, found.data, False))
        if k in closing:
            for name, data in rows:
                output = data[closing.index(k)].tobytes()
                items.append(Item(name, found.log_time, output, True))
    names = [*replay.input_topics, *published]
    recorded = batch.to_record(
        {topic: k for k, topic in enumerate(names, 1)}, replay.input_topics, replay.names
    )
    assert [
        (names[channel - 1], log_time, recorded.data[start : start + size].tobytes())
        for channel, log_time, _, start, size in zip(*recorded[1:], strict=True)
    ] == [item[:3] for item in items if item.replayed or item.topic in replay.input_topics]
    return items


def by_message(bag: Any, scene: Scene) -> tuple[list[Item], dict[str, Any]]:
    replay = Replay(bag, scene)
    return result_of(replay, replay.messages())


def by_batch(bag: Any, scene: Scene) -> tuple[list[Item], dict[str, Any], int]:
    """As :func:`by_message`, batched; and the number of samples in batches."""
    replay, batched = Replay(bag, scene), 0

    def items() -> Iterator[Item]:
        nonlocal batched
        for part in replay.parts():
            if isinstance(part, Batch):
                batched += len(part)
                yield from items_of(replay, part)
            else:
                yield part

    return (*result_of(replay, items()), batched)


def check(bag: Any, scene: Scene) -> tuple[dict[str, Any], int]:
    messages, state = by_message(bag, scene)
    again, state_again, batched = by_batch(bag, scene)
    assert again == messages
    assert state_again == state
    return state, batched


@pytest.mark.parametrize("name", NAMES)
def test_golden_bags(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = Bag(BAGS / name)
    scene = Scene.from_parameters(parameter_file.parameters_of(bag.metadata["parameters"]))
    state, batched = check(bag, scene)
    samples = state["matcher"].samples
    assert batched > (0.0 if name == "lossy" else 0.8) * samples
    monkeypatch.setattr(batches, "MAX_SAMPLES", 7)
    check(bag, scene)


FREE = make(friction__coefficient=0.2, friction__overlap=0.05, period=0.0)
UNEVEN = make(friction__coefficient=0.2, friction__overlap=0.05)
BODY_AXES = make(friction__coefficient=0.2, twist_axes="body")
ODOM = make(friction__coefficient=0.2, input="odometry")
FIXED = make(friction__coefficient=0.2, body_a={"kind": "fixed"})
OBSERVED = make(friction__coefficient=0.2, method="observe")
SCENES = {"free": FREE, "uneven": UNEVEN, "body axes": BODY_AXES, "odometry": ODOM,
          "fixed": FIXED, "observe": OBSERVED}  # fmt: skip
STATES = simulate(make(friction__coefficient=0.2), samples=STEPS).states

EVENTS = (
    "lost", "twice", "overtaken", "shuffled", "another frame", "unknown frame", "no frame",
    "garbage", "longer", "load", "load in body axes", "command", "late", "back", "uneven", "nan",
    "no quaternion", "chatter", "same stamp",
)  # fmt: skip


def sample_messages(
    scene: Scene, stamp: int, state: np.ndarray, frames: dict[str, str]
) -> list[tuple[str, bytes]]:
    """The messages of one sample, as a simulator sends them."""
    found = []
    for body, name in ((0, "a"), (1, "b")):
        if scene.bodies[body].kind == "fixed":
            continue
        pose = np.ascontiguousarray(state[OFFSETS[2 * body] :][:7])
        twist = np.ascontiguousarray(state[OFFSETS[2 * body + 1] :][:6])
        if scene.input == "odometry":
            child = frames.get("child", f"body_{name}")
            writer = OdometryWriter(frames.get("pose", "world"), child)
            found.append((f"/body_{name}/odom", writer.write(stamp, pose, twist)))
            continue
        data = StampedWriter(frames.get("pose", "world"), 7).write(stamp, pose)
        found.append((f"/body_{name}/pose", data))
        data = StampedWriter(frames.get("twist", "world"), 6).write(stamp, twist)
        found.append((f"/body_{name}/twist", data))
    return found


def stream(scene: Scene, events: list[tuple[int, str, int]]) -> list[tuple[str, bytes]]:
    """Messages of a motion with ``events``: number of the sample, event, and a selector."""
    found: list[tuple[str, bytes]] = []
    at: dict[int, list[tuple[str, int]]] = {}
    for step, event, number in events:
        at.setdefault(step, []).append((event, number))
    stamp, delayed = 5 * MS, None
    for step in range(STEPS):
        events_now = at.get(step, [])
        state = STATES[step].copy()
        frames: dict[str, str] = {}
        stamp += MS
        for event, number in events_now:
            if event == "uneven":
                stamp += 1000 * (number % 500)
            elif event in ("late", "same stamp"):
                stamp -= 2 * MS if event == "late" else MS
            elif event == "back":
                stamp = MS * (number % 5)
            elif event == "nan":
                state[number % 26] = (math.nan, math.inf, -1e300)[number % 3]
            elif event == "no quaternion":
                state[layout.B_POSE + 3 : layout.B_POSE + 7] = 0.0
            elif event.endswith("frame"):
                name = {"another frame": "body_b", "unknown frame": "map", "no frame": ""}[event]
                frames[("pose", "twist", "child")[number % 3]] = name
        sample = sample_messages(scene, max(stamp, 0), state, frames)
        for event, number in events_now:
            place = number % (len(sample) or 1)
            if event in ("load", "load in body axes"):
                data = StampedWriter("world" if event == "load" else "body_b").write(
                    stamp, np.arange(6.0) * number
                )
                sample.insert(place, ("/body_b/load", data))
            elif event == "command":
                writer = JointStateWriter("", ["spin"])
                data = writer.write(stamp, [math.nan], [math.nan], [0.1 * (number % 7)])
                sample.insert(place, ("/connector/command", data))
            elif event == "chatter":
                sample.insert(place, ("/other", b"\0\1\0\0hello"))
            elif not sample:
                continue
            elif event == "lost":
                sample.pop(place)
            elif event == "twice":
                sample.insert(place, sample[place])
            elif event == "shuffled":
                sample.append(sample.pop(place))
            elif event == "garbage":
                sample[place] = (sample[place][0], sample[place][1][: number % 60])
            elif event == "longer":
                sample[place] = (sample[place][0], sample[place][1] + b"\0" * (number % 9))
            elif event == "overtaken" and delayed is None:
                delayed = sample.pop(place)
                continue
        found += sample
        if delayed is not None and not any(event == "overtaken" for event, _ in events_now):
            found.append(delayed)
            delayed = None
    return found


@pytest.mark.parametrize("name", SCENES)
@settings(max_examples=40, suppress_health_check=list(HealthCheck))
@given(
    events=st.lists(
        st.tuples(st.integers(0, STEPS - 1), st.sampled_from(EVENTS), st.integers(0, 60)),
        max_size=8,
    ),
    sizes=st.lists(st.integers(1, 300), min_size=1, max_size=3),
)
def test_batches_between_irregular_messages(
    name: str, events: list[tuple[int, str, int]], sizes: list[int]
) -> None:
    check(BagInMemory(stream(SCENES[name], events), sizes), SCENES[name])


@pytest.mark.parametrize("name", SCENES)
def test_all_but_the_first_samples_of_a_motion_are_batched(name: str) -> None:
    """Also those after a load, except the first."""
    bag = BagInMemory(stream(SCENES[name], [(20, "load in body axes", 1)]), [10**6])
    state, batched = check(bag, SCENES[name])
    assert batched >= STEPS - 4
    assert state["counts"].responses == STEPS


def test_unknown_frames_are_counted_in_batches() -> None:
    events = [(step, "unknown frame", number) for step in range(STEPS) for number in (0, 2)]
    state, batched = check(BagInMemory(stream(ODOM, events), [10**6]), ODOM)
    assert batched > STEPS // 2
    assert state["matcher"].unknown_frames == 4 * STEPS


def test_failed_attempts_at_a_batch_become_rarer(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    process_block = PrefixDecoder.process_block

    def counted(*arguments: Any) -> tuple[int, int]:
        n, end = process_block(*arguments)
        calls.append(n)
        return n, end

    monkeypatch.setattr(PrefixDecoder, "process_block", counted)
    events = [(step, "lost", 1) for step in range(1, STEPS, 2)]
    check(BagInMemory(stream(UNEVEN, events), [10**6]), UNEVEN)
    assert 2 <= len(calls) <= 10


@given(st.lists(st.tuples(st.sampled_from([3, 5, 5, 5, 99]), st.integers(0, 60)), max_size=90),
       st.integers(-9, 40))  # fmt: skip
def test_compiled_and_interpreted_index_of_a_chunk_agree(
    records: list[tuple[int, int]], cut: int
) -> None:
    """Both find the same messages, or that the chunk is damaged."""
    raw = b"".join(
        struct.pack("<BQ", code, size) + bytes((7 * k + j) % 256 for j in range(size))
        for k, (code, size) in enumerate(records)
    )
    raw = raw[: len(raw) - cut] if cut > 0 else raw
    found = []
    for fill in (
        functools.partial(kernels.index_chunk, np.frombuffer(raw, np.uint8),
                          message_block.from_messages([RawMessage(0, 0, 0, raw)]).unaligned("<u8")),
        functools.partial(message_block._index_interpreted, raw),
    ):  # fmt: skip
        longs, places, others = (np.zeros((n, len(raw) + 1), k) for n, k in
                                 ((3, np.uint64), (2, np.int64), (2, np.int64)))  # fmt: skip
        count, more = fill(longs, places, others)
        found.append((count, max(more, 0) if count >= 0 else 0, longs[:, : max(count, 0)].tolist(),
                      places[:, : max(count, 0)].tolist()))  # fmt: skip
    assert found[0] == found[1]


def test_the_replay_benchmark_measures_all_cases() -> None:
    found = replay_cost.measure(Settings.short(bundled))
    assert len({m.subject for m in found.measurements}) == 5
    assert all(m.value > 0.0 for m in found.measurements)
    assert not found.not_measured
