"""Messages that never came are counted, and one that is left in its queue is not forgotten."""

import time
from types import SimpleNamespace

import pytest

from cylconn_ros.ros import qos
from cylconn_ros.ros.executor import executor, new_message_event
from cylconn_ros.ros.executor.sequence_numbers import Gaps


def counted(*numbers):
    missing: list[int] = []
    gaps = Gaps(missing.append)
    for number in numbers:
        gaps.look(number)
    return sum(missing)


@pytest.mark.parametrize(
    ("numbers", "missing"),
    [
        ((), 0),
        ((1, 2, 3), 0),
        ((700, 701), 0),  # a publisher that was there before
        ((1, 2, 5, 6, 9), 4),
        ((8, 9, 1, 2, 3), 0),  # started anew
        ((50, 1, 51, 2, 52, 53, 3, 4), 0),  # two publishers in turns
        ((None, None), 0),  # a middleware without numbers
    ],
)
def test_gaps_are_messages_that_never_came(numbers, missing):
    assert counted(*numbers) == missing


def test_lost_messages_are_not_asked_of_the_middleware():
    """It locks up over the answer where more are lost meanwhile."""
    assert qos.reading(print)["event_callbacks"].message_lost is None


class Queue:
    """A subscription whose messages are put there by hand."""

    def __init__(self) -> None:
        self.waiting: list[bytes] = []
        self.topic_name, self.msg_type, self.handle = "/topic", bytes, self

    def take_message(self, _kind, _raw):
        return (self.waiting.pop(0), {"publication_sequence_number": 1}) if self.waiting else None


@pytest.fixture
def silent_bells(monkeypatch):
    made = SimpleNamespace(tie=lambda _: None, close=lambda: None)
    monkeypatch.setattr(new_message_event, "Bell", lambda _: made)


def test_what_rang_for_several_and_completes_nothing_is_taken_whole(silent_bells):
    queue, taken = Queue(), []

    def receive(data):
        taken.append(data)
        return data == b"completes"

    group = executor._Group(executor.Inputs([executor.Entry(queue, receive)]), print)
    queue.waiting += [b"completes"]
    group.serve(1.0)
    queue.waiting += [b"again", b"completes"]  # one ringing for both
    group.serve(1.0005)
    assert taken == [b"completes", b"again", b"completes"]
    assert group.due > 1.0005


def test_between_close_samples_nobody_sleeps(silent_bells):
    queue, now = Queue(), 1.0
    group = executor._Group(
        executor.Inputs([executor.Entry(queue, lambda data: data == b"completes")]), print
    )

    def awake(after, data=b"completes"):
        nonlocal now
        now += after
        queue.waiting.append(data)
        group.serve(now)
        return group.awake

    assert not any(awake(0.002) or awake(1e-6, b"part of one") for _ in range(20))  # 500 a second
    assert not any(awake(0.0009) or awake(0.0001) for _ in range(20))  # two at a time
    assert not awake(0.002)
    assert not any(awake(0.0001) for _ in range(executor._IN_A_ROW - 1))
    assert awake(0.0001) == pytest.approx(now + executor._CLOSE)
    assert awake(0.0001) == pytest.approx(now + executor._CLOSE)
    assert not awake(0.002)


def test_an_ear_looks_while_awake_and_sleeps_after_that(monkeypatch):
    ear, asked = new_message_event.Ear(), []
    ear._numbers[7] = 3

    def poll(timeout):
        asked.append(timeout)
        return [(7, 1)] if len(asked) == 4 or timeout else []

    ear._poll.close()
    monkeypatch.setattr(ear, "_poll", SimpleNamespace(poll=poll))
    assert ear.wait(0.05, time.monotonic() + 60.0) == [3]
    assert asked == [0.0] * 4
    asked.clear()
    assert ear.wait(0.05, time.monotonic() - 1.0) == ear.wait(0.05) == [3]
    assert asked == [0.05, 0.05]
