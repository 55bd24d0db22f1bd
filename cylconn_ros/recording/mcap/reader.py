"""Reader of MCAP files that tolerates a missing end, damaged records and damaged chunks.

A file is read twice: :meth:`McapFile.contents` reads definitions and the places and times of the
messages, :meth:`McapFile.load` reads a chunk again. So channels may be declared anywhere, and
memory holds one chunk at a time. After a damaged record, reading continues at the next chunk, which
is searched for: every intact chunk is found.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from cylconn_ros.recording.files import compression
from cylconn_ros.recording.files.storage import Contents, StoredChannel, Unit
from cylconn_ros.recording.mcap import message_block, resume
from cylconn_ros.recording.mcap.message_block import MessageBlock
from cylconn_ros.recording.metadata import METADATA_RECORD

_READ_ERRORS = (McapError, struct.error, ValueError, EOFError, OverflowError, TypeError)

_RECORD = struct.Struct("<BQ")  # opcode, content length
_CHUNK = struct.Struct("<QQQII")  # start, end, uncompressed size, CRC, length of the compression
_UINT16, _UINT64, _LENGTH = struct.Struct("<H"), struct.Struct("<Q"), struct.Struct("<HI")
_END = struct.Struct("<BQQQI8s")  # footer and magic bytes
_DEFINITIONS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA)
_LOOSE = (Opcode.MESSAGE, *_DEFINITIONS)  # records that may stand outside of chunks
_LENGTHS = {Opcode.DATA_END: 4, Opcode.FOOTER: 20}
_BLOCK_SIZE = 1 << 20  # bytes of messages outside of chunks that are read at once
_MAX_DEFINITION = 1 << 24  # bytes of a schema, channel or metadata record


class _Header(NamedTuple):
    """Header of a chunk; ``begin`` and ``size`` of its stored records."""

    uncompressed: int
    crc: int
    compression: bytes
    begin: int
    size: int


class _DamagedError(ValueError):
    """A record is not what its header says."""


class McapFile:
    """An MCAP file."""

    def __init__(self, path: Path | str, stream: IO[bytes] | None = None) -> None:
        """Open ``path``, or read ``stream``; raises OSError."""
        self._stream = stream if stream is not None else Path(path).open("rb")  # noqa: SIM115
        self._size = self._stream.seek(0, 2)
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._found = Contents()
        self._loose = -1  # begin of the records outside of chunks that are not indexed yet
        self._intact = 0  # end of the last record that is known to be intact
        self._broken_chunks = 0
        self._data_ended = False

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def contents(self) -> Contents:
        """Read the file once; see :class:`~cylconn_ros.recording.files.storage.StorageFile`."""
        found, at = self._found, len(MCAP0_MAGIC)
        found.finished = False
        if self._read(0, at) != MCAP0_MAGIC:
            found.damage.append("no MCAP magic bytes at the beginning")
            if self._read(at, 1)[:1] != b"\x01":  # not even a header record
                at = resume.next_chunk(self._stream, self._size, 0)
        self._intact = at
        places, resumed = 0, -1
        while at < self._size and not found.finished:
            try:
                at = self._record(at)
            except _READ_ERRORS:
                self._end_loose(at)
                if not places:
                    reason = "truncated" if self._ends(at) else "damaged"
                    found.damage.append(f"{reason} at byte {at} of {self._size}")
                places += 1
                at = resume.next_chunk(self._stream, self._size, max(self._intact, resumed + 1))
                if at >= self._size and not self._data_ended:
                    at = self._summary(max(self._intact, resumed + 1))
                resumed = self._intact = at
        if places > 1:
            found.damage[0] += f" and in {places - 1} more places"
        self._end_loose(min(at, self._size))
        if self._broken_chunks:
            found.damage.append(f"{self._broken_chunks} of its chunks cannot be read")
        found.channels = {n: self._channel(channel) for n, channel in self._channels.items()}
        return found

    def load(self, unit: Unit, begin: int, end: int) -> Iterator[MessageBlock]:
        """Yield messages; see :class:`~cylconn_ros.recording.files.storage.StorageFile`."""
        try:
            block = self._block(unit)
        except _READ_ERRORS:
            return  # changed since it was indexed
        if begin > unit.first or end <= unit.last:
            times = block.log_time
            block = message_block.select(block, np.flatnonzero((times >= begin) & (times < end)))
        if len(block):
            yield message_block.by_time(block)

    def _block(self, unit: Unit) -> MessageBlock:
        if unit.chunk:
            return message_block.from_chunk(self._chunk_records(unit.begin, unit.end))[0]
        return message_block.from_chunk(self._read(unit.begin, unit.end - unit.begin))[0]

    def _summary(self, begin: int) -> int:
        """Return the first byte of the summary, behind ``begin``; the file's size if none."""
        footer = self._read(max(0, self._size - _END.size), _END.size)
        if len(footer) == _END.size:
            opcode, length, start, _, _, magic = _END.unpack(footer)
            known = opcode == Opcode.FOOTER and length == _LENGTHS[Opcode.FOOTER]
            if known and magic == MCAP0_MAGIC and begin <= start < self._size:
                self._data_ended = True
                return int(start)
        return self._size

    def _ends(self, at: int) -> bool:
        """Return whether the record at ``at`` reaches beyond the end of the file."""
        head = self._read(at, _RECORD.size)
        return len(head) < _RECORD.size or at + _RECORD.size + _RECORD.unpack(head)[1] > self._size

    def _begins_record(self, at: int) -> bool:
        """Return whether a known record may begin at ``at``."""
        head = self._read(at, _RECORD.size)
        if len(head) < _RECORD.size:
            return False
        opcode, length = _RECORD.unpack(head)
        return opcode in iter(Opcode) and at + _RECORD.size + length <= self._size

    def _record(self, at: int) -> int:
        """Index the record at byte ``at``; return the next one's. Raises one of _READ_ERRORS."""
        opcode, length = _RECORD.unpack(self._read(at, _RECORD.size))
        end = at + _RECORD.size + length
        if end > self._size or not opcode or _LENGTHS.get(opcode, length) != length:
            raise _DamagedError
        if opcode in _LOOSE and not (self._data_ended and opcode == Opcode.MESSAGE):
            if length > (compression.MAX_PART if opcode == Opcode.MESSAGE else _MAX_DEFINITION):
                raise _DamagedError
            if self._loose < 0:
                self._loose = at
            if end - self._loose >= _BLOCK_SIZE:
                self._end_loose(end)
            return end
        self._end_loose(at)
        if opcode == Opcode.CHUNK:
            self._chunk(at, end)
            self._intact = end
        elif opcode == Opcode.MESSAGE_INDEX:
            _, size = _LENGTH.unpack(self._read(at + _RECORD.size, _LENGTH.size))
            # A later version of the format may add fields; in a damaged length are other records.
            added = length - _LENGTH.size - size
            if added < 0 or size % 16 or (added and self._begins_record(end - added)):
                raise _DamagedError
            self._intact = end
        elif opcode == Opcode.DATA_END:
            self._data_ended = True
        elif opcode == Opcode.FOOTER:
            self._found.finished = self._read(end, self._size - end) == MCAP0_MAGIC
            if not self._found.finished:
                raise _DamagedError
        return end

    def _end_loose(self, end: int) -> None:
        """Index the records outside of chunks up to ``end``."""
        begin, self._loose = self._loose, -1
        if begin < 0 or begin >= end:
            return
        try:
            raw = self._read(begin, end - begin)
            block, others = message_block.from_chunk(raw)
        except _READ_ERRORS:
            self._found.damage.append(f"records that cannot be read from byte {begin} on")
            return
        self._keep_definitions(raw, others)
        self._add(block, begin, end, False)

    def _add(self, block: MessageBlock, begin: int, end: int, chunk: bool) -> None:
        if len(block):
            first, last = int(block.log_time.min()), int(block.log_time.max())
            self._found.units.append(Unit(begin, end, first, last, len(block.raw), chunk))
            self._found.count(block)

    def _chunk(self, at: int, end: int) -> None:
        """Index a chunk; count it if it is damaged.

        Raises _DamagedError if its lengths disagree.
        """
        try:
            raw = self._chunk_records(at, end)
            block, others = message_block.from_chunk(raw)
        except _READ_ERRORS as error:
            self._broken_chunks += 1
            if isinstance(error, compression.CompressionError) and "lz4" in str(error):
                self._found.damage.append(str(error))
            if isinstance(error, _DamagedError):
                raise
            return
        self._keep_definitions(raw, others)
        self._add(block, at, end, True)

    def _chunk_records(self, at: int, end: int) -> bytes:
        """Return the uncompressed records of a chunk; raises one of _READ_ERRORS."""
        head = self._chunk_header(at, end)
        if head.uncompressed > compression.MAX_PART or head.size > compression.MAX_PART:
            raise ValueError(f"a chunk of {head.uncompressed} bytes")
        data = self._read(head.begin, head.size)
        if head.compression == b"zstd":
            data = compression.unzstd(data, head.uncompressed)
        elif head.compression == b"lz4":
            data = compression.unlz4(data, head.uncompressed)
        elif head.compression:
            raise ValueError(f"compression {head.compression!r}")
        if head.crc and zlib.crc32(data) != head.crc:
            raise ValueError("CRC")
        return data

    def _chunk_header(self, at: int, end: int) -> _Header:
        begin = at + _RECORD.size
        _, _, size, crc, length = _CHUNK.unpack(self._read(begin, _CHUNK.size))
        rest = begin + _CHUNK.size
        if length > resume.MAX_NAME:
            raise _DamagedError
        name = self._read(rest, length)
        (stored,) = _UINT64.unpack(self._read(rest + length, 8))
        records = rest + length + 8
        if records + stored != end:
            raise _DamagedError
        return _Header(size, crc, name, records, stored)

    def _keep_definitions(self, raw: bytes, places: list[tuple[int, int]]) -> None:
        """Keep schemas, channels and the run's metadata; the first definition of a number holds."""
        for begin, end in places:
            opcode, content = raw[begin], raw[begin + _RECORD.size : end]
            if opcode not in _DEFINITIONS:
                continue
            stream = ReadDataStream(BytesIO(content))
            try:
                if opcode == Opcode.SCHEMA:
                    schema = Schema.read(stream)
                    self._schemas.setdefault(schema.id, schema)
                elif opcode == Opcode.CHANNEL:
                    channel = Channel.read(stream)
                    self._channels.setdefault(channel.id, channel)
                elif opcode == Opcode.METADATA:
                    metadata = Metadata.read(stream)
                    if metadata.name == METADATA_RECORD:
                        self._found.metadata.update(metadata.metadata)
            except (*_READ_ERRORS, KeyError, MemoryError):
                self._found.damage.append(f"a definition of {len(content)} bytes cannot be read")

    def _channel(self, channel: Channel) -> StoredChannel:
        found = StoredChannel(
            channel.topic,
            type_hash=channel.metadata.get("topic_type_hash", ""),
            qos=channel.metadata.get("offered_qos_profiles", ""),
        )
        schema = self._schemas.get(channel.schema_id)
        if channel.message_encoding != "cdr":
            found.reason = (
                f"its messages are {channel.message_encoding or 'of no encoding'}, not cdr"
            )
        elif schema is None:
            number = channel.schema_id
            found.reason = f"schema {number} is missing" if number else "it has no schema"
        else:
            found.type, found.definition_encoding = schema.name, schema.encoding
            found.definition = schema.data.decode("utf-8", errors="replace")
        return found

    def _read(self, at: int, length: int) -> bytes:
        self._stream.seek(at)
        return self._stream.read(length)
