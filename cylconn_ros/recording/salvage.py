"""Give back what a recording holds that was never closed, or that is damaged, as a valid run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from mcap.records import Channel

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.mcap_reader import Source
from cylconn_ros.recording.message_definitions import Interface
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.recording.run import read_run
from cylconn_ros.recording.writer import RunWriter

_READ_AHEAD = 1 << 20


@dataclass(frozen=True)
class Salvaged:
    """What was saved."""

    directory: Path  # the new run
    messages: int
    seconds: float  # from the first to the last, by log times
    damage: str  # what was wrong with the source, in words


def salvage(source: Path, target: Path | None = None) -> Salvaged:
    """Write what can be read of ``source`` as a new run.

    Args:
        source: a recorded directory, with or without metadata.yaml, or an .mcap file.
        target: the new directory; by default beside the source, its name with ``_salvaged``.

    Raises
    ------
        RecordingError: there is no recording, it is whole, nothing in it can be read, or the new
            run cannot be written.
    """
    if _is_whole(source):
        raise RecordingError(f"{source}: is whole: nothing to salvage")
    file = _file(source)
    run = source if source.is_dir() else source.with_suffix("")
    target = target or run.with_name(f"{run.name}_salvaged")
    try:
        size = file.stat().st_size
        with file.open("rb", buffering=_READ_AHEAD) as stream:
            found = Source(stream, size)
            count = sum(1 for _ in found.messages())  # first to know all topics
            if not count:
                raise RecordingError(
                    f"{file}: holds no message that can be read: {found.damage or 'it is empty'}"
                )
        with file.open("rb", buffering=_READ_AHEAD) as stream:
            return _write(Source(stream, size), found, target, file)
    except OSError as error:
        raise RecordingError(f"{file}: {error.strerror or error}") from error


def _write(source: Source, known: Source, target: Path, file: Path) -> Salvaged:
    topics, interfaces = _topics(known)
    start, end, count = 1 << 64, 0, 0
    texts = {**known.texts, "salvaged": f"from {file.name}: {known.damage or 'never closed'}"}
    with RunWriter(target, list(topics.values()), texts, interfaces=interfaces) as writer:
        for message in source.messages():
            topic = topics[message.channel].name
            writer.write(topic, message.data, message.log_time, message.publish_time)
            start, end = min(start, message.log_time), max(end, message.log_time)
            count += 1
    return Salvaged(target, count, (end - start) * 1e-9, known.damage or "it was never closed")


def _topics(known: Source) -> tuple[dict[int, TopicInfo], dict[str, Interface]]:
    topics, interfaces = {}, {}
    for channel in known.channels.values():
        schema = known.schemas.get(channel.schema_id)
        if schema is None:
            raise RecordingError(f"{channel.topic}: the recording does not say its type")
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


def _is_whole(source: Path) -> bool:
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
