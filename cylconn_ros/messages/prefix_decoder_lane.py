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
from typing import Any, Final

import numpy as np

from cylconn_ros.connector.frames import hold_load, turn_twist
from cylconn_ros.connector.synchronizer import Matched, SampleMatcher
from cylconn_ros.core import layout
from cylconn_ros.core.jit import device_function, kernel
from cylconn_ros.messages.prefix import ODOMETRIES, STREAMS, Form, body_of
from cylconn_ros.scene.scene import Scene

_POSSIBLE = sys.byteorder == "little"
_SECOND: Final = 1_000_000_000

FIRST: Final = 4
"""Where a message begins in its row, in bytes: its numbers are then aligned."""
ROW: Final = 1024
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
FOREIGN: Final = 7  # frames that named none of the scene, in samples since somebody asked
ORDER: Final = 8  # which streams have brought theirs, in that order
NSTATE: Final = ORDER + 4

# What is known of the messages of a stream.
SIZE: Final = 0  # bytes; -1: nothing
_AT: Final = 1  # where the numbers begin
_TWIST_AT: Final = 2  # and those of an odometry's twist
_TURNED: Final = 3  # whether the twist is in body axes
_FOREIGN: Final = 4  # frames that name none of the scene
NLIKE: Final = 5

NOT_ALIKE: Final = 0
KEPT: Final = 1
COMPLETE: Final = 2


@device_function
def bits_of(stream: int) -> int:
    """What a stream brings of a sample, a bit for each of the four poses and twists."""
    return 1 << stream if stream < ODOMETRIES else 3 << 2 * (stream - ODOMETRIES)


@device_function
def take(stream: int, size: int, state: Any, like: Any, model: Any, row: Any, words: Any) -> int:
    """Take the message of ``size`` bytes in a stream's row: NOT_ALIKE, KEPT or COMPLETE.

    Args:
        state: (NSTATE,). like: (STREAMS NLIKE,) what is known of the messages, by stream.
        model: (STREAMS ROW,) a message that it has to be like, by stream.
        row: (STREAMS ROW,) the messages, the same memory as ``words``: (STREAMS ROW / 4,).
    """
    bits, known = bits_of(stream), stream * NLIKE
    if state[OPEN] == 0 or state[NEEDED] & bits != bits or size != like[known + SIZE]:
        return NOT_ALIKE
    begin = stream * ROW + FIRST
    end = begin + like[known + _AT]
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
    elif stamp != state[STAMP] or state[HELD] & bits != 0:
        return NOT_ALIKE
    state[ORDER + state[COUNT]] = stream
    state[COUNT] += 1
    state[HELD] |= bits
    return COMPLETE if state[HELD] == state[NEEDED] else KEPT


@device_function
def fill(state: Any, like: Any, numbers: Any, loads: Any, axes: Any, sample: Any) -> None:
    """Write the complete sample to ``sample`` (NSAMPLE,) and hold nothing any more.

    ``numbers``: the rows as (STREAMS ROW / 8,) doubles. ``loads``, ``axes``: the matcher's.
    """
    for k in range(state[COUNT]):
        stream = state[ORDER + k]
        known = stream * NLIKE
        begin = stream * _NUMBERS + FIRST // 8
        at = begin + (like[known + _AT] + 4) // 8
        state[FOREIGN] += like[known + _FOREIGN]
        body = body_of(stream)
        pose, twist = layout.A_POSE, layout.A_TWIST
        if body == 1:
            pose, twist = layout.B_POSE, layout.B_TWIST
        if stream >= ODOMETRIES or stream & 1 == 0:
            for j in range(7):
                sample[pose + j] = numbers[at + j]
            at = begin + (like[known + _TWIST_AT] + 4) // 8
        if stream >= ODOMETRIES or stream & 1 == 1:
            for j in range(6):
                sample[twist + j] = numbers[at + j]
    for k in range(state[COUNT]):  # poses are there now
        stream = state[ORDER + k]
        if like[stream * NLIKE + _TURNED]:
            turn_twist(body_of(stream), sample)
    for body in range(2):
        hold_load(body, loads, axes, sample)
    state[HELD] = 0


@kernel
def _take(stream: int, size: int, state: Any, like: Any, model: Any, row: Any, words: Any) -> int:
    return take(stream, size, state, like, model, row, words)


@kernel
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
        self._state: memoryview[int] = self.state.data  # for Python, which reads it faster so
        self._state[NEEDED] = sum(1 << stream for stream in matcher.needed)
        self.like = np.full(STREAMS * NLIKE, -1, np.int64)
        self.model = np.zeros(STREAMS * ROW, np.uint8)
        self.numbers = np.zeros(STREAMS * _NUMBERS)
        self.row, self.words = self.numbers.view(np.uint8), self.numbers.view(np.int32)
        self._bytes: memoryview = self.row.data

    def learn(self, stream: int, form: Form | None, data: bytes) -> None:
        """Let messages of the form of ``data`` take this lane; none where it has no form."""
        known = stream * NLIKE
        self.like[known + SIZE] = -1
        if form is not None and _POSSIBLE and len(data) <= MOST_BYTES:
            at, size, twist_at, _ = form.numbers.tolist()
            self.like[known : known + NLIKE] = size, at, twist_at, form.turned, form.foreign
            begin = stream * ROW + FIRST
            self.model[begin : begin + size] = np.frombuffer(data, np.uint8)

    def follow(self) -> None:
        """Take over where the matcher is, after whatever it may have taken."""
        matcher, state = self.matcher, self._state
        last = matcher.last_stamp
        state[OPEN] = not matcher.waiting
        state[BEGUN] = last is not None
        state[LAST] = last or 0

    def take(self, stream: int, data: bytes) -> bool | Matched:
        """Take a message: a :class:`Matched` where it completes a sample, True where it is kept.

        False: it, and first what :meth:`give_back` gives, have to go the ordinary way.
        """
        size = len(data)
        if size != self.like[stream * NLIKE + SIZE] or self._state[HELD] & bits_of(stream):
            return False
        if not self._state[HELD]:
            self.follow()
        at = stream * ROW + FIRST
        self._bytes[at : at + size] = data
        found = _take(stream, size, self.state, self.like, self.model, self.row, self.words)
        if found != COMPLETE:
            return found == KEPT
        return self.complete(self._state[STAMP])

    def complete(self, stamp: int) -> Matched:
        """Hand what is held to the matcher as the sample at ``stamp``."""
        matcher = self.matcher
        matched = matcher.straight(stamp)
        _fill(
            self.state, self.like, self.numbers, matcher.load_numbers, matcher.load_axes,
            matcher.sample,
        )  # fmt: skip
        self.count_foreign()
        return matched

    def count_foreign(self) -> None:
        """Have the matcher count foreign frames of the samples since this was last called."""
        self.matcher.counts.foreign_frames += self._state[FOREIGN]
        self._state[FOREIGN] = 0

    @property
    def held(self) -> tuple[tuple[int, bytes], ...]:
        """Stream and bytes of what is held, in the order it came."""
        state = self._state
        if not state[HELD]:
            return ()
        return tuple(
            (stream, bytes(self._bytes[at : at + int(self.like[stream * NLIKE + SIZE])]))
            for stream in state[ORDER : ORDER + state[COUNT]].tolist()
            for at in (stream * ROW + FIRST,)
        )

    def give_back(self, ordinary: Callable[[int, bytes], object]) -> None:
        """Put what is held on the ordinary way."""
        held = self.held
        self._state[HELD] = 0
        for stream, data in held:
            ordinary(stream, data)


def prepare(scene: Scene) -> None:
    """Have everything compiled now, not while a sample waits."""
    lane = Lane(SampleMatcher(scene))
    lane.complete(0)
    _take(0, 0, lane.state, lane.like, lane.model, lane.row, lane.words)
