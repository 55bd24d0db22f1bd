"""MCAP writer: one system call per chunk, so that the file on disk ends at a whole record.

Message records, chunks and their indexes are serialized here, since they take most of a recording's
time; the mcap library serializes every record that is written once. The writer truncates a chunk
that the disk refuses in part. So a file ends at a whole record, also if its process is killed
between two calls or the disk is full.
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
_LEVEL = 1  # of zstd: the fastest, and within a few percent of the smallest result here

_ENTRY_SIZE = 16  # bytes of a message index entry: log time, offset within the chunk
_MESSAGE_INDEX = struct.Struct("<BQHI")  # opcode, content length, channel, bytes of entries
_CHUNK = struct.Struct("<BQQQQI")  # opcode, content length, start, end, uncompressed size, CRC
# Chunk index: opcode, content length, start, end, offset and length of the chunk, bytes of the
# offsets of its message indexes.
_CHUNK_INDEX = struct.Struct("<BQQQQQI")
_INDEX_OFFSET = struct.Struct("<HQ")  # channel, offset of its message index
_SIZES = struct.Struct("<QQ")  # of the chunk's records: compressed, uncompressed
_UINT64, _UINT32 = struct.Struct("<Q"), struct.Struct("<I")
_PIECE = 128  # chunk indexes that are compressed together


Buffer = bytes | bytearray | memoryview


class _ChunkIndexes:
    """Serialized chunk indexes until the end of the file; compressed, as their number grows."""

    def __init__(self) -> None:
        self._compressed: list[bytes] = []
        self._last: list[bytes] = []

    def append(self, data: bytes) -> None:
        self._last.append(data)
        if len(self._last) == _PIECE:
            self._compressed.append(zlib.compress(b"".join(self._last), 1))
            self._last = []

    def __len__(self) -> int:
        """Return the number of chunk indexes."""
        return _PIECE * len(self._compressed) + len(self._last)

    def __iter__(self) -> Iterator[bytes]:
        """Yield all of them in order, as byte strings of one or more."""
        yield from map(zlib.decompress, self._compressed)
        yield from self._last


class McapWriter:
    """An MCAP file under construction; raises the operating system's errors (OSError).

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
        self._chunks = _ChunkIndexes()
        self._times = (1 << 64) - 1, 0  # first and last log time, ns
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        try:
            self._write([MCAP0_MAGIC, *_serialized([Header(profile="ros2", library=LIBRARY)])])
        except OSError:
            self.close()
            raise

    def add_schema(self, name: str, definition: str) -> int:
        """Define a message type; return its number."""
        schema = Schema(
            id=len(self._schemas) + 1, data=definition.encode(), encoding="ros2msg", name=name
        )
        self._write(_serialized([schema]))
        self._schemas.append(schema)
        return schema.id

    def add_channel(self, topic: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Define a topic of the message type with number ``schema``; return its channel number."""
        number = len(self._channels) + 1
        channel = Channel(
            id=number,
            topic=topic,
            message_encoding="cdr",
            metadata=dict(metadata),
            schema_id=schema,
        )
        self._write(_serialized([channel]))
        self._channels.append(channel)
        return number

    def add_metadata(self, name: str, metadata: Mapping[str, str]) -> None:
        """Add a metadata record."""
        (data,) = _serialized([Metadata(name=name, metadata=dict(metadata))])
        index = MetadataIndex(offset=self.size, length=len(data), name=name)
        self._write([data])
        self._metadata.append(index)

    def add_chunk(self, records: Buffer, index: NDArray[np.int64]) -> None:
        """Add a chunk of message records.

        Args:
            records: serialized records, at least one.
            index: (n, 3) channel, log time (ns, its 64 bits) and offset of each record.

        If this raises, nothing of the chunk is in the file.
        """
        checksum = zlib.crc32(records)
        stored = self._compressor.compress(records) if self._compression else records
        times = index[:, 1].view(np.uint64)
        start, end = int(times.min()), int(times.max())
        name = _UINT32.pack(len(self._compression)) + self._compression.encode()
        content = _CHUNK.size - 9 + len(name) + 8 + len(stored)
        parts: list[Buffer] = [
            _CHUNK.pack(Opcode.CHUNK, content, start, end, len(records), checksum),
            name,
            _UINT64.pack(len(stored)),
            stored,
        ]
        length = 9 + content
        at = self.size + length
        offsets, counts = bytearray(), []
        for channel, count, entries in _message_indexes(index):
            offsets += _INDEX_OFFSET.pack(channel, at)
            parts += (
                _MESSAGE_INDEX.pack(
                    Opcode.MESSAGE_INDEX, 6 + len(entries), channel, len(entries)
                ),
                entries,
            )  # fmt: skip
            at += _MESSAGE_INDEX.size + len(entries)
            counts.append((channel, count))
        content = _CHUNK_INDEX.size - 9 + len(offsets) + 8 + len(name) + 16
        chunk_index = b"".join((
            _CHUNK_INDEX.pack(
                Opcode.CHUNK_INDEX, content, start, end, self.size, length, len(offsets)
            ),
            offsets,
            _UINT64.pack(at - self.size - length),
            name,
            _SIZES.pack(len(stored), len(records)),
        ))  # fmt: skip
        self._write(parts)
        self._chunks.append(chunk_index)
        first, last = self._times
        self._times = min(first, start), max(last, end)
        for channel, count in counts:
            self._counts[channel] = self._counts.get(channel, 0) + count

    def finish(self) -> None:
        """Write the end of the data, the summary and the footer."""
        begin = self.size + 13  # behind the data end record
        summary = bytearray()
        offsets: list[SummaryOffset] = []
        groups: Sequence[tuple[int, Iterable[Buffer]]] = (
            (Opcode.SCHEMA, _serialized(self._schemas)),
            (Opcode.CHANNEL, _serialized(self._channels)),
            (Opcode.STATISTICS, _serialized([self._statistics()])),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.METADATA_INDEX, _serialized(self._metadata)),
        )
        for opcode, records in groups:
            at = begin + len(summary)
            for data in records:
                summary += data
            length = begin + len(summary) - at
            if length:
                offsets.append(
                    SummaryOffset(group_opcode=opcode, group_start=at, group_length=length)
                )
        offsets_at = begin + len(summary)
        for data in _serialized(offsets):
            summary += data
        footer_start = struct.pack("<BQQQ", Opcode.FOOTER, 20, begin, offsets_at)
        footer = Footer(
            summary_start=begin,
            summary_offset_start=offsets_at,
            summary_crc=zlib.crc32(footer_start, zlib.crc32(summary)),
        )
        self._write([
            *_serialized([DataEnd(data_section_crc=0)]), summary, *_serialized([footer]),
            MCAP0_MAGIC,
        ])  # fmt: skip

    @property
    def times(self) -> tuple[int, int]:
        """First and last log time, ns; zeros if there is no message."""
        return self._times if self._chunks else (0, 0)

    def close(self) -> None:
        """Close the file; a second call does nothing."""
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
        """Append all parts, or restore the file's previous end and raise."""
        data = b"".join(parts)  # one write is faster than a vectored one of many parts
        left = memoryview(data)
        try:
            while left:
                left = left[os.write(self._file, left) :]
        except OSError:
            os.ftruncate(self._file, self.size)
            os.lseek(self._file, self.size, os.SEEK_SET)
            raise
        self.size += len(data)


def _message_indexes(index: NDArray[np.int64]) -> Iterator[tuple[int, int, memoryview]]:
    """Yield channel, number of messages and serialized index entries in recording order."""
    channels = index[:, 0]
    ordered = index.take(channels.argsort(kind="stable"), axis=0)
    entries = memoryview(ordered[:, 1:].astype("<i8", copy=False).tobytes())
    begin = 0
    for channel, count in enumerate(np.bincount(channels).tolist()):
        if count:
            end = begin + _ENTRY_SIZE * count
            yield channel, count, entries[begin:end]
            begin = end


def _serialized(records: Iterable[McapRecord]) -> list[Buffer]:
    """Serialize records as they are in a file."""
    found: list[Buffer] = []
    for record in records:
        builder = RecordBuilder()
        record.write(builder)
        found.append(bytes(builder.end()))
    return found
