"""Parameter groups of the bodies: Body, Node, the reference configuration, and the plant.

SI units, radians, quaternions x, y, z, w. Rules between parameters: validation.py.
"""

# ruff: noqa: RUF009 - parameter() and group() make the fields themselves

from __future__ import annotations

import dataclasses
import math
from typing import Any

from cylconn_ros.scene.amplitude import Amplitude
from cylconn_ros.scene.schema import group, parameter

NAN = math.nan
INF = math.inf
IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def _factor(of: str, **rules: Any) -> Any:
    """An amplitude of the quantity ``of``; ``rules``: of all its parameters."""
    change = {field.name: dict(rules) for field in dataclasses.fields(Amplitude)}
    times = f"Times of the factor on {of}, ascending, at least 2; []: no table."
    change["times"]["doc"] = times
    return group(Amplitude, change=change)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Body:
    """One of the two rigid bodies.

    Example::

        body = cr.Body(mass=2.0, com=(0, 0, 0.1), inertia=(0.01, 0, 0, 0.02, 0, 0.02))
    """

    frame: str = parameter(
        "",
        read_only=True,
        restarts=True,
        doc="Name of the body frame. Connectors whose bodies have the same frame share the body.",
    )
    kind: str = parameter(
        "free",
        choices=("free", "unknown", "driven", "fixed"),
        restarts=True,
        shared="body",
        doc="free: mass and inertia known; unknown: moves, inertia not known; "
        "driven: prescribed motion, infinite inertia; fixed: does not move.",
    )
    pose: tuple[float, ...] = parameter(
        IDENTITY,
        size=7,
        pose=True,
        unit="m, 1",
        restarts=True,
        shared="body",
        doc="Body frame in the world: position and quaternion. The pose of a fixed body; "
        "the initial pose of a moving body in the plant.",
    )
    mass: float = parameter(
        NAN,
        gt=0.0,
        unit="kg",
        example=1.0,
        restarts=True,
        shared="body",
        doc="Mass; required for a free body.",
    )
    com: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0),
        size=3,
        unit="m",
        restarts=True,
        shared="body",
        doc="Mass centre in the body frame.",
    )
    inertia: tuple[float, ...] = parameter(
        (),
        size=6,
        optional=True,
        unit="kg.m^2",
        example=(0.002, 0.0, 0.0, 0.003, 0.0, 0.004),
        restarts=True,
        shared="body",
        doc="Inertia tensor about the mass centre in body axes: ixx, ixy, ixz, iyy, iyz, izz "
        "(tensor elements, as in geometry_msgs/Inertia); required for a free body.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Node:
    """An end point of the connector, fixed on its body.

    Example::

        node = cr.Node(position=(0, 0, 0.1), orientation=(0, 0, 0, 1))
    """

    position: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), size=3, unit="m", restarts=True, doc="Node in its body's frame."
    )
    orientation: tuple[float, ...] = parameter(
        (),
        size=4,
        pose=True,
        optional=True,
        unit="1",
        restarts=True,
        doc="Node's axes in its body's frame, a quaternion; "
        "[]: the axes of node a in the reference configuration.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Reference:
    """The reference configuration and the constitutive reference.

    Example::

        reference = cr.Reference(offsets="zero", length=0.2)
    """

    offsets: str = parameter(
        "hold",
        choices=("hold", "zero"),
        restarts=True,
        doc="The slot constraint's target: the offsets of the first accepted sample, or zero.",
    )
    misalignment: str = parameter(
        "hold",
        choices=("hold", "zero"),
        restarts=True,
        doc="The revolute constraint's target: the misalignment of the first accepted sample, "
        "or zero.",
    )
    pull_in_speed: float = parameter(
        0.1,
        gt=0.0,
        unit="m/s",
        restarts=True,
        doc="Maximum speed at which an offset violation is removed.",
    )
    pull_in_rate: float = parameter(
        1.0,
        gt=0.0,
        unit="rad/s",
        restarts=True,
        doc="Maximum rate at which an angular violation is removed.",
    )
    length: float = parameter(
        NAN,
        unit="m",
        restarts=True,
        doc="Constitutive reference l1ref; .nan: the length of the first accepted sample.",
    )
    angle: float = parameter(
        NAN,
        unit="rad",
        restarts=True,
        doc="Constitutive reference theta1ref; .nan: the angle of the first accepted sample.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlantBody:
    """Initial state of a body in the plant, and its external load.

    Example::

        initial = cr.PlantBody(twist=(1.0, 0, 0, 0, 0, 0))
    """

    pose: tuple[float, ...] = parameter(
        (),
        size=7,
        pose=True,
        optional=True,
        unit="m, 1",
        shared="body",
        doc="Initial pose; []: the body's pose.",
    )
    twist: tuple[float, ...] = parameter(
        (0.0,) * 6,
        size=6,
        unit="m/s, rad/s",
        shared="body",
        doc="Initial velocity of the body frame's origin and angular velocity, in world axes.",
    )
    load: tuple[float, ...] = parameter(
        (0.0,) * 6,
        size=6,
        unit="N, N.m",
        shared="body",
        doc="External load besides gravity: force and torque about the body frame's origin, in "
        "world axes; constant unless it has an amplitude. The plant publishes it too.",
    )
    load_amplitude: Amplitude = _factor("the load", shared="body")


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlantSettings:
    """The plant: two rigid bodies in place of a simulator.

    Example::

        plant = cr.PlantSettings(duration=2.0, body_b=cr.PlantBody(twist=(1.0, 0, 0, 0, 0, 0)))
    """

    lock_step: bool = parameter(
        True,
        read_only=True,
        shared="coupled",
        doc="Wait for the wrenches of each sample; false: free running.",
    )
    rate: float = parameter(
        0.0,
        ge=0.0,
        unit="Hz",
        read_only=True,
        doc="Sample rate on the wall clock when free running; 0: real time.",
    )
    duration: float = parameter(
        INF, gt=0.0, unit="s", read_only=True, doc="Simulated time after which the plant ends."
    )
    timeout: float = parameter(
        5.0,
        gt=0.0,
        unit="s",
        read_only=True,
        doc="Maximum wait for a wrench in lock step, on the wall clock.",
    )
    latency: float = parameter(
        NAN,
        ge=0.0,
        unit="samples",
        read_only=True,
        shared="coupled",
        doc="Simulated delay: the wrench of a sample acts this number of periods after the "
        "sample's stamp, zero before the first; fractions are allowed. .nan: the delay that the "
        "parameter latency states, and none if it is 0 or -1. Another value than latency states is "
        "a delay of which the connector is not told.",
    )
    progress: bool = parameter(
        False, read_only=True, doc="Print lines 'progress DONE TOTAL' on standard output."
    )
    body_a: PlantBody = group(PlantBody)
    body_b: PlantBody = group(PlantBody)
    preload_amplitude: Amplitude = _factor("friction.preload, sent on ~/preload")
    slide_amplitude: Amplitude = _factor("what command.slide imposes, sent on ~/command")
    spin_amplitude: Amplitude = _factor("what command.spin imposes, sent on ~/command")
