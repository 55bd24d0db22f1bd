"""A scene's parameters as ROS parameters: declared from the schema, changed as a whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from cylconn_ros.connector.parameters import Parameter, Value, show
from cylconn_ros.connector.scene import Scene, schema
from cylconn_ros.connector.scene_file import ROS_PARAMETERS


def ros_part(parameters: Mapping[str, Any]) -> list[RosParameter]:
    """The parameters that belong to ROS itself (use_sim_time, qos_overrides …), for the node."""
    return [
        RosParameter(name, value=value)
        for name, value in parameters.items()
        if name.split(".")[0] in ROS_PARAMETERS
    ]


def describe(parameter: Parameter) -> ParameterDescriptor:
    """Describe a parameter to ROS tools.

    Numbers are typed dynamically, because ROS takes 1 for another type than 1.0 and an empty list
    for no value; and bounds stand in words, because ROS ranges refuse NaN. The scene checks both.
    """
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    return ParameterDescriptor(
        name=parameter.name,
        description=parameter.doc + unit,
        additional_constraints=parameter.rule,
        read_only=parameter.read_only,
        dynamic_typing=True,
    )


def declare(node: Node, scene: Scene) -> None:
    """Declare every parameter of a scene with its value."""
    table = schema()
    for name, value in scene.parameters().items():
        node.declare_parameter(name, _to_ros(value), describe(table[name]), ignore_override=True)


class SceneParameters:
    """Keep a scene and the node's parameters in agreement.

    A change is accepted when the scene it gives can be used; ``prepare`` gets that scene and may
    raise SceneError, too; ``apply`` then gets it with the scene before, and puts in force what was
    prepared. All of a change or none.
    """

    def __init__(
        self,
        node: Node,
        scene: Scene,
        prepare: Callable[[Scene], None],
        apply: Callable[[Scene, Scene], None],
    ) -> None:
        self.scene = scene
        self._next: Scene | None = None
        self._prepare, self._apply = prepare, apply
        declare(node, scene)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._changed)

    def _check(self, parameters: Sequence[RosParameter]) -> SetParametersResult:
        values: dict[str, Any] = dict(self.scene.parameters())
        mine = {p.name: p.value for p in parameters if p.name in values}
        self._next = None
        if mine:
            try:
                for name, value in mine.items():
                    values[name] = schema()[name].default if value is None else value
                scene = Scene.from_parameters(values)
                self._prepare(scene)
            except Exception as error:  # SceneError; whatever else it is, nothing changes
                return SetParametersResult(successful=False, reason=str(error))
            self._next = scene
        return SetParametersResult(successful=True)

    def _changed(self, _parameters: Sequence[RosParameter]) -> None:
        if self._next is not None:
            before, self.scene, self._next = self.scene, self._next, None
            self._apply(self.scene, before)


def differences(before: Scene, after: Scene) -> Iterator[tuple[str, str, str]]:
    """Name, old and new value, as a user would write them, of every parameter that differs."""
    old = before.parameters()
    for name, value in after.parameters().items():
        if show(old[name]) != show(value):
            yield name, show(old[name]), show(value)


def _to_ros(value: Value) -> Any:
    """ROS has no empty list of doubles: not set."""
    return (list(value) or None) if isinstance(value, tuple) else value
