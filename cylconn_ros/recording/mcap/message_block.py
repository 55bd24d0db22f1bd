"""Messages of an MCAP chunk as arrays: channel, times and place of each, without Python objects."""

from __future__ import annotations

import functools
import struct
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

_RECORD = struct.Struct("<BQ")  # opcode, content length
_MESSAGE = struct.Struct("<BQHIQQ")  # and channel, sequence, log time, publish time
MESSAGE_HEADER = _MESSAGE.size
_RECORD_HEADER = _RECORD.size
_CONTENT_HEADER = MESSAGE_HEADER - _RECORD_HEADER  # least content length of a message record
_MESSAGE_OPCODE = int(Opcode.MESSAGE)
_OTHERS = 64  # other records that one pass over a chunk indexes; more need a second pass
_WORTH_COMPILER = 1 << 25  # bytes; reading more takes longer than loading the compiler
_bytes_interpreted = 0  # bytes that this process has indexed without the compiler

Integers = NDArray[np.int64]
Unsigned = NDArray[np.uint64]


class RawMessage(NamedTuple):
    """A serialized message as recorded; times in ns since the epoch."""

    channel: int
    log_time: int
    publish_time: int
    data: bytes


@dataclass(frozen=True)
class MessageBlock:
    """Messages in recording order, as arrays.

    Attributes
    ----------
        raw: bytes that contain all messages.
        channel: (n,) channel numbers.
        log_time, publish_time: (n,) ns since the epoch.
        start, size: (n,) first byte of each message in ``raw``, and its size in bytes.
    """

    raw: bytes
    channel: Unsigned
    log_time: Unsigned
    publish_time: Unsigned
    start: Integers
    size: Integers

    def __len__(self) -> int:
        return len(self.channel)

    def messages(self, begin: int = 0, end: int | None = None) -> Iterator[RawMessage]:
        """Yield messages ``begin`` to ``end`` - 1 as objects."""
        part, raw = slice(begin, end), self.raw
        columns = (self.channel, self.log_time, self.publish_time, self.start, self.size)
        for channel, log, publish, at, size in zip(
            *(column[part].tolist() for column in columns), strict=True
        ):
            yield RawMessage(channel, log, publish, raw[at : at + size])

    def rows(self, which: Integers, size: int) -> NDArray[np.uint8]:
        """Return the bytes of messages ``which`` (k,), all of ``size`` bytes, as (k, size)."""
        windows: NDArray[np.uint8] = np.ndarray(  # ``size`` bytes from every byte of the block on
            (max(len(self.raw) - size + 1, 0), size), np.uint8, self.raw, strides=(1, 1)
        )
        return windows[self.start[which]]

    def unaligned(self, dtype: str) -> NDArray[Any]:
        """Return the 8-byte numbers that begin at every byte of the block, as a view."""
        return np.ndarray((max(len(self.raw) - 7, 0),), dtype, self.raw, strides=(1,))


def empty() -> MessageBlock:
    """Return a block without messages."""
    none = np.zeros(0, np.uint64)
    return MessageBlock(b"", none, none, none, none.astype(np.int64), none.astype(np.int64))


def from_messages(messages: Sequence[RawMessage]) -> MessageBlock:
    """Build a block from single messages."""
    sizes = np.array([len(message.data) for message in messages], np.int64)
    channel, log_time, publish_time = (
        np.array([message[k] for message in messages], np.uint64) for k in range(3)
    )
    raw = b"".join(message.data for message in messages)
    return MessageBlock(raw, channel, log_time, publish_time, np.cumsum(sizes) - sizes, sizes)


def concatenate(blocks: Sequence[MessageBlock]) -> MessageBlock:
    """Concatenate blocks, at least one."""
    if len(blocks) == 1:
        return blocks[0]
    begin = np.cumsum([0, *(len(block.raw) for block in blocks)])
    start = [block.start + at for block, at in zip(blocks, begin[:-1], strict=True)]
    return MessageBlock(
        b"".join(block.raw for block in blocks),
        np.concatenate([block.channel for block in blocks]),
        np.concatenate([block.log_time for block in blocks]),
        np.concatenate([block.publish_time for block in blocks]),
        np.concatenate(start),
        np.concatenate([block.size for block in blocks]),
    )


def select(block: MessageBlock, which: Integers) -> MessageBlock:
    """Return messages ``which`` (k,) of a block, in this order, with their bytes copied."""
    starts, sizes = block.start[which], block.size[which]
    raw = b"".join(
        block.raw[at : at + size] for at, size in zip(starts.tolist(), sizes.tolist(), strict=True)
    )
    return MessageBlock(
        raw,
        block.channel[which],
        block.log_time[which],
        block.publish_time[which],
        np.cumsum(sizes) - sizes,
        sizes,
    )


def by_time(block: MessageBlock) -> MessageBlock:
    """Return the messages of a block in order of log time; equal times keep their order."""
    times = block.log_time
    if len(times) < 2 or bool((times[1:] >= times[:-1]).all()):
        return block
    return select(block, np.argsort(times, kind="stable"))


def from_chunk(raw: bytes) -> tuple[MessageBlock, list[tuple[int, int]]]:
    """Index an uncompressed chunk: its messages, and begin and end of its other records.

    Raises ValueError if a record is longer than the chunk or shorter than its kind requires.
    """
    most, capacity = len(raw) // MESSAGE_HEADER, _OTHERS
    headers = np.empty((3, most), np.uint64)
    places = np.empty((2, most), np.int64)
    index = _index_function(raw)
    while True:
        others = np.empty((2, capacity), np.int64)
        count, other_count = index(headers, places, others)
        if other_count <= capacity:
            break
        capacity = other_count
    if count < 0:
        raise ValueError("a record is longer than its chunk, or shorter than its kind")
    channel, log_time, publish_time = headers[:, :count].copy()
    block = MessageBlock(raw, channel, log_time, publish_time, *places[:, :count].copy())
    return block, [(int(a), int(b)) for a, b in others[:, :other_count].T]


def _index_function(raw: bytes) -> Callable[[Unsigned, Integers, Integers], tuple[int, int]]:
    """Choose the function that indexes a chunk.

    Compiled if the compiler is already loaded, or if this process has read enough to make loading
    it worthwhile; else interpreted.
    """
    global _bytes_interpreted
    if "numba" in sys.modules or _bytes_interpreted > _WORTH_COMPILER:
        from cylconn_ros.recording.mcap import kernels

        if kernels.COMPILED:
            codes = np.frombuffer(raw, np.uint8)
            words: NDArray[np.uint64] = np.ndarray(
                (max(len(raw) - 7, 0),), "<u8", raw, strides=(1,)
            )
            return functools.partial(kernels.index_chunk, codes, words)
    _bytes_interpreted += len(raw)
    return functools.partial(_index_interpreted, raw)


def _index_interpreted(
    raw: bytes, headers: Unsigned, places: Integers, others: Integers
) -> tuple[int, int]:
    """Same as :func:`cylconn_ros.recording.mcap.kernels.index_chunk`, in Python."""
    at, end, k, j = 0, len(raw), 0, 0
    while at < end:
        if at + _RECORD_HEADER > end:
            return -1, 0
        code, length = _RECORD.unpack_from(raw, at)
        behind = at + _RECORD_HEADER + length
        if behind > end or (code == _MESSAGE_OPCODE and length < _CONTENT_HEADER):
            return -1, 0
        if code == _MESSAGE_OPCODE:
            _, _, channel, _, log_time, publish_time = _MESSAGE.unpack_from(raw, at)
            headers[:, k] = channel, log_time, publish_time
            places[:, k] = at + MESSAGE_HEADER, behind - at - MESSAGE_HEADER
            k += 1
        else:
            if j < others.shape[1]:
                others[:, j] = at, behind
            j += 1
        at = behind
    return k, j
