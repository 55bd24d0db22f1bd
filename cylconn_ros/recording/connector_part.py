"""One connector of a recording that holds several.

A node stores, as JSON in the metadata text ``connectors``, for each connector: its topics by the
names that a single connector uses, its method and its model.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import yaml

from cylconn_ros.errors import RecordingError, SceneError
from cylconn_ros.scene import multiple, parameter_file
from cylconn_ros.scene.scene import schema


class ConnectorRecording(NamedTuple):
    """Metadata and topics of one connector of a recording."""

    metadata: dict[str, str]  # as of a recording of this connector alone
    topics: dict[str, str]  # resolved topics by single-connector name; empty if not stored


def names(metadata: Mapping[str, str]) -> list[str]:
    """Return the names of the connectors in a recording; none for a single, unnamed connector."""
    return [name for name in _stored(metadata) if name]


def select(metadata: Mapping[str, str], connector: str) -> ConnectorRecording:
    """Return metadata and topics of ``connector``; of the whole recording for ``""``.

    Raises RecordingError if the recording has no connector of that name.
    """
    stored = _stored(metadata)
    if not connector:
        single = stored.get(multiple.ONE, {})
        return ConnectorRecording(dict(metadata), dict(single.get("topics", {})))
    if connector not in stored:
        known = ", ".join(names(metadata)) or "one, without a name"
        raise RecordingError(f"connector {connector}: is not in the recording; it has {known}")
    own = dict(stored[connector])
    topics = {str(name): str(topic) for name, topic in own.pop("topics", {}).items()}
    found = {**metadata, **{key: str(text) for key, text in own.items()}}
    found["connectors"] = json.dumps({multiple.ONE: {**own, "topics": topics}})
    if "parameters" in metadata:
        try:
            split = multiple.split(parameter_file.parameters_of(metadata["parameters"]), schema())
        except (SceneError, TypeError, KeyError, AttributeError) as error:
            raise RecordingError(f"parameters stored with the run: {error!r}") from None
        document = {"/**": {"ros__parameters": split.get(connector, {})}}
        found["parameters"] = yaml.safe_dump(document, sort_keys=False)
    return ConnectorRecording(found, topics)


def refuse_coupled(metadata: Mapping[str, str], connector: str, consequence: str) -> None:
    """Raise RecordingError if a connector was solved together with others.

    Args:
        metadata: of this connector, from :func:`select`.
        connector: its name.
        consequence: end of the message, e.g. "it cannot be replayed alone".
    """
    others = metadata.get("together", "")
    if others:
        raise RecordingError(f"{connector} was solved together with {others}: {consequence}")


def _stored(metadata: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Return the stored facts by connector; empty if the text is missing or malformed."""
    try:
        stored = json.loads(metadata.get("connectors", "{}"))
    except ValueError:
        return {}
    if not isinstance(stored, dict):
        return {}
    return {str(name): facts for name, facts in stored.items() if isinstance(facts, dict)}
