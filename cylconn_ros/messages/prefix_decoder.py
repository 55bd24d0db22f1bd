"""Decoder of messages whose prefix is known: compare the prefix, copy the numbers (compiled).

The messages of a publisher differ only in stamp and numbers (messages/prefix.py). If the prefix of
a message equals the known prefix of its stream, the numbers are copied from fixed offsets. Anything
else takes the reference path, which decodes the message and passes it to the synchronizer: another
frame or byte order, a stamp that is not newer than the last sample's, messages of two samples
interleaved. Both paths give the same samples and the same counts.

The same device functions serve live messages, one at a time (:meth:`PrefixDecoder.process`,
ros/executor/fused.py), and the messages of a recorded block (:meth:`PrefixDecoder.process_block`).
The source of a message is the memory it is in, seen as uint64 and as float64 numbers that begin at
every byte.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.frames import rotate_twist, write_load
from cylconn_ros.connector.synchronizer import SampleMatcher, SynchronizedSample
from cylconn_ros.core import layout
from cylconn_ros.core.jit import COMPILED, device_function, inline_function, kernel
from cylconn_ros.messages import prefix
from cylconn_ros.messages.prefix import MAX_WORDS, NCOLUMN, PrefixTable
from cylconn_ros.scene.inputs import STREAMS
from cylconn_ros.scene.scene import Scene

AVAILABLE: Final = COMPILED and sys.byteorder == "little"
"""Whether this decoder works; if not, all messages take the reference path."""

_SECOND: Final = 1_000_000_000
_LITTLE_ENDIAN: Final = 256  # encapsulation header of little-endian plain CDR, as a number
_STAMP: Final = 4  # offset of the stamp in a message

ROW: Final = 1024
"""Bytes of memory for the message of one stream."""
OFFSET: Final = 4
"""Offset of a message (mod 8), so that its float64 fields are 8-byte aligned."""
MAX_BYTES: Final = ROW - OFFSET
"""Greatest size of a live message that is decoded here."""

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

# Meanings of a channel of a block that is not the number of a stream.
NOT_READ: Final = -1  # no input
OTHER_INPUT: Final = -2  # an input without motion (load, command): a batch ends before it

Integers = NDArray[np.int64]
Array = NDArray[np.float64]


@device_function
def row_begin(stream: int) -> int:
    """Offset of the live message of a stream in the decoder's memory."""
    return stream * ROW + OFFSET


@device_function
def quantities(stream: int, columns: Any) -> int:
    """Bits of the quantities that the messages of a stream carry."""
    return columns[stream * NCOLUMN + prefix.QUANTITIES]


@inline_function
def accept(
    stream: int, begin: int, size: int, words: Any, columns: Any, prefixes: Any, partial: Any
) -> int:
    """Add a message to the partly received sample: MISMATCH, ACCEPTED or COMPLETE.

    Args:
        begin, size: the message in its source, bytes.
        words: the source as uint64 numbers that begin at every byte.
        columns, prefixes: of a :class:`~cylconn_ros.messages.prefix.PrefixTable`.
        partial: (NPARTIAL,) state of the partly received sample; unchanged after a MISMATCH.
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
    stamp_word = words[begin + _STAMP]
    nanoseconds = np.int64(stamp_word >> np.uint64(32))
    if nanoseconds >= _SECOND:
        return MISMATCH
    stamp = np.int64(np.int32(stamp_word & np.uint64(0xFFFFFFFF))) * _SECOND + nanoseconds
    if partial[RECEIVED] == 0:
        # Only a stamp newer than all before: an older one may be a repetition or a restart.
        if partial[HAS_LAST] != 0 and stamp <= partial[LAST]:
            return MISMATCH
        partial[STAMP] = stamp
        partial[COUNT] = 0
    elif stamp != partial[STAMP] or partial[RECEIVED] & bits != 0:
        return MISMATCH
    partial[ORDER + partial[COUNT]] = stream
    partial[BEGIN + stream] = begin
    partial[COUNT] += 1
    partial[RECEIVED] |= bits
    return COMPLETE if partial[RECEIVED] == partial[NEEDED] else ACCEPTED


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
    numbers: Any, columns: Any, partial: Any, loads: Any, load_axes: Any, sample: Any
) -> None:
    """Write the complete sample to ``sample`` (NSAMPLE,), world axes, and begin the next one.

    ``loads``, ``load_axes``: of a :class:`~cylconn_ros.connector.synchronizer.SampleMatcher`.
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
    for body in range(2):
        write_load(body, loads, load_axes, sample)
    partial[RECEIVED] = 0


@kernel
def _accept(
    stream: int, begin: int, size: int, words: Any, columns: Any, prefixes: Any, partial: Any
) -> int:
    return accept(stream, begin, size, words, columns, prefixes, partial)


@kernel
def _write_sample(
    numbers: Any, columns: Any, partial: Any, loads: Any, load_axes: Any, sample: Any
) -> None:
    write_sample(numbers, columns, partial, loads, load_axes, sample)


@kernel
def _decode_block(
    words: Any, numbers: Any, channel: Any, start: Any, size: Any,
    begin: int, end: int, streams: Any, columns: Any, prefixes: Any, partial: Any,
    base: Any, loads: Any, load_axes: Any, samples: Any, stamps: Any, since: Any, closing: Any,
) -> tuple[int, int]:  # fmt: skip
    """Decode samples from messages ``begin`` to ``end`` of a block until one does not match.

    Args:
        words, numbers: the bytes of the block as numbers that begin at every byte.
        channel, start, size: (n,) of its messages.
        streams: by channel, the number of the stream, NOT_READ or OTHER_INPUT.
        columns, prefixes, partial: as for :func:`accept`. loads, load_axes: as for
            :func:`write_sample`.
        base: (NSAMPLE,) the numbers of a sample that no message carries.
        samples, stamps, since, closing: (m, NSAMPLE), (m,) results: samples, their stamps in ns,
            the seconds since the sample before, the message that completed each.

    Returns the number of samples, and the first message that is not part of them.
    """
    n, first = 0, begin
    for k in range(begin, end):
        stream = NOT_READ
        if channel[k] < np.uint64(streams.shape[0]):
            stream = streams[channel[k]]
        if stream == NOT_READ:
            continue
        if partial[RECEIVED] == 0:
            first = k
        found = MISMATCH
        if stream != OTHER_INPUT:
            found = accept(stream, start[k], size[k], words, columns, prefixes, partial)
        if found == MISMATCH:
            partial[RECEIVED] = 0
            return n, first
        if found == COMPLETE:
            sample, stamp = samples[n], partial[STAMP]
            for j in range(layout.NSAMPLE):
                sample[j] = base[j]
            write_sample(numbers, columns, partial, loads, load_axes, sample)
            stamps[n], closing[n] = stamp, k
            since[n] = (stamp - partial[LAST]) * 1e-9
            partial[LAST] = stamp
            n += 1
            if n == samples.shape[0]:
                return n, k + 1
    if partial[RECEIVED] == 0:
        return n, end
    partial[RECEIVED] = 0
    return n, first


class DecodedBlock(NamedTuple):
    """Arrays for the samples of a batch: (m, NSAMPLE) numbers and (m,) of each."""

    samples: Array  # world axes
    stamps: Integers  # ns
    since: Array  # s since the sample before
    closing: Integers  # number of the message that completed the sample

    @classmethod
    def empty(cls, most: int) -> DecodedBlock:
        """Arrays for up to ``most`` samples."""
        stamps, closing = np.zeros((2, most), np.int64)
        return cls(np.zeros((most, layout.NSAMPLE)), stamps, np.zeros(most), closing)


class MessageBlock(Protocol):
    """Recorded messages as arrays (recording/mcap/message_block.py)."""

    @property
    def channel(self) -> NDArray[np.uint64]:
        """(n,) channel numbers."""

    @property
    def start(self) -> Integers:
        """(n,) first byte of each message."""

    @property
    def size(self) -> Integers:
        """(n,) bytes of each message."""

    def __len__(self) -> int: ...

    def unaligned(self, dtype: str) -> NDArray[Any]:
        """The bytes of the block as numbers of eight bytes that begin at every byte."""


class PrefixDecoder:
    """Decode messages with a known prefix into the samples of a :class:`SampleMatcher`.

    Attributes
    ----------
        matcher: takes note of the complete samples; its ``sample`` gets their numbers.
        table: the known prefixes.
        partial: (NPARTIAL,) state of the partly received sample.
        memory: (NSTREAM ROW,) uint8, the last live message of each stream.
        words, numbers: the memory as uint64 and float64 numbers that begin at every byte.
    """

    def __init__(self, scene: Scene, matcher: SampleMatcher) -> None:
        self.matcher = matcher
        self.table = PrefixTable(scene)
        self.partial = np.zeros(NPARTIAL, np.int64)
        self._partial: memoryview[int] = self.partial.data  # faster to access from Python
        self._columns: memoryview[int] = self.table.columns.data
        self._partial[NEEDED] = matcher.needed
        self.memory = np.zeros(len(STREAMS) * ROW, np.uint8)
        self._bytes: memoryview = self.memory.data
        self.words: NDArray[np.uint64] = self._unaligned("<u8")
        self.numbers: Array = self._unaligned("<f8")

    def _unaligned(self, dtype: str) -> NDArray[Any]:
        return np.ndarray((len(self.memory) - 7,), dtype, self.memory.data, strides=(1,))

    def prepare(self) -> None:
        """Compile everything now, so that no sample has to wait for it."""
        if AVAILABLE:
            table, matcher = self.table, self.matcher
            _accept(0, OFFSET, 0, self.words, table.columns, table.words, self.partial.copy())
            _write_sample(
                self.numbers, table.columns, self.partial.copy(), matcher.load_numbers,
                matcher.load_axes, matcher.sample.copy(),
            )  # fmt: skip

    def learn(self, stream: int, data: bytes) -> None:
        """Make the prefix of a message the known one; those with the same are decoded here."""
        if AVAILABLE and len(data) <= MAX_BYTES:
            self.table.learn(stream, data)
        else:
            self._columns[stream * NCOLUMN + prefix.SIZE] = -1

    def follow(self) -> None:
        """Continue after the last sample of the matcher, whichever path it took."""
        matcher, partial = self.matcher, self._partial
        last = matcher.last_stamp
        partial[OPEN] = not matcher.has_pending
        partial[HAS_LAST] = last is not None
        partial[LAST] = last or 0

    def process(self, stream: int, data: bytes) -> bool | SynchronizedSample:
        """Process a message: the sample that it completes; True if it is part of a sample.

        False: the message, and before it those of :meth:`replay_pending`, take the reference path.
        """
        size, partial, columns = len(data), self._partial, self._columns
        row = stream * NCOLUMN
        if (
            size != columns[row + prefix.SIZE]
            or partial[RECEIVED] & columns[row + prefix.QUANTITIES]
        ):
            return False
        if not partial[RECEIVED]:
            self.follow()
        at = stream * ROW + OFFSET
        self._bytes[at : at + size] = data
        table = self.table
        found = _accept(stream, at, size, self.words, table.columns, table.words, self.partial)
        if found != COMPLETE:
            return found == ACCEPTED
        matcher = self.matcher
        complete = matcher.accept(partial[STAMP])
        _write_sample(
            self.numbers, table.columns, self.partial, matcher.load_numbers, matcher.load_axes,
            matcher.sample,
        )  # fmt: skip
        self.count_unknown_frames()
        return complete

    def process_block(
        self, block: MessageBlock, begin: int, streams: Integers, results: DecodedBlock
    ) -> tuple[int, int]:
        """Decode samples from message ``begin`` of a block on; no sample may be partly received.

        ``streams``: by channel, the number of the stream, NOT_READ or OTHER_INPUT. Returns the
        number of samples in ``results``, and the first message that is not part of them.
        """
        self.follow()
        matcher, table = self.matcher, self.table
        found: tuple[int, int] = _decode_block(
            block.unaligned("<u8"), block.unaligned("<f8"), block.channel, block.start, block.size,
            begin, len(block), streams, table.columns, table.words, self.partial,
            matcher.sample.copy(), matcher.load_numbers, matcher.load_axes, *results,
        )  # fmt: skip
        self.count_unknown_frames()
        return found

    def count_unknown_frames(self) -> None:
        """Add the unknown frames of the samples since the last call to the matcher's counts."""
        self.matcher.counts.unknown_frames += self._partial[UNKNOWN_FRAMES]
        self._partial[UNKNOWN_FRAMES] = 0

    @property
    def pending(self) -> tuple[tuple[int, bytes], ...]:
        """Stream and bytes of the messages of the partly received sample, in their order."""
        partial = self._partial
        if not partial[RECEIVED]:
            return ()
        return tuple(
            (stream, bytes(self._bytes[at : at + self.table.size(stream)]))
            for stream in partial[ORDER : ORDER + partial[COUNT]].tolist()
            for at in (stream * ROW + OFFSET,)
        )

    def replay_pending(self, reference_path: Callable[[int, bytes], object]) -> None:
        """Pass the messages of the partly received sample to the reference path."""
        pending = self.pending
        self._partial[RECEIVED] = 0
        for stream, data in pending:
            reference_path(stream, data)
