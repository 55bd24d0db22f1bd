"""Command line of a node, read before rclpy.init so that an error names the parameter.

rclpy.init fails for mixed lists and for an integer in place of a float, with a message that does
not name the parameter. Parameter files and ``-p`` are therefore removed from the arguments, read
here and passed to the node as one mapping. All other arguments (remapping, log levels …) are passed
to ROS unchanged.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from cylconn_ros.errors import CylconnError, SceneError
from cylconn_ros.scene.parameter_file import OtherNodesError, load_parameters, parse


class UsageError(CylconnError, ValueError):
    """Invalid command-line arguments; the message names the argument."""


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Parsed command line."""

    name: str  # of the node, after remapping
    namespace: str
    parameters: dict[str, Any]  # dotted, from files and -p in the order given
    ros: list[str]  # for rclpy.init
    help: bool = False
    version: bool = False
    unused: tuple[str, ...] = ()  # a message for each file without parameters for this node


@dataclasses.dataclass(frozen=True)
class _Source:
    """A parameter file, or a parameter given with -p."""

    kind: str
    text: str


def split(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Arguments of the executable, and those of ROS with the words --ros-args and --."""
    own, ros = _split(arguments)
    return own, ["--ros-args", *ros] if ros else []


def read_arguments(arguments: Sequence[str], node: str) -> Arguments:
    """Read the arguments (without the program's name) of the executable of ``node``.

    Raises :class:`UsageError`, or SceneError for a parameter file or value that cannot be read.
    """
    own, ros = _split(arguments)
    wants_help, wants_version = bool({"-h", "--help"} & set(own)), "--version" in own
    unknown = [argument for argument in own if argument not in ("-h", "--help", "--version")]
    if unknown:
        raise UsageError(f"{unknown[0]}: unknown argument; ROS arguments come after --ros-args")
    sources, remaps, rest = _take_parameters(ros)
    name, namespace = node, "/"
    for rule in remaps:
        target, _, to = rule.partition(":=")
        scope, _, what = target.rpartition(":")
        if scope in ("", node) and to:
            if what in ("__node", "__name"):
                name = to
            elif what == "__ns":
                namespace = to
    parameters: dict[str, Any] = {}
    unused = []
    for source in sources:
        if source.kind == "file":
            try:
                parameters.update(load_parameters(source.text, name, namespace))
            except OtherNodesError as error:  # several nodes may share a file
                unused.append(str(error))
        else:
            parameters.update(_read_parameter(source.text, name))
    ros_arguments = ["--ros-args", *rest] if rest else []
    return Arguments(
        name, namespace, parameters, ros_arguments, wants_help, wants_version, tuple(unused)
    )


def _split(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split off the arguments between --ros-args and --."""
    own: list[str] = []
    ros: list[str] = []
    target = own
    for argument in arguments:
        if argument == "--ros-args":
            target = ros
        elif argument == "--" and target is ros:
            target = own
        else:
            target.append(argument)
    return own, ros


def _take_parameters(ros: Sequence[str]) -> tuple[list[_Source], list[str], list[str]]:
    """Sources of parameters, remapping rules, and all arguments except the parameters."""
    sources: list[_Source] = []
    remaps: list[str] = []
    rest: list[str] = []
    following = iter(ros)
    for argument in following:
        name, equals, value = argument.partition("=")
        if name in ("--params-file", "-p", "--param", "-r", "--remap") and not (
            equals and not name.startswith("--")
        ):
            text = value if equals else next(following, None)
            if not text:
                raise UsageError(f"{name}: a value must follow")
            if name == "--params-file":
                sources.append(_Source("file", text))
            elif name in ("-p", "--param"):
                sources.append(_Source("value", text))
            else:
                remaps.append(text)
                rest += [name, text]
        else:
            rest.append(argument)
    return sources, remaps, rest


def _read_parameter(rule: str, node: str) -> dict[str, Any]:
    """The parameter of ``[node:]name:=value``; empty if it belongs to another node."""
    target, separator, text = rule.partition(":=")
    scope, _, name = target.rpartition(":")
    if not separator or not name:
        raise UsageError(f"-p {rule}: must be name:=value")
    if scope.strip("/") not in ("", node):
        return {}
    try:
        return {name: parse(text)}
    except SceneError as error:
        raise SceneError(f"{name} = {text}: {error}") from None
