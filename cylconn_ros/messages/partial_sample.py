"""The partly received sample: messages with known prefixes, and their numbers (compiled).

The source of a message is the memory it is in, seen as uint64 and as float64 numbers that begin at
every byte. The state of the sample is an int64 array.

A sample that waits for an awaited load (connector/load_history.py) stays partly received, although
all its poses and twists are there.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from cylconn_ros.connector.frames import rotate_twist, write_load
from cylconn_ros.connector.load_history import is_settled, select_loads
from cylconn_ros.core import layout
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.messages import prefix
from cylconn_ros.messages.prefix import MAX_WORDS, NCOLUMN
from cylconn_ros.scene.inputs import STREAMS

_SECOND: Final = 1_000_000_000
_LITTLE_ENDIAN: Final = 256  # encapsulation header of little-endian plain CDR, as a number
_STAMP: Final = 4  # offset of the stamp in a message

# State of the partly received sample: the indices of an int64 array.
OPEN: Final = 0  # 1: messages may be decoded here
NEEDED: Final = 1  # bits of the quantities of a sample (connector/synchronizer.py)
RECEIVED: Final = 2  # bits of the quantities that are received
COUNT: Final = 3  # messages received
STAMP: Final = 4  # of the partly received sample, ns
HAS_LAST: Final = 5  # 1: a sample was complete before
LAST: Final = 6  # stamp of the last complete sample, ns
UNKNOWN_FRAMES: Final = 7  # frames that are no frame of the scene, in samples not yet counted
ORDER: Final = 8  # (4,) streams of the received messages in their order
BEGIN: Final = ORDER + 4  # (NSTREAM,) offset of the message of each stream in the source
NPARTIAL: Final = BEGIN + len(STREAMS)

# Results of accept().
MISMATCH: Final = 0  # the message takes the reference path
ACCEPTED: Final = 1
COMPLETE: Final = 2  # the message completes the sample


@device_function
def quantities(stream: int, columns: Any) -> int:
    """Bits of the quantities that the messages of a stream carry."""
    return columns[stream * NCOLUMN + prefix.QUANTITIES]


@inline_function
def message_stamp(begin: int, words: Any) -> int:
    """Stamp in ns of the message at ``begin``; ``words``: as for :func:`accept`."""
    word = words[begin + _STAMP]
    seconds: Any = np.int64(np.int32(word & np.uint64(0xFFFFFFFF)))
    stamp: int = seconds * _SECOND + np.int64(word >> np.uint64(32))
    return stamp


@inline_function
def accept(
    stream: int, begin: int, size: int, words: Any, columns: Any, prefixes: Any, partial: Any,
    load_state: Any,
) -> int:  # fmt: skip
    """Add a message to the partly received sample: MISMATCH, ACCEPTED or COMPLETE.

    A sample that waits for a load is not complete.

    Args:
        begin, size: the message in its source, bytes.
        words: the source as uint64 numbers that begin at every byte.
        columns, prefixes: of a :class:`~cylconn_ros.messages.prefix.PrefixTable`.
        partial: (NPARTIAL,) state of the partly received sample; unchanged after a MISMATCH.
        load_state: of a :class:`~cylconn_ros.connector.load_history.LoadHistory`.
    """
    row = stream * NCOLUMN
    bits = columns[row + prefix.QUANTITIES]
    if partial[OPEN] == 0 or partial[NEEDED] & bits != bits or size != columns[row + prefix.SIZE]:
        return MISMATCH
    if words[begin] & np.uint64(0xFFFFFFFF) != np.uint64(_LITTLE_ENDIAN):
        return MISMATCH
    known, first = stream * MAX_WORDS, begin + prefix.FIRST_WORD
    for i in range(columns[row + prefix.WORDS]):
        if words[first + 8 * i] != prefixes[known + i]:
            return MISMATCH
    if np.int64(words[begin + _STAMP] >> np.uint64(32)) >= _SECOND:
        return MISMATCH
    stamp = message_stamp(begin, words)
    if partial[RECEIVED] == 0:
        # Only a stamp newer than all before: an older one may be a repetition or a restart. With
        # the first sample of a history the synchronizer decides which loads are awaited.
        if partial[HAS_LAST] == 0 or stamp <= partial[LAST]:
            return MISMATCH
        partial[STAMP] = stamp
        partial[COUNT] = 0
    elif stamp != partial[STAMP] or partial[RECEIVED] & bits != 0:
        return MISMATCH
    partial[ORDER + partial[COUNT]] = stream
    partial[BEGIN + stream] = begin
    partial[COUNT] += 1
    partial[RECEIVED] |= bits
    return COMPLETE if is_complete(partial, load_state) else ACCEPTED


@inline_function
def is_complete(partial: Any, load_state: Any) -> bool:
    """Whether all poses and twists of the sample are received and it waits for no load."""
    return partial[RECEIVED] == partial[NEEDED] and is_settled(partial[STAMP], load_state)


@inline_function
def copy_numbers(numbers: Any, begin: int, row: int, columns: Any, sample: Any) -> None:
    """Copy the pose and twist of the message at ``begin`` to a sample (NSAMPLE,).

    ``numbers``: the source as float64 numbers that begin at every byte. ``row``: the begin of the
    stream's row in ``columns``.
    """
    pose, twist = layout.A_POSE, layout.A_TWIST
    if columns[row + prefix.BODY] == 1:
        pose, twist = layout.B_POSE, layout.B_TWIST
    offset = columns[row + prefix.POSE]
    if offset >= 0:
        for j in range(7):
            sample[pose + j] = numbers[begin + offset + 8 * j]
    offset = columns[row + prefix.TWIST]
    if offset >= 0:
        for j in range(6):
            sample[twist + j] = numbers[begin + offset + 8 * j]


@inline_function
def write_sample(
    numbers: Any, columns: Any, partial: Any, loads: Any, load_state: Any, sample: Any
) -> None:
    """Write the complete sample to ``sample`` (NSAMPLE,), world axes, and begin the next one.

    ``loads``, ``load_state``: of a :class:`~cylconn_ros.connector.load_history.LoadHistory`.
    """
    for k in range(partial[COUNT]):
        stream = partial[ORDER + k]
        row = stream * NCOLUMN
        copy_numbers(numbers, partial[BEGIN + stream], row, columns, sample)
        partial[UNKNOWN_FRAMES] += columns[row + prefix.UNKNOWN_FRAMES]
    for k in range(partial[COUNT]):  # now that all poses are in the sample
        row = partial[ORDER + k] * NCOLUMN
        if columns[row + prefix.TWIST] >= 0 and columns[row + prefix.IN_BODY_AXES] != 0:
            rotate_twist(columns[row + prefix.BODY], sample)
    select_loads(partial[STAMP], loads, load_state)
    for body in range(2):
        write_load(body, loads, load_state, sample)
    partial[RECEIVED] = 0
