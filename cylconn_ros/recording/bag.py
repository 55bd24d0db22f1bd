"""A recording of any software as a sequence of messages in order of log time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from cylconn_ros.recording import connector_part
from cylconn_ros.recording.files.source import Paths, Source
from cylconn_ros.recording.files.storage import Topics
from cylconn_ros.recording.mcap.message_block import MessageBlock


class Message(NamedTuple):
    """A serialized message with its topic; log time in ns since the epoch."""

    topic: str
    log_time: int
    data: bytes


class Bag:
    """A recording, read sequentially. Memory holds one block of messages at a time.

    Attributes
    ----------
        source: its files.
        path: as of the source.
        types: message type of every topic that is read, ``package/msg/Name``.
        definitions: stored schema of every topic (``ros2msg`` text), as far as it has one.
        metadata: texts that cylconn_ros stored (``parameters``, ``version``, etc.); else empty.
        names: resolved topics of the connector by single-connector name; empty if not stored.
    """

    def __init__(self, path: Paths | Source, connector: str = "") -> None:
        """Open a recording, and read its topics and metadata.

        Args:
            path: as of :class:`~cylconn_ros.recording.files.source.Source`, or a source.
            connector: the one to select of several connectors.

        Raises RecordingError if ``path`` is not a recording or has no such connector.
        """
        self.source = path if isinstance(path, Source) else Source(path)
        self.path = self.source.path
        facts = self.source.channels
        self.types = {topic: each.type for topic, each in facts.items()}
        self.definitions = {t: each.definition for t, each in facts.items() if each.stored}
        self.metadata, self.names = connector_part.select(self.source.metadata, connector)
        if connector:
            own = set(self.names.values())
            self.types = {topic: kind for topic, kind in self.types.items() if topic in own}

    @property
    def damage(self) -> str:
        """Description of what could not be read so far; '' for an intact recording."""
        found = self.source.damage
        return found or ("" if self.source.finished else "it was never closed")

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return self.source.size

    @property
    def done(self) -> int:
        """Bytes read so far."""
        return self.source.done

    def messages(self) -> Iterator[Message]:
        """Yield every message, in order of log time."""
        for topics, block in self.blocks():
            for channel, log_time, _, data in block.messages():
                yield Message(topics[channel], log_time, data)

    def blocks(self) -> Iterator[tuple[Topics, MessageBlock]]:
        """Yield blocks of messages, in order of log time, with the topics of their channels."""
        for block in self.source.blocks():
            yield self.source.topics, block
