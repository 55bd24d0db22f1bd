"""Decoder of messages whose prefix is known: compare the prefix, copy the numbers (compiled).

The messages of a publisher differ only in stamp and numbers (messages/prefix.py). If the prefix of
a message equals the known prefix of its stream, the numbers are copied from fixed offsets. Anything
else takes the reference path, which decodes the message and passes it to the synchronizer: another
frame or byte order, a stamp that is not newer than the last sample's, messages of two samples
interleaved. Both paths give the same samples and the same counts.

The same device functions (messages/partial_sample.py) serve live messages, one at a time
(:meth:`PrefixDecoder.process`, ros/executor/fused.py), and the messages of a recorded block
(:meth:`PrefixDecoder.process_block`).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.synchronized_sample import SynchronizedSample
from cylconn_ros.connector.synchronizer import SampleMatcher
from cylconn_ros.core import layout
from cylconn_ros.core.jit import COMPILED, device_function, kernel
from cylconn_ros.messages import prefix
from cylconn_ros.messages.partial_sample import (
    ACCEPTED,
    COMPLETE,
    COUNT,
    HAS_LAST,
    LAST,
    MISMATCH,
    NEEDED,
    NPARTIAL,
    OPEN,
    ORDER,
    RECEIVED,
    STAMP,
    UNKNOWN_FRAMES,
    accept,
    is_complete,
    message_stamp,
    write_sample,
)
from cylconn_ros.messages.prefix import NCOLUMN, PrefixTable
from cylconn_ros.scene.inputs import STREAMS
from cylconn_ros.scene.scene import Scene

AVAILABLE: Final = COMPILED and sys.byteorder == "little"
"""Whether this decoder works; if not, all messages take the reference path."""

ROW: Final = 1024
"""Bytes of memory for the message of one stream."""
OFFSET: Final = 4
"""Offset of a message (mod 8), so that its float64 fields are 8-byte aligned."""
MAX_BYTES: Final = ROW - OFFSET
"""Greatest size of a live message that is decoded here."""

# Meanings of a channel of a block that is not the number of a stream.
NOT_READ: Final = -1  # no input
OTHER_INPUT: Final = -2  # an input without motion (load, command): a batch ends before it
OUTPUT: Final = -3  # a wrench of the connector: the sample before it waited for no load any longer

Integers = NDArray[np.int64]
Array = NDArray[np.float64]


@device_function
def row_begin(stream: int) -> int:
    """Offset of the live message of a stream in the decoder's memory."""
    return stream * ROW + OFFSET


@kernel
def _accept(
    stream: int, begin: int, size: int, words: Any, columns: Any, prefixes: Any, partial: Any,
    load_state: Any,
) -> int:  # fmt: skip
    return accept(stream, begin, size, words, columns, prefixes, partial, load_state)


@kernel
def _is_complete(partial: Any, load_state: Any) -> bool:
    return is_complete(partial, load_state)


@kernel
def _write_sample(
    numbers: Any, columns: Any, partial: Any, loads: Any, load_state: Any, sample: Any
) -> None:
    write_sample(numbers, columns, partial, loads, load_state, sample)


@kernel
def _decode_block(
    words: Any, numbers: Any, channel: Any, start: Any, size: Any,
    begin: int, end: int, streams: Any, columns: Any, prefixes: Any, partial: Any,
    base: Any, loads: Any, load_state: Any, samples: Any, stamps: Any, since: Any, closing: Any,
) -> tuple[int, int]:  # fmt: skip
    """Decode samples from messages ``begin`` to ``end`` of a block until one does not match.

    Args:
        words, numbers: the bytes of the block as numbers that begin at every byte.
        channel, start, size: (n,) of its messages.
        streams: by channel, the number of the stream, NOT_READ, OTHER_INPUT or OUTPUT.
        columns, prefixes, partial: as for :func:`accept`. loads, load_state: as for
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
        found = MISMATCH
        if stream == OUTPUT:
            waits = partial[RECEIVED] == partial[NEEDED]
            if not waits or message_stamp(start[k], words) != partial[STAMP]:
                continue
            found = COMPLETE
        elif partial[RECEIVED] == 0:
            first = k
        if stream >= 0:
            found = accept(stream, start[k], size[k], words, columns, prefixes, partial, load_state)
        if found == MISMATCH:
            partial[RECEIVED] = 0
            return n, first
        if found == COMPLETE:
            sample, stamp = samples[n], partial[STAMP]
            for j in range(layout.NSAMPLE):
                sample[j] = base[j]
            write_sample(numbers, columns, partial, loads, load_state, sample)
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
            table, matcher, partial = self.table, self.matcher, self.partial.copy()
            loads, state = matcher.loads.numbers.copy(), matcher.loads.state.copy()
            _accept(0, OFFSET, 0, self.words, table.columns, table.words, partial, state)
            _is_complete(partial, state)
            _write_sample(self.numbers, table.columns, partial, loads, state, matcher.sample.copy())

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
        found = _accept(
            stream, at, size, self.words, table.columns, table.words, self.partial,
            self.matcher.loads.state,
        )  # fmt: skip
        return self._complete() if found == COMPLETE else found == ACCEPTED

    @property
    def is_partial(self) -> bool:
        """Whether messages of a sample that is not complete are received."""
        return self._partial[RECEIVED] != 0 or self.matcher.is_partial

    @property
    def waiting(self) -> int | None:
        """Stamp in ns of the oldest sample that lacks nothing but a load, or None."""
        partial = self._partial
        if partial[RECEIVED] == partial[NEEDED]:
            return partial[STAMP]
        return self.matcher.waiting

    @property
    def is_overtaken(self) -> bool:
        """Whether messages of a newer sample than :attr:`waiting` are received."""
        return self.matcher.is_overtaken  # a newer one ends the partly received sample

    def next(self) -> SynchronizedSample | None:
        """Complete a sample that waits for no load any longer; None if there is none."""
        partial = self._partial
        if partial[RECEIVED] != partial[NEEDED]:
            return self.matcher.next()
        return self._complete() if _is_complete(self.partial, self.matcher.loads.state) else None

    def _complete(self) -> SynchronizedSample:
        matcher = self.matcher
        complete = matcher.accept(self._partial[STAMP])
        _write_sample(
            self.numbers, self.table.columns, self.partial, matcher.loads.numbers,
            matcher.loads.state, matcher.sample,
        )  # fmt: skip
        self.count_unknown_frames()
        return complete

    def process_block(
        self, block: MessageBlock, begin: int, streams: Integers, results: DecodedBlock
    ) -> tuple[int, int]:
        """Decode samples from message ``begin`` of a block on; no sample may be partly received.

        ``streams``: by channel, the number of the stream, NOT_READ, OTHER_INPUT or OUTPUT. Returns
        the number of samples in ``results``, and the first message that is not part of them.
        """
        self.follow()
        matcher, table = self.matcher, self.table
        found: tuple[int, int] = _decode_block(
            block.unaligned("<u8"), block.unaligned("<f8"), block.channel, block.start, block.size,
            begin, len(block), streams, table.columns, table.words, self.partial,
            matcher.sample.copy(), matcher.loads.numbers, matcher.loads.state, *results,
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
