"""Compiled loops over MCAP records: append messages to a chunk buffer, index a read chunk."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core.jit import COMPILED, device_function, inline_function, kernel
from cylconn_ros.recording.mcap.chunk_buffer import (
    ACCEPTED,
    CHANNEL,
    CONTENT_HEADER,
    COUNT,
    LOG_TIME,
    MESSAGE_OPCODE,
    OFFSET,
    RECORD_HEADER,
    REFUSED,
    USED,
)

__all__ = ["COMPILED", "append", "append_batch", "index_chunk"]

Integers = NDArray[np.int64]
Unsigned = NDArray[np.uint64]
Bytes = NDArray[np.uint8]


@inline_function
def _write_integer(records: Bytes, at: int, size: int, value: int) -> None:
    """Write an integer of ``size`` bytes, little endian."""
    for k in range(size):
        records[at + k] = (value >> (8 * k)) & 255


if COMPILED:

    @inline_function
    def _copy(records: Bytes, begin: int, data: Bytes, length: int) -> None:
        """Copy the first ``length`` bytes of ``data``.

        A slice assignment would need numba's runtime. numba checks every signed index for a
        negative value; unsigned indices let the loop become the processor's widest moves.
        """
        to = np.uint64(begin)
        for k in range(length):
            records[to + np.uint64(k)] = data[np.uint64(k)]
else:

    def _copy(records: Bytes, begin: int, data: Bytes, length: int) -> None:
        records[begin : begin + length] = data[:length]


@device_function
def append(
    records: Bytes,
    entries: Integers,
    state: Integers,
    counts: Integers,
    channel: int,
    log_time: int,
    publish_time: int,
    data: Bytes,
    length: int,
) -> bool:
    """Append a message to a chunk buffer: the first ``length`` bytes of ``data``; times in ns.

    The first four arguments are :class:`~cylconn_ros.recording.mcap.chunk_buffer.ChunkArrays`. A
    message that does not fit is counted as refused, and the result is False;
    :meth:`~cylconn_ros.recording.writer.RunWriter.reserve` provides a buffer with free memory.
    """
    at, count = state[USED], state[COUNT]
    begin = at + RECORD_HEADER
    end = begin + length
    if end > len(records) or count >= len(entries):
        counts[REFUSED, channel] += 1
        return False
    records[at] = MESSAGE_OPCODE
    _write_integer(records, at + 1, 8, CONTENT_HEADER + length)
    _write_integer(records, at + 9, 2, channel)
    _write_integer(records, at + 11, 4, counts[ACCEPTED, channel])
    _write_integer(records, at + 15, 8, log_time)
    _write_integer(records, at + 23, 8, publish_time)
    _copy(records, begin, data, length)
    entries[count, CHANNEL] = channel
    entries[count, LOG_TIME] = log_time
    entries[count, OFFSET] = at
    counts[ACCEPTED, channel] += 1
    state[USED] = end
    state[COUNT] = count + 1
    return True


@kernel
def append_batch(
    records: Bytes,
    entries: Integers,
    state: Integers,
    counts: Integers,
    data: Bytes,
    channel: Integers,
    log_time: Integers,
    publish_time: Integers,
    start: Integers,
    size: Integers,
    begin: int,
) -> int:
    """Append messages from index ``begin`` on while they fit; return the next index.

    The arguments between ``counts`` and ``begin`` are
    :class:`~cylconn_ros.recording.mcap.chunk_buffer.MessageArrays`.
    """
    for k in range(begin, len(channel)):
        length = size[k]
        if state[USED] + RECORD_HEADER + length > len(records) or state[COUNT] >= len(entries):
            return k
        message = data[start[k] : start[k] + length]
        append(
            records, entries, state, counts, channel[k], log_time[k], publish_time[k], message,
            length,
        )  # fmt: skip
    return len(channel)


@kernel
def index_chunk(
    codes: Bytes, words: Unsigned, headers: Unsigned, places: Integers, others: Integers
) -> tuple[int, int]:
    """Index the records of an uncompressed chunk.

    Args:
        codes: (bytes,) the chunk.
        words: (bytes - 7,) the uint64 that begins at every byte of it.
        headers: (3, n) filled with channel, log time and publish time of every message.
        places: (2, n) filled with first byte and size of every message's data.
        others: (2, m) filled with begin and end of the other records, up to m of them.

    Returns
    -------
        Number of messages and of other records; (-1, 0) for a record that is longer than the chunk,
        or a message record that is shorter than its header.
    """
    at, end, k, j = 0, codes.shape[0], 0, 0
    while at < end:
        if at + 9 > end:
            return -1, 0
        length = words[at + 1]
        if length > end - at - 9:
            return -1, 0
        behind = at + 9 + np.int64(length)
        if codes[at] == MESSAGE_OPCODE:
            if length < CONTENT_HEADER:
                return -1, 0
            headers[0, k] = np.uint64(codes[at + 9]) + np.uint64(256) * np.uint64(codes[at + 10])
            headers[1, k] = words[at + 15]
            headers[2, k] = words[at + 23]
            places[0, k] = at + RECORD_HEADER
            places[1, k] = behind - at - RECORD_HEADER
            k += 1
        else:
            if j < others.shape[1]:
                others[0, j] = at
                others[1, j] = behind
            j += 1
        at = int(behind)
    return k, j
