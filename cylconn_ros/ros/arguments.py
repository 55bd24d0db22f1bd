"""The command line of a node: read before ROS does, so that an error names the parameter.

ROS stops at mixed lists and at a whole number where a float was meant, before our code runs and
in words of its own. So parameter files and ``-p`` are taken from the arguments here, read, and
given to the node as one mapping; everything else (remapping, log levels …) goes to ROS untouched.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from cylconn_ros.errors import SceneError
from cylconn_ros.scene.parameter_file import OtherNodesError, load_parameters, parse


class UsageError(ValueError):
    """Arguments that are not understood."""


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What the command line says."""

    name: str  # the node's, remapping considered
    namespace: str
    parameters: dict[str, Any]  # dotted, by files and -p in the order given
    ros: list[str]  # for rclpy.init
    help: bool = False
    version: bool = False
    unused: tuple[str, ...] = ()  # parameter files that have nothing for this node, in words


@dataclasses.dataclass(frozen=True)
class _Source:
    """A parameter file, or one parameter given with -p."""

    kind: str
    text: str


def read_arguments(arguments: Sequence[str], node: str) -> Arguments:
    """Read the arguments (without the program's name) of the executable of ``node``.

    Raises :class:`UsageError`, or SceneError for a parameter file or value that cannot be read.
    """
    own, ros = _split(arguments)
    wants_help, wants_version = bool({"-h", "--help"} & set(own)), "--version" in own
    foreign = [argument for argument in own if argument not in ("-h", "--help", "--version")]
    if foreign:
        raise UsageError(f"{foreign[0]}: not understood; ROS arguments come after --ros-args")
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
            except OtherNodesError as error:  # as several nodes may share their files
                unused.append(str(error))
        else:
            parameters.update(_read_parameter(source.text, name))
    ros_arguments = ["--ros-args", *rest] if rest else []
    return Arguments(
        name, namespace, parameters, ros_arguments, wants_help, wants_version, tuple(unused)
    )


def _split(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Ours and those between --ros-args and --."""
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
    """Sources of parameters, rules of remapping, and everything but the parameters."""
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
    """The parameter of ``[node:]name:=value``; none where it is another node's."""
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
