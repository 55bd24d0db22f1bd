"""ROS 2 parameter files in YAML: read and written, with errors that name the parameter."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from cylconn_ros.errors import SceneError
from cylconn_ros.scene import limited_yaml, multiple
from cylconn_ros.scene.fields import SceneFields
from cylconn_ros.scene.schema import flatten

# Parameters of ROS itself, which every node accepts.
ROS_PARAMETERS = ("use_sim_time", "start_type_description_service", "qos_overrides")


class OtherNodesError(SceneError):
    """A parameter file all of whose blocks are for other nodes."""


def load_parameters(path: str | Path, node: str, namespace: str = "/") -> dict[str, Any]:
    """Dotted parameters for a node from a file: blocks with wildcards first, then its own.

    Raises :class:`SceneError`; :class:`OtherNodesError` if all blocks name other nodes.
    """
    try:
        text = limited_yaml.read_text(Path(path))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SceneError(f"{path}: cannot be read: {reason}") from None
    try:
        document = parse(text)
        if document is None:
            document = {}
        if not isinstance(document, Mapping):
            raise SceneError(
                "is not a parameter file: a node's name and ros__parameters are missing"
            )
        full_name = "/" + "/".join(part for part in (*namespace.split("/"), node) if part)
        found: dict[str, Any] = {}
        blocks = sorted(_blocks(document, ""), key=lambda block: "*" not in block[0])
        mine = [parameters for pattern, parameters in blocks if _matches(pattern, full_name)]
        if blocks and not mine:
            names = ", ".join(pattern for pattern, _ in blocks)
            raise OtherNodesError(
                f"has parameters for {names}, but none for {full_name} (nor for /**)"
            )
        for parameters in mine:
            found.update(flatten(parameters))
        return found
    except SceneError as error:
        raise type(error)(f"{path}: {error}") from None


def scene_part(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the given dotted parameters without those that belong to ROS itself."""
    return {k: v for k, v in parameters.items() if k.split(".")[0] not in ROS_PARAMETERS}


def dump(scene: SceneFields) -> str:
    """Write a parameter file with every parameter of the scene; loading it gives the same scene."""
    return dump_several({multiple.ONE: scene})


def dump_several(scenes: Mapping[str, SceneFields]) -> str:
    """Write a parameter file for connectors by name; loading it gives the same scenes."""
    parameters: dict[str, Any] = {}
    if multiple.ONE not in scenes:
        parameters[multiple.CONNECTORS] = list(scenes)
    for connector, scene in scenes.items():
        for name, value in scene.parameters().items():
            own = connector and not multiple.is_of_the_node(name)
            parameters[f"{connector}.{name}" if own else name] = (
                list(value) if isinstance(value, tuple) else value
            )
    document = {"/**": {"ros__parameters": parameters}}
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)


def parameters_of(text: str) -> dict[str, Any]:
    """Dotted parameters of every block of a parameter file's text, as :func:`dump` wrote it."""
    parameters: dict[str, Any] = {}
    for block in (parse(text) or {}).values():
        parameters.update(flatten(block["ros__parameters"]))
    return parameters


def parse(text: str) -> Any:
    """Parse YAML as ROS 2 does: 1e-3 is a number; a name given twice is refused.

    Raises :class:`SceneError`.
    """
    try:
        return limited_yaml.load(text, _Loader)
    except ValueError as error:
        raise SceneError(str(error)) from None


def _blocks(tree: Mapping[Any, Any], prefix: str) -> Sequence[tuple[str, Mapping[str, Any]]]:
    """(pattern of the node's full name, parameters) of each ros__parameters block in a file."""
    found: list[tuple[str, Mapping[str, Any]]] = []
    for key, value in tree.items():
        name = f"{prefix}/{str(key).strip('/')}"
        if key == "ros__parameters":
            raise SceneError("ros__parameters: must be below a node's name or /**")
        if not isinstance(value, Mapping):
            raise SceneError(
                f"{name} = {value!r}: must hold ros__parameters with the parameters in it"
            )
        below = dict(value)
        parameters = below.pop("ros__parameters", None)
        if parameters is not None:
            if not isinstance(parameters, Mapping):
                raise SceneError(f"{name}: ros__parameters must hold names and values")
            found.append((name, parameters))
        found.extend(_blocks(below, name))
    return found


def _matches(pattern: str, full_name: str) -> bool:
    """Whether a pattern (* one level, ** any number of levels) covers a node's full name."""
    expression = "".join(
        "(/[^/]+)*" if part == "**" else "/" + re.escape(part).replace(r"\*", "[^/]*")
        for part in pattern.strip("/").split("/")
    )
    return re.fullmatch(expression, full_name) is not None


class _Loader(limited_yaml.Loader):
    """The loader with the numbers of YAML 1.2 and ROS 2; no name twice."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        names: set[Any] = set()
        for key, _ in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else None
            if name in names and name != "<<":
                raise yaml.constructor.ConstructorError(
                    None, None, f"{name} is given twice", key.start_mark
                )
            names.add(name)
        return super().construct_mapping(node, deep)


def _construct_float(loader: Any, node: Any) -> float:
    text = loader.construct_scalar(node).lower().replace("_", "")
    special = {".inf": math.inf, "+.inf": math.inf, "-.inf": -math.inf, ".nan": math.nan}
    return special[text] if text in special else float(text)


_FLOAT = re.compile(
    r"^(?:[-+]?(?:[0-9][0-9_]*)?\.[0-9]+(?:[eE][-+]?[0-9]+)?"
    r"|[-+]?[0-9][0-9_]*\.(?:[eE][-+]?[0-9]+)?"
    r"|[-+]?[0-9][0-9_]*[eE][-+]?[0-9]+"
    r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$"
)
_Loader.yaml_implicit_resolvers = {
    first: [(tag, expression) for tag, expression in resolvers if tag != "tag:yaml.org,2002:float"]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+0123456789."))
_Loader.add_constructor("tag:yaml.org,2002:float", _construct_float)
