"""The express lane: samples whose four messages come straight after each other, as nearly all do.

A publisher's messages differ in stamp and numbers only. So where the bytes before and between them
are those of the message before, nothing need be decoded: the numbers of a sample are copied as they
stand. Whatever is different (another frame, byte order, stamp, an order that leaves a sample
incomplete) is put back on the ordinary way, message by message in the order they came, so that the
result is the same; only the time is not.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np

from cylconn_ros.connector.axes import hold_load
from cylconn_ros.connector.matching import PLACES, Matched, SampleMatcher
from cylconn_ros.connector.scene import Scene
from cylconn_ros.core.compiled import entry, jit

_LITTLE = b"\x00\x01\x00\x00"
_POSSIBLE = sys.byteorder == "little"
_SECOND: Final = 1_000_000_000

STREAMS: Final = 4
FIRST: Final = 4
"""Where a message begins in its row, in bytes: its numbers are then aligned."""
ROW: Final = 512
"""Bytes of a row."""
MOST_BYTES: Final = ROW - FIRST
"""Bytes of a message at most."""
_NUMBERS: Final = ROW // 8
_WORDS: Final = ROW // 4
_STAMP: Final = 8  # in a row

# The state of a lane, whole numbers.
OPEN: Final = 0  # whether messages may take it
NEEDED: Final = 1  # bits of the streams a sample needs
HELD: Final = 2  # bits of the streams that have brought theirs
COUNT: Final = 3  # how many those are
STAMP: Final = 4  # of the sample under way, ns
BEGUN: Final = 5  # whether there was a sample before
LAST: Final = 6  # its stamp, ns
ORDER: Final = 7  # which streams have brought theirs, in that order
NSTATE: Final = ORDER + STREAMS

NOT_ALIKE: Final = 0
KEPT: Final = 1
COMPLETE: Final = 2

_AT: Final = tuple(place.start for place in PLACES)
_SIZE: Final = tuple(place.stop - place.start for place in PLACES)


class Likeness(NamedTuple):
    """What the messages of a stream have in common: all but the stamp and the numbers."""

    size: int  # bytes of a message
    at: int  # where the numbers begin
    words: bytes  # what stands between stamp and numbers

    @classmethod
    def of(cls, data: bytes, numbers: int) -> Likeness | None:
        """The likeness of a message that ends in ``numbers`` doubles; None where it has none."""
        at = len(data) - 8 * numbers
        alike = _POSSIBLE and data[:4] == _LITTLE and at >= 12 and (at - 4) % 8 == 0
        return cls(len(data), at, data[12:at]) if alike and len(data) <= MOST_BYTES else None


@jit
def take(stream: int, size: int, state: Any, like: Any, model: Any, row: Any, words: Any) -> int:
    """Take the message of ``size`` bytes in a stream's row: NOT_ALIKE, KEPT or COMPLETE.

    Args:
        state: (NSTATE,). like: (2 STREAMS,) size and place of the numbers, by stream.
        model: (STREAMS ROW,) a message that it has to be like, by stream.
        row: (STREAMS ROW,) the messages, the same memory as ``words``: (STREAMS ROW / 4,).
    """
    bit = 1 << stream
    if state[OPEN] == 0 or state[NEEDED] & bit == 0 or size != like[2 * stream]:
        return NOT_ALIKE
    begin = stream * ROW + FIRST
    end = begin + like[2 * stream + 1]
    for k in range(begin, begin + 4):
        if row[k] != model[k]:
            return NOT_ALIKE
    for k in range(begin + 12, end):
        if row[k] != model[k]:
            return NOT_ALIKE
    at = stream * _WORDS + _STAMP // 4
    nanoseconds = words[at + 1]
    if nanoseconds < 0 or nanoseconds >= _SECOND:
        return NOT_ALIKE
    stamp = words[at] * _SECOND + nanoseconds
    if state[HELD] == 0:
        # Only what is newer than all before: nothing of it can complete a sample alone.
        if state[BEGUN] != 0 and stamp <= state[LAST]:
            return NOT_ALIKE
        state[STAMP] = stamp
        state[COUNT] = 0
    elif stamp != state[STAMP] or state[HELD] & bit != 0:
        return NOT_ALIKE
    state[ORDER + state[COUNT]] = stream
    state[COUNT] += 1
    state[HELD] |= bit
    return COMPLETE if state[HELD] == state[NEEDED] else KEPT


@jit
def fill(state: Any, like: Any, numbers: Any, loads: Any, axes: Any, sample: Any) -> None:
    """Write the complete sample to ``sample`` (NSAMPLE,) and hold nothing any more.

    ``numbers``: the rows as (STREAMS ROW / 8,) doubles. ``loads``, ``axes``: the matcher's.
    """
    for stream in range(STREAMS):
        if state[HELD] >> stream & 1:
            at = stream * _NUMBERS + (FIRST + like[2 * stream + 1]) // 8
            for k in range(_SIZE[stream]):
                sample[_AT[stream] + k] = numbers[at + k]
    for body in range(2):
        hold_load(body, loads, axes, sample)
    state[HELD] = 0


@entry
def _take(stream: int, size: int, state: Any, like: Any, model: Any, row: Any, words: Any) -> int:
    return take(stream, size, state, like, model, row, words)


@entry
def _fill(state: Any, like: Any, numbers: Any, loads: Any, axes: Any, sample: Any) -> None:
    fill(state, like, numbers, loads, axes, sample)


class Lane:
    """Hold the messages of the sample under way.

    Attributes
    ----------
        state, like, model, row, words, numbers: as :func:`take` and :func:`fill` have them.
        matcher: who takes what is complete.
    """

    def __init__(self, matcher: SampleMatcher) -> None:
        self.matcher = matcher
        self.state = np.zeros(NSTATE, np.int64)
        self.state[NEEDED] = sum(1 << stream for stream in matcher.needed)
        self.like = np.full(2 * STREAMS, -1, np.int64)
        self.model = np.zeros(STREAMS * ROW, np.uint8)
        self.numbers = np.zeros(STREAMS * _NUMBERS)
        self.row, self.words = self.numbers.view(np.uint8), self.numbers.view(np.int32)
        self._bytes: memoryview = self.row.data

    def learn(self, stream: int, likeness: Likeness | None, data: bytes) -> None:
        """Let messages that are like ``data`` take this lane; none where it has no likeness."""
        self.like[2 * stream] = -1
        if likeness is not None:
            self.like[2 * stream : 2 * stream + 2] = likeness[:2]
            at = stream * ROW + FIRST
            self.model[at : at + len(data)] = np.frombuffer(data, np.uint8)

    def follow(self) -> None:
        """Take over where the matcher is, after whatever it may have taken."""
        matcher, state = self.matcher, self.state
        last = matcher.last_stamp
        state[OPEN] = not matcher.waiting
        state[BEGUN] = last is not None
        state[LAST] = last or 0

    def take(self, stream: int, data: bytes) -> bool | Matched:
        """Take a message: a :class:`Matched` where it completes a sample, True where it is kept.

        False: it, and first what :meth:`give_back` gives, have to go the ordinary way.
        """
        size = len(data)
        if size != self.like[2 * stream] or self.state[HELD] >> stream & 1:
            return False
        if not self.state[HELD]:
            self.follow()
        at = stream * ROW + FIRST
        self._bytes[at : at + size] = data
        found = _take(stream, size, self.state, self.like, self.model, self.row, self.words)
        if found != COMPLETE:
            return found == KEPT
        return self.complete(int(self.state[STAMP]))

    def complete(self, stamp: int) -> Matched:
        """Hand what is held to the matcher as the sample at ``stamp``."""
        matcher = self.matcher
        matched = matcher.straight(stamp)
        _fill(
            self.state, self.like, self.numbers, matcher.load_numbers, matcher.load_axes,
            matcher.sample,
        )  # fmt: skip
        return matched

    @property
    def held(self) -> tuple[tuple[int, bytes], ...]:
        """Stream and bytes of what is held, in the order it came."""
        state = self.state
        if not state[HELD]:
            return ()
        return tuple(
            (stream, bytes(self._bytes[at : at + int(self.like[2 * stream])]))
            for stream in state[ORDER : ORDER + state[COUNT]].tolist()
            for at in (stream * ROW + FIRST,)
        )

    def give_back(self, ordinary: Callable[[int, bytes], object]) -> None:
        """Put what is held on the ordinary way."""
        held = self.held
        self.state[HELD] = 0
        for stream, data in held:
            ordinary(stream, data)


def prepare(scene: Scene) -> None:
    """Have everything compiled now, not while a sample waits."""
    lane = Lane(SampleMatcher(scene))
    lane.complete(0)
    _take(0, 0, lane.state, lane.like, lane.model, lane.row, lane.words)
