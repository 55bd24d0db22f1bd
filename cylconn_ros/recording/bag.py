"""Sequential reader of any rosbag2 recording: directory or file, MCAP or SQLite storage.

Recordings of other software are read, too. Memory holds one block of messages at a time.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording import connector_part, sqlite
from cylconn_ros.recording.mcap.message_block import MessageBlock
from cylconn_ros.recording.mcap.reader import McapReader
from cylconn_ros.recording.sqlite import Topics

SUFFIXES = (".mcap", ".db3")


class Message(NamedTuple):
    """A serialized message with its topic; log time in ns since the epoch."""

    topic: str
    log_time: int
    data: bytes


class Bag:
    """A recording, read sequentially.

    Attributes
    ----------
        types: message type of every topic, ``package/msg/Name``.
        definitions: stored schema of every topic (``ros2msg`` text); none in SQLite storage.
        metadata: texts that cylconn_ros stored (``parameters``, ``version``, etc.); else empty.
        names: resolved topics of the connector by single-connector name; empty if not stored.
        damage: description of what could not be read so far.
        done, size: bytes read so far, and in total.
    """

    def __init__(self, path: Path | str, connector: str = "") -> None:
        """Open a recording, and read its topics and metadata.

        Args:
            path: a rosbag2 directory, or an .mcap or .db3 file.
            connector: the one to select of several connectors.

        Raises RecordingError if ``path`` is not a recording or has no such connector.
        """
        self.path = Path(path)
        self._files, custom = _files(self.path)
        self.types: dict[str, str] = {}
        self.definitions: dict[str, str] = {}
        self.metadata: dict[str, str] = {str(k): str(v) for k, v in custom.items()}
        self.damage = ""
        try:
            self._sizes = [file.stat().st_size for file in self._files]
            for file, size in zip(self._files, self._sizes, strict=True):
                self._read_topics(file, size)
        except OSError as error:
            raise RecordingError(f"{self.path}: {error.strerror or error}") from error
        except sqlite3.Error as error:
            raise RecordingError(f"{self.path}: not a readable recording: {error}") from None
        self.size, self.done = sum(self._sizes), 0
        self.metadata, self.names = connector_part.select(self.metadata, connector)
        if connector:
            own = set(self.names.values())
            self.types = {topic: kind for topic, kind in self.types.items() if topic in own}

    def messages(self) -> Iterator[Message]:
        """Yield every message, in file order."""
        for topics, block in self.blocks():
            for channel, log_time, _, data in block.messages():
                yield Message(topics[channel], log_time, data)

    def blocks(self) -> Iterator[tuple[Topics, MessageBlock]]:
        """Yield blocks of messages, in file order, with the topics of their channel numbers."""
        before = 0
        damages = []
        for file, size in zip(self._files, self._sizes, strict=True):
            try:
                if file.suffix == ".db3":
                    for topics, block, share in sqlite.messages(file):
                        self.done = before + int(share * size)
                        yield topics, block
                else:
                    with file.open("rb") as stream:
                        reader = McapReader(stream, size)
                        topics = Topics()
                        for block in reader.blocks():
                            if len(reader.channels) > len(topics):
                                known = reader.channels.items()
                                topics = Topics({number: c.topic for number, c in known})
                            self.done = before + reader.position
                            yield topics, block
                    if reader.damage:
                        damages.append(f"{file.name}: {reader.damage}")
            except OSError as error:
                raise RecordingError(f"{file}: {error.strerror or error}") from error
            except sqlite3.Error as error:
                damages.append(f"{file.name}: {error}")
            before += size
        self.done, self.damage = self.size, "; ".join(damages)

    def _read_topics(self, file: Path, size: int) -> None:
        if file.suffix == ".db3":
            for name, kind in sqlite.topics(file):
                self._add_topic(name, kind)
            return
        with file.open("rb") as stream:
            reader = McapReader(stream, size)
            first = next(reader.messages(), None)
            if first is None and not reader.channels:
                raise RecordingError(
                    f"{file}: contains no readable message: {reader.damage or 'it is empty'}"
                )
            for number, channel in reader.channels.items():
                self._add_topic(channel.topic, reader.type_of(number))
                if definition := reader.definition_of(number):
                    self.definitions.setdefault(channel.topic, definition)
            self.metadata = {**self.metadata, **reader.metadata}

    def _add_topic(self, topic: str, kind: str) -> None:
        if self.types.setdefault(topic, kind) != kind:
            raise RecordingError(
                f"{self.path}: topic {topic} has messages of {self.types[topic]} and {kind}; "
                "only one type per topic is supported"
            )


def _files(path: Path) -> tuple[list[Path], dict[str, Any]]:
    """Return the files of a recording in order, and the custom data of its metadata.yaml."""
    if not path.is_dir():
        if not path.exists():
            raise RecordingError(f"{path}: no such file or directory")
        if path.suffix not in SUFFIXES:
            raise RecordingError(
                f"{path}: is not a recording (a directory with metadata.yaml, .mcap or .db3)"
            )
        return [path], {}
    description = path / "metadata.yaml"
    if not description.exists():  # never closed
        found = sorted(file for file in path.iterdir() if file.suffix in SUFFIXES)
        if not found:
            raise RecordingError(f"{path}: no metadata.yaml, .mcap or .db3 in it: not a recording")
        return found, {}
    try:
        content = yaml.safe_load(description.read_text(encoding="utf-8"))
        information = content["rosbag2_bagfile_information"]
        files = [path / name for name in information["relative_file_paths"]]
        return files, dict(information.get("custom_data") or {})
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise RecordingError(f"{description}: not metadata of a recording: {error!r}") from error
