"""Recorded runs: :func:`read_run`, tables of NumPy columns per topic, parameters in force."""

from __future__ import annotations

import functools
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording import connector_part, export, schema
from cylconn_ros.recording.columns import concatenate, has_columns, of_block
from cylconn_ros.recording.files.source import Paths, Source, TopicFacts
from cylconn_ros.recording.table import Table
from cylconn_ros.scene import limited_yaml

if TYPE_CHECKING:
    import pandas

_STATE_TYPE = "cylconn_ros/msg/ConnectorState"
_UNFINISHED = "never finished, its end is missing"
_SALVAGE = "; cylconn salvage recovers its messages"


class Run:
    """A recorded run; its messages are read from the file on demand.

    Attributes
    ----------
        path: the recorded file, or the directory of several.
        source: the files. left_out: why a topic is not read, by its name.
        metadata: texts stored with the run (``version``, ``method``, ``parameters``, etc.).
        parameters: parameters in force, nested as in a scene file; empty if none were stored.
        counts: messages per topic. types: message type per topic.
        undefined: why a topic cannot be decoded, by its name: its type is not known.
        incomplete: why the recording is incomplete, or None.
    """

    def __init__(
        self,
        source: Source,
        metadata: Mapping[str, str] | None = None,
        channels: Mapping[str, TopicFacts] | None = None,
    ) -> None:
        """``metadata``, ``channels``: those of one connector; by default all of the source."""
        self.source, self.path = source, source.file
        self.metadata = dict(source.metadata if metadata is None else metadata)
        self._channels = source.channels if channels is None else channels
        self.incomplete = why_incomplete(source)
        self.left_out = source.left_out
        self.counts = {topic: facts.extent.count for topic, facts in self._channels.items()}
        self.types = {topic: facts.type for topic, facts in self._channels.items()}
        self.undefined = {t: f.reason for t, f in self._channels.items() if not f.definition}
        self._tables: dict[str, Table] = {}

    @functools.cached_property
    def parameters(self) -> dict[str, Any]:
        """Dotted parameters stored with the run; raises RecordingError if they cannot be read."""
        return _parameters(self.metadata.get("parameters", ""), self.path)

    @property
    def connectors(self) -> list[str]:
        """Names of the recorded connectors; none for a single, unnamed connector."""
        return connector_part.names(self.metadata)

    def select(self, connector: str) -> Run:
        """Return the run of one of several connectors; raise RecordingError if it is unknown."""
        found = connector_part.select(self.metadata, connector)
        channels = {topic: self._channels[topic] for topic in found.topics.values()
                    if topic in self._channels}  # fmt: skip
        return Run(self.source, found.metadata, channels)

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
        ends = [c.extent for c in self._channels.values() if c.extent.count]
        return (max(e.last for e in ends) - min(e.first for e in ends)) * 1e-9 if ends else 0.0

    def raw(self, topic: str) -> Iterator[tuple[int, int, bytes]]:
        """Yield log time, publish time (ns) and serialized bytes of every message of a topic."""
        numbers = self._channel(topic).numbers
        for block in self.source.blocks():
            for number, log_time, publish_time, data in block.messages():
                if number in numbers:
                    yield log_time, publish_time, data

    def read_blocks(self, *topics: str, fields: Collection[str] | None = None) -> Iterator[Table]:
        """Yield tables of some messages each, in order of log time, without loading whole topics.

        Args:
            topics: topics to decode.
            fields: the fields to decode; default: all.

        Raises RecordingError for a topic that is unknown or whose type has no columns.
        """
        wanted = [(topic, self._channel(topic)) for topic in topics]
        schemas = {topic: self._schema(topic) for topic in topics}
        for block in self.source.blocks():
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

    def to_dataframe(self, topic: str = "") -> pandas.DataFrame:
        """A topic as a pandas DataFrame with ``time`` as the index, s since the first stamp.

        The columns have the names of the message's fields, ``header.stamp.sec`` for nested ones;
        an array becomes columns ``force[0]``, ``force[1]``. Raises RecordingError if pandas is
        not installed, or the topic is unknown or has no columns.

        Args:
            topic: name of the topic; default: that of the connector's states.
        """
        return export.to_dataframe(self.table(topic or self.state_topic))

    def _schema(self, topic: str) -> tuple[schema.Schema, str]:
        channel = self._channel(topic)
        name = schema.short_name(channel.type)[0]
        if not channel.definition:
            raise RecordingError(f"{topic}: {channel.reason}")
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

    def _channel(self, topic: str) -> TopicFacts:
        try:
            return self._channels[topic]
        except KeyError:
            names = ", ".join(self._channels) or "none"
            raise RecordingError(f"{self.path}: no topic {topic}; it has {names}") from None


def read_run(path: Paths, connector: str = "") -> Run:
    """Open a recorded run.

    Args:
        path: a rosbag2 directory, or an MCAP or SQLite (.db3) file, also compressed by rosbag2; or
            several of these, which are one run.
        connector: the one to select of a run of several connectors.

    Returns
    -------
        The run; its ``incomplete`` holds the reason if the recording is incomplete or damaged.

    Raises
    ------
        RecordingError: there is no recording, or it has no such connector.

    Example::

        recorded = cr.read_run("bag")
        recorded.state["normal_force"], recorded.state.time, recorded.parameters
    """
    run = Run(Source(path))
    return run.select(connector) if connector else run


def why_incomplete(source: Source) -> str | None:
    """Return why a recording is incomplete, or None."""
    if source.incomplete:
        return source.incomplete
    advice = _SALVAGE if any(each.extent.count for each in source.channels.values()) else ""
    if not source.finished:
        return f"{_UNFINISHED}{source.damage and f' ({source.damage})'}{advice}"
    if source.damage:
        return f"{source.damage}{advice}"
    for name, count in source.declared.items():
        known = source.channels.get(name)
        found = known.extent.count if known is not None else 0
        if found != count and name not in source.left_out:
            return f"{name}: metadata.yaml lists {count} messages, found {found}"
    return None


def _parameters(text: str, path: Path) -> dict[str, Any]:
    if not text:
        return {}
    try:
        nodes = limited_yaml.load(text) or {}
        merged: dict[str, Any] = {}
        for block in nodes.values():
            merged.update(block["ros__parameters"])
        return merged
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        reason = repr(error) if isinstance(error, KeyError) else error
        raise RecordingError(f"{path}: parameters stored with the run: {reason}") from error
