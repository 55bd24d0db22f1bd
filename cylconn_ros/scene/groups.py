"""The groups of a scene's parameters: what each one is, with unit, default, bounds and words.

SI units, radians, quaternions x, y, z, w. Rules between parameters: scene_rules.py.
"""

# ruff: noqa: RUF009 - parameter() and group() make the fields themselves

from __future__ import annotations

import dataclasses
import math

from cylconn_ros.scene.schema import group, parameter

NAN = math.nan
INF = math.inf
IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Wrench:
    """How the published wrenches are expressed, and how they are meant to be held."""

    axes: str = parameter("body", choices=("body", "world"), doc="Axes of the published wrenches.")
    point: str = parameter(
        "origin",
        choices=("origin", "com"),
        doc="Point of the published torques: the body frame's origin or the mass centre.",
    )
    hold: str = parameter(
        "world",
        choices=("world", "body"),
        doc="How a wrench is held until the next: fixed in world axes, or turning with the body.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Body:
    """One of the two rigid bodies."""

    frame: str = parameter(doc="Name of the body frame.", read_only=True)
    kind: str = parameter(
        choices=("free", "unknown", "driven", "fixed"),
        doc="free: mass and inertia known; unknown: moves, inertia not known; "
        "driven: moves on its own, as if infinitely heavy; fixed: does not move.",
    )
    pose: tuple[float, ...] = parameter(
        IDENTITY,
        size=7,
        pose=True,
        unit="m, 1",
        doc="Body frame in the world: position and quaternion. Where a fixed body is; "
        "where the plant starts a moving one.",
    )
    mass: float = parameter(
        NAN, gt=0.0, unit="kg", example=1.0, doc="Mass; needed for a free body."
    )
    com: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), size=3, unit="m", doc="Mass centre in the body frame."
    )
    inertia: tuple[float, ...] = parameter(
        (),
        size=6,
        optional=True,
        unit="kg.m^2",
        example=(0.002, 0.0, 0.0, 0.003, 0.0, 0.004),
        doc="Inertia tensor about the mass centre in body axes: ixx, ixy, ixz, iyy, iyz, izz "
        "(tensor elements, as in geometry_msgs/Inertia); needed for a free body.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Node:
    """An end point of the connector, fixed on its body."""

    position: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), size=3, unit="m", doc="Node in its body's frame."
    )
    orientation: tuple[float, ...] = parameter(
        (),
        size=4,
        pose=True,
        optional=True,
        unit="1",
        doc="Node's axes in its body's frame, a quaternion; "
        "[]: as node a's in the reference configuration.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Reference:
    """The reference configuration and the constitutive reference."""

    offsets: str = parameter(
        "hold",
        choices=("hold", "zero"),
        doc="The slot constraint's target: the offsets of the first accepted sample, or zero.",
    )
    misalignment: str = parameter(
        "hold",
        choices=("hold", "zero"),
        doc="The revolute constraint's target: the misalignment of the first accepted sample, "
        "or zero.",
    )
    pull_in_speed: float = parameter(
        0.1, gt=0.0, unit="m/s", doc="Greatest speed at which an offset violation is removed."
    )
    pull_in_rate: float = parameter(
        1.0, gt=0.0, unit="rad/s", doc="Greatest rate at which an angular violation is removed."
    )
    length: float = parameter(
        NAN, unit="m", doc="Constitutive reference l1ref; .nan: the first accepted sample's."
    )
    angle: float = parameter(
        NAN, unit="rad", doc="Constitutive reference theta1ref; .nan: the first accepted sample's."
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class FrictionTable:
    """Friction coefficient over slip rate and contact force; constant beyond the last entries."""

    rates: tuple[float, ...] = parameter((), ge=0.0, unit="m/s", doc="Slip rates, ascending.")
    forces: tuple[float, ...] = parameter((), ge=0.0, unit="N", doc="Contact forces, ascending.")
    values: tuple[float, ...] = parameter(
        (), ge=0.0, unit="1", doc="Coefficients row by row: one row a rate, one column a force."
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Friction:
    """Coulomb friction on slide and spin together."""

    coefficient: float = parameter(
        0.0, ge=0.0, unit="1", doc="Friction coefficient (kinetic); 0: no friction."
    )
    radius: float = parameter(
        NAN, gt=0.0, unit="m", doc="Effective radius R of the shaft; needed with friction."
    )
    overlap: float = parameter(
        0.0, ge=0.0, unit="m", doc="Overlap L of shaft and sleeve; 0: bending adds no normal force."
    )
    preload: float = parameter(
        0.0, unit="N", doc="Self-equilibrated contact force FCint (press fit), of either sign."
    )
    static_coefficient: float = parameter(
        NAN, ge=0.0, unit="1", doc="Static coefficient; .nan: as the kinetic."
    )
    decay: float = parameter(
        0.0, ge=0.0, unit="s/m", doc="Decay dc of mu = mu_k + (mu_s - mu_k) exp(-dc |s|)."
    )
    max_force: float = parameter(INF, ge=0.0, unit="N", doc="Cap on the friction traction P.")
    rest_rate: float = parameter(
        1e-3, ge=0.0, unit="m/s", doc="observe: slip that is slower counts as rest."
    )
    table: FrictionTable | None = group(FrictionTable, absent=True)

    @property
    def on(self) -> bool:
        """Whether there is friction at all."""
        static = self.static_coefficient > 0.0  # False for NaN
        return self.coefficient > 0.0 or static or self.table is not None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Stops:
    """Bounds of the position in the slot and of the angle; each one optional."""

    l_min: float = parameter(NAN, unit="m", doc="Least position in the slot; .nan: none.")
    l_max: float = parameter(NAN, unit="m", doc="Greatest position in the slot; .nan: none.")
    theta_min: float = parameter(NAN, unit="rad", doc="Least angle; .nan: none.")
    theta_max: float = parameter(NAN, unit="rad", doc="Greatest angle; .nan: none.")
    restitution: float = parameter(
        0.0, ge=0.0, le=1.0, unit="1", doc="Coefficient of restitution at the stops."
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Lock:
    """Freezing of the available components once a criterion is met."""

    component: str = parameter(
        "none", choices=("none", "slide", "spin"), doc="Which component locks."
    )
    position: float = parameter(
        NAN, unit="m or rad", doc="Locks when the component passes this position or angle."
    )
    force: float = parameter(
        NAN, gt=0.0, unit="N or N.m", doc="Locks when the component's force exceeds this."
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Elasticity:
    """Linear springs on the available components, about the constitutive reference."""

    k1: float = parameter(0.0, ge=0.0, unit="N/m", doc="Stiffness of the slide.")
    kr1: float = parameter(0.0, ge=0.0, unit="N.m/rad", doc="Stiffness of the spin.")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Damping:
    """Linear dampers on the available components."""

    c1: float = parameter(0.0, ge=0.0, unit="N.s/m", doc="Damping of the slide.")
    cr1: float = parameter(0.0, ge=0.0, unit="N.m.s/rad", doc="Damping of the spin.")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Penalty:
    """Gains of penalty and augmented_lagrangian: stable up to about m/h^2 and m/h."""

    stiffness: float = parameter(
        NAN, gt=0.0, unit="N/m", example=1e4, doc="Stiffness of the offsets; needed by penalty."
    )
    damping: float = parameter(
        NAN, ge=0.0, unit="N.s/m", example=20.0, doc="Damping of the offsets; needed by penalty."
    )
    rotational_stiffness: float = parameter(
        NAN,
        gt=0.0,
        unit="N.m/rad",
        doc="Stiffness of the swings; .nan: stiffness r^2, r the greater of overlap/2 and radius.",
    )
    rotational_damping: float = parameter(
        NAN, ge=0.0, unit="N.m.s/rad", doc="Damping of the swings; .nan: damping r^2."
    )
    stick_stiffness: float = parameter(
        NAN,
        gt=0.0,
        unit="N/m",
        doc="Stick stiffness; .nan: stiffness, or what the preload gives over elastic_slip.",
    )
    elastic_slip: float = parameter(
        NAN,
        gt=0.0,
        unit="m",
        doc="Elastic slip allowed at the friction limit of the preload; .nan: not stated.",
    )
    multiplier_gain: float = parameter(
        NAN,
        gt=0.0,
        lt=1.0,
        unit="1",
        doc="augmented_lagrangian: share of the spring's force that the multiplier takes over each "
        "sample; .nan: stiffness h/(32 damping), at most 0.1.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Baumgarte:
    """Feedback and regularisation of the method baumgarte."""

    alpha: float = parameter(
        NAN, gt=0.0, unit="1/s", doc="Half the feedback of the constraint's rate; .nan: 0.2/h."
    )
    beta: float = parameter(
        NAN,
        gt=0.0,
        unit="1/s",
        doc="Root of the feedback of the constraint's error; .nan: 0.2/h. A held force is stable "
        "for beta^2 h/4 < alpha < 1/h.",
    )
    regularisation_velocity: float = parameter(
        0.001,
        gt=0.0,
        unit="m/s",
        doc="v0 in mu FN s/sqrt(s^2 + v0^2): below it friction is viscous and a load creeps.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Limits:
    """Output limits; both bodies' wrenches are scaled by one factor to keep them."""

    force: float = parameter(INF, gt=0.0, unit="N", doc="Greatest published force.")
    torque: float = parameter(INF, gt=0.0, unit="N.m", doc="Greatest published torque.")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Record:
    """Recording of a run."""

    enabled: bool = parameter(
        False, read_only=True, doc="Record from activation on (a service starts one later)."
    )
    directory: str = parameter(
        "runs",
        doc="Where runs are put, each in a directory of its own. While the node runs it can be "
        "changed to what is below the one given at the start.",
    )
    compression: str = parameter(
        "zstd", choices=("none", "zstd"), doc="Compression of the recording's chunks."
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlantBody:
    """How the plant starts a body, and what loads it."""

    pose: tuple[float, ...] = parameter(
        (), size=7, pose=True, optional=True, unit="m, 1", doc="Initial pose; []: the body's pose."
    )
    twist: tuple[float, ...] = parameter(
        (0.0,) * 6,
        size=6,
        unit="m/s, rad/s",
        doc="Initial velocity of the body frame's origin and angular velocity, in world axes.",
    )
    load: tuple[float, ...] = parameter(
        (0.0,) * 6,
        size=6,
        unit="N, N.m",
        doc="Constant external load besides gravity: force and torque about the body frame's "
        "origin, in world axes; the plant publishes it too.",
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlantSettings:
    """The plant: two rigid bodies standing in for a simulator."""

    lock_step: bool = parameter(
        True, read_only=True, doc="Wait for the wrenches of each sample; false: free running."
    )
    rate: float = parameter(
        0.0,
        ge=0.0,
        unit="Hz",
        read_only=True,
        doc="Samples a second of wall clock when free running; 0: real time.",
    )
    duration: float = parameter(
        INF, gt=0.0, unit="s", read_only=True, doc="Simulated time after which the plant ends."
    )
    timeout: float = parameter(
        5.0,
        gt=0.0,
        unit="s",
        read_only=True,
        doc="Longest wait for a wrench in lock step, on the wall clock.",
    )
    progress: bool = parameter(
        False, read_only=True, doc="Print lines 'progress DONE TOTAL' on standard output."
    )
    body_a: PlantBody = group(PlantBody)
    body_b: PlantBody = group(PlantBody)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Imposed:
    """Motion or force imposed on one available component; also by the topic ``~/command``."""

    position: float = parameter(
        NAN, unit="m or rad", doc="Position in the slot or angle to be held or reached; .nan: none."
    )
    velocity: float = parameter(
        NAN, unit="m/s or rad/s", doc="Velocity to follow; with a position, its rate; .nan: none."
    )
    force: float = parameter(
        NAN, unit="N or N.m", doc="Force or moment on B along e1a; not with a motion; .nan: none."
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Command:
    """What is imposed on slide and spin."""

    slide: Imposed = group(
        Imposed,
        change={
            "position": {"unit": "m", "doc": "Position in the slot to hold or reach; .nan: none."},
            "velocity": {"unit": "m/s"},
            "force": {"unit": "N", "doc": "Force on B along e1a; not with a motion; .nan: none."},
        },
    )
    spin: Imposed = group(
        Imposed,
        change={
            "position": {"unit": "rad", "doc": "Angle to hold or reach; .nan: none."},
            "velocity": {"unit": "rad/s"},
            "force": {
                "unit": "N.m",
                "doc": "Moment on B about e1a; not with a motion; .nan: none.",
            },
        },
    )
