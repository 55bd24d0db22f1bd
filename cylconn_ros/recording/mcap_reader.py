"""Messages of an MCAP file from its beginning to its end, whatever that end is like.

Nothing is kept but the chunk being read, so a file may be larger than memory, and one that was
never closed, or is damaged, gives what it has.
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
from cylconn_ros.recording import message_block
from cylconn_ros.recording.message_block import Block, Found
from cylconn_ros.recording.writer import METADATA_RECORD

BROKEN = (McapError, ZstdError, struct.error, ValueError, EOFError)

_RECORD = struct.Struct("<BQ")  # opcode, length
_KEPT = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA)
_ENOUGH = 1 << 20  # bytes of a block: smaller chunks are joined


class Source:
    """What can be read of an MCAP file.

    Attributes
    ----------
        schemas, channels: by number, as far as read.
        texts: of the run's own metadata record.
        damage: what could not be read, in words; empty for a file that is whole.
        at: bytes read so far, of ``size``.
    """

    def __init__(self, stream: IO[bytes], size: int) -> None:
        self._stream, self.size = stream, size
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.texts: dict[str, str] = {}
        self.damage = ""
        self.at = 0
        self._broken_chunks = 0

    def messages(self) -> Iterator[Found]:
        """Every message in the order they stand in the file."""
        for block in self.blocks():
            yield from block.messages()

    def blocks(self) -> Iterator[Block]:
        """The same by the block; none of them is empty."""
        waiting: list[Block] = []
        loose: list[Found] = []  # messages that stand in no chunk
        size = 0
        for part in self._parts():
            if isinstance(part, Found):
                loose.append(part)
                size += len(part.data)
            else:
                if loose:
                    waiting.append(message_block.of_messages(loose))
                    loose = []
                waiting.append(part)
                size += len(part.raw)
            if size >= _ENOUGH:
                if loose:
                    waiting.append(message_block.of_messages(loose))
                yield message_block.joined(waiting)
                waiting, loose, size = [], [], 0
        if loose:
            waiting.append(message_block.of_messages(loose))
        if waiting:
            yield message_block.joined(waiting)

    def _parts(self) -> Iterator[Block | Found]:
        """Chunks, and messages that stand in none."""
        stream, ended = self._stream, False
        try:
            if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise ValueError("it does not begin as MCAP files do")
            while not ended:
                self.at = stream.tell()
                opcode, length = _RECORD.unpack(self._read(_RECORD.size))
                if length > self.size - stream.tell():
                    raise EOFError("a record is not whole")
                ended = opcode == Opcode.DATA_END
                if opcode == Opcode.CHUNK:
                    block = self._chunk(Chunk.read(ReadDataStream(stream)))
                    stream.seek(self.at + _RECORD.size + length)
                    if block is not None and len(block):
                        yield block
                elif opcode == Opcode.MESSAGE:
                    message = Message.read(ReadDataStream(stream), length)
                    log_time, publish_time = message.log_time, message.publish_time
                    yield Found(message.channel_id, log_time, publish_time, message.data)
                elif opcode in _KEPT:
                    self._note(_RECORD.pack(opcode, length) + self._read(length))
                else:
                    stream.seek(length, 1)
        except BROKEN as error:
            self.damage = f"it breaks off at byte {self.at} of {self.size} ({words(error)})"
        if self._broken_chunks:
            broken = f"{self._broken_chunks} of its chunks cannot be read"
            self.damage = "; ".join(filter(None, (self.damage, broken)))

    def _read(self, length: int) -> bytes:
        data = self._stream.read(length)
        if len(data) < length:
            raise EOFError("the file ends")
        return data

    def read_headers(self) -> None:
        """Read on to the first message, for what stands before it, and go back to the beginning."""
        self._stream.seek(0)
        next(self.messages(), None)
        self._stream.seek(0)
        self.damage, self._broken_chunks = "", 0

    def type_of(self, channel: int) -> str:
        """The type of a channel's messages; raises RecordingError where the file does not say."""
        found = self.channels[channel]
        schema = self.schemas.get(found.schema_id)
        if schema is None:
            raise RecordingError(f"{found.topic}: the recording does not say its type")
        return schema.name

    def _note(self, data: bytes) -> None:
        """Keep what records other than messages say."""
        for record in _records(data):
            if isinstance(record, Schema):
                self.schemas[record.id] = record
            elif isinstance(record, Channel):
                self.channels[record.id] = record
            elif isinstance(record, Metadata) and record.name == METADATA_RECORD:
                self.texts.update(record.metadata)

    def _chunk(self, chunk: Chunk) -> Block | None:
        try:
            stream, size = get_chunk_data_stream(chunk, validate_crc=True)
            data = stream.read(size)
            block, others = message_block.of_chunk(data)
            if others:
                self._note(b"".join(data[begin:end] for begin, end in others))
        except BROKEN:
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


def words(error: Exception) -> str:
    """An error's text, or its name where it has none."""
    return str(error) or type(error).__name__
