"""Sequential reader of MCAP files that tolerates a missing end and damaged chunks.

Memory holds one block of chunks at a time, so a file may be larger than memory. A file that was
never closed, or is damaged, yields all messages before the damage and all intact chunks.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import BytesIO
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdError

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.mcap import message_block
from cylconn_ros.recording.mcap.message_block import MessageBlock, RawMessage
from cylconn_ros.recording.metadata import METADATA_RECORD

_READ_ERRORS = (McapError, ZstdError, struct.error, ValueError, EOFError)

_RECORD = struct.Struct("<BQ")  # opcode, content length
_DEFINITIONS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA)
_BLOCK_SIZE = 1 << 20  # bytes; smaller chunks are joined up to this size


class McapReader:
    """Messages and definitions of an MCAP file.

    Attributes
    ----------
        schemas, channels: by number, as far as read.
        metadata: texts of the run's own metadata record.
        damage: description of what could not be read; empty for an intact file.
        position: bytes read so far, of ``size``.
    """

    def __init__(self, stream: IO[bytes], size: int) -> None:
        """Read from ``stream``, a binary file of ``size`` bytes, positioned at its beginning."""
        self._stream, self.size = stream, size
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.metadata: dict[str, str] = {}
        self.damage = ""
        self.position = 0
        self._broken_chunks = 0

    def messages(self) -> Iterator[RawMessage]:
        """Yield every message, in file order."""
        for block in self.blocks():
            yield from block.messages()

    def blocks(self) -> Iterator[MessageBlock]:
        """Yield the messages as non-empty blocks, in file order."""
        waiting: list[MessageBlock] = []
        unchunked: list[RawMessage] = []  # messages outside of chunks
        size = 0
        for part in self._parts():
            if isinstance(part, RawMessage):
                unchunked.append(part)
                size += len(part.data)
            else:
                if unchunked:
                    waiting.append(message_block.from_messages(unchunked))
                    unchunked = []
                waiting.append(part)
                size += len(part.raw)
            if size >= _BLOCK_SIZE:
                if unchunked:
                    waiting.append(message_block.from_messages(unchunked))
                yield message_block.concatenate(waiting)
                waiting, unchunked, size = [], [], 0
        if unchunked:
            waiting.append(message_block.from_messages(unchunked))
        if waiting:
            yield message_block.concatenate(waiting)

    def _parts(self) -> Iterator[MessageBlock | RawMessage]:
        """Yield chunks, and messages outside of chunks; keep definitions, note the damage."""
        stream, ended = self._stream, False
        try:
            if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise ValueError("no MCAP magic bytes at the beginning")
            while not ended:
                self.position = stream.tell()
                opcode, length = _RECORD.unpack(self._read(_RECORD.size))
                if length > self.size - stream.tell():
                    raise EOFError("a record is truncated")
                ended = opcode == Opcode.DATA_END
                if opcode == Opcode.CHUNK:
                    block = self._read_chunk(Chunk.read(ReadDataStream(stream)))
                    stream.seek(self.position + _RECORD.size + length)
                    if block is not None and len(block):
                        yield block
                elif opcode == Opcode.MESSAGE:
                    message = Message.read(ReadDataStream(stream), length)
                    log_time, publish_time = message.log_time, message.publish_time
                    yield RawMessage(message.channel_id, log_time, publish_time, message.data)
                elif opcode in _DEFINITIONS:
                    self._keep_definitions(_RECORD.pack(opcode, length) + self._read(length))
                else:
                    stream.seek(length, 1)
        except _READ_ERRORS as error:
            self.damage = f"truncated at byte {self.position} of {self.size} ({_text(error)})"
        if self._broken_chunks:
            broken = f"{self._broken_chunks} of its chunks cannot be read"
            self.damage = "; ".join(filter(None, (self.damage, broken)))

    def _read(self, length: int) -> bytes:
        data = self._stream.read(length)
        if len(data) < length:
            raise EOFError("the file ends")
        return data

    def type_of(self, channel: int) -> str:
        """Return the message type of a channel; raise RecordingError if its schema is missing."""
        found = self.channels[channel]
        schema = self.schemas.get(found.schema_id)
        if schema is None:
            raise RecordingError(f"{found.topic}: the recording does not define its message type")
        return schema.name

    def definition_of(self, channel: int) -> str:
        """Return the schema text of a channel; '' if it is missing or not ``ros2msg``."""
        schema = self.schemas.get(self.channels[channel].schema_id)
        return schema.data.decode() if schema is not None and schema.encoding == "ros2msg" else ""

    def _keep_definitions(self, data: bytes) -> None:
        """Keep schemas, channels and the run's metadata of serialized records."""
        for record in _records(data):
            if isinstance(record, Schema):
                self.schemas[record.id] = record
            elif isinstance(record, Channel):
                self.channels[record.id] = record
            elif isinstance(record, Metadata) and record.name == METADATA_RECORD:
                self.metadata.update(record.metadata)

    def _read_chunk(self, chunk: Chunk) -> MessageBlock | None:
        """Decompress and index a chunk; None, and count it, if it is damaged."""
        try:
            stream, size = get_chunk_data_stream(chunk, validate_crc=True)
            data = stream.read(size)
            block, others = message_block.from_chunk(data)
            if others:
                self._keep_definitions(b"".join(data[begin:end] for begin, end in others))
        except _READ_ERRORS:
            self._broken_chunks += 1
            return None
        return block


def _records(data: bytes) -> Iterator[McapRecord]:
    end = len(data)
    stream = BytesIO(data)
    reader = StreamReader(stream, skip_magic=True, record_size_limit=end).records
    while stream.tell() < end:
        record = next(reader, None)
        if record is not None:
            yield record


def _text(error: Exception) -> str:
    """Return an error's text, or its class name if it has none."""
    return str(error) or type(error).__name__
