"""Recovery of a recording that was never closed or is damaged, as a new valid run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from mcap.records import Channel

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.mcap.reader import McapReader
from cylconn_ros.recording.message_definitions import Interface
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.recording.run import read_run
from cylconn_ros.recording.writer import RunWriter

_READ_AHEAD = 1 << 20


@dataclass(frozen=True)
class Salvaged:
    """Result of a recovery."""

    directory: Path  # the new run
    messages: int
    seconds: float  # from the first to the last message, by log time
    damage: str  # description of the damage of the source


def salvage(source: Path, target: Path | None = None) -> Salvaged:
    """Write the readable messages of ``source`` to a new run.

    Args:
        source: a recorded directory, with or without metadata.yaml, or an .mcap file.
        target: the new directory; default: beside the source, its name with ``_salvaged``.

    Raises
    ------
        RecordingError: there is no recording, it is complete, it has no readable message, or the
            new run cannot be written.
    """
    if _is_complete(source):
        raise RecordingError(f"{source}: is complete: nothing to salvage")
    file = _file(source)
    run = source if source.is_dir() else source.with_suffix("")
    target = target or run.with_name(f"{run.name}_salvaged")
    try:
        size = file.stat().st_size
        with file.open("rb", buffering=_READ_AHEAD) as stream:
            first_pass = McapReader(stream, size)  # collects all topics
            count = sum(1 for _ in first_pass.messages())
            if not count:
                raise RecordingError(
                    f"{file}: contains no readable message: {first_pass.damage or 'it is empty'}"
                )
        with file.open("rb", buffering=_READ_AHEAD) as stream:
            return _write(McapReader(stream, size), first_pass, target, file)
    except OSError as error:
        raise RecordingError(f"{file}: {error.strerror or error}") from error


def _write(reader: McapReader, known: McapReader, target: Path, file: Path) -> Salvaged:
    topics, interfaces = _topics(known)
    start, end, count = 1 << 64, 0, 0
    metadata = {**known.metadata, "salvaged": f"from {file.name}: {known.damage or 'never closed'}"}
    with RunWriter(target, list(topics.values()), metadata, interfaces=interfaces) as writer:
        for message in reader.messages():
            topic = topics[message.channel].name
            writer.write(topic, message.data, message.log_time, message.publish_time)
            start, end = min(start, message.log_time), max(end, message.log_time)
            count += 1
    return Salvaged(target, count, (end - start) * 1e-9, known.damage or "it was never closed")


def _topics(known: McapReader) -> tuple[dict[int, TopicInfo], dict[str, Interface]]:
    topics, interfaces = {}, {}
    for channel in known.channels.values():
        schema = known.schemas.get(channel.schema_id)
        if schema is None:
            raise RecordingError(f"{channel.topic}: the recording does not define its message type")
        topics[channel.id] = TopicInfo(channel.topic, schema.name, **_qos(channel))
        interfaces[schema.name] = Interface(
            schema.name, schema.data.decode(), channel.metadata.get("topic_type_hash", "")
        )
    return topics, interfaces


def _qos(channel: Channel) -> dict[str, Any]:
    try:
        profiles = yaml.safe_load(channel.metadata.get("offered_qos_profiles", ""))
        names = ("reliability", "durability", "history", "depth")
        return {name: profiles[0][name] for name in names}
    except (yaml.YAMLError, LookupError, TypeError):
        return {}


def _is_complete(source: Path) -> bool:
    try:
        return read_run(source).incomplete is None
    except RecordingError:
        return False


def _file(source: Path) -> Path:
    if source.is_dir():
        files = sorted(source.glob("*.mcap"))
        if len(files) != 1:
            raise RecordingError(f"{source}: expected one .mcap file, found {len(files)}")
        return files[0]
    return source
