"""An MCAP file written chunk by chunk, so that what is on disk is whole at any moment.

The records of messages, chunks and their indexes are laid out here, because that is where a
recording's time goes; everything written once is left to the library. Each chunk goes to the file
in one call, and one that the disk refuses is taken back: a file ends at a whole record, also when
its program is killed between two calls or the disk is full.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

LIBRARY = "cylconn_ros"
COMPRESSIONS = ("zstd", "none")
_LEVEL = 1  # of zstd: of the levels the fastest, and within a few percent of the smallest here

_ENTRY = 16  # bytes of an entry of an index: log time, offset within the chunk
_INDEX = struct.Struct("<BQHI")  # opcode, length of the rest, channel, bytes of entries
_CHUNK = struct.Struct("<BQQQQI")  # opcode, length of the rest, start, end, size, checksum
# Of a chunk's own index: opcode, length of the rest, start, end, where it is, its bytes, bytes of
# the places of the message indexes.
_CHUNK_INDEX = struct.Struct("<BQQQQQI")
_PLACE = struct.Struct("<HQ")  # channel, where its index is
_SIZES = struct.Struct("<QQ")  # of the chunk's records, in the file and as they are
_LONG, _SHORT = struct.Struct("<Q"), struct.Struct("<I")
_TOGETHER = 128  # indexes of chunks that are kept as one packed piece


Buffer = bytes | bytearray | memoryview


class _Kept:
    """Bytes that are not needed before the end, packed: there are more of them all the time."""

    def __init__(self) -> None:
        self._packed: list[bytes] = []
        self._last: list[bytes] = []

    def append(self, data: bytes) -> None:
        self._last.append(data)
        if len(self._last) == _TOGETHER:
            self._packed.append(zlib.compress(b"".join(self._last), 1))
            self._last = []

    def __len__(self) -> int:
        """How many were appended."""
        return _TOGETHER * len(self._packed) + len(self._last)

    def __iter__(self) -> Iterator[bytes]:
        """All of them in order, in pieces of one or more."""
        yield from map(zlib.decompress, self._packed)
        yield from self._last


class Container:
    """An MCAP file under construction; errors are the operating system's (OSError).

    Attributes
    ----------
        size: bytes of the file so far.
    """

    def __init__(self, path: Path, compression: str) -> None:
        """Create ``path``, which must not exist; compression is ``zstd`` or ``none``."""
        self.size = 0
        self._compression = compression if compression == "zstd" else ""
        self._compressor = zstandard.ZstdCompressor(level=_LEVEL)
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks = _Kept()  # their index, as it will stand in the file
        self._times = (1 << 64) - 1, 0  # first and last log time, ns
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        try:
            self._write([MCAP0_MAGIC, *_bytes([Header(profile="ros2", library=LIBRARY)])])
        except OSError:
            self.close()
            raise

    def add_schema(self, name: str, definition: str) -> int:
        """Define a message type; its number."""
        schema = Schema(
            id=len(self._schemas) + 1, data=definition.encode(), encoding="ros2msg", name=name
        )
        self._write(_bytes([schema]))
        self._schemas.append(schema)
        return schema.id

    def add_channel(self, topic: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Define a topic with the number of its type; its number."""
        number = len(self._channels) + 1
        channel = Channel(
            id=number,
            topic=topic,
            message_encoding="cdr",
            metadata=dict(metadata),
            schema_id=schema,
        )
        self._write(_bytes([channel]))
        self._channels.append(channel)
        return number

    def add_metadata(self, name: str, metadata: Mapping[str, str]) -> None:
        """Add a record of texts."""
        (data,) = _bytes([Metadata(name=name, metadata=dict(metadata))])
        index = MetadataIndex(offset=self.size, length=len(data), name=name)
        self._write([data])
        self._metadata.append(index)

    def add_chunk(self, records: Buffer, index: NDArray[np.int64]) -> None:
        """Add records of messages.

        Args:
            records: one after the other, at least one.
            index: (n, 3) channel, log time (ns, its 64 bits) and offset of each.

        All of it or, where this raises, nothing is in the file.
        """
        checksum = zlib.crc32(records)
        stored = self._compressor.compress(records) if self._compression else records
        times = index[:, 1].view(np.uint64)
        start, end = int(times.min()), int(times.max())
        name = _SHORT.pack(len(self._compression)) + self._compression.encode()
        rest = _CHUNK.size - 9 + len(name) + 8 + len(stored)
        parts: list[Buffer] = [
            _CHUNK.pack(Opcode.CHUNK, rest, start, end, len(records), checksum),
            name,
            _LONG.pack(len(stored)),
            stored,
        ]
        length = 9 + rest
        at = self.size + length
        places, counts = bytearray(), []
        for channel, count, entries in _entries(index):
            places += _PLACE.pack(channel, at)
            parts += (_INDEX.pack(Opcode.MESSAGE_INDEX, 6 + len(entries), channel, len(entries)),
                      entries)  # fmt: skip
            at += _INDEX.size + len(entries)
            counts.append((channel, count))
        rest = _CHUNK_INDEX.size - 9 + len(places) + 8 + len(name) + 16
        found = b"".join((
            _CHUNK_INDEX.pack(
                Opcode.CHUNK_INDEX, rest, start, end, self.size, length, len(places)
            ),
            places,
            _LONG.pack(at - self.size - length),
            name,
            _SIZES.pack(len(stored), len(records)),
        ))  # fmt: skip
        self._write(parts)
        self._chunks.append(found)
        first, last = self._times
        self._times = min(first, start), max(last, end)
        for channel, count in counts:
            self._counts[channel] = self._counts.get(channel, 0) + count

    def finish(self) -> None:
        """Write the end of the file, with what readers look messages up by."""
        begin = self.size + 13  # behind the end of the data
        summary = bytearray()
        offsets: list[SummaryOffset] = []
        kinds: Sequence[tuple[int, Iterable[Buffer]]] = (
            (Opcode.SCHEMA, _bytes(self._schemas)),
            (Opcode.CHANNEL, _bytes(self._channels)),
            (Opcode.STATISTICS, _bytes([self._statistics()])),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.METADATA_INDEX, _bytes(self._metadata)),
        )
        for code, records in kinds:
            at = begin + len(summary)
            for data in records:
                summary += data
            length = begin + len(summary) - at
            if length:
                offsets.append(
                    SummaryOffset(group_opcode=code, group_start=at, group_length=length)
                )
        offsets_at = begin + len(summary)
        for data in _bytes(offsets):
            summary += data
        ending = struct.pack("<BQQQ", Opcode.FOOTER, 20, begin, offsets_at)
        footer = Footer(
            summary_start=begin,
            summary_offset_start=offsets_at,
            summary_crc=zlib.crc32(ending, zlib.crc32(summary)),
        )
        self._write(
            [*_bytes([DataEnd(data_section_crc=0)]), summary, *_bytes([footer]), MCAP0_MAGIC]
        )

    @property
    def times(self) -> tuple[int, int]:
        """The first and the last log time, ns; zeros while there is no message."""
        return self._times if self._chunks else (0, 0)

    def close(self) -> None:
        """Release the file; a second call does nothing."""
        file, self._file = self._file, -1
        if file >= 0:
            os.close(file)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=self.times[1],
            message_start_time=self.times[0],
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _write(self, parts: Sequence[Buffer]) -> None:
        """Append all parts, or leave the file as it was and raise."""
        data = b"".join(parts)  # one piece: the system takes many more slowly
        left = memoryview(data)
        try:
            while left:
                left = left[os.write(self._file, left) :]
        except OSError:
            os.ftruncate(self._file, self.size)
            os.lseek(self._file, self.size, os.SEEK_SET)
            raise
        self.size += len(data)


def _entries(index: NDArray[np.int64]) -> Iterator[tuple[int, int, memoryview]]:
    """Each channel, how many messages it has, and their entries in the order they came."""
    channels = index[:, 0]
    ordered = index.take(channels.argsort(kind="stable"), axis=0)
    entries = memoryview(ordered[:, 1:].astype("<i8", copy=False).tobytes())
    begin = 0
    for channel, count in enumerate(np.bincount(channels).tolist()):
        if count:
            end = begin + _ENTRY * count
            yield channel, count, entries[begin:end]
            begin = end


def _bytes(records: Iterable[McapRecord]) -> list[Buffer]:
    """The records as they stand in a file."""
    found: list[Buffer] = []
    for record in records:
        builder = RecordBuilder()
        record.write(builder)
        found.append(bytes(builder.end()))
    return found
