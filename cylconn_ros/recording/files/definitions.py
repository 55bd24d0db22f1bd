"""Message definitions of recorded topics as ``ros2msg`` text: stored, converted, or installed."""

from __future__ import annotations

from functools import lru_cache
from importlib.util import find_spec
from typing import NamedTuple

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.files.storage import StoredChannel
from cylconn_ros.recording.message_definitions import interface


class Definition(NamedTuple):
    """Definition of a type: ros2msg text, whether the recording holds it, or why there is none."""

    text: str = ""
    stored: bool = False
    reason: str = ""


def resolve(channel: StoredChannel) -> Definition:
    """Return the definition of a channel's type.

    ``ros2idl`` definitions are converted with rosbags, if it is installed. A recording without a
    definition (SQLite before Iron) is decoded by the installed one.
    """
    if channel.definition and channel.definition_encoding == "ros2msg":
        return Definition(channel.definition, True)
    reason = f"its type {channel.type} is not installed here"
    if channel.definition and channel.definition_encoding == "ros2idl":
        converted = _from_idl(channel.type, channel.definition)
        if converted:
            return Definition(converted, True)
        remedy = "cannot be read" if find_spec("rosbags") else "is read with: pip install rosbags"
        reason += f", and its definition in the recording (ros2idl) {remedy}"
    try:
        return Definition(interface(channel.type).definition)
    except RecordingError:
        return Definition(reason=reason)


@lru_cache(maxsize=64)
def _from_idl(type_name: str, text: str) -> str:
    """Convert a definition with rosbags; '' if it is not installed or cannot parse it."""
    try:
        from rosbags.typesys import Stores, get_types_from_idl, get_typestore

        store = get_typestore(Stores.EMPTY)
        parts = [part.strip() for part in text.split("=" * 80) if part.strip()]
        for part in parts:
            body = part.partition("\n")[2] if part.startswith("IDL:") else part
            store.register(get_types_from_idl(body))
        return str(store.generate_msgdef(type_name, ros_version=2)[0])
    except Exception:  # a foreign parser on a foreign text
        return ""
