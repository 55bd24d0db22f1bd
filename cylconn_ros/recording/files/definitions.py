"""Message definitions of recorded topics as ``ros2msg`` text: stored, converted, or installed."""

from __future__ import annotations

from functools import lru_cache

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.files.storage import StoredChannel
from cylconn_ros.recording.message_definitions import interface


def resolve(channel: StoredChannel) -> tuple[str, bool]:
    """Return the definition of a channel's type, and whether the recording holds it.

    ``ros2idl`` definitions are converted with rosbags, if it is installed. A recording without a
    definition (SQLite before Iron) is decoded by the installed one; '' if there is none.
    """
    if channel.definition and channel.definition_encoding == "ros2msg":
        return channel.definition, True
    if channel.definition and channel.definition_encoding == "ros2idl":
        converted = _from_idl(channel.type, channel.definition)
        if converted:
            return converted, True
    try:
        return interface(channel.type).definition, False
    except RecordingError:
        return "", False


@lru_cache(maxsize=64)
def _from_idl(type_name: str, text: str) -> str:
    """Convert a definition with rosbags; '' if it is not installed or cannot parse it."""
    try:
        from rosbags.typesys import Stores, get_types_from_idl, get_typestore

        store = get_typestore(Stores.EMPTY)
        parts = [part for part in text.split("=" * 80) if part.strip()]
        for part in parts:
            body = part.partition("\n")[2] if part.lstrip().startswith("IDL:") else part
            store.register(get_types_from_idl(body))
        return str(store.generate_msgdef(type_name, ros_version=2)[0])
    except Exception:  # a foreign parser on a foreign text
        return ""
