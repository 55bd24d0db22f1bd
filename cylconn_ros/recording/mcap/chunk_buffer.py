"""Chunk buffer: preallocated memory for the message records of the MCAP chunk being filled.

Each message is copied once, into a record laid out as in the MCAP file. An index holds channel, log
time and offset of every record. Python appends with :meth:`ChunkBuffer.append`; compiled code
appends to the same arrays with :func:`cylconn_ros.recording.mcap.kernels.append`, without the GIL.
Both hold the lock of the run's writer while they append.
"""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

MESSAGE_OPCODE: Final = 0x05  # MCAP opcode of a message record
RECORD_HEADER: Final = 31  # bytes of a message record before the message data
CONTENT_HEADER: Final = 22  # bytes of it that the record's content length counts
USED, COUNT = 0, 1  # places in ``state``
ACCEPTED, REFUSED = 0, 1  # rows of ``counts``
CHANNEL, LOG_TIME, OFFSET = 0, 1, 2  # columns of ``entries``

# Opcode, content length, channel, sequence, log time, publish time; the message data follow.
_pack_header = struct.Struct("<BQHIQQ").pack_into
_pack_entry = struct.Struct("=qQq").pack_into
_ENTRY_SIZE = 24
_MEAN_RECORD = 64  # bytes; smaller records on average fill the index before the record memory
_SEQUENCE_MASK = 0xFFFFFFFF  # sequence numbers of a record have 32 bits


class ChunkArrays(NamedTuple):
    """The memory of a chunk buffer.

    Attributes
    ----------
        records: (bytes,) uint8, the records one after the other.
        entries: (messages, 3) int64: channel, log time (ns, its 64 bits) and offset of each record.
        state: (2,) int64: bytes used, and messages.
        counts: (2, channels) int64, shared by all buffers of a run, by channel number: messages
            accepted, which is the next sequence number, and messages refused.
    """

    records: NDArray[np.uint8]
    entries: NDArray[np.int64]
    state: NDArray[np.int64]
    counts: NDArray[np.int64]


class MessageArrays(NamedTuple):
    """Messages to record as arrays, in recording order.

    Attributes
    ----------
        data: (bytes,) uint8, memory that contains all messages.
        channel: (n,) channel numbers in the file.
        log_time, publish_time: (n,) ns since the epoch.
        start, size: (n,) first byte of each message in ``data``, and its size in bytes.
    """

    data: NDArray[np.uint8]
    channel: NDArray[np.int64]
    log_time: NDArray[np.int64]
    publish_time: NDArray[np.int64]
    start: NDArray[np.int64]
    size: NDArray[np.int64]


class ChunkBuffer:
    """Memory for the message records of one chunk.

    Attributes
    ----------
        arrays: the memory; see :class:`ChunkArrays`.
        size: capacity in bytes of records.
        max_messages: capacity in messages.
    """

    __slots__ = ("_accepted", "_entries", "_records", "_state", "arrays", "max_messages", "size")

    def __init__(self, size: int, counts: NDArray[np.int64]) -> None:
        """Allocate an empty buffer for ``size`` bytes of records.

        ``counts`` is shared by all buffers of a run; see :class:`ChunkArrays`.
        """
        entries = -(-size // _MEAN_RECORD)
        self.size, self.max_messages = size, entries
        self.arrays = ChunkArrays(
            np.empty(size, np.uint8),
            np.empty((entries, 3), np.int64),
            np.zeros(2, np.int64),
            counts,
        )
        self._records = self.arrays.records.data
        self._entries = self.arrays.entries.reshape(-1).view(np.uint8).data
        self._state = self.arrays.state.data
        self._accepted = counts[ACCEPTED].data

    @classmethod
    def for_messages(cls, messages: int, size: int, counts: NDArray[np.int64]) -> ChunkBuffer:
        """Allocate a buffer for ``messages`` messages of ``size`` bytes in total, in any split."""
        return cls(size + max(RECORD_HEADER, _MEAN_RECORD) * messages, counts)

    def __len__(self) -> int:
        """Return the number of messages in the buffer."""
        return self._state[COUNT]

    def fits(self, messages: int, size: int) -> bool:
        """Return whether ``messages`` more messages of ``size`` bytes in total fit."""
        used, count = self._state
        return (
            used + RECORD_HEADER * messages + size <= self.size
            and count + messages <= self.max_messages
        )

    def append(self, channel: int, data: bytes, log_time: int, publish_time: int) -> bool:
        """Append a message; return False, and change nothing, if it does not fit.

        Times in ns since the epoch, 64 bits.
        """
        state, accepted, length = self._state, self._accepted, len(data)
        at, count = state[USED], state[COUNT]
        begin = at + RECORD_HEADER
        end = begin + length
        if end > self.size or count >= self.max_messages:
            return False
        sequence = accepted[channel]
        records = self._records
        _pack_header(
            records, at, MESSAGE_OPCODE, CONTENT_HEADER + length, channel,
            sequence & _SEQUENCE_MASK, log_time, publish_time,
        )  # fmt: skip
        records[begin:end] = data
        _pack_entry(self._entries, _ENTRY_SIZE * count, channel, log_time, at)
        accepted[channel] = sequence + 1
        state[USED] = end
        state[COUNT] = count + 1
        return True

    def contents(self) -> tuple[memoryview, NDArray[np.int64]]:
        """Return the records and their index as views, valid until :meth:`clear`."""
        used, count = self._state
        return self._records[:used], self.arrays.entries[:count]

    def clear(self) -> None:
        """Empty the buffer; the counts of the run stay."""
        self._state[USED] = self._state[COUNT] = 0
