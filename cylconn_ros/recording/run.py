"""Recorded runs: :func:`read_run`, tables of NumPy columns per topic, parameters in force."""

from __future__ import annotations

import os
import sqlite3
import struct
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np
import yaml
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.writer import MCAP0_MAGIC

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording import connector_part, schema, sqlite
from cylconn_ros.recording.columns import concatenate, has_columns, of_block
from cylconn_ros.recording.mcap.message_block import MessageBlock
from cylconn_ros.recording.mcap.reader import McapReader
from cylconn_ros.recording.message_definitions import interface
from cylconn_ros.recording.table import Table

_STATE_TYPE = "cylconn_ros/msg/ConnectorState"


_Counted = tuple[int, int, int]  # messages, log time of the first and of the last


@dataclass
class _Channel:
    type: str
    definition: str
    numbers: set[int] = field(default_factory=set)  # channel numbers in the file; usually one
    count: int = 0
    times: tuple[int, int] = (0, 0)  # log times of the first and the last message

    def add(self, count: int, first: int, last: int) -> None:
        """Count messages, and update the log times of the first and the last."""
        self.times = (self.times[0] if self.count else first), last
        self.count += count


class Run:
    """A recorded run; its messages are read from the file on demand.

    Attributes
    ----------
        path: the recorded file.
        metadata: texts stored with the run (``version``, ``method``, ``parameters``, etc.).
        parameters: parameters in force, nested as in a scene file; empty if none were stored.
        counts: messages per topic. types: message type per topic.
        incomplete: why the recording is incomplete, or None.
    """

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, str],
        channels: Mapping[str, _Channel],
        incomplete: str | None = None,
    ) -> None:
        self.path = path
        self.metadata = dict(metadata)
        self.incomplete = incomplete
        self.parameters = _parameters(metadata.get("parameters", ""))
        self.counts = {topic: channel.count for topic, channel in channels.items()}
        self.types = {topic: channel.type for topic, channel in channels.items()}
        self._channels = channels
        self._tables: dict[str, Table] = {}

    @property
    def connectors(self) -> list[str]:
        """Names of the recorded connectors; none for a single, unnamed connector."""
        return connector_part.names(self.metadata)

    def select(self, connector: str) -> Run:
        """Return the run of one of several connectors; raise RecordingError if it is unknown."""
        found = connector_part.select(self.metadata, connector)
        channels = {topic: self._channels[topic] for topic in found.topics.values()
                    if topic in self._channels}  # fmt: skip
        return Run(self.path, found.metadata, channels, self.incomplete)

    @property
    def names(self) -> dict[str, str]:
        """Resolved topics of a single connector by name, e.g. ``body_b/pose``; else empty."""
        return connector_part.select(self.metadata, "").topics

    @property
    def version(self) -> str:
        """Version of cylconn_ros that recorded the run; empty if unknown."""
        return self.metadata.get("version", "")

    @property
    def duration(self) -> float:
        """Seconds from the first to the last message, by log time."""
        ends = [c.times for c in self._channels.values() if c.count]
        return (max(e for _, e in ends) - min(s for s, _ in ends)) * 1e-9 if ends else 0.0

    def raw(self, topic: str) -> Iterator[tuple[int, int, bytes]]:
        """Yield log time, publish time (ns) and serialized bytes of every message of a topic."""
        numbers = self._channel(topic).numbers
        for block in _blocks(self.path):
            for number, log_time, publish_time, data in block.messages():
                if number in numbers:
                    yield log_time, publish_time, data

    def read_blocks(self, *topics: str, fields: Collection[str] | None = None) -> Iterator[Table]:
        """Yield tables of some messages each, in file order, without loading whole topics.

        Args:
            topics: topics to decode.
            fields: the fields to decode; default: all.

        Raises RecordingError for a topic that is unknown or whose type has no columns.
        """
        wanted = [(topic, self._channel(topic)) for topic in topics]
        schemas = {topic: self._schema(topic) for topic in topics}
        for block in _blocks(self.path):
            for topic, channel in wanted:
                which = np.flatnonzero(np.isin(block.channel, list(channel.numbers)))
                if not len(which):
                    continue
                try:
                    found, good = of_block(*schemas[topic], block, which, fields)
                except RecordingError as error:
                    raise RecordingError(f"{topic} ({channel.type}): {error}") from None
                log_time = block.log_time[which][good].astype(np.int64)
                publish_time = block.publish_time[which][good].astype(np.int64)
                undecodable = int((~good).sum())
                yield Table(topic, channel.type, log_time, publish_time, found, undecodable)

    def has_columns(self, topic: str) -> bool:
        """Return whether a topic can be decoded: its type is known and has no message lists."""
        try:
            return has_columns(*self._schema(topic))
        except RecordingError:
            return False

    def table(self, topic: str) -> Table:
        """Decode a topic; raise RecordingError if it is unknown or its type has no columns."""
        if topic not in self._tables:
            blocks = list(self.read_blocks(topic))
            none = [np.zeros(0, np.int64)]
            log_time = np.concatenate([block.log_time for block in blocks] or none)
            publish_time = np.concatenate([block.publish_time for block in blocks] or none)
            undecodable = sum(block.undecodable for block in blocks)
            found = concatenate([dict(block.columns) for block in blocks])
            kind = self._channel(topic).type
            self._tables[topic] = Table(topic, kind, log_time, publish_time, found, undecodable)
        return self._tables[topic]

    def _schema(self, topic: str) -> tuple[schema.Schema, str]:
        channel = self._channel(topic)
        name = schema.short_name(channel.type)[0]
        if not channel.definition:
            raise RecordingError(f"{topic}: its type {channel.type} is not installed here")
        try:
            return schema.parse(channel.type, channel.definition), name
        except RecordingError as error:
            raise RecordingError(f"{topic} ({channel.type}): {error}") from None

    @property
    def state(self) -> Table:
        """The ConnectorState table; raises RecordingError unless exactly one topic has it."""
        return self.table(self.state_topic)

    @property
    def state_topic(self) -> str:
        """Topic of the states; raises RecordingError unless there is exactly one."""
        topics = [topic for topic, name in self.types.items() if name == _STATE_TYPE]
        if self.connectors:
            raise RecordingError(
                f"{self.path}: contains several connectors, {', '.join(self.connectors)}: "
                "choose one with --connector NAME"
            )
        if len(topics) != 1:
            found = ", ".join(topics) or "none"
            raise RecordingError(f"{self.path}: expected one topic of {_STATE_TYPE}, found {found}")
        return topics[0]

    def topic(self, ending: str) -> str:
        """Return the one topic whose name ends in ``ending``, in any namespace.

        ``~/name`` is a topic below the name of the recording node. Raises RecordingError if there
        is no such topic, or more than one.
        """
        if ending.startswith("~/"):
            below = [self.metadata.get("node", "") + ending[1:], "/connector" + ending[1:]]
            ending = next((topic for topic in below if topic in self.types), ending[2:])
        found = [t for t in self.types if t == ending or t.endswith("/" + ending.lstrip("/"))]
        if len(found) != 1:
            names = ", ".join(found or self.types)
            raise RecordingError(f"{self.path}: no single topic {ending} among {names}")
        return found[0]

    def _channel(self, topic: str) -> _Channel:
        try:
            return self._channels[topic]
        except KeyError:
            names = ", ".join(self._channels) or "none"
            raise RecordingError(f"{self.path}: no topic {topic}; it has {names}") from None


def read_run(path: Path | str, connector: str = "") -> Run:
    """Open a recorded run.

    Args:
        path: the rosbag2 directory, or its MCAP or SQLite (.db3) file.
        connector: the one to select of a run of several connectors.

    Returns
    -------
        The run; its ``incomplete`` holds the reason if the recording is incomplete.

    Raises
    ------
        RecordingError: there is no recording, it was never finished, it has no such connector, or
            its metadata cannot be read.

    Example::

        recorded = cr.read_run("bag")
        recorded.state["normal_force"], recorded.state.time, recorded.parameters
    """
    path = Path(path)
    declared: dict[str, Any] | None = None
    file = path
    if path.is_dir():
        declared = _bag_information(path)
        names = declared.get("relative_file_paths") or []
        if len(names) != 1:
            raise RecordingError(f"{path}: expected one recorded file, found {len(names)}")
        file = path / names[0]
    try:
        read = _read_sqlite if file.suffix == sqlite.SUFFIX else _read_mcap
        metadata, channels = read(file)
    except OSError as error:
        raise RecordingError(f"{file}: {error.strerror or error}") from error
    except (McapError, sqlite3.Error, struct.error, ValueError, KeyError) as error:
        raise RecordingError(f"{file}: not a readable recording: {error!r}") from error
    run = Run(file, metadata, channels)
    run.incomplete = _disagreement(run, declared)
    return run.select(connector) if connector else run


def _read_mcap(file: Path) -> tuple[dict[str, str], dict[str, _Channel]]:
    """Return metadata and topics of an MCAP file, with message counts."""
    with file.open("rb") as stream:
        _check_ends(file, stream)
        if make_reader(stream).get_summary() is None:
            raise RecordingError(f"{file}: has no MCAP summary")
        stream.seek(0)
        reader = McapReader(stream, file.stat().st_size)
        counted = [_count(block) for block in reader.blocks()]
    if reader.damage:
        raise RecordingError(f"{file}: not a readable recording: {reader.damage}")
    channels: dict[str, _Channel] = {}
    for number, channel in sorted(reader.channels.items()):
        kind = reader.type_of(number)
        definition = reader.schemas[channel.schema_id].data.decode("utf-8")
        kept = channels.setdefault(channel.topic, _Channel(kind, definition))
        kept.numbers.add(number)
    for block in counted:
        for number, found in block.items():
            channels[reader.channels[number].topic].add(*found)
    return reader.metadata, channels


def _read_sqlite(file: Path) -> tuple[dict[str, str], dict[str, _Channel]]:
    """Return topics of an SQLite file, which has no metadata.

    It has no message definitions either; the installed ones are used.
    """
    file.stat()  # its OSError is clearer than the error of SQLite
    channels: dict[str, _Channel] = {}
    topics = sqlite.topics(file)
    for number, (topic, kind) in enumerate(topics):
        try:
            definition = interface(kind).definition
        except RecordingError:
            definition = ""
        channels.setdefault(topic, _Channel(kind, definition)).numbers.add(number)
    for _, block, _ in sqlite.messages(file):
        for number, found in _count(block).items():
            channels[topics[number][0]].add(*found)
    return {}, channels


def _count(block: MessageBlock) -> dict[int, _Counted]:
    """Return the messages of each channel in a block, with first and last log time."""
    numbers, first, counts = np.unique(block.channel, return_index=True, return_counts=True)
    _, last = np.unique(block.channel[::-1], return_index=True)
    times = block.log_time
    return {
        int(number): (int(n), int(times[a]), int(times[len(block) - 1 - b]))
        for number, a, b, n in zip(numbers, first, last, counts, strict=True)
    }


def _blocks(file: Path) -> Iterator[MessageBlock]:
    if file.suffix == sqlite.SUFFIX:
        for _, block, _ in sqlite.messages(file):
            yield block
        return
    try:
        with file.open("rb") as stream:
            yield from McapReader(stream, file.stat().st_size).blocks()
    except OSError as error:
        raise RecordingError(f"{file}: {error.strerror or error}") from error


def _check_ends(file: Path, stream: IO[bytes]) -> None:
    """Raise RecordingError if a file does not begin and end with the MCAP magic bytes."""
    length = len(MCAP0_MAGIC)
    if stream.read(length) != MCAP0_MAGIC:
        raise RecordingError(
            f"{file}: is not a recording (an MCAP file, or a directory with metadata.yaml)"
        )
    end = stream.seek(0, os.SEEK_END)
    stream.seek(max(length, end - length))
    if stream.read() != MCAP0_MAGIC:
        raise RecordingError(
            f"{file}: never finished (no summary at its end); cylconn salvage recovers its messages"
        )
    stream.seek(0)


def _bag_information(directory: Path) -> dict[str, Any]:
    path = directory / "metadata.yaml"
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        return dict(content["rosbag2_bagfile_information"])
    except FileNotFoundError:
        raise RecordingError(
            f"{directory}: no metadata.yaml: not a recorded run, or one that was never closed "
            "(cylconn salvage recovers its messages)"
        ) from None
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}") from error
    except (yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise RecordingError(f"{path}: not metadata of a recorded run: {error!r}") from error


def _disagreement(run: Run, declared: dict[str, Any] | None) -> str | None:
    """Compare metadata.yaml with the file; return the first difference, or None."""
    if declared is None:
        return None
    reason = (declared.get("custom_data") or {}).get("incomplete")
    if reason:
        return str(reason)
    for item in declared.get("topics_with_message_count", []):
        name, count = item["topic_metadata"]["name"], item["message_count"]
        if run.counts.get(name, 0) != count:
            return f"{name}: metadata.yaml lists {count} messages, found {run.counts.get(name, 0)}"
    return None


def _parameters(text: str) -> dict[str, Any]:
    if not text:
        return {}
    try:
        nodes = yaml.safe_load(text) or {}
        merged: dict[str, Any] = {}
        for block in nodes.values():
            merged.update(block["ros__parameters"])
        return merged
    except (yaml.YAMLError, AttributeError, KeyError, TypeError) as error:
        raise RecordingError(f"parameters stored with the run: {error!r}") from error
