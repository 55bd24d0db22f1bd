"""All parameters of a scene as the fields of a dataclass.

Each parameter has its type, unit, default, bounds and description here or in groups.py, and only
there. SI units, radians, quaternions x, y, z, w.
"""

# ruff: noqa: RUF009 - parameter() and group() make the fields themselves

from __future__ import annotations

import dataclasses
import math
from typing import Any, cast

from cylconn_ros.methods.traits import TRAITS
from cylconn_ros.scene.behaviour import (
    Baumgarte,
    Command,
    Damping,
    Elasticity,
    Friction,
    Lock,
    Penalty,
    Stops,
)
from cylconn_ros.scene.bodies import Body, Node, PlantSettings, Reference
from cylconn_ros.scene.inputs import MODES
from cylconn_ros.scene.outputs import (
    Access,
    FeedForward,
    JointNames,
    Limits,
    QualityOfService,
    Record,
    Wrench,
)
from cylconn_ros.scene.schema import Parameter, Value, describe, group, parameter


@dataclasses.dataclass(frozen=True, kw_only=True)
class SceneFields:
    """The parameters of a connector and of the plant; :class:`~.scene.Scene` checks them."""

    input: str = parameter(
        "pose_twist",
        choices=MODES,
        read_only=True,
        restarts=True,
        shared="coupled",
        doc="Message types of the motion: PoseStamped and TwistStamped, or Odometry.",
    )
    autostart: bool = parameter(
        True, read_only=True, node=True, doc="The node configures and activates itself."
    )
    period: float = parameter(
        0.001,
        ge=0.0,
        le=1e6,
        unit="s",
        restarts=True,
        shared="coupled",
        doc="Sample period h; 0: from the stamps. The interval of the samples replaces a period "
        "that the motion contradicts.",
    )
    method: str = parameter(
        "auto",
        choices=("auto", *TRAITS),
        restarts=True,
        doc="auto: impulse if every inertia is known, else penalty. impulse: constraint and "
        "friction solved together. baumgarte: acceleration-level multipliers with feedback. "
        "penalty, augmented_lagrangian: for unknown inertia; the latter has no steady-state "
        "deflection. observe: no wrench is sent; forces and friction of the measured motion. "
        "minimal: offline simulation in joint coordinates.",
    )
    constraint: str = parameter(
        "connector",
        choices=("connector", "simulator"),
        restarts=True,
        shared="coupled",
        doc="connector: the wrenches keep slot and revolute. simulator: a joint of the simulator "
        "keeps them; only what acts on slide and spin is sent (friction, stops, springs, dampers, "
        "drives, locks). The method must be impulse.",
    )
    tolerance: float = parameter(
        0.0,
        ge=0.0,
        unit="1",
        doc="Maximum relative error of slide and rotation over the whole motion, kept by "
        "`cylconn simulate` with the methods auto and minimal; 0: none stated.",
    )
    latency: int = parameter(
        -1,
        ge=-1,
        unit="samples",
        restarts=True,
        shared="coupled",
        doc="Number of samples between a sample and the action of its wrench; -1: measured.",
    )
    plant_integration: str = parameter(
        "exact",
        choices=("exact", "semi_implicit"),
        shared="coupled",
        doc="How the simulator integrates a held wrench.",
    )
    world_frame: str = parameter(
        "world", read_only=True, shared="coupled", doc="Name of the world frame."
    )
    twist_axes: str = parameter(
        "world",
        choices=("world", "body"),
        shared="coupled",
        doc="Axes of twists and loads whose frame_id names neither the world nor the body frame.",
    )
    gravity: tuple[float, ...] = parameter(
        (0.0, 0.0, -9.81), size=3, unit="m/s^2", shared="coupled", doc="Gravity in world axes."
    )
    timeout: float = parameter(
        0.1,
        gt=0.0,
        unit="s",
        infinite=True,
        doc="Wall-clock time without a complete sample after which one zero wrench is sent. Its "
        "stamp is 1 ns after the last sample's: a client that applies the newest wrench applies "
        "it; a plant in lock step waits for its own stamp and ignores it.",
    )
    stamp_tolerance: float = parameter(
        0.0,
        ge=0.0,
        unit="s",
        shared="coupled",
        doc="Largest difference of the stamps within one sample.",
    )
    wrench: Wrench = group(Wrench)
    body_a: Body = group(
        Body, change={"frame": {"default": "body_a"}, "kind": {"default": "fixed"}}
    )
    body_b: Body = group(Body, change={"frame": {"default": "body_b"}})
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
    qos: QualityOfService = group(QualityOfService)
    record: Record = group(Record)
    access: Access = group(Access)
    joint_names: JointNames = group(JointNames)
    feed_forward: FeedForward = group(FeedForward)
    markers: bool = parameter(
        False, read_only=True, doc="Publish ~/markers: shaft, sleeve and force, for RViz."
    )
    tf: bool = parameter(
        False,
        read_only=True,
        doc="Broadcast the frames of both bodies on /tf, 30 times per second. Leave it false if "
        "other software broadcasts them. Needs the ROS package tf2_msgs.",
    )
    plant: PlantSettings = group(PlantSettings)

    @staticmethod
    def schema() -> dict[str, Parameter]:
        """Every parameter of a scene by dotted name."""
        return schema()

    def parameters(self) -> dict[str, Value]:
        """Every parameter by dotted name, defaults included; an unset vector is ()."""
        found = ((name, value_of(self, name)) for name in schema())
        return {name: () if value is None else cast(Value, value) for name, value in found}

    @property
    def bodies(self) -> tuple[Body, Body]:
        """Body A and body B."""
        return self.body_a, self.body_b

    @property
    def plant_latency(self) -> float:
        """Periods between a sample and the action of its wrench in the plant (plant.latency)."""
        given = self.plant.latency
        return float(max(self.latency, 0)) if math.isnan(given) else given

    def initial_pose(self, index: int) -> tuple[float, ...]:
        """(7,) initial pose of body A (0) or B (1) in the plant, in the world frame."""
        settings = (self.plant.body_a, self.plant.body_b)[index]
        return settings.pose or self.bodies[index].pose

    def initial_twist(self, index: int) -> tuple[float, ...]:
        """(6,) initial velocity of the frame's origin and angular velocity, world axes."""
        return (self.plant.body_a, self.plant.body_b)[index].twist


_SCHEMA: dict[str, Parameter] = {}


def schema() -> dict[str, Parameter]:
    """Every parameter of a scene by dotted name."""
    if not _SCHEMA:
        _SCHEMA.update(describe(SceneFields))
    return _SCHEMA


def value_of(scene: SceneFields, name: str) -> Any:
    """The value of a parameter by dotted name; None within an absent group."""
    value: Any = scene
    for part in name.split("."):
        value = None if value is None else getattr(value, part)
    return value
