"""The express lane is only faster: whatever comes in whatever order, the answers are the same."""

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

from cylconn_ros.core import layout
from cylconn_ros.messages import cdr_decoder, statistics
from cylconn_ros.messages.cdr_encoder import OdometryWriter, StampedWriter
from cylconn_ros.messages.pipeline import Answering
from cylconn_ros.messages.prefix import STREAM_OF, Forms
from cylconn_ros.ros.executor import fused, rcl
from cylconn_ros.ros.executor.fused import Straight
from cylconn_ros.ros.executor.sequence_numbers import Gaps
from cylconn_ros.scene.scene import Scene

NAMES = ("body_a/pose", "body_a/twist", "body_b/pose", "body_b/twist")
# Where the computing time stands in the bytes of a state: nothing else may differ.
TIME = 8 * (layout.COMPUTING_TIME - layout.STATE0)


ODOMETRIES = ("body_a/odom", "body_b/odom")


def messages(
    rng: random.Random, count: int, names: Sequence[str] = NAMES
) -> list[tuple[str, bytes]]:
    """Messages of a motion, with all that can happen to them on their way."""
    found: list[tuple[str, bytes]] = []
    frames = {"pose": ["world"] * 30 + ["", "map"], "twist": ["world"] * 30 + ["", "body_b", "x"]}
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
    for _ in range(count // 20):  # overtaken on the way
        at = rng.randrange(len(found) - 5)
        found.insert(at + rng.randrange(5), found.pop(at))
    return found


def big_endian(data: bytes) -> bytes:
    """The same message as a machine of the other byte order writes it."""
    seconds, nanoseconds, length = struct.unpack_from("<iII", data, 4)
    text = data[16 : 16 + length]
    at = 16 + length + (4 - (16 + length)) % 8
    numbers = struct.unpack_from(f"<{(len(data) - at) // 8}d", data, at)
    head = b"\0\0\0\0" + struct.pack(">iII", seconds, nanoseconds, length) + text
    return head.ljust(at, b"\0") + struct.pack(f">{len(numbers)}d", *numbers)


def serve(scene: Scene, stream: list[tuple[str, bytes]]) -> tuple[list, Answering]:
    answering = Answering(scene)
    found = []
    for name, data in stream:
        answer = answering.inputs[name].receive(data)
        if answer is not None:
            state = None if answer.state is None else without_time(2, answer.state)[1]
            found.append((*answer[:3], state, answer.joint_state))
    return found, answering


def without_time(k: int, data: bytes) -> tuple[int, bytes]:
    """Message ``k`` of an answer, a state without its computing time."""
    if k != 2:
        return k, data
    block = data.index(b"body_a") + 12  # "body_a" and a zero, aligned to 8
    return k, data[: block + TIME] + data[block + TIME + 8 :]


def motion(seed: int, **changes: Any) -> tuple[Scene, tuple[str, ...]]:
    """A scene, with odometry for some seeds, and the names of its inputs."""
    odometry = seed % 3 == 2
    scene = make(
        friction__coefficient=0.2, input="odometry" if odometry else "pose_twist", **changes
    )
    return scene, ODOMETRIES if odometry else NAMES


@pytest.mark.parametrize("seed", range(9))
def test_answers_and_counts_are_those_of_the_ordinary_way(seed, monkeypatch):
    scene, names = motion(seed, stamp_tolerance=1e-6 if seed > 6 else 0.0)
    stream = messages(random.Random(seed), 400, names)
    by_express, first = serve(scene, stream)
    monkeypatch.setattr(Forms, "of", lambda *_: None)
    ordinarily, second = serve(scene, stream)
    assert len(by_express) > 100
    assert by_express == ordinarily
    first.lane.give_back(first._ordinary)
    assert first.matcher.counts == second.matcher.counts
    assert first.matcher.received == second.matcher.received
    assert first.health.undecodable == second.health.undecodable > 0
    np.testing.assert_array_equal(first.matcher.sample, second.matcher.sample)


class Middleware:
    """Give messages in their order and keep what is published, called by address as rcl is."""

    def __init__(
        self, stream: list[tuple[str, bytes]], names: Sequence[str], listened: set[int]
    ) -> None:
        self.left, self.names, self.listened = list(stream), names, listened
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
        ctypes.cast(count, ctypes.POINTER(ctypes.c_int64))[0] = int(publisher in self.listened)
        return 0


def serve_straight(scene: Scene, stream: list[tuple[str, bytes]]) -> tuple[list, Answering, int]:
    """The same through the compiled call, and how many samples went straight."""
    answering, gone = Answering(scene), [0]
    names = [name for name in answering.inputs if name in STREAM_OF]
    middleware = Middleware(stream, names, {2})
    answering.wanted = lambda name: name == "~/state"

    def answered(samples: int) -> None:
        gone[0] += samples
        stamp, before, begun = way.told[fused.STAMP : fused.STAMP + 3]
        answering.went_on(stamp, before if begun else None, samples)

    def receive(name: str, data: bytes) -> bool:
        answer = answering.inputs[name].receive(data)
        for k, message in enumerate(answer[1:] if answer is not None else ()):
            if message is not None:
                middleware.published.append((k, message))
        return answer is not None

    inputs = [
        fused.Input(
            SimpleNamespace(handle=SimpleNamespace(pointer=k)), STREAM_OF[name],
            functools.partial(receive, name), Gaps(lambda count: pytest.fail(f"{count} lost")),
        )
        for k, name in enumerate(names)
    ]  # fmt: skip
    publishers = [SimpleNamespace(pointer=k) for k in range(4)]
    way = Straight(inputs, publishers, answering.parts, answered)
    for at, function in zip(
        (rcl.TAKE, rcl.PUBLISH, rcl.LISTENERS), middleware.functions, strict=True
    ):
        way._memory.addresses[at] = ctypes.cast(function, ctypes.c_void_p).value
    while middleware.left:
        if middleware.left[0][0] not in names:
            name, data = middleware.left.pop(0)
            answering.inputs[name].receive(data)
        way.take(lambda error: pytest.fail(str(error)))
    answering.lane.give_back(answering._ordinary)
    way._inbox = rcl.Inbox(0)  # whose bytes were ours
    return middleware.published, answering, gone[0]


@pytest.mark.parametrize("seed", range(6))
def test_the_straight_way_publishes_what_the_ordinary_one_does(seed, monkeypatch):
    scene, names = motion(seed, period=0.0 if seed == 4 else 0.001)
    stream = messages(random.Random(seed), 400, names)
    published, first, gone = serve_straight(scene, stream)
    monkeypatch.setattr(Forms, "of", lambda *_: None)
    found, second = serve(scene, stream)
    assert gone > 50
    assert [without_time(k, data) for k, data in published] == [
        (k, data) for answer in found for k, data in enumerate(answer[1:4]) if data is not None
    ]
    assert first.matcher.counts == second.matcher.counts
    assert first.matcher.received == second.matcher.received
    np.testing.assert_array_equal(
        np.delete(first.health.numbers, statistics.WORST_TIME),
        np.delete(second.health.numbers, statistics.WORST_TIME),
    )
    np.testing.assert_array_equal(first.matcher.sample, second.matcher.sample)
    np.testing.assert_array_equal(first.connector.memory, second.connector.memory)


def test_samples_that_are_alike_take_it(monkeypatch):
    loop = Loop(make())
    loop.step()
    monkeypatch.setattr(cdr_decoder, "read_pose", lambda _: pytest.fail("decoded"))
    monkeypatch.setattr(cdr_decoder, "read_twist", lambda _: pytest.fail("decoded"))
    for _ in range(5):
        loop.step()
    assert loop.answering.matcher.counts.samples == 6
    assert loop.answering.matcher.received["body_b/twist"] == 6


def test_what_is_held_in_vain_is_counted_in_the_end():
    loop = Loop(make())
    loop.step()
    for name, data in list(loop.exchange.messages(loop.plant.time_ns, loop.plant.state))[:3]:
        assert loop.answering.inputs[name].receive(data) is None
    assert loop.answering.matcher.received["body_b/pose"] == 1
    loop.answering.settle()
    loop.answering.settle()
    assert loop.answering.matcher.received["body_b/pose"] == 2
    assert loop.answering.matcher.received["body_b/twist"] == 1
    assert loop.sample() is not None  # the first three came twice


def test_a_form_needs_numbers_where_they_belong():
    forms = Forms(make())
    message = StampedWriter("world", 7).write(5, np.arange(7.0))
    form = forms.of(0, message)
    assert form is not None
    assert form.numbers[:2].tolist() == [len(message) - 56, len(message)]
    assert forms.of(0, message + b"\0") is None
    assert forms.of(0, big_endian(message)) is None
    assert forms.of(0, b"\0\1\0\0") is None


LACKING = """
from cylconn_ros.ros.connector import node as connector_node
from cylconn_ros.ros.executor import executor as loop
loop.missing = lambda node: "WaitSet.wait"
raise SystemExit(connector_node.main())
"""


def test_without_the_private_interface_the_executor_serves_and_it_is_said(peer, tmp_path):
    with program(
        [sys.executable, "-c", LACKING, *parameters("timeout:=.inf")], tmp_path
    ) as running:
        listener, source = Listener(peer), Source(peer)
        listener.answer(source, 1 * MS)
        listener.answer(source, 2 * MS)
        text = "this rclpy has no WaitSet.wait: samples are served by its executor, which is slower"
        assert text in running.output
        assert running.stop() == 0
