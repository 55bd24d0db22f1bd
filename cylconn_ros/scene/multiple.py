"""Several connectors in one set of parameters: a block for each, and what stands outside for all.

``connectors: [front, rear]`` names them. ``front.friction.radius`` is front's own; what stands
outside of the blocks holds for every connector whose block does not say otherwise. What is the
node's (:data:`OF_THE_NODE`) stands outside only. Without ``connectors`` there is one, unnamed.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from cylconn_ros.errors import SceneError
from cylconn_ros.scene.schema import flatten, show

CONNECTORS = "connectors"
OF_THE_NODE = ("autostart", "record")
ONE = ""  # the name of the only connector

_TOKEN = re.compile(r"[A-Za-z][A-Za-z0-9]*(?:_[A-Za-z0-9]+)*")  # part of a ROS topic's name


def is_of_the_node(name: str) -> bool:
    """Whether a parameter is the node's, so that all connectors have the same."""
    return name.split(".")[0] in OF_THE_NODE


def names(value: object, taken: Collection[str]) -> tuple[str, ...]:
    """The names in ``connectors``; raises SceneError unless each can be one, and is one only once.

    ``taken``: dotted names of parameters, whose first parts are no names of connectors.
    """
    rule = f"{CONNECTORS} = {show(value)}: must be a list of names"
    if isinstance(value, str) or not isinstance(value, Sequence) or not value:
        raise SceneError(rule)
    groups = {name.split(".")[0] for name in taken} | {CONNECTORS}
    for name in value:
        if not isinstance(name, str) or not _TOKEN.fullmatch(name):
            raise SceneError(
                f"{rule}, each of letters, digits and single underscores, a letter first; "
                f"{show(name)} is not"
            )
        if name in groups:
            raise SceneError(f"{rule}; {show(name)} is the name of a parameter")
    twice = [name for k, name in enumerate(value) if name in value[:k]]
    if twice:
        raise SceneError(f"{rule}, each of them once; {show(twice[0])} is given twice")
    return tuple(value)


def split(parameters: Mapping[str, Any], known: Collection[str]) -> dict[str, dict[str, Any]]:
    """Dotted parameters for each connector, by its name; ``known``: a scene's parameters.

    Body frames that are not given are named after the connector, ``front/body_a``, so that no two
    connectors have a body in common unless somebody says so.

    Raises SceneError for names that cannot be, and for what stands in the wrong place.
    """
    flat = flatten(parameters)
    given = flat.pop(CONNECTORS, None)
    if given is None:
        return {ONE: flat}
    found: dict[str, dict[str, Any]] = {}
    listed = names(given, known)
    for name in listed:
        found[name] = {f"body_{x}.frame": f"{name}/body_{x}" for x in "ab"}
    blocks: dict[str, dict[str, Any]] = {name: {} for name in listed}
    for key, value in flat.items():
        first, _, rest = key.partition(".")
        if first not in blocks:
            for one in found.values():
                one[key] = value
        elif not rest:
            raise SceneError(f"{key} = {show(value)}: must hold the parameters of this connector")
        elif is_of_the_node(rest):
            raise SceneError(
                f"{key} = {show(value)}: is the node's, give {rest} outside of {first}"
            )
        else:
            blocks[first][rest] = value
    for name, block in blocks.items():
        found[name].update(block)
    return found
