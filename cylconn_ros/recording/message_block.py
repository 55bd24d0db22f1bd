"""Messages of an MCAP file by the block: where each stands, without an object a message."""

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

_RECORD = struct.Struct("<BQ")  # opcode, length
_MESSAGE = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
MESSAGE_HEAD = _MESSAGE.size
_RECORD_HEAD = _RECORD.size
_LEAST = MESSAGE_HEAD - _RECORD_HEAD  # bytes of a message record behind its length
_MESSAGE_CODE = int(Opcode.MESSAGE)
_OTHERS = 64  # records of a chunk that are no messages: more take a second look
_MUCH = 1 << 25  # bytes: to read more takes longer than to load the compiler
_read_plainly = 0  # bytes, by this program

Integers = NDArray[np.int64]
Longs = NDArray[np.uint64]


class Found(NamedTuple):
    """A message as it was recorded; times in ns since the epoch."""

    channel: int
    log_time: int
    publish_time: int
    data: bytes


@dataclass(frozen=True)
class Block:
    """Messages in the order in which they were recorded.

    Attributes
    ----------
        raw: the bytes in which they stand.
        channel: (n,) the number of the topic.
        log_time, publish_time: (n,) ns since the epoch.
        start, size: (n,) where the bytes of a message begin in ``raw``, and how many they are.
    """

    raw: bytes
    channel: Longs
    log_time: Longs
    publish_time: Longs
    start: Integers
    size: Integers

    def __len__(self) -> int:
        return len(self.channel)

    def messages(self, begin: int = 0, end: int | None = None) -> Iterator[Found]:
        """One by one, as objects."""
        part, raw = slice(begin, end), self.raw
        columns = (self.channel, self.log_time, self.publish_time, self.start, self.size)
        for channel, log, publish, at, size in zip(
            *(column[part].tolist() for column in columns), strict=True
        ):
            yield Found(channel, log, publish, raw[at : at + size])

    def rows(self, which: Integers, size: int) -> NDArray[np.uint8]:
        """(k, size) the bytes of messages ``which`` (k,), all of that size."""
        places: NDArray[np.uint8] = (
            np.ndarray(  # every place of the block where so many bytes begin
                (max(len(self.raw) - size + 1, 0), size), np.uint8, self.raw, strides=(1, 1)
            )
        )
        return places[self.start[which]]

    def unaligned(self, kind: str) -> NDArray[Any]:
        """The numbers of eight bytes that begin at every byte of the block."""
        return np.ndarray((max(len(self.raw) - 7, 0),), kind, self.raw, strides=(1,))


def empty() -> Block:
    """A block without messages."""
    none = np.zeros(0, np.uint64)
    return Block(b"", none, none, none, none.astype(np.int64), none.astype(np.int64))


def of_messages(messages: Sequence[Found]) -> Block:
    """Messages that did not stand together."""
    sizes = np.array([len(message.data) for message in messages], np.int64)
    channel, log_time, publish_time = (
        np.array([message[k] for message in messages], np.uint64) for k in range(3)
    )
    raw = b"".join(message.data for message in messages)
    return Block(raw, channel, log_time, publish_time, np.cumsum(sizes) - sizes, sizes)


def joined(blocks: Sequence[Block]) -> Block:
    """Blocks one after the other as one."""
    if len(blocks) == 1:
        return blocks[0]
    begin = np.cumsum([0, *(len(block.raw) for block in blocks)])
    start = [block.start + at for block, at in zip(blocks, begin[:-1], strict=True)]
    return Block(
        b"".join(block.raw for block in blocks),
        np.concatenate([block.channel for block in blocks]),
        np.concatenate([block.log_time for block in blocks]),
        np.concatenate([block.publish_time for block in blocks]),
        np.concatenate(start),
        np.concatenate([block.size for block in blocks]),
    )


def of_chunk(raw: bytes) -> tuple[Block, list[tuple[int, int]]]:
    """The messages of a chunk, and where its other records begin and end.

    Raises ValueError where a record is longer than the chunk, and EOFError where one is too short.
    """
    most, room = len(raw) // MESSAGE_HEAD, _OTHERS
    longs = np.empty((3, most), np.uint64)
    places = np.empty((2, most), np.int64)
    index = _index_for(raw)
    while True:
        others = np.empty((2, room), np.int64)
        count, more = index(longs, places, others)
        if more <= room:
            break
        room = more
    if count < 0:
        raise ValueError("a record is longer than its chunk, or shorter than its kind")
    channel, log_time, publish_time = longs[:, :count].copy()
    block = Block(raw, channel, log_time, publish_time, *places[:, :count].copy())
    return block, [(int(a), int(b)) for a, b in others[:, :more].T]


def _index_for(raw: bytes) -> Callable[[Longs, Integers, Integers], tuple[int, int]]:
    """What fills the index of a chunk: compiled where the compiler is at hand, or worth loading."""
    global _read_plainly
    if "numba" in sys.modules or _read_plainly > _MUCH:
        from cylconn_ros.recording import kernels_index

        if kernels_index.COMPILED:
            codes = np.frombuffer(raw, np.uint8)
            words: NDArray[np.uint64] = np.ndarray(
                (max(len(raw) - 7, 0),), "<u8", raw, strides=(1,)
            )
            return functools.partial(kernels_index.fill, codes, words)
    _read_plainly += len(raw)
    return functools.partial(_index_plainly, raw)


def _index_plainly(raw: bytes, longs: Longs, places: Integers, others: Integers) -> tuple[int, int]:
    """Do what ``index.fill`` does, without the compiler."""
    at, end, k, j = 0, len(raw), 0, 0
    while at < end:
        if at + _RECORD_HEAD > end:
            return -1, 0
        code, long = _RECORD.unpack_from(raw, at)
        behind = at + _RECORD_HEAD + long
        if behind > end or (code == _MESSAGE_CODE and long < _LEAST):
            return -1, 0
        if code == _MESSAGE_CODE:
            _, _, channel, _, log_time, publish_time = _MESSAGE.unpack_from(raw, at)
            longs[:, k] = channel, log_time, publish_time
            places[:, k] = at + MESSAGE_HEAD, behind - at - MESSAGE_HEAD
            k += 1
        else:
            if j < others.shape[1]:
                others[:, j] = at, behind
            j += 1
        at = behind
    return k, j
