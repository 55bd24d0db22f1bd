"""The straight way: from the middleware's queues to its publishers in one compiled call.

It takes what has come, and where it makes a sample as nearly all do, answers it and
publishes the answer; it goes on while samples come. A message that is not like the others ends the
call, for the caller to have it served on the ordinary way and to call again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from cylconn_ros.connector import batch
from cylconn_ros.core import layout
from cylconn_ros.core.jit import COMPILED, call, device_function, kernel
from cylconn_ros.messages import prefix_decoder_lane
from cylconn_ros.messages.prefix_decoder_lane import (
    COMPLETE,
    FIRST,
    MOST_BYTES,
    NOT_ALIKE,
    ROW,
    Lane,
)
from cylconn_ros.messages.statistics import note
from cylconn_ros.messages.templates import BEGIN, COUNT, SIZE, Letters, write
from cylconn_ros.recording.chunk_buffer import Tray
from cylconn_ros.recording.kernels import put
from cylconn_ros.recording.writer import RunWriter
from cylconn_ros.ros.executor import rcl
from cylconn_ros.ros.executor.sequence_numbers import Gaps

_REAL, _MONOTONIC = 0, 1  # the numbers of those clocks
_WRENCHES: Final = 2  # the messages of an answer that are published whether somebody listens or not

# What a call tells, and is told.
ODD: Final = 0  # number of the input whose message is odd; -1: none is
LAST: Final = 1  # number of the input that completed the last sample; -1: none was
STAMP: Final = 2  # of the last sample, ns
BEFORE: Final = 3  # of the one before, ns
BEGUN: Final = 4  # whether there was one
UNSENT: Final = 5  # messages that could not be published
NEXT: Final = 6  # number of the input to begin with; the one behind the odd message
MOST: Final = 7  # samples that may be answered in the call
RECORDING: Final = 8  # whether messages are recorded
NTOLD: Final = 9
_ALL = 1 << 30
_NO_TRAY = Tray(0, np.zeros((2, 1), np.int64)).arrays
_AT_ONCE = 4  # samples, while recording


@device_function
def _now(addresses: Any, clock: Any) -> float:
    """Seconds on the steady clock."""
    call(addresses[rcl.CLOCK], _MONOTONIC, addresses[rcl.NUMBERS], 0, 0)
    return clock[0] + 1e-9 * clock[1]


@device_function
def _time_of_day(addresses: Any, clock: Any) -> int:
    """Nanoseconds since the epoch."""
    call(addresses[rcl.CLOCK], _REAL, addresses[rcl.NUMBERS], 0, 0)
    return clock[0] * 1_000_000_000 + clock[1]


@device_function
def _is_heard(k: int, addresses: Any, clock: Any, publishers: Any) -> bool:
    """Whether message ``k`` of an answer is published: a wrench always, the rest where heard."""
    if k < _WRENCHES:
        return True
    clock[0] = 0
    call(addresses[rcl.LISTENERS], publishers[k], addresses[rcl.NUMBERS], 0, 0)
    return clock[0] != 0


@kernel
def _serve(
    told: Any, addresses: Any, info: Any, clock: Any,
    subscriptions: Any, streams: Any, expected: Any, boxes: Any, inbox: Any,
    held: Any, like: Any, model: Any, row_address: int, row: Any, words: Any, numbers: Any,
    loads: Any, axes: Any, sample: Any,
    method: int, par: Any, mem: Any, period: float, out: Any, tally: Any,
    places: Any, letters: Any, letter_words: Any, small: Any, publishers: Any, outbox: Any,
    records: Any, entries: Any, used: Any, counts: Any, channels: Any,
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
        records, entries, used, counts: of a ``Tray``. channels: (n + COUNT,) of the inputs and of
            the messages of an answer.
    """
    answered, count, recording = 0, len(subscriptions), told[RECORDING] != 0
    told[ODD] = told[LAST] = -1
    while answered < told[MOST]:
        first, came = told[NEXT], 0
        told[NEXT] = 0
        for j in range(first, count):
            taking = addresses[rcl.TAKE]
            if call(taking, subscriptions[j], inbox[j], addresses[rcl.INFO], 0) != 0:
                if answered > 0 and j == 0:
                    return answered  # nothing more has come of what comes first
                continue
            came += 1
            stream = streams[j]
            size = boxes[rcl.MESSAGE * j + rcl.LENGTH]
            fits = (
                size <= MOST_BYTES
                and held[prefix_decoder_lane.HELD] & prefix_decoder_lane.bits_of(stream) == 0
            )
            begin = stream * ROW + FIRST
            taken = NOT_ALIKE
            if info[rcl.SEQUENCE] == expected[j] and fits:
                of = boxes[rcl.MESSAGE * j + rcl.BYTES]
                call(addresses[rcl.COPY], row_address + begin, of, size, 0)
                taken = prefix_decoder_lane.take(stream, size, held, like, model, row, words)
            if taken == NOT_ALIKE:
                told[ODD], told[NEXT] = j, j + 1
                return answered
            expected[j] += 1
            if recording:
                now = _time_of_day(addresses, clock)
                data = row[begin : begin + size]
                put(records, entries, used, counts, channels[j], now, now, data, size)
            if taken != COMPLETE:
                continue
            began = _now(addresses, clock)
            prefix_decoder_lane.fill(held, like, numbers, loads, axes, sample)
            stamp = held[prefix_decoder_lane.STAMP]
            h = (
                (stamp - held[prefix_decoder_lane.LAST]) * 1e-9
                if held[prefix_decoder_lane.BEGUN]
                else 0.0
            )
            batch.answer(method, par, mem, sample, h, period, out)
            out[layout.COMPUTING_TIME] = _now(addresses, clock) - began
            write(stamp, out, places, letters, letter_words, small)
            now = _time_of_day(addresses, clock) if recording else 0
            for k in range(COUNT):
                heard = _is_heard(k, addresses, clock, publishers)
                if heard and call(addresses[rcl.PUBLISH], publishers[k], outbox[k], 0, 0) != 0:
                    told[UNSENT] += 1
                if recording:
                    begin, size = places[BEGIN + k], places[SIZE + k]
                    data, to = small[begin : begin + size], channels[count + k]
                    put(records, entries, used, counts, to, now, now, data, size)
            note(tally, out, h, period)
            told[BEGUN], told[BEFORE], told[STAMP] = (
                held[prefix_decoder_lane.BEGUN],
                held[prefix_decoder_lane.LAST],
                stamp,
            )
            held[prefix_decoder_lane.BEGUN], held[prefix_decoder_lane.LAST] = 1, stamp
            told[LAST] = j
            answered += 1
        if first == 0 and (came == 0 or held[prefix_decoder_lane.HELD]):
            return answered
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
    """Serve what a connector is told of its bodies' motion.

    Attributes
    ----------
        told: (NTOLD,) what the last call told, whole numbers.
        writer: what records, or None.
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
        self._answered = answered
        self._inputs = list(inputs)
        self._memory = rcl.Memory()
        self._inbox = rcl.Inbox(len(inputs))
        told = np.zeros(NTOLD, np.int64)
        self._told_array, self.told = told, told.data  # memory that Python reads faster so
        self._expected, self._subscriptions, self._streams = (
            np.array(found, np.int64)
            for found in (
                [one.gaps.expected for one in inputs],
                [one.subscription.handle.pointer for one in inputs],
                [one.stream for one in inputs],
            )
        )
        self._publishers = np.array([publisher.pointer for publisher in publishers], np.int64)
        self._messages = _AT_ONCE * (len(inputs) + COUNT)
        self.record(None)
        self.use(parts)

    def use(self, parts: Parts) -> None:
        """Answer with these from now on."""
        held, letters = parts.lane, parts.letters
        self._lane, self._parts = held, parts
        self._outbox = rcl.Outbox(letters.addresses, letters.sizes.tolist())
        self._largest = max(MOST_BYTES, *letters.sizes.tolist())
        matcher, memory, inbox = held.matcher, self._memory, self._inbox
        self._arguments = (
            self._told_array, memory.addresses, memory.info, memory.numbers,
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
        last, told = None, self.told
        while True:
            self._lane.follow()
            answered = self._serve()
            if answered:
                self._lane.count_foreign()
                last = told[LAST]
                self._answered(answered)
            k = told[ODD]
            if k < 0:
                if answered < told[MOST]:
                    return last
                continue
            try:
                if self._take_odd(k):
                    last = k
            except Exception as error:
                caught(error)

    def record(self, writer: RunWriter | None, channels: Sequence[int] = ()) -> None:
        """Record from now on with ``writer``, or not.

        ``channels``: in the file, of the inputs and of the messages of an answer.
        """
        self.writer = writer
        recording = writer is not None
        self.told[RECORDING], self.told[MOST] = recording, _AT_ONCE if recording else _ALL
        self._channels = np.array(channels, np.int64)

    def _serve(self) -> int:
        writer = self.writer
        if writer is None:
            return _serve(*self._arguments, *_NO_TRAY, self._channels)
        with writer.lock:
            tray = writer.tray(self._messages, self._messages * self._largest)
            return _serve(*self._arguments, *tray.arrays, self._channels)

    def _take_odd(self, k: int) -> bool:
        """Have the odd message served on the ordinary way; whether it completed a sample."""
        one, number = self._inputs[k], int(self._memory.info[rcl.SEQUENCE])
        one.gaps.expected = int(self._expected[k])
        one.gaps.look(number if number >= 0 else None)  # -1: the middleware has no numbers
        self._expected[k] = one.gaps.expected
        return one.receive(self._inbox.message(k))

    def close(self) -> None:
        """Give memory back; not to be used any more."""
        self._inbox.close()
