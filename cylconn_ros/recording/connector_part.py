"""One connector's part of a recording that holds several.

A node writes with a run, as JSON in ``connectors``, for each connector the whole names of its
topics by the names that one alone has, its method and its model.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import yaml

from cylconn_ros.errors import RecordingError, SceneError
from cylconn_ros.scene import multiple, parameter_file
from cylconn_ros.scene.scene import schema


class Part(NamedTuple):
    """What a recording tells of one connector."""

    texts: dict[str, str]  # as if it had been alone: parameters, method, model
    topics: dict[str, str]  # its topics by name; empty where that was not written


def names(texts: Mapping[str, str]) -> list[str]:
    """Names of the connectors in a recording, from what was written with it; none of one alone."""
    return [name for name in _told(texts) if name]


def part(texts: Mapping[str, str], connector: str) -> Part:
    """What belongs to ``connector``; ``""``: all that there is.

    Raises RecordingError where there is none of that name.
    """
    told = _told(texts)
    if not connector:
        only = told.get(multiple.ONE, {})
        return Part(dict(texts), dict(only.get("topics", {})))
    if connector not in told:
        known = ", ".join(names(texts)) or "one, without a name"
        raise RecordingError(f"connector {connector}: is not in the recording; it has {known}")
    own = dict(told[connector])
    topics = {str(name): str(topic) for name, topic in own.pop("topics", {}).items()}
    found = {**texts, **{key: str(text) for key, text in own.items()}}
    found["connectors"] = json.dumps({multiple.ONE: {**own, "topics": topics}})
    if "parameters" in texts:
        try:
            split = multiple.split(parameter_file.parameters_of(texts["parameters"]), schema())
        except (SceneError, TypeError, KeyError, AttributeError) as error:
            raise RecordingError(f"parameters stored with the run: {error!r}") from None
        document = {"/**": {"ros__parameters": split.get(connector, {})}}
        found["parameters"] = yaml.safe_dump(document, sort_keys=False)
    return Part(found, topics)


def refuse_together(texts: Mapping[str, str], connector: str, what: str) -> None:
    """Raise RecordingError where a connector was solved together with others: it is not one alone.

    ``texts``: of its part. ``what`` cannot be done then, in words.
    """
    others = texts.get("together", "")
    if others:
        raise RecordingError(f"{connector} was solved together with {others}: {what}")


def _told(texts: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """What was written of each connector; nothing where that is not of this form."""
    try:
        told = json.loads(texts.get("connectors", "{}"))
    except ValueError:
        return {}
    if not isinstance(told, dict):
        return {}
    return {str(name): one for name, one in told.items() if isinstance(one, dict)}
