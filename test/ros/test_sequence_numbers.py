"""Lost messages are counted, and the executor leaves no message in a queue."""

import time
from types import SimpleNamespace

import pytest

from cylconn_ros.ros import qos
from cylconn_ros.ros.executor import executor, new_message_event
from cylconn_ros.ros.executor.sequence_numbers import SequenceNumbers


def lost(*numbers):
    counts: list[int] = []
    sequence = SequenceNumbers(counts.append)
    for number in numbers:
        sequence.check(number)
    return sum(counts)


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [
        ((), 0),
        ((1, 2, 3), 0),
        ((700, 701), 0),  # a publisher that started before
        ((1, 2, 5, 6, 9), 4),
        ((8, 9, 1, 2, 3), 0),  # a restarted publisher
        ((50, 1, 51, 2, 52, 53, 3, 4), 0),  # two publishers in turns
        ((None, None), 0),  # a middleware without numbers
    ],
)
def test_lost_messages_are_counted_by_sequence_numbers(numbers, expected):
    assert lost(*numbers) == expected


def test_message_lost_event_of_the_middleware_is_not_used():
    """rmw_fastrtps deadlocks if messages are lost while the status is taken."""
    assert qos.subscription_events(print)["event_callbacks"].message_lost is None


class Queue:
    """A subscription whose queue the test fills."""

    def __init__(self) -> None:
        self.waiting: list[bytes] = []
        self.topic_name, self.msg_type, self.handle = "/topic", bytes, self

    def take_message(self, _kind, _raw):
        return (self.waiting.pop(0), {"publication_sequence_number": 1}) if self.waiting else None


@pytest.fixture
def poller(monkeypatch):
    """A poller without events."""
    monkeypatch.setattr(executor, "MessageEvent", lambda _: None)
    return SimpleNamespace(register=lambda *_: None, arm=lambda *_: None)


def test_whole_queue_is_taken_if_its_first_message_completes_no_sample(poller):
    queue, taken = Queue(), []

    def receive(data):
        taken.append(data)
        return data == b"completes"

    subscription = executor.InputSubscription(queue, receive)
    group = executor.Group(executor.InputGroup([subscription]), print, poller, 0)
    queue.waiting += [b"completes"]
    group.process(1.0, [0])
    queue.waiting += [b"again", b"completes"]  # one event for both
    group.process(1.0005, [0])
    assert taken == [b"completes", b"again", b"completes"]
    assert group.due > 1.0005


def test_executor_polls_between_samples_at_short_intervals(poller):
    queue, now = Queue(), 1.0
    subscription = executor.InputSubscription(queue, lambda data: data == b"completes")
    group = executor.Group(executor.InputGroup([subscription]), print, poller, 0)

    def poll_until(after, data=b"completes"):
        nonlocal now
        now += after
        queue.waiting.append(data)
        group.process(now, [0])
        return group.poll_until

    for _ in range(20):  # 500 per second
        assert not poll_until(0.002)
        assert not poll_until(1e-6, b"part of a sample")
    for _ in range(20):  # two at a time
        assert not poll_until(0.0009)
        assert not poll_until(0.0001)
    assert not poll_until(0.002)
    assert not any(poll_until(0.0001) for _ in range(executor._IN_A_ROW - 1))
    assert poll_until(0.0001) == pytest.approx(now + executor._CLOSE)
    assert poll_until(0.0001) == pytest.approx(now + executor._CLOSE)
    assert not poll_until(0.002)


def test_poller_polls_first_and_blocks_afterwards(monkeypatch):
    poller, timeouts = new_message_event.EventPoller[int](), []
    poller._keys[7] = 3

    def poll(timeout):
        timeouts.append(timeout)
        return [(7, 1)] if len(timeouts) == 4 or timeout else []

    poller._epoll.close()
    monkeypatch.setattr(poller, "_epoll", SimpleNamespace(poll=poll))
    assert poller.wait(0.05, time.monotonic() + 60.0) == [3]
    assert timeouts == [0.0] * 4
    timeouts.clear()
    assert poller.wait(0.05, time.monotonic() - 1.0) == poller.wait(0.05) == [3]
    assert timeouts == [0.05, 0.05]
