"""The express lane: samples whose four messages come straight after each other, as nearly all do.

A publisher's messages differ in stamp and numbers only. So where the bytes before and between them
are those of the message before, nothing need be decoded: the numbers of a sample are copied as they
stand. Whatever is different (another frame, byte order, stamp, an order that leaves a sample
incomplete) is put back on the ordinary way, message by message in the order they came, so that the
result is the same; only the time is not.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Callable
from typing import NamedTuple

from cylconn_ros.connector.matching import PLACES, Matched, SampleMatcher

_LITTLE = b"\x00\x01\x00\x00"
_STAMP = struct.Struct("<iI")
_SECOND = 1_000_000_000
_POSSIBLE = sys.byteorder == "little"


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
        return cls(len(data), at, data[12:at]) if alike else None


class Lane:
    """Hold the messages of the sample under way.

    Attributes
    ----------
        likenesses: by stream, of those that may take this lane.
        held: messages of the sample under way, by stream, in the order they came.
    """

    def __init__(self, matcher: SampleMatcher) -> None:
        self._matcher = matcher
        self._needed = matcher.needed
        numbers = matcher.sample.data.cast("B")
        self._into = [numbers[8 * place.start : 8 * place.stop] for place in PLACES]
        self._stamp, self._time = b"", 0  # of what is held
        self.likenesses: dict[int, Likeness] = {}
        self.held: dict[int, bytes] = {}

    def take(self, stream: int, data: bytes) -> bool | Matched:
        """Take a message: a :class:`Matched` where it completes a sample, True where it is kept.

        False: it, and first what :meth:`give_back` gives, have to go the ordinary way.
        """
        like = self.likenesses.get(stream)
        if (
            like is None
            or len(data) != like.size
            or data[12 : like.at] != like.words
            or data[:4] != _LITTLE
        ):
            return False
        held, stamp = self.held, data[4:12]
        if (
            not held
        ):  # only what is newer than all before: nothing of it can complete a sample alone
            if self._matcher.waiting:
                return False
            seconds, nanoseconds = _STAMP.unpack(stamp)
            self._time = seconds * _SECOND + nanoseconds
            if nanoseconds >= _SECOND or not self._matcher.is_new(self._time):
                return False
            self._stamp = stamp
        elif stamp != self._stamp or stream in held:
            return False
        held[stream] = data
        if len(held) < len(self._needed):
            return True
        matched = self._matcher.straight(self._time)
        into, likenesses = self._into, self.likenesses
        for k, message in held.items():
            into[k][:] = message[likenesses[k].at :]
        held.clear()
        self._matcher.fill_loads()
        return matched

    def give_back(self, ordinary: Callable[[int, bytes], object]) -> None:
        """Put what is held on the ordinary way."""
        held, self.held = self.held, {}
        for stream, data in held.items():
            ordinary(stream, data)
