"""Recovery of a recording that was never closed or is damaged, as a new valid run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.files.source import Source, TopicFacts
from cylconn_ros.recording.message_definitions import Interface
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.recording.run import Run
from cylconn_ros.recording.writer import RunWriter
from cylconn_ros.scene import limited_yaml


@dataclass(frozen=True)
class Salvaged:
    """Result of a recovery."""

    directory: Path  # the new run
    messages: int
    seconds: float  # from the first to the last message, by log time
    damage: str  # description of the damage of the source
    left_out: dict[str, str]  # why a topic is not in the new run, by its name


def salvage(source: Path, target: Path | None = None) -> Salvaged:
    """Write the readable messages of ``source`` to a new run.

    Args:
        source: a recorded directory, with or without metadata.yaml, or a file.
        target: the new directory; default: beside the source, its name with ``_salvaged``.

    Raises
    ------
        RecordingError: there is no recording, it is complete, it has no readable message, or the
            new run cannot be written.
    """
    source = Path(source)
    opened = Source(source)
    # metadata.yaml is written last: a directory without it was not closed.
    closed = source.is_file() or (source / "metadata.yaml").exists()
    incomplete = Run(opened).incomplete or ("" if closed else "it was never closed")
    if not incomplete:
        raise RecordingError(f"{source}: is complete: nothing to salvage")
    known = {topic: facts for topic, facts in opened.channels.items() if facts.definition}
    count = sum(facts.extent.count for facts in known.values())
    if not count:
        raise RecordingError(
            f"{opened.file}: contains no readable message: {opened.damage or 'it is empty'}"
        )
    run = source if source.is_dir() else source.with_suffix("")
    target = target or run.with_name(f"{run.name}_salvaged")
    return _write(opened, known, target)


def _write(source: Source, known: dict[str, TopicFacts], target: Path) -> Salvaged:
    damage = source.damage or source.incomplete or "it was never closed"
    topics = [TopicInfo(topic, each.type, **_qos(each.qos)) for topic, each in known.items()]
    interfaces = {
        each.type: Interface(each.type, each.definition, each.type_hash) for each in known.values()
    }
    left_out = {
        **source.left_out,
        **{t: f"{f.type} is not defined" for t, f in source.channels.items() if t not in known},
    }
    metadata = {**source.metadata, "salvaged": f"from {source.file.name}: {damage}"}
    metadata.pop("incomplete", None)
    numbers = {number: topic for topic, facts in known.items() for number in facts.numbers}
    start, end, count = 1 << 64, 0, 0
    with RunWriter(target, topics, metadata, interfaces=interfaces) as writer:
        for block in source.blocks():
            for message in block.messages():
                topic = numbers.get(message.channel)
                if topic is None:
                    continue
                writer.write(topic, message.data, message.log_time, message.publish_time)
                start, end = min(start, message.log_time), max(end, message.log_time)
                count += 1
    return Salvaged(target, count, (end - start) * 1e-9, damage, left_out)


def _qos(stored: str) -> dict[str, Any]:
    """Return the QoS of a topic as of TopicInfo, as far as it is stored in that form."""
    rules: dict[str, type] = {"reliability": str, "durability": str, "history": str, "depth": int}
    try:
        profile = limited_yaml.load(stored)[0]
        return {name: profile[name] for name, kind in rules.items()
                if isinstance(profile[name], kind)}  # fmt: skip
    except (ValueError, LookupError, TypeError):
        return {}
