"""What takes messages until they are written: one copy each, into memory laid out beforehand.

A tray holds the records of messages as they will stand in a chunk of the file, and where each of
them begins. Python puts messages in by :meth:`Tray.put`; compiled code, which needs no interpreter
for that, by :func:`cylconn_ros.recording.kernels.put` into the same arrays. Whoever does holds the lock
of the run's writer.
"""

from __future__ import annotations

import struct
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

MESSAGE: Final = 0x05  # the opcode of a message's record
HEAD: Final = 31  # bytes of a record before the message
REST: Final = 22  # of them behind the record's length
USED, COUNT = 0, 1  # places in ``state``
ACCEPTED, REFUSED = 0, 1  # rows of ``counts``
CHANNEL, LOG_TIME, OFFSET = 0, 1, 2  # columns of ``entries``

# Opcode, length of the rest, channel, sequence, log time, publish time; then the message.
_head = struct.Struct("<BQHIQQ").pack_into
_entry = struct.Struct("=qQq").pack_into
_ENTRY = 24
_LEAST = 64  # bytes of a record on average, or its entries take more than there are
_NUMBERS = 0xFFFFFFFF  # sequence numbers of a record have 32 bits


class Arrays(NamedTuple):
    """The memory of a tray.

    Attributes
    ----------
        records: (bytes,) uint8, the records one after the other.
        entries: (messages, 3) int64: channel, log time (ns, its 64 bits) and offset of each record.
        state: (2,) int64: bytes used, and messages.
        counts: (2, channels) int64, of all trays of a run: messages accepted, which is the sequence
            number of the next, and messages refused, by the number of their channel.
    """

    records: NDArray[np.uint8]
    entries: NDArray[np.int64]
    state: NDArray[np.int64]
    counts: NDArray[np.int64]


class Messages(NamedTuple):
    """Messages in the order in which they are to be recorded, as arrays.

    Attributes
    ----------
        data: (bytes,) uint8, where they all stand.
        channel: (n,) the numbers of their topics in the file.
        log_time, publish_time: (n,) ns since the epoch.
        start, size: (n,) where each begins in ``data``, and how many bytes it has.
    """

    data: NDArray[np.uint8]
    channel: NDArray[np.int64]
    log_time: NDArray[np.int64]
    publish_time: NDArray[np.int64]
    start: NDArray[np.int64]
    size: NDArray[np.int64]


class Tray:
    """Room for the messages of a chunk.

    Attributes
    ----------
        arrays: where they stand.
        size: bytes of room, empty or not.
    """

    __slots__ = ("_accepted", "_entries", "_records", "_state", "arrays", "room", "size")

    def __init__(self, size: int, counts: NDArray[np.int64]) -> None:
        """Make an empty one for ``size`` bytes of records; ``counts`` as in :class:`Arrays`."""
        entries = -(-size // _LEAST)
        self.size, self.room = size, entries
        self.arrays = Arrays(
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
    def for_messages(cls, messages: int, size: int, counts: NDArray[np.int64]) -> Tray:
        """Make one for so many messages of ``size`` bytes together, however many or large."""
        return cls(size + max(HEAD, _LEAST) * messages, counts)

    def __len__(self) -> int:
        """How many messages it holds."""
        return self._state[COUNT]

    def has_room(self, messages: int, size: int) -> bool:
        """Whether so many more messages fit, ``size`` bytes of data together."""
        used, count = self._state
        return used + HEAD * messages + size <= self.size and count + messages <= self.room

    def put(self, channel: int, data: bytes, log_time: int, publish_time: int) -> bool:
        """Append a message; False where there is no room. Times in ns, 64 bits."""
        state, accepted, length = self._state, self._accepted, len(data)
        at, count = state[USED], state[COUNT]
        begin = at + HEAD
        end = begin + length
        if end > self.size or count >= self.room:
            return False
        sequence = accepted[channel]
        records = self._records
        _head(
            records, at, MESSAGE, REST + length, channel, sequence & _NUMBERS, log_time,
            publish_time,
        )  # fmt: skip
        records[begin:end] = data
        _entry(self._entries, _ENTRY * count, channel, log_time, at)
        accepted[channel] = sequence + 1
        state[USED] = end
        state[COUNT] = count + 1
        return True

    def held(self) -> tuple[memoryview, NDArray[np.int64]]:
        """The records and their index; views, good until :meth:`clear`."""
        used, count = self._state
        return self._records[:used], self.arrays.entries[:count]

    def clear(self) -> None:
        """Forget what it holds."""
        self._state[USED] = self._state[COUNT] = 0
