"""A scene: two bodies, a cylindrical connector between them, and how it is served.

The fields below are the one place where a parameter has its type, unit, default, bounds and words.
:class:`Scene` is checked as a whole when it is made: a scene that exists is one that can be used.
SI units, radians, quaternions x, y, z, w.
"""

# ruff: noqa: RUF009 - parameter() and group() make the fields themselves

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from cylconn_ros.errors import SceneError
from cylconn_ros.scene import multiple, parameter_file, shared_bodies, validation
from cylconn_ros.scene.groups import (
    Baumgarte,
    Body,
    Command,
    Damping,
    Elasticity,
    Friction,
    Limits,
    Lock,
    Node,
    Penalty,
    PlantSettings,
    Record,
    Reference,
    Stops,
    Wrench,
)
from cylconn_ros.scene.resources import shipped
from cylconn_ros.scene.schema import (
    Parameter,
    Value,
    describe,
    flatten,
    group,
    groups,
    parameter,
    show,
)

__all__ = [
    "Body",
    "Friction",
    "Node",
    "Scene",
    "SceneError",
    "load",
    "schema",
    "several",
    "shipped",
]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scene:
    """All parameters of a connector and of the plant that goes with it.

    Raises :class:`SceneError` on anything that cannot be used.
    """

    input: str = parameter(
        "pose_twist",
        choices=("pose_twist", "odometry"),
        read_only=True,
        doc="Which topics carry the motion.",
    )
    autostart: bool = parameter(
        True, read_only=True, doc="The node configures and activates itself."
    )
    period: float = parameter(0.001, ge=0.0, unit="s", doc="Sample period h; 0: from the stamps.")
    method: str = parameter(
        "auto",
        choices=(
            "auto",
            "impulse",
            "minimal",
            "baumgarte",
            "penalty",
            "augmented_lagrangian",
            "observe",
        ),
        doc="Inertia known: impulse; minimal, the mean wrench of the integrated motion; baumgarte, "
        "the textbook's. Unknown: penalty, or augmented_lagrangian, which does not give. "
        "auto: impulse where it can, else penalty. observe: no wrench; forces and friction of the "
        "motion seen.",
    )
    tolerance: float = parameter(
        0.0,
        ge=0.0,
        unit="1",
        doc="Greatest error of slide and spin, each over the way it goes, that auto and minimal "
        "are to keep; 0: none stated.",
    )
    latency: int = parameter(
        0, ge=-1, unit="samples", doc="Samples between sample and action; -1: measured."
    )
    plant_integration: str = parameter(
        "exact",
        choices=("exact", "semi_implicit"),
        doc="How the simulator integrates a held wrench.",
    )
    world_frame: str = parameter("world", read_only=True, doc="Name of the world frame.")
    twist_axes: str = parameter(
        "world",
        choices=("world", "body"),
        doc="Axes of twists and loads whose frame_id names neither the world nor the body frame.",
    )
    gravity: tuple[float, ...] = parameter(
        (0.0, 0.0, -9.81), size=3, unit="m/s^2", doc="Gravity in world axes."
    )
    timeout: float = parameter(
        0.1,
        gt=0.0,
        unit="s",
        infinite=True,
        doc="Wall-clock time without a complete sample after which one zero wrench is sent. Its "
        "stamp is 1 ns after the last sample's: the newest for whoever applies the newest, and "
        "ignored by a plant in lock step, which waits for its own stamp however long.",
    )
    stamp_tolerance: float = parameter(
        0.0, ge=0.0, unit="s", doc="Largest difference of stamps within one sample."
    )
    wrench: Wrench = group(Wrench)
    body_a: Body = group(
        Body, change={"frame": {"default": "body_a"}, "kind": {"default": "fixed"}}
    )
    body_b: Body = group(Body, change={"frame": {"default": "body_b"}, "kind": {"default": "free"}})
    node_a: Node = group(
        Node,
        change={
            "orientation": {
                "required": True,
                "optional": False,
                "example": (0.0, 0.0, 0.0, 1.0),
                "doc": "Node's axes in its body's frame, a quaternion; its first axis is the slot.",
            }
        },
    )
    node_b: Node = group(Node)
    reference: Reference = group(Reference)
    friction: Friction = group(Friction)
    stops: Stops = group(Stops)
    lock: Lock = group(Lock)
    command: Command = group(Command)
    elasticity: Elasticity = group(Elasticity)
    damping: Damping = group(Damping)
    penalty: Penalty = group(Penalty)
    baumgarte: Baumgarte = group(Baumgarte)
    limits: Limits = group(Limits)
    record: Record = group(Record)
    markers: bool = parameter(
        False, read_only=True, doc="Publish ~/markers: shaft, sleeve and force, for RViz."
    )
    plant: PlantSettings = group(PlantSettings)

    def __post_init__(self) -> None:
        values = {}
        for name, rules in schema().items():
            given = _get(self, name)
            if rules.required and (given is None or given == ()):
                raise SceneError(f"{name}: is required and not given; must be {rules.rule}")
            values[name] = () if given is None else rules.check(given)
        for field in dataclasses.fields(self):
            object.__setattr__(self, field.name, _take(Scene, field.name, "", values))
        validation.check(self)

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any]) -> Scene:
        """Make a scene from nested or dotted names; names not given have their defaults.

        Raises :class:`SceneError` for an unknown name (with the nearest one) or an unusable value.
        A value of ``None`` means not given, and so does an empty list.
        """
        flat = flatten(parameters)
        table = schema()
        values: dict[str, Any] = {}
        for name, value in flat.items():
            if name not in table:
                raise SceneError(_unknown(name, value, table))
            if value is not None and not (isinstance(value, list | tuple) and not value):
                values[name] = table[name].check(value)
        for name, rules in table.items():
            if rules.required and name not in values:
                raise SceneError(f"{name}: is required and not given; must be {rules.rule}")
            values.setdefault(name, rules.default)
        return cls(**{f.name: _take(cls, f.name, "", values) for f in dataclasses.fields(cls)})

    @staticmethod
    def schema() -> dict[str, Parameter]:
        """Every parameter of a scene by dotted name."""
        return schema()

    def parameters(self) -> dict[str, Value]:
        """Every parameter by dotted name, defaults included; :meth:`from_parameters` undoes it."""
        found = ((name, _get(self, name)) for name in schema())
        return {name: () if value is None else cast(Value, value) for name, value in found}

    @property
    def bodies(self) -> tuple[Body, Body]:
        """Body A and body B."""
        return self.body_a, self.body_b

    def initial_pose(self, index: int) -> tuple[float, ...]:
        """(7,) where the plant starts body A (0) or B (1), in the world."""
        settings = (self.plant.body_a, self.plant.body_b)[index]
        return settings.pose or self.bodies[index].pose

    def initial_twist(self, index: int) -> tuple[float, ...]:
        """(6,) velocity of the frame's origin and angular velocity at the start, world axes."""
        return (self.plant.body_a, self.plant.body_b)[index].twist


_SCHEMA: dict[str, Parameter] = {}


def schema() -> dict[str, Parameter]:
    """Every parameter of a scene by dotted name."""
    if not _SCHEMA:
        _SCHEMA.update(describe(Scene))
    return _SCHEMA


def several(parameters: Mapping[str, Any]) -> dict[str, Scene]:
    """The scene of each connector by its name; of one without a name where none are listed.

    Raises :class:`SceneError`, which says whose parameter it is.
    """
    scenes = {}
    for name, given in multiple.split(parameters, schema()).items():
        try:
            scenes[name] = Scene.from_parameters(given)
        except SceneError as error:
            raise SceneError(f"{name}.{error}" if name else str(error)) from None
    shared_bodies.check(scenes)
    return scenes


def load(
    path: str | Path, node: str = "connector", namespace: str = "/", connector: str = multiple.ONE
) -> Scene:
    """Read the scene in a ROS 2 parameter file, as the node ``node`` in ``namespace`` sees it.

    Blocks with wildcards (``/**``) come first, then the node's own. ``connector`` chooses one where
    the file has several. Raises :class:`SceneError` for a file that cannot be read or used; the
    text begins with the file's name.
    """
    parameters = parameter_file.load_parameters(path, node, namespace)
    try:
        return chosen(several(parameter_file.scene_part(parameters)), connector)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None


def chosen(scenes: Mapping[str, Scene], connector: str) -> Scene:
    """The scene of a connector; raises SceneError where there is none of that name."""
    if connector in scenes:
        return scenes[connector]
    if multiple.ONE in scenes:
        raise SceneError(f"connector {connector}: there is only one, without a name")
    which = f"{connector} is none of them" if connector else "choose one"
    raise SceneError(f"several connectors, {', '.join(scenes)}: {which}")


def _get(scene: Scene, name: str) -> Any:
    value: Any = scene
    for part in name.split("."):
        value = None if value is None else getattr(value, part)
    return value


def _take(cls: type, name: str, prefix: str, values: Mapping[str, Any]) -> Any:
    """Take the value of field ``name`` of ``cls``: a parameter, or a group made of several."""
    for group_name, group_cls, absent in groups(cls):
        if group_name == name:
            below = f"{prefix}{name}."
            fields = dataclasses.fields(group_cls)
            made = {f.name: _take(group_cls, f.name, below, values) for f in fields}
            return None if absent and not any(made.values()) else group_cls(**made)
    return values[prefix + name]


def _unknown(name: str, value: object, table: Mapping[str, Parameter]) -> str:
    parts = {known.rsplit(".", level)[0] for known in table for level in (0, 1, 2)}
    near = difflib.get_close_matches(name, sorted(parts), n=1)
    below = [known for known in table if known.startswith(name + ".")]
    text = f"{name} = {show(value)}: no such parameter"
    if below:
        return f"{text}; it is a group: give {', '.join(below)}"
    return f"{text}; did you mean {near[0]}?" if near else text
