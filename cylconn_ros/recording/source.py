"""Messages of an MCAP file one after the other, from its beginning, whatever its end is like.

Nothing is kept but the chunk being read, so a file may be larger than memory, and one that was
never closed, or is damaged, gives what it has.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import IO, NamedTuple

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk, get_chunk_data_stream
from zstandard import ZstdError

from .errors import RecordingError
from .writer import METADATA_RECORD

BROKEN = (McapError, ZstdError, struct.error, ValueError, EOFError)

_RECORD = struct.Struct("<BQ")  # opcode, length
_MESSAGE = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time


class Found(NamedTuple):
    """A message as it was recorded; times in ns since the epoch."""

    channel: int
    log_time: int
    publish_time: int
    data: bytes


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
        records = StreamReader(self._stream, emit_chunks=True, record_size_limit=self.size).records
        ended = False
        while not ended:
            self.at = self._stream.tell()
            try:
                record = next(records, None)
            except BROKEN as error:
                self.damage = f"it breaks off at byte {self.at} of {self.size} ({words(error)})"
                break
            ended = record is None or isinstance(record, DataEnd)
            if isinstance(record, Chunk):
                yield from self._chunk(record)
            elif isinstance(record, Message):
                yield Found(record.channel_id, record.log_time, record.publish_time, record.data)
            elif record is not None:
                self._note(record)
        if self._broken_chunks:
            broken = f"{self._broken_chunks} of its chunks cannot be read"
            self.damage = "; ".join(filter(None, (self.damage, broken)))

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

    def _note(self, record: McapRecord) -> None:
        if isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            self.channels[record.id] = record
        elif isinstance(record, Metadata) and record.name == METADATA_RECORD:
            self.texts.update(record.metadata)

    def _chunk(self, chunk: Chunk) -> Iterator[Found]:
        try:
            stream, size = get_chunk_data_stream(chunk, validate_crc=True)
            data = stream.read(size)
            others, found = [], []
            at = 0
            while at < size:
                opcode, length = _RECORD.unpack_from(data, at)
                end = at + _RECORD.size + length
                if end > size:
                    raise ValueError("a record is longer than its chunk")
                if opcode == Opcode.MESSAGE:
                    _, _, channel, _, log, publish = _MESSAGE.unpack_from(data, at)
                    found.append(Found(channel, log, publish, data[at + _MESSAGE.size : end]))
                else:
                    others.append(at)
                at = end
            if others:
                for record in breakup_chunk(chunk):
                    self._note(record)
        except BROKEN:
            self._broken_chunks += 1
            return
        yield from found


def words(error: Exception) -> str:
    """An error's text, or its name where it has none."""
    return str(error) or type(error).__name__
