"""Messages put into a tray by compiled code, which may have let go of the interpreter's lock."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core.jit import COMPILED, device_function, inline_function, kernel
from cylconn_ros.recording.chunk_buffer import (
    ACCEPTED,
    CHANNEL,
    COUNT,
    HEAD,
    LOG_TIME,
    MESSAGE,
    OFFSET,
    REFUSED,
    REST,
    USED,
)

Integers = NDArray[np.int64]
Bytes = NDArray[np.uint8]


@inline_function
def _number(records: Bytes, at: int, size: int, value: int) -> None:
    """Write a whole number, its least byte first."""
    for k in range(size):
        records[at + k] = (value >> (8 * k)) & 255


if COMPILED:

    @inline_function
    def _copy(records: Bytes, begin: int, data: Bytes, length: int) -> None:
        """Copy the first ``length`` bytes of ``data``.

        A slice would need numba's runtime. Without signs, for which numba looks at every index, the
        loop becomes the processor's widest moves.
        """
        to = np.uint64(begin)
        for k in range(length):
            records[to + np.uint64(k)] = data[np.uint64(k)]
else:

    def _copy(records: Bytes, begin: int, data: Bytes, length: int) -> None:
        records[begin : begin + length] = data[:length]


@device_function
def put(
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
    """Append a message, the first ``length`` bytes of ``data``, to a tray.

    The first four are :class:`~cylconn_ros.recording.chunk_buffer.Arrays`; times in ns. Where there is no
    room, which :meth:`~cylconn_ros.recording.writer.RunWriter.tray` makes, it is counted as refused
    and the result is False.
    """
    at, count = state[USED], state[COUNT]
    begin = at + HEAD
    end = begin + length
    if end > len(records) or count >= len(entries):
        counts[REFUSED, channel] += 1
        return False
    records[at] = MESSAGE
    _number(records, at + 1, 8, REST + length)
    _number(records, at + 9, 2, channel)
    _number(records, at + 11, 4, counts[ACCEPTED, channel])
    _number(records, at + 15, 8, log_time)
    _number(records, at + 23, 8, publish_time)
    _copy(records, begin, data, length)
    entries[count, CHANNEL] = channel
    entries[count, LOG_TIME] = log_time
    entries[count, OFFSET] = at
    counts[ACCEPTED, channel] += 1
    state[USED] = end
    state[COUNT] = count + 1
    return True


@kernel
def put_each(
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
    """Append messages from number ``begin`` on while there is room; the number of the next.

    Between ``counts`` and ``begin`` are :class:`~cylconn_ros.recording.chunk_buffer.Messages`.
    """
    for k in range(begin, len(channel)):
        length = size[k]
        if state[USED] + HEAD + length > len(records) or state[COUNT] >= len(entries):
            return k
        message = data[start[k] : start[k] + length]
        put(
            records, entries, state, counts, channel[k], log_time[k], publish_time[k], message,
            length,
        )  # fmt: skip
    return len(channel)
