"""Messages of one or more files in order of log time, in bounded memory.

The units of a file (chunks) state their least and greatest log time. Units that do not overlap in
time follow each other. Those that overlap are merged in time windows of about
:data:`WINDOW` bytes: each window reads the units that reach into it. Equal times keep the order of
the files, and within a file the order of recording.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from cylconn_ros.recording.files.storage import Unit
from cylconn_ros.recording.mcap import message_block
from cylconn_ros.recording.mcap.message_block import MessageBlock

WINDOW = 1 << 24
"""Bytes of messages that are merged at once, as estimated from the units."""
_MOST = 4  # windows; more in one is divided again
_JOINED = 1 << 20  # bytes up to which consecutive blocks are joined


class Place(NamedTuple):
    """A unit of one of several files."""

    file: int
    unit: Unit

    @property
    def position(self) -> tuple[int, int]:
        """Order of recording."""
        return self.file, self.unit.begin


Load = Callable[[Place, int, int], Iterable[MessageBlock]]
"""Returns the messages of a place with begin <= log time < end (ns), in order of log time."""


def in_order(load: Load, places: Sequence[Place]) -> Iterator[tuple[MessageBlock, int]]:
    """Yield the messages of all places by log time, each block with the bytes of files behind it.

    Args:
        load: reads a place.
        places: the units of all files.
    """
    ordered = sorted(places, key=lambda place: (place.unit.first, *place.position))
    done = 0
    for group in _groups(ordered):
        done += sum(place.unit.end - place.unit.begin for place in group)
        for block in _blocks(load, group):
            yield block, done


def joined(blocks: Iterable[tuple[MessageBlock, int]]) -> Iterator[tuple[MessageBlock, int]]:
    """Join consecutive small blocks."""
    waiting: list[MessageBlock] = []
    size = done = 0
    for block, done in blocks:
        waiting.append(block)
        size += len(block.raw)
        if size >= _JOINED:
            yield message_block.concatenate(waiting), done
            waiting, size = [], 0
    if waiting:
        yield message_block.concatenate(waiting), done


def _groups(ordered: Sequence[Place]) -> Iterator[list[Place]]:
    """Divide places, by their first time, into groups that do not overlap in time."""
    group: list[Place] = []
    last, position = -1, (-1, -1)
    for place in ordered:
        first = place.unit.first
        if group and (first > last or (first == last and place.position > position)):
            yield group
            group, last, position = [], -1, (-1, -1)
        group.append(place)
        last, position = max(last, place.unit.last), max(position, place.position)
    if group:
        yield group


def _blocks(load: Load, group: Sequence[Place]) -> Iterator[MessageBlock]:
    """Yield the messages of places that overlap in time."""
    begin = min(place.unit.first for place in group)
    end = max(place.unit.last for place in group) + 1
    if len(group) == 1:
        yield from load(group[0], begin, end)
        return
    places = sorted(group, key=lambda place: place.position)
    start = np.array([place.unit.first - begin for place in places], np.float64)
    length = np.array([place.unit.last - place.unit.first + 1 for place in places], np.float64)
    size = np.array([place.unit.size for place in places], np.float64)
    origin = begin

    def until(time: int) -> float:
        """Estimate the bytes of the messages before ``time``."""
        return float((size * np.clip((time - origin - start) / length, 0.0, 1.0)).sum())

    while begin < end:
        stop = _last_below(until, until(begin) + WINDOW, begin, end)
        found = _window(load, places, begin, stop)
        while found is None and stop - begin > 1:
            stop = begin + (stop - begin) // 2
            found = _window(load, places, begin, stop)
        if found is not None:
            if len(found):
                yield found
        else:  # more at one time than a window holds: in the order of recording
            for place in _within(places, begin, stop):
                yield from load(place, begin, stop)
        begin = stop


def _last_below(until: Callable[[int], float], limit: float, begin: int, end: int) -> int:
    """Return the greatest time up to ``end``, after ``begin``, before which there is ``limit``."""
    low, high = begin + 1, end
    while low < high:
        middle = (low + high + 1) // 2
        if until(middle) <= limit:
            low = middle
        else:
            high = middle - 1
    return low


def _within(places: Sequence[Place], begin: int, end: int) -> list[Place]:
    return [p for p in places if p.unit.first < end and p.unit.last >= begin]


def _window(load: Load, places: Sequence[Place], begin: int, end: int) -> MessageBlock | None:
    """Return the messages of a window; None if they are too many."""
    parts, size = [message_block.empty()], 0
    for place in _within(places, begin, end):
        for block in load(place, begin, end):
            parts.append(block)
            size += len(block.raw)
            if size > _MOST * WINDOW:
                return None
    return message_block.by_time(message_block.concatenate(parts))
