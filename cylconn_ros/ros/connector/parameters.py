"""ROS parameters of a scene: declared from the schema, changed all at once or not at all.

A value is kept in the type of its parameter, whatever ROS type it is set with: ``1`` is kept as
1.0. ``ros2 param load`` sends some numbers of a dump as texts (``inf``, ``nan``, ``1e-06``, ``[inf,
0.0]``); they are read as numbers. A parameter that is set to "not set" gets its default.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from cylconn_ros.errors import SceneError
from cylconn_ros.scene import multiple, shared_bodies
from cylconn_ros.scene.parameter_file import ROS_PARAMETERS, parse
from cylconn_ros.scene.scene import Scene, schema
from cylconn_ros.scene.schema import Parameter, Value, show

_CONNECTORS = ParameterDescriptor(
    name=multiple.CONNECTORS,
    description="Names of the connectors; each has its parameters and topics below its name.",
    read_only=True,
)

FROZEN = (
    "access.frozen = true: nothing can be changed since the node was first active; restart it with "
    "other parameters"
)


def ros_part(parameters: Mapping[str, Any]) -> list[RosParameter]:
    """Parameters of ROS itself (use_sim_time, qos_overrides …), for the node."""
    return [
        RosParameter(name, value=value)
        for name, value in parameters.items()
        if name.split(".")[0] in ROS_PARAMETERS
    ]


def describe(parameter: Parameter) -> ParameterDescriptor:
    """Describe a parameter to ROS tools.

    Numbers are typed dynamically, because in ROS 1 has another type than 1.0 and an empty list has
    none. Bounds are given as text, because ROS ranges refuse NaN. The scene checks both.
    """
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    return ParameterDescriptor(
        name=parameter.name,
        description=parameter.doc + unit,
        additional_constraints=parameter.rule,
        read_only=parameter.read_only,
        dynamic_typing=True,
    )


def declare(node: Node, scenes: Mapping[str, Scene]) -> dict[str, list[tuple[str, str]]]:
    """Declare every parameter of the scenes of connectors by name.

    Returns, by ROS parameter, the connectors and the parameters of their scenes that it sets.
    """
    places: dict[str, list[tuple[str, str]]] = {}
    empty: list[RosParameter] = []
    if multiple.ONE not in scenes:
        node.declare_parameter(multiple.CONNECTORS, list(scenes), _CONNECTORS, ignore_override=True)
    table = schema()
    for connector, scene in scenes.items():
        for name, value in scene.parameters().items():
            own = connector and not multiple.is_of_the_node(name)
            ros_name = f"{connector}.{name}" if own else name
            places.setdefault(ros_name, []).append((connector, name))
            if len(places[ros_name]) == 1:
                descriptor = describe(dataclasses.replace(table[name], name=ros_name))
                node.declare_parameter(ros_name, _to_ros(value), descriptor, ignore_override=True)
                if value == ():  # rclpy declares an empty list as one of bytes
                    empty.append(_ros_parameter(ros_name, value))
    Node.set_parameters_atomically(node, empty)
    return places


class SceneParameters:
    """Keep the scenes of connectors and the node's parameters consistent.

    A change is accepted if the resulting scenes are valid. ``prepare`` gets the changed scenes by
    connector and may raise SceneError; ``apply`` gets them with the previous scenes and puts the
    prepared state in force. A change is applied completely or not at all.
    """

    def __init__(
        self,
        node: Node,
        scenes: Mapping[str, Scene],
        prepare: Callable[[Mapping[str, Scene]], None],
        apply: Callable[[Mapping[str, Scene], Mapping[str, Scene]], None],
    ) -> None:
        self.scenes = dict(scenes)
        self._node = node
        self._next: dict[str, Scene] = {}
        self._prepare, self._apply = prepare, apply
        self._places = declare(node, scenes)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._changed)

    def changes(self, parameters: Sequence[RosParameter]) -> list[RosParameter]:
        """The given parameters that would change, with their values in the types of the schema.

        A value that the schema refuses is returned as it was given.
        """
        found = []
        for parameter in parameters:
            places = self._places.get(parameter.name)
            wanted = parameter if places is None else _typed(parameter, schema()[places[0][1]])
            if not (
                self._node.has_parameter(parameter.name)
                and _same(self._node.get_parameter(parameter.name), wanted)
            ):
                found.append(wanted)
        return found

    def _check(self, parameters: Sequence[RosParameter]) -> SetParametersResult:
        values: dict[str, dict[str, Any]] = {}
        self._next = {}
        for parameter in parameters:
            for connector, name in self._places.get(parameter.name, ()):
                changed = values.setdefault(connector, dict(self.scenes[connector].parameters()))
                changed[name] = parameter.value
        try:
            scenes = {}
            for connector, given in values.items():
                try:
                    scenes[connector] = Scene.from_parameters(given)
                except SceneError as error:
                    raise SceneError(f"{connector}.{error}" if connector else str(error)) from None
            if scenes:
                after = {**self.scenes, **scenes}
                shared_bodies.check(after)
                if shared_bodies.groups(after) != shared_bodies.groups(self.scenes):
                    raise SceneError("shared bodies are fixed when the node starts")
                self._prepare(scenes)
        except Exception as error:  # SceneError, or any other error: nothing changes
            return SetParametersResult(successful=False, reason=str(error))
        self._next = scenes
        return SetParametersResult(successful=True)

    def _changed(self, _parameters: Sequence[RosParameter]) -> None:
        if self._next:
            changed, self._next = self._next, {}
            before = {connector: self.scenes[connector] for connector in changed}
            self.scenes.update(changed)
            self._apply(changed, before)


def differences(before: Scene, after: Scene) -> Iterator[tuple[str, str, str]]:
    """Name, old and new value (in YAML) of every parameter that differs."""
    old = before.parameters()
    for name, value in after.parameters().items():
        if show(old[name]) != show(value):
            yield name, show(old[name]), show(value)


def _typed(parameter: RosParameter, rules: Parameter) -> RosParameter:
    """The parameter in the type of the schema; as given if the schema refuses it."""
    value = parameter.value
    if isinstance(value, str) and rules.kind != "str":
        value = _from_text(value)
    if value is None:
        value = rules.default
    try:
        return _ros_parameter(parameter.name, rules.check(value))
    except SceneError:
        return parameter


def _from_text(text: str) -> Any:
    """The numbers in a text as Python writes them (inf, nan, 1e-06, None), or the text itself."""
    words = {"inf": math.inf, "-inf": -math.inf, "nan": math.nan, "None": None}
    try:
        value = parse(text)
    except SceneError:
        return text
    if isinstance(value, list):
        return [words.get(item, item) if isinstance(item, str) else item for item in value]
    return words.get(value, value) if isinstance(value, str) else value


def _same(present: RosParameter, wanted: RosParameter) -> bool:
    """Whether two parameters have the same type and value."""
    return present.type_ == wanted.type_ and show(present.value) == show(wanted.value)


def _ros_parameter(name: str, value: Value) -> RosParameter:
    """A ROS parameter with a value of the schema; an empty list is one of doubles."""
    if isinstance(value, tuple) and not any(isinstance(item, str) for item in value):
        return RosParameter(name, RosParameter.Type.DOUBLE_ARRAY, list(value))
    return RosParameter(name, value=list(value) if isinstance(value, tuple) else value)


def _to_ros(value: Value) -> Any:
    """Convert to a value that rclpy can declare; None for an empty list."""
    return (list(value) or None) if isinstance(value, tuple) else value
