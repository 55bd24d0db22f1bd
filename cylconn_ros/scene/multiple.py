"""Several connectors in one set of parameters: one block each, and common parameters outside.

``connectors: [front, rear]`` names them. ``front.friction.radius`` belongs to front. A parameter
outside these blocks applies to all connectors whose block does not set it. Parameters of the node
(``node=True`` in the schema) stand outside the blocks only. Without ``connectors`` there is one
connector without a name.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from cylconn_ros.errors import SceneError
from cylconn_ros.scene.fields import schema
from cylconn_ros.scene.schema import flatten, show

CONNECTORS = "connectors"
ONE = ""  # the name of the only connector

_TOKEN = re.compile(r"[A-Za-z][A-Za-z0-9]*(?:_[A-Za-z0-9]+)*")  # part of a ROS topic's name


def is_of_the_node(name: str) -> bool:
    """Whether a parameter, or all parameters of a group, belong to the node."""
    flags = [rules.node for key, rules in schema().items() if f"{key}.".startswith(f"{name}.")]
    return bool(flags) and all(flags)


def names(value: object, taken: Collection[str]) -> tuple[str, ...]:
    """The names in ``connectors``. Raises SceneError unless all are valid and differ.

    ``taken``: dotted names of parameters; their first parts are not valid connector names.
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
    """Dotted parameters of each connector by its name; ``known``: names of a scene's parameters.

    A body frame that is not given is named after the connector, ``front/body_a``, so that two
    connectors share a body only if the parameters say so.

    Raises SceneError for invalid names and for parameters in the wrong block.
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
            raise SceneError(
                f"{key} = {show(value)}: must be a block with the parameters of this connector"
            )
        elif is_of_the_node(rest):
            raise SceneError(
                f"{key} = {show(value)}: belongs to the node: give {rest} outside the block {first}"
            )
        else:
            blocks[first][rest] = value
    for name, block in blocks.items():
        found[name].update(block)
    return found
