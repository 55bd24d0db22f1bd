"""Any rosbag2 recording as a stream of messages: directories and files, MCAP or SQLite.

Who wrote it does not matter. Memory holds one chunk at a time.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording import connector_part, sqlite
from cylconn_ros.recording.mcap_reader import Source
from cylconn_ros.recording.message_block import Block
from cylconn_ros.recording.sqlite import Topics

SUFFIXES = (".mcap", ".db3")


class Message(NamedTuple):
    """A serialised message and where it was recorded; times in ns since the epoch."""

    topic: str
    log_time: int
    data: bytes


class Bag:
    """A recording, read from its beginning to its end.

    Attributes
    ----------
        types: of every topic, ``package/msg/Name``.
        texts: kept with a run of ours (``parameters``, ``version``, …); empty for others'.
        names: of a run of ours, the topics of the connector by the names that one alone has.
        damage: what could not be read so far, in words.
        done, size: bytes read so far, and in all.
    """

    def __init__(self, path: Path | str, connector: str = "") -> None:
        """Look at what is there; of several connectors that were recorded, at one.

        Raises RecordingError where that is no recording, or holds no such connector.
        """
        self.path = Path(path)
        self._files, custom = _files(self.path)
        self.types: dict[str, str] = {}
        self.texts: dict[str, str] = {str(k): str(v) for k, v in custom.items()}
        self.damage = ""
        try:
            self._sizes = [file.stat().st_size for file in self._files]
            for file, size in zip(self._files, self._sizes, strict=True):
                self._look(file, size)
        except OSError as error:
            raise RecordingError(f"{self.path}: {error.strerror or error}") from error
        except sqlite3.Error as error:
            raise RecordingError(f"{self.path}: not a readable recording: {error}") from None
        self.size, self.done = sum(self._sizes), 0
        self.texts, self.names = connector_part.part(self.texts, connector)
        if connector:
            own = set(self.names.values())
            self.types = {topic: kind for topic, kind in self.types.items() if topic in own}

    def messages(self) -> Iterator[Message]:
        """Every message, in the order in which they stand in the files."""
        for topics, block in self.blocks():
            for channel, log_time, _, data in block.messages():
                yield Message(topics[channel], log_time, data)

    def blocks(self) -> Iterator[tuple[Topics, Block]]:
        """The same by the block, with the topics of its channels."""
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
                        source = Source(stream, size)
                        topics = Topics()
                        for block in source.blocks():
                            if len(source.channels) > len(topics):
                                known = source.channels.items()
                                topics = Topics({number: c.topic for number, c in known})
                            self.done = before + source.at
                            yield topics, block
                    if source.damage:
                        damages.append(f"{file.name}: {source.damage}")
            except OSError as error:
                raise RecordingError(f"{file}: {error.strerror or error}") from error
            except sqlite3.Error as error:
                damages.append(f"{file.name}: {error}")
            before += size
        self.done, self.damage = self.size, "; ".join(damages)

    def _look(self, file: Path, size: int) -> None:
        if file.suffix == ".db3":
            for name, kind in sqlite.topics(file):
                self._add(name, kind)
            return
        with file.open("rb") as stream:
            source = Source(stream, size)
            seen = next(source.messages(), None)
            if seen is None and not source.channels:
                raise RecordingError(
                    f"{file}: holds no message that can be read: {source.damage or 'it is empty'}"
                )
            for number, channel in source.channels.items():
                self._add(channel.topic, source.type_of(number))
            self.texts = {**self.texts, **source.texts}

    def _add(self, topic: str, kind: str) -> None:
        if self.types.setdefault(topic, kind) != kind:
            raise RecordingError(
                f"{self.path}: topic {topic} holds {self.types[topic]} and {kind}; "
                "one type a topic can be read"
            )


def _files(path: Path) -> tuple[list[Path], dict[str, Any]]:
    """The files of a recording in order, and what else its metadata.yaml tells."""
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
        told = content["rosbag2_bagfile_information"]
        files = [path / name for name in told["relative_file_paths"]]
        return files, dict(told.get("custom_data") or {})
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise RecordingError(f"{description}: not metadata of a recording: {error!r}") from error
