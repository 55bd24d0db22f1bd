"""The straight way: from the middleware's queues to its publishers in one compiled call.

:func:`serve` takes what has come, and where it makes a sample as nearly all do, answers it and
publishes the answer; it goes on while samples come. A message that is not like the others ends the
call, for the caller to have it served on the ordinary way and to call again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from cylconn_ros.connector import series
from cylconn_ros.core import layout
from cylconn_ros.core.compiled import COMPILED, call, entry, jit
from cylconn_ros.ros.express import lane, rcl
from cylconn_ros.ros.express.lane import COMPLETE, FIRST, NOT_ALIKE, ROW, Lane
from cylconn_ros.ros.express.letters import COUNT, Letters, write
from cylconn_ros.ros.express.tally import note
from cylconn_ros.ros.gaps import Gaps

_MONOTONIC: Final = 1  # the number of that clock
_WRENCHES: Final = 2  # the messages of an answer that are always published
_TAIL: Final = ROW - FIRST

# What a call tells, and is told.
ODD: Final = 0  # number of the input whose message is odd; -1: none is
LAST: Final = 1  # number of the input that completed the last sample; -1: none was
STAMP: Final = 2  # of the last sample, ns
BEFORE: Final = 3  # of the one before, ns
BEGUN: Final = 4  # whether there was one
UNSENT: Final = 5  # messages that could not be published
WANTED: Final = 6  # bits of the messages that are made whether anybody listens or not
NEXT: Final = 7  # number of the input to begin with; the one behind the odd message
NTOLD: Final = 8


@jit
def _now(addresses: Any, numbers: Any) -> float:
    """Seconds on the steady clock."""
    call(addresses[rcl.CLOCK], _MONOTONIC, addresses[rcl.NUMBERS], 0, 0)
    return numbers[0] + 1e-9 * numbers[1]


@jit
def _publish(addresses: Any, numbers: Any, publishers: Any, outbox: Any, told: Any) -> None:
    """Publish the wrenches, and of the rest what is wanted or somebody listens to."""
    for k in range(COUNT):
        if k >= _WRENCHES and not told[WANTED] >> k & 1:
            numbers[0] = 0
            call(addresses[rcl.LISTENERS], publishers[k], addresses[rcl.NUMBERS], 0, 0)
            if numbers[0] == 0:
                continue
        if call(addresses[rcl.PUBLISH], publishers[k], outbox[k], 0, 0) != 0:
            told[UNSENT] += 1


@entry
def _serve(
    told: Any, addresses: Any, info: Any, clock: Any,
    subscriptions: Any, streams: Any, expected: Any, boxes: Any, inbox: Any,
    held: Any, like: Any, model: Any, row_address: int, row: Any, words: Any, numbers: Any,
    loads: Any, axes: Any, sample: Any,
    method: int, par: Any, mem: Any, period: float, out: Any, tally: Any,
    places: Any, letters: Any, letter_words: Any, small: Any, publishers: Any, outbox: Any,
) -> int:  # fmt: skip
    """Serve what has come; the samples that were answered.

    Args:
        told: (NTOLD,). addresses, info, clock: of ``rcl.Memory``, the last being its numbers.
        subscriptions: (n,) addresses. streams: (n,) of each. expected: (n,) numbers of the next
            messages. boxes, inbox: memory and addresses of an ``rcl.Inbox`` of n.
        held, like, model, row, words, numbers: of a ``Lane``; row_address: where ``row`` is.
        loads, axes, sample: of its matcher.
        method, par, mem, period: of a ``Connector``. out, tally: of an ``Answering``.
        places, letters, letter_words, small: of ``Letters``. publishers, outbox: (COUNT,)
            addresses.
    """
    answered = 0
    told[ODD] = told[LAST] = -1
    while True:
        first, came = told[NEXT], 0
        told[NEXT] = 0
        for j in range(first, len(subscriptions)):
            taking = addresses[rcl.TAKE]
            if call(taking, subscriptions[j], inbox[j], addresses[rcl.INFO], 0) != 0:
                if answered > 0 and j == 0:
                    return answered  # nothing more has come of what comes first
                continue
            came += 1
            stream = streams[j]
            size = boxes[rcl.MESSAGE * j + rcl.LENGTH]
            fits = size <= _TAIL and not held[lane.HELD] >> stream & 1
            if info[rcl.SEQUENCE] != expected[j] or not fits:
                told[ODD], told[NEXT] = j, j + 1
                return answered
            expected[j] += 1
            to = row_address + stream * ROW + FIRST
            call(addresses[rcl.COPY], to, boxes[rcl.MESSAGE * j + rcl.BYTES], size, 0)
            taken = lane.take(stream, size, held, like, model, row, words)
            if taken == NOT_ALIKE:
                expected[j] -= 1  # not yet counted
                told[ODD], told[NEXT] = j, j + 1
                return answered
            if taken != COMPLETE:
                continue
            began = _now(addresses, clock)
            lane.fill(held, like, numbers, loads, axes, sample)
            stamp = held[lane.STAMP]
            h = (stamp - held[lane.LAST]) * 1e-9 if held[lane.BEGUN] else 0.0
            series.answer(method, par, mem, sample, h, period, out)
            out[layout.COMPUTING_TIME] = _now(addresses, clock) - began
            write(stamp, out, places, letters, letter_words, small)
            _publish(addresses, clock, publishers, outbox, told)
            note(tally, out, h, period)
            told[BEGUN], told[BEFORE], told[STAMP] = held[lane.BEGUN], held[lane.LAST], stamp
            held[lane.BEGUN], held[lane.LAST] = 1, stamp
            told[LAST] = j
            answered += 1
        if first == 0 and (came == 0 or held[lane.HELD]):
            return answered


def missing() -> str:
    """What this machine lacks for the straight way; mostly nothing."""
    return rcl.missing() if COMPILED else "numba"


def prepare(parts: Parts) -> None:
    """Have everything compiled now, not while a sample waits."""
    Straight([], [], parts, lambda _: None).take(lambda _: None)


class Parts(NamedTuple):
    """What answers a connector's samples, to be worked on by compiled code."""

    lane: Lane
    connector: tuple[int, np.ndarray, np.ndarray, float]  # Connector.lend()
    out: np.ndarray
    tally: np.ndarray
    letters: Letters


class Input(NamedTuple):
    """A subscription of rclpy, the stream it brings, and what takes its odd messages."""

    subscription: Any
    stream: int
    receive: Callable[[bytes], bool]
    gaps: Gaps


class Straight:
    """Serve a connector's poses and twists.

    Attributes
    ----------
        told: (NTOLD,) what the last call told; WANTED is the caller's.
        open: whether samples may go straight; otherwise all messages are odd.
    """

    def __init__(
        self,
        inputs: Sequence[Input],
        publishers: Sequence[Any],
        parts: Parts,
        answered: Callable[[int], object],
    ) -> None:
        """``publishers``: handles of rclpy for the messages of an answer.

        ``answered`` is told how many samples were, when :attr:`told` says which.
        """
        self.open, self._answered = True, answered
        self._inputs = list(inputs)
        self._memory = rcl.Memory()
        self._inbox = rcl.Inbox(len(inputs))
        self.told = np.zeros(NTOLD, np.int64)
        self._expected, self._subscriptions, self._streams = (
            np.array(found, np.int64)
            for found in (
                [one.gaps.expected for one in inputs],
                [one.subscription.handle.pointer for one in inputs],
                [one.stream for one in inputs],
            )
        )
        self._publishers = np.array([publisher.pointer for publisher in publishers], np.int64)
        self.use(parts)

    def use(self, parts: Parts) -> None:
        """Answer with these from now on."""
        held, letters = parts.lane, parts.letters
        self._lane, self._parts = held, parts
        self._outbox = rcl.Outbox(
            (letters.small.ctypes.data + letters.begins).tolist(), letters.sizes.tolist()
        )
        matcher, memory, inbox = held.matcher, self._memory, self._inbox
        self._arguments = (
            self.told, memory.addresses, memory.info, memory.numbers,
            self._subscriptions, self._streams, self._expected, inbox.memory, inbox.addresses,
            held.state, held.like, held.model, held.row.ctypes.data, held.row, held.words,
            held.numbers, matcher.load_numbers, matcher.load_axes, matcher.sample,
            *parts.connector, parts.out, parts.tally,
            letters.places, letters.numbers, letters.words, letters.small,
            self._publishers, self._outbox.addresses,
        )  # fmt: skip

    def take(self, caught: Callable[[Exception], object]) -> int | None:
        """Serve all that has come; the number of the input that completed the last sample.

        ``caught`` gets what serving an odd message raises.
        """
        last = None
        while True:
            self._lane.follow(self.open)
            answered = _serve(*self._arguments)
            if answered:
                last = int(self.told[LAST])
                self._answered(answered)
            k = int(self.told[ODD])
            if k < 0:
                return last
            try:
                if self._take_odd(k):
                    last = k
            except Exception as error:
                caught(error)

    def _take_odd(self, k: int) -> bool:
        """Have the odd message served on the ordinary way; whether it completed a sample."""
        one, number = self._inputs[k], int(self._memory.info[rcl.SEQUENCE])
        one.gaps.expected = int(self._expected[k])
        one.gaps.look(number)
        self._expected[k] = one.gaps.expected
        return one.receive(self._inbox.message(k))

    def close(self) -> None:
        """Give memory back; not to be used any more."""
        self._inbox.close()
