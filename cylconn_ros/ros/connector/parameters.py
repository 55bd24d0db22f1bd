"""ROS parameters of a scene: declared from the schema, changed all at once or not at all."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from cylconn_ros.errors import SceneError
from cylconn_ros.scene import multiple, shared_bodies
from cylconn_ros.scene.parameter_file import ROS_PARAMETERS
from cylconn_ros.scene.scene import Scene, schema
from cylconn_ros.scene.schema import Parameter, Value, show

_CONNECTORS = ParameterDescriptor(
    name=multiple.CONNECTORS,
    description="Names of the connectors; each has its parameters and topics below its name.",
    read_only=True,
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
        self._next: dict[str, Scene] = {}
        self._prepare, self._apply = prepare, apply
        self._places = declare(node, scenes)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._changed)

    def _check(self, parameters: Sequence[RosParameter]) -> SetParametersResult:
        values: dict[str, dict[str, Any]] = {}
        self._next = {}
        for parameter in parameters:
            for connector, name in self._places.get(parameter.name, ()):
                changed = values.setdefault(connector, dict(self.scenes[connector].parameters()))
                unset = parameter.value is None
                changed[name] = schema()[name].default if unset else parameter.value
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


def _to_ros(value: Value) -> Any:
    """Convert to a ROS value; ROS has no empty list of doubles: not set (None)."""
    return (list(value) or None) if isinstance(value, tuple) else value
