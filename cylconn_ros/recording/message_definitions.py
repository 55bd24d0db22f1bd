"""Definitions and type hashes of installed message types, from ``share/<package>/msg``."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from cylconn_ros.errors import RecordingError
from cylconn_ros.scene.resources import share_directories

SEPARATOR = "=" * 80


@dataclass(frozen=True)
class Interface:
    """Definition and hash of a message type, with which any reader can decode its messages."""

    type: str  # package/msg/Name
    definition: str  # .msg text with the referenced definitions appended (encoding `ros2msg`)
    type_hash: str  # RIHS01_..., REP-2011


def _find(type_name: str, suffix: str) -> Path:
    try:
        package, namespace, name = type_name.split("/")
    except ValueError:
        raise RecordingError(f"message type {type_name!r}: expected package/msg/Name") from None
    searched = share_directories()
    for share in searched:
        path = share / package / namespace / f"{name}{suffix}"
        if path.is_file():
            return path
    places = ", ".join(map(str, searched))
    raise RecordingError(f"message type {type_name}: no {name}{suffix} of {package} in {places}")


@cache
def interface(type_name: str) -> Interface:
    """Return definition and hash of an installed type, e.g. ``geometry_msgs/msg/PoseStamped``.

    Raises RecordingError if the type is not installed or its files cannot be read.
    """
    path = _find(type_name, ".json")
    try:
        description = json.loads(path.read_text(encoding="utf-8"))
        hashes = {h["type_name"]: h["hash_string"] for h in description["type_hashes"]}
        message = description["type_description_msg"]
        referenced = [d["type_name"] for d in message["referenced_type_descriptions"]]
        parts = [_find(type_name, ".msg").read_text(encoding="utf-8")]
        for name in referenced:
            package, _, short = name.split("/")
            text = _find(name, ".msg").read_text(encoding="utf-8")
            parts.append(f"{SEPARATOR}\nMSG: {package}/{short}\n{text}")
        return Interface(type_name, "\n".join(parts), hashes[type_name])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RecordingError(f"message type {type_name}: {path}: {error!r}") from error
