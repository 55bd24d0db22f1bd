"""The fast path (known prefix, fused call) gives the responses and counts of the reference path."""

import ctypes
import functools
import random
import struct
import sys
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pipelines import MS, Loop, make
from ros_processes import Listener, Source, parameters, program

from cylconn_ros.connector.load_history import IF_REGULAR
from cylconn_ros.core import layout
from cylconn_ros.messages import cdr_decoder, prefix, statistics
from cylconn_ros.messages.cdr_encoder import OdometryWriter, StampedWriter
from cylconn_ros.messages.pipeline import MessagePipeline
from cylconn_ros.messages.prefix import PrefixTable
from cylconn_ros.ros.executor import fused, rcl
from cylconn_ros.ros.executor.fused import FusedPath
from cylconn_ros.ros.executor.sequence_numbers import SequenceNumbers
from cylconn_ros.scene.inputs import STREAM_NUMBER
from cylconn_ros.scene.scene import Scene

NAMES = ("body_a/pose", "body_a/twist", "body_b/pose", "body_b/twist")
ODOMETRIES = ("body_a/odom", "body_b/odom")
# Offset of the computing time in the state block; no other byte of a state may differ.
TIME = 8 * (layout.COMPUTING_TIME - layout.STATE0)


def messages(
    rng: random.Random, count: int, names: Sequence[str] = NAMES
) -> list[tuple[str, bytes]]:
    """Messages of ``count`` samples with transport faults, other frames and damaged bytes."""
    found: list[tuple[str, bytes]] = []
    frames = {
        "pose": ["world"] * 30 + ["", "map", "/world"],
        "twist": ["world"] * 30 + ["", "body_b", "x", "/body_b", "/"],
    }
    children = ["body_b"] * 30 + ["world", "", "x"]
    stamp = 0
    for _ in range(count):
        stamp = max(0, stamp + rng.choice([MS] * 80 + [MS + 500, 0, -MS, -30 * MS]))
        sample = []
        for name in rng.sample(names, len(names)) if rng.random() < 0.2 else names:
            kind = name.partition("/")[2]
            values = np.array([rng.gauss(0.0, 0.01) for _ in range(6 if kind == "twist" else 7)])
            if kind != "twist":
                values[6] = 1.0
            frame = rng.choice(frames.get(kind, frames["pose"]))
            if kind == "odom":
                twist = np.array([rng.gauss(0.0, 0.01) for _ in range(6)])
                writer = OdometryWriter(frame, rng.choice(children))
                data = writer.write(stamp, values, twist)
            else:
                data = StampedWriter(frame, len(values)).write(stamp, values)
            if rng.random() < 0.02:
                other = big_endian(data) if kind != "odom" else data[:40]
                data = rng.choice([data[:-3], data + b"\0\0", b"", other])
            sample += [(name, data)] * rng.choice([1] * 40 + [0, 2])
        if rng.random() < 0.05:
            load = StampedWriter(rng.choice(["world", "body_b"])).write(stamp, np.ones(6))
            sample.insert(rng.randrange(len(sample) + 1), ("body_b/load", load))
        found += sample
    for _ in range(count // 20):  # overtaken on the transport
        at = rng.randrange(len(found) - 5)
        found.insert(at + rng.randrange(5), found.pop(at))
    return found


def with_loads(
    rng: random.Random, stream: list[tuple[str, bytes]], everywhere: bool
) -> list[tuple[str, bytes]]:
    """Add a load with the stamp of each sample, at any place beside its messages.

    ``everywhere``: now and then it is missing, or comes much later.
    """
    found, last = list(stream), 0
    for stamp in sorted({cdr_decoder.read_stamp(data) for _, data in stream if len(data) > 60}):
        load = StampedWriter(rng.choice(["world", "body_b"])).write(stamp, np.full(6, 1e-9 * stamp))
        at = [k for k, (_, data) in enumerate(found) if is_of(data, stamp)]
        last = max(last + 1, rng.randint(at[0], at[-1] + 1))
        late = rng.choice([0] * 30 + [2, 5, 9, -1]) if everywhere else 0
        if late >= 0:
            found.insert(last + late, ("body_b/load", load))
    return found


def is_of(data: bytes, stamp: int) -> bool:
    """Whether a message can be decoded and has a stamp (ns)."""
    return len(data) > 60 and cdr_decoder.read_stamp(data) == stamp


def big_endian(data: bytes) -> bytes:
    """The same message as encoded by a big-endian machine."""
    seconds, nanoseconds, length = struct.unpack_from("<iII", data, 4)
    text = data[16 : 16 + length]
    at = 16 + length + (4 - (16 + length)) % 8
    numbers = struct.unpack_from(f"<{(len(data) - at) // 8}d", data, at)
    head = b"\0\0\0\0" + struct.pack(">iII", seconds, nanoseconds, length) + text
    return head.ljust(at, b"\0") + struct.pack(f">{len(numbers)}d", *numbers)


def process(scene: Scene, stream: list[tuple[str, bytes]]) -> tuple[list, MessagePipeline]:
    """The responses to messages in their order, states without computing time."""
    pipeline = MessagePipeline(scene)
    pipeline.matcher.expects = lambda *_: IF_REGULAR
    found = []
    for name, data in stream:
        response = pipeline.inputs[name].receive(data)
        while response is not None:
            state = None if response.state is None else without_time(2, response.state)[1]
            found.append((*response[:3], state, response.joint_state))
            response = pipeline.next()
    return found, pipeline


def without_time(k: int, data: bytes) -> tuple[int, bytes]:
    """Message ``k`` of a response, a state without its computing time."""
    if k != 2:
        return k, data
    block = data.index(b"body_a") + 12  # "body_a" and a zero, aligned to 8
    return k, data[: block + TIME] + data[block + TIME + 8 :]


def motion(seed: int, **changes: Any) -> tuple[Scene, tuple[str, ...]]:
    """A scene, with odometry for some seeds, and the names of its inputs of motion."""
    odometry = seed % 3 == 2
    scene = make(
        friction__coefficient=0.2, input="odometry" if odometry else "pose_twist", **changes
    )
    return scene, ODOMETRIES if odometry else NAMES


def use_reference_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no message have a known prefix."""
    monkeypatch.setattr(PrefixTable, "prefix_of", lambda *_: None)


@pytest.mark.parametrize("seed", range(9))
def test_responses_and_counts_are_those_of_the_reference_path(seed, monkeypatch):
    scene, names = motion(seed, stamp_tolerance=1e-6 if seed > 6 else 0.0)
    stream = messages(random.Random(seed), 400, names)
    responses, first = process(scene, stream)
    use_reference_path(monkeypatch)
    expected, second = process(scene, stream)
    assert len(responses) > 100
    assert responses == expected
    first.decoder.replay_pending(first._use_reference_path)
    assert first.matcher.counts == second.matcher.counts
    assert first.matcher.received == second.matcher.received
    assert first.health.undecodable == second.health.undecodable > 0
    np.testing.assert_array_equal(first.matcher.sample, second.matcher.sample)


class Middleware:
    """Give messages in their order and keep published ones; called by address, as rcl is."""

    def __init__(
        self, stream: list[tuple[str, bytes]], names: Sequence[str], subscribed: set[int]
    ) -> None:
        self.left, self.names, self.subscribed = list(stream), names, subscribed
        self.published: list[tuple[int, bytes]] = []
        self.sent = dict.fromkeys(names, 0)
        self._buffers: list[ctypes.Array] = []
        kind = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_int64] * 4)
        self.functions = [kind(f) for f in (self._take, self._publish, self._count)]

    def _take(self, subscription: int, message: int, info: int, _: int) -> int:
        if not self.left or self.left[0][0] != self.names[subscription]:
            return 401
        name, data = self.left.pop(0)
        self._buffers = [*self._buffers[-8:], ctypes.create_string_buffer(data, len(data))]
        words = ctypes.cast(message, ctypes.POINTER(ctypes.c_int64))
        words[0], words[1] = ctypes.addressof(self._buffers[-1]), len(data)
        ctypes.cast(info, ctypes.POINTER(ctypes.c_int64))[rcl.SEQUENCE] = self.sent[name]
        self.sent[name] += 1
        return 0

    def _publish(self, publisher: int, message: int, *_: int) -> int:
        words = ctypes.cast(message, ctypes.POINTER(ctypes.c_int64))
        self.published.append((publisher, ctypes.string_at(words[0], words[1])))
        return 0

    def _count(self, publisher: int, count: int, *_: int) -> int:
        ctypes.cast(count, ctypes.POINTER(ctypes.c_int64))[0] = int(publisher in self.subscribed)
        return 0


def process_fused(
    scene: Scene, stream: list[tuple[str, bytes]]
) -> tuple[list[tuple[int, bytes]], MessagePipeline, int]:
    """As :func:`process` through the fused call: published messages, and its number of samples."""
    pipeline, fused_samples = MessagePipeline(scene), [0]
    pipeline.matcher.expects = lambda *_: IF_REGULAR
    names = [name for name in pipeline.inputs if name in STREAM_NUMBER]
    middleware = Middleware(stream, names, {2})
    pipeline.wanted = lambda name: name == "~/state"

    def on_samples(samples: int) -> None:
        fused_samples[0] += samples
        stamp, previous, has_previous = path.status[fused.STAMP : fused.STAMP + 3]
        pipeline.advance(stamp, previous if has_previous else None, samples)

    def receive(name: str, data: bytes) -> bool:
        response = pipeline.inputs[name].receive(data)
        complete = response is not None
        while response is not None:
            for k, message in enumerate(response[1:]):
                if message is not None:
                    middleware.published.append((k, message))
            response = pipeline.next()
        return complete

    inputs = [
        fused.Input(
            SimpleNamespace(handle=SimpleNamespace(pointer=k)), STREAM_NUMBER[name],
            functools.partial(receive, name),
            SequenceNumbers(lambda count: pytest.fail(f"{count} lost")),
        )
        for k, name in enumerate(names)
    ]  # fmt: skip
    publishers = [SimpleNamespace(pointer=k) for k in range(4)]
    path = FusedPath(inputs, publishers, pipeline.parts, on_samples)
    for at, function in zip(
        (rcl.TAKE, rcl.PUBLISH, rcl.SUBSCRIBERS), middleware.functions, strict=True
    ):
        path._calls.addresses[at] = ctypes.cast(function, ctypes.c_void_p).value
    while middleware.left:
        if middleware.left[0][0] not in names:
            receive(*middleware.left.pop(0))
        path.take(None, lambda error: pytest.fail(str(error)))
    pipeline.decoder.replay_pending(pipeline._use_reference_path)
    path._received = rcl.ReceiveBuffers(0)  # the buffers were the test's own
    return middleware.published, pipeline, fused_samples[0]


@pytest.mark.parametrize("everywhere", [False, True], ids=["each", "most"])
@pytest.mark.parametrize("seed", range(5))
def test_loads_of_each_sample_give_the_same_on_all_paths(seed, everywhere, monkeypatch):
    scene, names = motion(seed)
    rng = random.Random(seed)
    stream = with_loads(rng, messages(rng, 200, names), everywhere)
    published, compiled, samples = process_fused(scene, stream)
    responses, first = process(scene, stream)
    use_reference_path(monkeypatch)
    expected, second = process(scene, stream)
    assert len(expected) > 100
    assert responses == expected
    assert [without_time(k, data) for k, data in published] == [
        (k, data) for one in expected for k, data in enumerate(one[1:4]) if data is not None
    ]
    for pipeline in (first, compiled):
        assert pipeline.matcher.counts == second.matcher.counts
        np.testing.assert_array_equal(pipeline.matcher.sample, second.matcher.sample)
        np.testing.assert_array_equal(pipeline.connector.memory, second.connector.memory)
    assert samples > 20


@pytest.mark.parametrize("seed", range(6))
def test_the_fused_path_publishes_the_outputs_of_the_reference_path(seed, monkeypatch):
    scene, names = motion(seed, period=0.0 if seed == 4 else 0.001)
    stream = messages(random.Random(seed), 400, names)
    published, first, samples = process_fused(scene, stream)
    use_reference_path(monkeypatch)
    found, second = process(scene, stream)
    assert samples > 50
    assert [without_time(k, data) for k, data in published] == [
        (k, data) for response in found for k, data in enumerate(response[1:4]) if data is not None
    ]
    assert first.matcher.counts == second.matcher.counts
    assert first.matcher.received == second.matcher.received
    np.testing.assert_array_equal(
        np.delete(first.health.numbers, statistics.WORST_TIME),
        np.delete(second.health.numbers, statistics.WORST_TIME),
    )
    np.testing.assert_array_equal(first.matcher.sample, second.matcher.sample)
    np.testing.assert_array_equal(first.connector.memory, second.connector.memory)


def test_messages_with_a_known_prefix_are_not_decoded(monkeypatch):
    loop = Loop(make())
    loop.step()
    read_input = cdr_decoder.read_input

    def read_load(kind, data):
        """The plant decodes wrenches; poses and twists must not be decoded."""
        return pytest.fail("decoded") if kind.carries_motion else read_input(kind, data)

    monkeypatch.setattr(cdr_decoder, "read_input", read_load)
    for _ in range(5):
        loop.step()
    assert loop.pipeline.matcher.counts.samples == 6
    assert loop.pipeline.matcher.received["body_b/twist"] == 6


def test_flush_counts_the_messages_of_an_incomplete_sample():
    loop = Loop(make())
    loop.step()
    for name, data in list(loop.exchange.messages(loop.plant.time_ns, loop.plant.state))[:3]:
        assert loop.pipeline.inputs[name].receive(data) is None
    assert loop.pipeline.matcher.received["body_b/pose"] == 1
    loop.pipeline.flush()
    loop.pipeline.flush()
    assert loop.pipeline.matcher.received["body_b/pose"] == 2
    assert loop.pipeline.matcher.received["body_b/twist"] == 1
    assert loop.sample() is not None  # the first three are duplicates


def test_a_prefix_requires_aligned_little_endian_numbers_at_the_end():
    table, stream = PrefixTable(make()), STREAM_NUMBER["body_a/pose"]
    message = StampedWriter("world", 7).write(5, np.arange(7.0))
    found = table.prefix_of(stream, message)
    assert found is not None
    assert (found.numbers, found.size) == (len(message) - 56, len(message))
    assert table.prefix_of(stream, message + b"\0") is None
    assert table.prefix_of(stream, big_endian(message)) is None
    assert table.prefix_of(stream, b"\0\1\0\0") is None
    long_frame = StampedWriter("w" * 8 * prefix.MAX_WORDS, 7).write(5, np.arange(7.0))
    assert table.prefix_of(stream, long_frame) is None
    table.learn(stream, message)
    assert table.size(stream) == len(message)
    table.learn(stream, long_frame)
    assert table.size(stream) == -1


LACKING = """
from cylconn_ros.ros.connector import node
from cylconn_ros.ros.executor import executor
executor.missing = lambda _: "WaitSet.wait"
raise SystemExit(node.main())
"""


def test_without_rclpys_private_interface_its_executor_serves_and_the_log_states_so(peer, tmp_path):
    with program(
        [sys.executable, "-c", LACKING, *parameters("timeout:=.inf")], tmp_path
    ) as running:
        listener, source = Listener(peer), Source(peer)
        listener.exchange(source, 1 * MS)
        listener.exchange(source, 2 * MS)
        text = "rclpy has no WaitSet.wait: samples are processed by its own executor"
        assert text in running.output
        assert running.stop() == 0
