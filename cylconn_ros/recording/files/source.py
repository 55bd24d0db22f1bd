"""The one way to open a recording: all commands read the same files with the same result.

:class:`Source` finds the files, identifies their formats, indexes them once, and then yields the
messages in order of log time, as ``ros2 bag play`` does. What it cannot read is named:
``left_out`` topics, ``damage``, ``notes``.
"""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.files import compression, definitions, finding, formats, ordering
from cylconn_ros.recording.files.ordering import Place
from cylconn_ros.recording.files.sqlite import SqliteFile
from cylconn_ros.recording.files.storage import Contents, Extent, StorageFile, StoredChannel, Topics
from cylconn_ros.recording.mcap.message_block import MessageBlock
from cylconn_ros.recording.mcap.reader import McapFile

Paths = Path | str | Sequence[Path | str]


@dataclass
class TopicFacts:
    """A topic of a recording.

    Attributes
    ----------
        type: package/msg/Name. definition: ros2msg text; '' if none is known.
        stored: whether the definition was stored with the recording. reason: why there is none.
        numbers: channel numbers in the blocks of the source; usually one.
        extent: number of messages, first and last log time.
        type_hash, qos: as stored.
    """

    type: str
    definition: str = ""
    stored: bool = False
    reason: str = ""
    numbers: set[int] = field(default_factory=set)
    extent: Extent = field(default_factory=Extent)
    type_hash: str = ""
    qos: str = ""


class Source:
    """A recording of one or more files; its messages are read on demand.

    Attributes
    ----------
        path: as named; the first of several.
        files: the files, in order of recording.
        topics: topic by channel number of the blocks.
        channels: facts by topic, of the topics that can be read.
        left_out: why a topic is not read, by its name.
        metadata: texts stored with the recording.
        declared: number of messages by topic according to metadata.yaml.
        notes: what metadata.yaml says wrongly.
        incomplete: why the recording is incomplete; empty if it is not.
        finished: whether all files have their end.
        size, done: bytes of all files; bytes read so far.
    """

    def __init__(self, paths: Paths) -> None:
        """Open a recording.

        Args:
            paths: a rosbag2 directory, or an MCAP or SQLite (.db3) file, also compressed by
                rosbag2; or several of these, which are one recording.

        Raises RecordingError with the name of the file if it is not a recording.
        """
        named = [Path(paths)] if isinstance(paths, str | Path) else [Path(p) for p in paths]
        found = finding.find(named)
        self.files = found.files
        self.path = named[0]
        self.metadata: dict[str, str] = dict(found.custom)
        self.notes, self.declared = found.notes, found.counts
        self.incomplete, self.finished = found.incomplete, True
        self.topics = Topics()
        self.channels: dict[str, TopicFacts] = {}
        self.left_out: dict[str, str] = {}
        self.size = self.done = 0
        self._temporary: list[IO[bytes]] = []
        self._stored: list[StorageFile] = []
        self._maps: list[np.ndarray] = []  # channel number here, by channel number in the file
        self._contents: list[Contents] = []
        self._places: list[Place] = []
        for path in self.files:
            self._add(path)
        if not self._places and not self.channels and not self.left_out:
            raise RecordingError(
                f"{self.file}: contains no readable message: {self.damage or 'it is empty'}"
            )

    @property
    def file(self) -> Path:
        """The file, or ``path`` if there are several."""
        return self.files[0] if len(self.files) == 1 else self.path

    @property
    def damage(self) -> str:
        """Description of what cannot be read; '' for intact files."""
        several = len(self.files) > 1
        return "; ".join(
            f"{path.name}: {text}" if several else text
            for path, contents in zip(self.files, self._contents, strict=False)
            for text in contents.damage
        )

    @property
    def fully_read(self) -> bool:
        """Whether the files have no damage and have their ends."""
        return self.finished and not self.damage

    def blocks(self) -> Iterator[MessageBlock]:
        """Yield all messages as non-empty blocks, in order of log time."""
        self.done = 0
        try:
            for block, done in ordering.joined(ordering.in_order(self._load, self._places)):
                self.done = done
                yield block
        except OSError as error:
            raise RecordingError(f"{self.path}: {error.strerror or error}") from error
        self.done = self.size

    def _load(self, place: Place, begin: int, end: int) -> Iterator[MessageBlock]:
        numbers = self._maps[place.file]
        for block in self._stored[place.file].load(place.unit, begin, end):
            parts = compression.decompressed(block) if compression.is_compressed(block) else [block]
            for part in parts:
                yield MessageBlock(
                    part.raw,
                    numbers[part.channel.astype(np.intp)],
                    part.log_time,
                    part.publish_time,
                    part.start,
                    part.size,
                )

    def _add(self, path: Path) -> None:
        """Open and index a file."""
        try:
            stored = self._open(path)
            contents = stored.contents()
            self.size += path.stat().st_size
        except OSError as error:
            raise RecordingError(f"{path}: {error.strerror or error}") from error
        except sqlite3.Error as error:
            raise RecordingError(f"{path}: not a readable recording: {error}") from None
        number = len(self._stored)
        self._stored.append(stored)
        self._contents.append(contents)
        self._places += [Place(number, unit) for unit in contents.units]
        self.finished &= contents.finished
        self.metadata = {**self.metadata, **contents.metadata}
        known = [*contents.channels, *contents.extents]
        numbers = np.zeros(1 + max(known, default=0), np.uint64)
        for channel in sorted(set(known)):
            numbers[channel] = len(self.topics)
            self._add_channel(
                contents.channels.get(channel),
                contents.extents.get(channel, Extent()),
                channel,
            )
        self._maps.append(numbers)

    def _open(self, path: Path) -> StorageFile:
        kind = formats.identify(path)
        place = path
        if kind in (formats.ZSTD, formats.LZ4):
            temporary = compression.unpacked(path, kind)
            self._temporary.append(temporary)
            place = Path(temporary.name)
            try:
                kind = formats.identify(place)
            except RecordingError:
                kind = ""
            if kind not in (formats.MCAP, formats.SQLITE):
                raise RecordingError(f"{path}: compressed, but its content is not a recording")
        if kind == formats.SQLITE:
            return SqliteFile(place, path)
        return McapFile(place)

    def _add_channel(self, stored: StoredChannel | None, extent: Extent, number: int) -> None:
        here = len(self.topics)
        if stored is None:
            self.topics[here] = f"(channel {number}, not described)"
            self.left_out[self.topics[here]] = f"{extent.count} messages of an undefined channel"
            return
        topic = stored.topic
        self.topics[here] = topic
        known = self.channels.get(topic)
        if stored.reason or not stored.type:
            self._leave_out(topic, stored.reason or "it has no type")
        elif topic in self.left_out:
            pass
        elif known is not None and known.type != stored.type:
            self._leave_out(topic, f"it has messages of {known.type} and of {stored.type}")
        else:
            found = definitions.resolve(stored)
            new = TopicFacts(stored.type, found.text, found.stored, found.reason)
            facts = self.channels.setdefault(topic, new)
            facts.numbers.add(here)
            facts.type_hash = facts.type_hash or stored.type_hash
            facts.qos = facts.qos or stored.qos
            if extent.count:
                facts.extent.add(extent.count, extent.first, extent.last)

    def _leave_out(self, topic: str, reason: str) -> None:
        self.left_out[topic] = reason
        self.channels.pop(topic, None)

    def __del__(self) -> None:
        for opened in (*getattr(self, "_stored", ()), *getattr(self, "_temporary", ())):
            with contextlib.suppress(OSError, sqlite3.Error):
                opened.close()
