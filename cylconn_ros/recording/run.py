"""Read a recorded run back: one table of NumPy columns per topic, and the parameters in force."""

from __future__ import annotations

import os
import sqlite3
import struct
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt
import yaml
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.writer import MCAP0_MAGIC

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording import connector_part, schema, sqlite
from cylconn_ros.recording.columns import appended, has_columns, of_block
from cylconn_ros.recording.mcap_reader import Source
from cylconn_ros.recording.message_block import Block
from cylconn_ros.recording.message_definitions import interface

STAMP = ("header.stamp.sec", "header.stamp.nanosec")
"""Fields of a message's stamp."""
_STATE_TYPE = "cylconn_ros/msg/ConnectorState"


@dataclass(frozen=True)
class Table:
    """The messages of one topic in the order they were written.

    ``table["pose.position.x"]`` is the column of a field, shape (n,) or (n, k). Messages that are
    not what their type says are left out of the columns and counted in ``undecodable``.
    """

    topic: str
    type: str
    log_time: npt.NDArray[np.int64]  # (n,) ns since the epoch, when recorded
    publish_time: npt.NDArray[np.int64]  # (n,) ns since the epoch, when sent
    columns: Mapping[str, npt.NDArray[Any]]
    undecodable: int

    def __len__(self) -> int:
        return len(self.log_time)

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        try:
            return self.columns[name]
        except KeyError:
            known = ", ".join(self.columns) or "none"
            raise RecordingError(f"{self.topic} has no field {name!r}; it has {known}") from None

    @property
    def stamp(self) -> npt.NDArray[np.int64]:
        """Header stamps, ns, shape (n,)."""
        seconds = self["header.stamp.sec"].astype(np.int64)
        return seconds * 1_000_000_000 + self["header.stamp.nanosec"]

    @property
    def time(self) -> npt.NDArray[np.float64]:
        """Seconds since the first header stamp, shape (n,)."""
        stamp = self.stamp
        return np.asarray((stamp - stamp[:1]) * 1e-9, dtype=np.float64)


_Counted = tuple[int, int, int]  # messages, log times of the first and the last


@dataclass
class _Channel:
    type: str
    definition: str
    numbers: set[int] = field(default_factory=set)  # in the file; mostly one
    count: int = 0
    times: tuple[int, int] = (0, 0)  # log times of the first and the last message

    def add(self, count: int, first: int, last: int) -> None:
        """Count messages, and keep the log times of the first and the last."""
        self.times = (self.times[0] if self.count else first), last
        self.count += count


class Run:
    """A recorded run. Its messages stay in the file until they are asked for.

    Attributes
    ----------
        path: the recorded file.
        metadata: texts stored with the run (``version``, ``method``, ``parameters``, …).
        parameters: parameters in force, nested as in a scene file; empty if none were stored.
        counts: messages per topic.
        incomplete: why the recording is not whole, or None.
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
        """Names of the connectors that were recorded; none where there is one alone."""
        return connector_part.names(self.metadata)

    def only(self, connector: str) -> Run:
        """The part of one of several connectors; raises RecordingError where there is none such."""
        found = connector_part.part(self.metadata, connector)
        channels = {topic: self._channels[topic] for topic in found.topics.values()
                    if topic in self._channels}  # fmt: skip
        return Run(self.path, found.texts, channels, self.incomplete)

    @property
    def names(self) -> dict[str, str]:
        """Topics of a run of ours by the names that one connector alone has."""
        return connector_part.part(self.metadata, "").topics

    @property
    def version(self) -> str:
        """Version of the program that recorded it; empty if unknown."""
        return self.metadata.get("version", "")

    @property
    def duration(self) -> float:
        """Seconds from the first to the last message, by their log times."""
        ends = [c.times for c in self._channels.values() if c.count]
        return (max(e for _, e in ends) - min(s for s, _ in ends)) * 1e-9 if ends else 0.0

    def raw(self, topic: str) -> Iterator[tuple[int, int, bytes]]:
        """Log time, publish time (ns) and bytes of every message of a topic, as written."""
        numbers = self._channel(topic).numbers
        for block in _blocks(self.path):
            for number, log_time, publish_time, data in block.messages():
                if number in numbers:
                    yield log_time, publish_time, data

    def pieces(self, *topics: str, only: Collection[str] | None = None) -> Iterator[Table]:
        """Topics decoded as the file is read: tables of some messages, in the order of the file.

        ``only``: the fields that are wanted; by default all.

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
                    found, good = of_block(*schemas[topic], block, which, only)
                except RecordingError as error:
                    raise RecordingError(f"{topic} ({channel.type}): {error}") from None
                log_time = block.log_time[which][good].astype(np.int64)
                publish_time = block.publish_time[which][good].astype(np.int64)
                undecodable = int((~good).sum())
                yield Table(topic, channel.type, log_time, publish_time, found, undecodable)

    def has_columns(self, topic: str) -> bool:
        """Whether a topic can be decoded: no lists of messages in it."""
        try:
            return has_columns(*self._schema(topic))
        except RecordingError:
            return False

    def table(self, topic: str) -> Table:
        """Decode a topic; raises RecordingError if it is unknown or its type has no columns."""
        if topic not in self._tables:
            pieces = list(self.pieces(topic))
            none = [np.zeros(0, np.int64)]
            log_time = np.concatenate([piece.log_time for piece in pieces] or none)
            publish_time = np.concatenate([piece.publish_time for piece in pieces] or none)
            undecodable = sum(piece.undecodable for piece in pieces)
            found = appended([dict(piece.columns) for piece in pieces])
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
        """The connector's states; raises RecordingError unless exactly one topic has them."""
        return self.table(self.state_topic)

    @property
    def state_topic(self) -> str:
        """Their topic; raises RecordingError unless there is exactly one."""
        topics = [topic for topic, name in self.types.items() if name == _STATE_TYPE]
        if self.connectors:
            raise RecordingError(
                f"{self.path}: holds several connectors, {', '.join(self.connectors)}: "
                "choose one with --connector NAME"
            )
        if len(topics) != 1:
            found = ", ".join(topics) or "none"
            raise RecordingError(f"{self.path}: expected one topic of {_STATE_TYPE}, found {found}")
        return topics[0]

    def topic(self, ending: str) -> str:
        """Find the one topic whose name ends in ``ending``, whatever namespace the run had.

        ``~/…`` is a topic below the name of the node that recorded.
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
    """Read a recorded run from its directory, or from its MCAP file.

    Of a run of several connectors, ``connector`` chooses one. Raises RecordingError when there is
    no recording, it was never finished, or its parts disagree.
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
        read = _read_database if file.suffix == sqlite.SUFFIX else _read_file
        metadata, channels = read(file)
    except OSError as error:
        raise RecordingError(f"{file}: {error.strerror or error}") from error
    except (McapError, sqlite3.Error, struct.error, ValueError, KeyError) as error:
        raise RecordingError(f"{file}: not a readable recording: {error!r}") from error
    run = Run(file, metadata, channels)
    run.incomplete = _disagreement(run, declared)
    return run.only(connector) if connector else run


def _read_file(file: Path) -> tuple[dict[str, str], dict[str, _Channel]]:
    """Texts and topics of an MCAP file, its messages counted."""
    with file.open("rb") as stream:
        _check_ends(file, stream)
        if make_reader(stream).get_summary() is None:
            raise RecordingError(f"{file}: has no summary, by which messages are looked up")
        stream.seek(0)
        source = Source(stream, file.stat().st_size)
        counted = [_counted(block) for block in source.blocks()]
    if source.damage:
        raise RecordingError(f"{file}: not a readable recording: {source.damage}")
    channels: dict[str, _Channel] = {}
    for number, channel in sorted(source.channels.items()):
        kind = source.type_of(number)
        definition = source.schemas[channel.schema_id].data.decode("utf-8")
        kept = channels.setdefault(channel.topic, _Channel(kind, definition))
        kept.numbers.add(number)
    for block in counted:
        for number, found in block.items():
            channels[source.channels[number].topic].add(*found)
    return source.texts, channels


def _read_database(file: Path) -> tuple[dict[str, str], dict[str, _Channel]]:
    """The same of SQLite, which defines no types: those that are installed can be decoded."""
    file.stat()  # or SQLite says less of what is wrong
    channels: dict[str, _Channel] = {}
    topics = sqlite.topics(file)
    for number, (topic, kind) in enumerate(topics):
        try:
            definition = interface(kind).definition
        except RecordingError:
            definition = ""
        channels.setdefault(topic, _Channel(kind, definition)).numbers.add(number)
    for _, block, _ in sqlite.messages(file):
        for number, found in _counted(block).items():
            channels[topics[number][0]].add(*found)
    return {}, channels


def _counted(block: Block) -> dict[int, _Counted]:
    """How many messages a block has of each channel, and their first and last log time."""
    numbers, first, counts = np.unique(block.channel, return_index=True, return_counts=True)
    _, last = np.unique(block.channel[::-1], return_index=True)
    times = block.log_time
    return {
        int(number): (int(n), int(times[a]), int(times[len(block) - 1 - b]))
        for number, a, b, n in zip(numbers, first, last, counts, strict=True)
    }


def _blocks(file: Path) -> Iterator[Block]:
    if file.suffix == sqlite.SUFFIX:
        for _, block, _ in sqlite.messages(file):
            yield block
        return
    try:
        with file.open("rb") as stream:
            yield from Source(stream, file.stat().st_size).blocks()
    except OSError as error:
        raise RecordingError(f"{file}: {error.strerror or error}") from error


def _check_ends(file: Path, stream: IO[bytes]) -> None:
    """Refuse a file that does not begin and end as MCAP files do, and say why."""
    length = len(MCAP0_MAGIC)
    if stream.read(length) != MCAP0_MAGIC:
        raise RecordingError(
            f"{file}: is not a recording (an MCAP file, or a directory with metadata.yaml)"
        )
    end = stream.seek(0, os.SEEK_END)
    stream.seek(max(length, end - length))
    if stream.read() != MCAP0_MAGIC:
        raise RecordingError(
            f"{file}: never finished (no summary at its end); cylconn salvage gives back what it "
            "has"
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
            "(cylconn salvage gives back what that has)"
        ) from None
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror or error}") from error
    except (yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise RecordingError(f"{path}: not metadata of a recorded run: {error!r}") from error


def _disagreement(run: Run, declared: dict[str, Any] | None) -> str | None:
    """Compare what metadata.yaml says with what is in the file."""
    if declared is None:
        return None
    reason = (declared.get("custom_data") or {}).get("incomplete")
    if reason:
        return str(reason)
    for item in declared.get("topics_with_message_count", []):
        name, count = item["topic_metadata"]["name"], item["message_count"]
        if run.counts.get(name, 0) != count:
            return f"{name}: metadata.yaml says {count} messages, found {run.counts.get(name, 0)}"
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
