"""No sample is left in a queue: every interleaving of the executor's operations and of arrivals.

The executor's group runs here on real eventfds and a real epoll, with queues in place of rcl's
subscriptions. Messages arrive between two operations of the executor (to take, to arm, to wait), at
every place, and nothing is checked by time: a sample whose messages have all arrived must be
processed without a further message.
"""

import ctypes
import itertools
import os
import random
from collections.abc import Callable, Iterator, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pipelines import MS, make

from cylconn_ros.connector.load_history import AWAITED, IF_REGULAR, NO, REGULAR
from cylconn_ros.messages.cdr_encoder import StampedWriter
from cylconn_ros.messages.pipeline import MessagePipeline
from cylconn_ros.ros.executor import fused, new_message_event, rcl
from cylconn_ros.ros.executor.executor import Group, InputGroup, InputSubscription
from cylconn_ros.ros.executor.fused import FusedPath
from cylconn_ros.ros.executor.new_message_event import EventPoller
from cylconn_ros.ros.executor.sequence_numbers import SequenceNumbers
from cylconn_ros.scene.inputs import STREAM_NUMBER

MOTION = ("body_b/pose", "body_b/twist")
LOAD = "body_b/load"
EMPTY = 401  # result of rcl_take_serialized_message for an empty queue
PLACES = 14  # operations after the first message at which the last ones arrive; then all are done


class Middleware:
    """Queues of messages that arrive between two operations, and the events of their arrival.

    A callback is registered as rmw_fastrtps does it: unread messages are counted first, and a
    message raises events only after the end of the call.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = list(names)
        self.queues: list[list[bytes]] = [[] for _ in names]
        self.taken, self.descriptors = [0] * len(names), [-1] * len(names)
        self.arriving: list[tuple[int, str, bytes]] = []  # operation, name, message
        self.operations = 0
        self._buffers: list[Any] = []
        kind = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_int64] * 4)
        self.rcl_take = kind(self._rcl_take)
        self.nothing = kind(lambda *_: 0)

    def operate(self) -> None:
        """Let the messages arrive that are due before the next operation."""
        while self.arriving and self.arriving[0][0] <= self.operations:
            _, name, data = self.arriving.pop(0)
            number = self.names.index(name)
            self.queues[number].append(data)
            if self.descriptors[number] >= 0:
                os.eventfd_write(self.descriptors[number], 1)
        self.operations += 1

    def register(self, number: int, callback: Any, descriptor: int | None) -> int:
        unread = len(self.queues[number])
        self.operate()
        if callback is not None and unread:
            os.eventfd_write(descriptor or -1, unread)
        self.descriptors[number] = -1 if descriptor is None else descriptor
        return 0

    def take(self, number: int) -> tuple[bytes, dict[str, int]] | None:
        self.operate()
        if not self.queues[number]:
            return None
        self.taken[number] += 1
        return self.queues[number].pop(0), {"publication_sequence_number": self.taken[number]}

    def _rcl_take(self, number: int, message: int, info: int, _: int) -> int:
        found = self.take(number)
        if found is None:
            return EMPTY
        self._buffers = [*self._buffers[-8:], ctypes.create_string_buffer(found[0], len(found[0]))]
        words = ctypes.cast(message, ctypes.POINTER(ctypes.c_int64))
        words[0], words[1] = ctypes.addressof(self._buffers[-1]), len(found[0])
        ctypes.cast(info, ctypes.POINTER(ctypes.c_int64))[rcl.SEQUENCE] = self.taken[number]
        return 0

    def subscription(self, name: str) -> Any:
        """A subscription of rclpy, as far as the executor needs it."""
        number = self.names.index(name)
        handle = SimpleNamespace(pointer=number, take_message=lambda *_: self.take(number))
        return SimpleNamespace(handle=handle, msg_type=None)


class Poller(EventPoller[tuple[int, int]]):
    """Messages arrive also before and after an event is armed."""

    def __init__(self, middleware: Middleware) -> None:
        super().__init__()
        self.middleware = middleware

    def arm(self, event: Any, armed: bool) -> None:
        self.middleware.operate()
        super().arm(event, armed)
        self.middleware.operate()


class Node:
    """A connector on queues: answers are the stamps of the processed samples."""

    def __init__(self, names: Sequence[str], compiled: bool) -> None:
        self.middleware = Middleware(names)
        self.answers: list[int] = []
        self.pipeline = MessagePipeline(make(body_a={"kind": "fixed"}))
        self.pipeline.matcher.expects = lambda *_: IF_REGULAR if LOAD in names else 0
        self.poller = Poller(self.middleware)
        entries = [
            InputSubscription(
                self.middleware.subscription(name), self.receiver(name), self.lost, name in MOTION
            )
            for name in names
        ]
        take = self.fused(entries) if compiled else None
        inputs = InputGroup(entries, take, lambda: self.pipeline.decoder.is_partial)
        self.group = Group(inputs, self.fail, self.poller, 0)

    def fused(self, entries: Sequence[InputSubscription]) -> Any:
        inputs = [
            fused.Input(
                entry.subscription, STREAM_NUMBER[name], entry.receive, SequenceNumbers(self.lost)
            )
            for name, entry in zip(self.middleware.names, entries, strict=True) if name in MOTION
        ]  # fmt: skip
        publishers = [SimpleNamespace(pointer=k) for k in range(4)]
        path = FusedPath(inputs, publishers, self.pipeline.parts, self.on_samples)
        for at, function in (
            (rcl.TAKE, self.middleware.rcl_take),
            (rcl.PUBLISH, self.middleware.nothing),
            (rcl.SUBSCRIBERS, self.middleware.nothing),
        ):
            path._calls.addresses[at] = ctypes.cast(function, ctypes.c_void_p).value or 0
        path.status[fused.MOST] = 1
        self.path = path
        return path.take

    def on_samples(self, samples: int) -> None:
        stamp, previous, known = self.path.status[fused.STAMP : fused.HAS_PREVIOUS + 1]
        self.pipeline.advance(stamp, previous if known else None, samples)
        self.answers.append(stamp)

    def receiver(self, name: str) -> Callable[[bytes], bool]:
        def receive(data: bytes) -> bool:
            response = self.pipeline.inputs[name].receive(data)
            complete = response is not None
            while response is not None:
                self.answers.append(response.stamp)
                response = self.pipeline.next()
            return complete

        return receive

    def lost(self, count: int) -> None:
        pytest.fail(f"{count} messages lost")

    def fail(self, error: Exception) -> None:
        raise error

    def run(self) -> int:
        """Process until nothing arrives and no event is left; the number of wake-ups."""
        wakes = 0
        while True:
            arriving = bool(self.middleware.arriving)
            self.middleware.operate()
            ready = self.poller.wait(0.0)
            if ready:
                wakes += 1
                self.group.process(0.0, [stream for _, stream in ready])
            elif not arriving:
                return wakes

    def close(self) -> None:
        self.group.close()
        self.poller.close()
        if hasattr(self, "path"):
            self.path._received = rcl.ReceiveBuffers(0)  # the buffers were the test's own


@pytest.fixture(params=[False, True], ids=["python", "fused"])
def open_node(request: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Node]]:
    """Make a node; its callbacks are registered with its own middleware."""
    nodes: list[Node] = []

    def register(number: int, callback: Any, descriptor: int | None) -> int:
        return nodes[-1].middleware.register(number, callback, descriptor)

    monkeypatch.setattr(new_message_event, "_callback_functions", lambda: (register, object()))

    def make_node(names: Sequence[str], before: Callable[[Middleware], object] = id) -> Node:
        node = Node.__new__(Node)
        nodes.append(node)
        made = Middleware.__init__

        def prepared(self: Middleware, some: Sequence[str]) -> None:
            made(self, some)
            before(self)

        with monkeypatch.context() as patch:
            patch.setattr(Middleware, "__init__", prepared)
            node.__init__(names, request.param and not fused.missing())  # type: ignore[misc]
        return node

    yield make_node
    for node in nodes:
        node.close()


def message(name: str, stamp: int) -> bytes:
    size = 7 if name.endswith("pose") else 6
    numbers = np.zeros(size)
    numbers[-1] = name.endswith("pose")
    return StampedWriter("world", size).write(stamp, numbers)


def arrive(node: Node, order: Sequence[tuple[str, int]], places: Sequence[int]) -> None:
    """Let messages (name, stamp) arrive in their order, after numbers of operations."""
    now = node.middleware.operations
    node.middleware.arriving = [
        (now + place, name, message(name, stamp))
        for (name, stamp), place in zip(order, places, strict=True)
    ]


@pytest.mark.parametrize("names", [MOTION, (*MOTION, LOAD)], ids=["motion", "loads"])
def test_a_sample_is_answered_wherever_its_messages_arrive(names, open_node):
    """Every order after every order, the last messages at every place."""
    node, stamp = open_node(names), 0
    orders = list(itertools.permutations(names))
    for before, order in itertools.product(orders, orders):
        for places in itertools.combinations_with_replacement(range(PLACES), len(names) - 1):
            stamp += MS
            arrive(node, [(name, stamp) for name in before], [0] * len(names))
            node.run()
            stamp += MS
            arrive(node, [(name, stamp) for name in order], [0, *places])
            node.run()
            assert node.answers[-2:] == [stamp - MS, stamp], (before, order, places)
    assert len(node.answers) == stamp // MS
    assert node.pipeline.matcher.counts.late_loads == 0


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("names", [MOTION, (*MOTION, LOAD)], ids=["motion", "loads"])
def test_samples_that_overlap_are_answered(names, seed, open_node):
    """Messages of the next sample arrive before the last of this one, in the order of a topic."""
    rng, node, stamp = random.Random(seed), open_node(names), 0
    for _ in range(300):
        count = rng.randint(1, 4)
        stamps = [stamp + (k + 1) * MS for k in range(count)]
        stamp = stamps[-1]
        order = [(name, at) for at in stamps for name in rng.sample(names, len(names))]
        for _ in range(rng.randint(0, len(order))):  # neighbours change places
            k = rng.randrange(len(order) - 1)
            (first, at), (second, later) = order[k : k + 2]
            if first != second and not (first in MOTION and second in MOTION and at != later):
                order[k : k + 2] = (second, later), (first, at)
        arrive(node, order, sorted(rng.randrange(40) for _ in order))
        node.run()
        assert node.answers[-count:] == stamps, order
    assert node.pipeline.matcher.counts.incomplete == 0


def test_loads_that_are_not_awaited_are_taken_between_samples(open_node):
    """Queued samples are processed one by one, each with the loads that have arrived by then."""
    node = open_node((*MOTION, LOAD))
    arrive(node, [(name, MS) for name in (LOAD, *MOTION)], [0, 0, 0])
    node.run()
    paused = node.pipeline.matcher.loads.state
    paused[AWAITED : AWAITED + 2], paused[REGULAR : REGULAR + 2] = NO, -1000
    stamps = [k * MS for k in range(2, 12)]
    queued = [(name, stamp) for stamp in stamps for name in MOTION]
    loads = [(LOAD, stamp) for stamp in stamps]
    arrive(node, [*queued, *loads], [0] * len(queued) + [3] * len(loads))
    node.run()
    assert node.answers == [MS, *stamps]
    assert node.pipeline.matcher.counts.late_loads <= 1  # of the sample that was being taken


def test_messages_that_arrive_while_callbacks_are_registered_are_taken(open_node):
    """Those that were queued, and those that raise no event."""
    for place in range(4):
        for second in range(place, 5):

            def before(middleware: Middleware, places: tuple[int, int] = (place, second)) -> None:
                middleware.arriving = [
                    (at, name, message(name, MS)) for at, name in zip(places, MOTION, strict=True)
                ]

            node = open_node(MOTION, before)
            node.run()
            assert node.answers == [MS]


def test_a_stream_that_ends_leaves_no_sample_behind(open_node):
    """Loads come with each sample, then no more: the sample after the last is processed without."""
    node, order = open_node((*MOTION, LOAD)), (*MOTION, LOAD)
    for k in range(1, 10):
        arrive(node, [(name, k * MS) for name in order], [0, 3, 9])
        node.run()
    for k in range(10, 20):
        arrive(node, [(name, k * MS) for name in MOTION], [0, 3])
        node.run()
        if node.pipeline.decoder.waiting is not None:
            response = node.pipeline.give_up()
            assert response is not None
            node.answers.append(response.stamp)
    assert node.answers == [k * MS for k in range(1, 20)]


@pytest.mark.parametrize("order", list(itertools.permutations(MOTION)))
def test_a_constant_order_costs_one_wake_up_per_sample(order, open_node):
    node = open_node(MOTION)
    wakes = []
    for k in range(1, 20):
        arrive(node, [(name, k * MS) for name in order], [0, 40])
        wakes.append(node.run())
    assert wakes[-10:] == [1] * 10


def test_loads_before_each_sample_cost_no_wake_up(open_node):
    node = open_node((*MOTION, LOAD))
    wakes = []
    for k in range(1, 20):
        arrive(node, [(name, k * MS) for name in (LOAD, *MOTION)], [0, 40, 80])
        wakes.append(node.run())
    assert wakes[-10:] == [1] * 10
