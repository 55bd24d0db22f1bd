"""The files of a recording: from what a user names, and from the metadata.yaml of a directory."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.files import formats
from cylconn_ros.scene import limited_yaml

METADATA = "metadata.yaml"


@dataclass
class Found:
    """Files of a recording.

    Attributes
    ----------
        files: in order of recording.
        custom: texts that the recorder stored in metadata.yaml.
        counts: number of messages by topic according to metadata.yaml.
        notes: what metadata.yaml says wrongly.
        incomplete: why the recording is incomplete; empty if it is not, as far as the files tell.
    """

    files: list[Path] = field(default_factory=list)
    custom: dict[str, str] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    incomplete: str = ""


def find(paths: Sequence[Path]) -> Found:
    """Find the files of recordings; several paths are one recording.

    Raises RecordingError if a path is missing or is no recording.
    """
    found = Found()
    for path in paths:
        try:
            if path.is_dir():
                _add_directory(path, found)
            else:
                path.stat()
                found.files.append(path)
        except OSError as error:
            raise RecordingError(f"{path}: {error.strerror or error}") from None
    if len(paths) > 1:
        found.counts = {}
    return found


def _add_directory(directory: Path, found: Found) -> None:
    there: list[Path] = sorted(filter(formats.is_recording, directory.iterdir()), key=_by_number)
    path = directory / METADATA
    try:
        information = _information(path)
    except FileNotFoundError:
        if not there:
            raise RecordingError(
                f"{directory}: no metadata.yaml, .mcap or .db3 in it: not a recording"
            ) from None
        found.files += there
        return
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        if not there:
            raise RecordingError(f"{path}: not metadata of a recording: {reason}") from None
        found.notes.append(f"{path}: not metadata of a recording, not used: {reason}")
        found.files += there
        return
    found.custom.update(_texts(information.get("custom_data")))
    found.incomplete = found.custom.get("incomplete", "")
    found.counts.update(_counts(information.get("topics_with_message_count")))
    names = information.get("relative_file_paths")
    names = [name for name in names if isinstance(name, str)] if isinstance(names, list) else []
    places = {name: _inside(directory, name) for name in names}
    listed = [file for file in places.values() if file is not None]
    missing = [name for name, file in places.items() if file is None]
    others = [file for file in there if file not in listed]
    if missing and len(others) == len(missing):  # renamed
        renamed = ", ".join(file.name for file in others)
        found.notes.append(f"{path}: lists {', '.join(missing)}; {renamed} is read")
        listed = sorted([*listed, *others], key=_by_number)
    elif missing:
        found.incomplete = found.incomplete or f"{', '.join(missing)} is missing"
        listed = listed or others
    elif not names:
        listed = there
    if not listed:
        raise RecordingError(f"{path}: lists {', '.join(names) or 'no file'}, which is not there")
    found.files += listed


def _information(path: Path) -> dict[str, Any]:
    """Return rosbag2_bagfile_information; raise OSError, or ValueError with the reason."""
    content = limited_yaml.load(limited_yaml.read_text(path))
    information = content.get("rosbag2_bagfile_information") if isinstance(content, dict) else None
    if not isinstance(information, dict):
        raise ValueError("rosbag2_bagfile_information is missing")
    return information


def _inside(directory: Path, name: str) -> Path | None:
    """Return a listed file if it is there.

    Metadata before version 4 names it with the directory. A file elsewhere is not read.
    """
    parts = PurePosixPath(name)
    if ".." in parts.parts or parts.is_absolute():
        parts = PurePosixPath(parts.name)
    for candidate in (directory / parts, directory / parts.name):
        if parts.name and candidate.exists() and not candidate.is_dir():
            return candidate
    return None


def _texts(custom: object) -> dict[str, str]:
    return {str(k): str(v) for k, v in custom.items()} if isinstance(custom, dict) else {}


def _counts(topics: object) -> dict[str, int]:
    """Return the listed numbers of messages, as far as they are given."""
    found = {}
    for item in topics if isinstance(topics, list) else ():
        facts = item.get("topic_metadata") if isinstance(item, dict) else None
        if not isinstance(facts, dict):
            continue
        name, count = facts.get("name"), item.get("message_count")
        if isinstance(name, str) and isinstance(count, int):
            found[name] = count
    return found


def _by_number(path: Path) -> list[Any]:
    """Order bag_9 before bag_10."""
    parts = re.split(r"(\d{1,18})", path.name)
    return [int(part) if part.isdigit() else part for part in parts]
