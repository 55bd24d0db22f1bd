"""Parameters of scenes as arrays: one row per scene, repeated by index for its samples."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.scene.scene import Body, Friction, Scene

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


Self = TypeVar("Self", bound="Rows")


class Rows:
    """Base of dataclasses whose fields are arrays, or such dataclasses, with one row per sample."""

    def take(self: Self, index: NDArray[np.intp] | NDArray[np.bool_]) -> Self:
        """The rows ``index`` of every field."""
        values: dict[str, Any] = {}
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            values[field.name] = value.take(index) if isinstance(value, Rows) else value[index]
        return type(self)(**values)


@dataclasses.dataclass
class Bodies(Rows):
    """Bodies of one side. For infinite inertia, the frame's origin replaces the mass centre."""

    free: Bools  # (n,)
    inverse_mass: Array  # (n,) 0: infinite
    com: Array  # (n, 3) from the body frame's origin, body axes
    inertia: Array  # (n, 3, 3) about the mass centre
    inverse_inertia: Array  # (n, 3, 3) zeros: infinite
    node: Array  # (n, 3) connector node from the mass centre, body axes


@dataclasses.dataclass
class Parameters(Rows):
    """Parameters that the laws depend on, SI units."""

    h: Array  # (n,) period; 0: from the stamps
    gravity: Array  # (n, 3)
    a: Bodies
    b: Bodies
    axes_a: Array  # (n, 4) node a's axes in body A
    axes_b: Array  # (n, 4) node b's axes in body B; NaN: equal to a's at the first sample
    hold_offsets: Bools
    hold_misalignment: Bools
    pull_in_speed: Array
    pull_in_rate: Array
    reference: Array  # (n, 2) l1ref, theta1ref; NaN: values of the first sample
    stiffness: Array  # (n, 2) k1, kr1
    damping: Array  # (n, 2) c1, cr1
    on: Bools  # whether there is friction
    kinetic: Array
    static: Array
    decay: Array
    cap: Array
    radius: Array  # 1 without friction
    overlap: Array  # as given; of a checked sample, its own (friction.at_contact)
    overlap_slope: Array  # of the overlap over the slide
    overlap_at: Array  # slide at which it is the one given; NaN: the reference configuration
    overlap_min: Array
    overlap_max: Array
    centre_slope: Array  # of the contact's middle over the slide
    centre: Array  # of a checked sample: middle of the contact before node b
    overlap_size: Array  # terms of the overlap over the overlap, 1 or more
    centre_size: Array
    preload: Array  # 0 if it does not press
    radial: Bools  # whether the radial force presses
    bends: Bools  # whether the bending moment presses
    direction: Array  # difference of mu of positive and negative slide over their sum
    offset: Array  # (n, 2) force, moment that resist a positive slide, spin
    table: Array  # (n,) index into the tables; -1: none
    explicit: Bools  # semi-implicit plant
    held_in_body: Bools
    world_axes: Bools
    at_com: Bools
    force_limit: Array
    torque_limit: Array
    stops: Array  # (n, 2, 2) slide and spin: lower and upper stop; infinite: none
    restitution: Array
    lock: NDArray[np.intp]  # (n,) component that locks; -1: none
    lock_position: Array  # NaN: no lock by position
    lock_force: Array
    gains: Array  # (n, 6) k, kr, c, cr of the penalty constraint, ks, cs of its stick; NaN: none
    feedback: Array  # (n, 2) alpha, beta of baumgarte
    command: Array  # (n, 2, 3) slide and spin: position, velocity, force; NaN: not imposed
    drive: Array  # (n, 2, 2) slide and spin: greatest force, speed of approach
    begins: Bools  # (n, 2) whether a message imposes motion or force from this sample on

    @property
    def bounded(self) -> Bools:
        """(n,) whether a stop, lock or imposed motion can hold slide or spin."""
        stops = np.isfinite(self.stops).any(axis=(1, 2))
        return np.asarray(stops | (self.lock >= 0) | self.imposed.any(axis=1))

    @property
    def imposed_force(self) -> Array:
        """(n, 2) commanded force and moment, less the constant ones that resist."""
        given = self.command[:, :, 2]
        return np.asarray(np.where(np.isnan(given), 0.0, given) - self.offset)

    @property
    def imposed(self) -> Bools:
        """(n, 2) whether a motion is imposed."""
        return np.asarray(~np.isnan(self.command[:, :, :2]).all(axis=2))


@dataclasses.dataclass(frozen=True)
class Table:
    """Table of the friction coefficient over slip rate (m/s) and contact force (N)."""

    rates: Array
    forces: Array
    values: Array  # (rates, forces)


def tables_of(scenes: Sequence[Scene]) -> list[Table]:
    """The friction tables of the scenes that have one, in order."""
    found = []
    for scene in scenes:
        table = scene.friction.table
        if table is not None:
            grid = np.array(table.values).reshape(len(table.rates), len(table.forces))
            found.append(Table(np.array(table.rates), np.array(table.forces), grid))
    return found


def parameters_of(scenes: Sequence[Scene]) -> Parameters:
    """Parameters with one row per scene; ``table`` is an index into :func:`tables_of`."""
    friction = [scene.friction for scene in scenes]
    has_table = np.array([f.table is not None for f in friction])
    absent = (math.nan,) * 4
    return Parameters(
        h=_column([s.period for s in scenes]),
        gravity=_column([s.gravity for s in scenes]),
        a=_bodies([s.body_a for s in scenes], [s.node_a.position for s in scenes]),
        b=_bodies([s.body_b for s in scenes], [s.node_b.position for s in scenes]),
        axes_a=_column([s.node_a.orientation for s in scenes]),
        axes_b=_column([s.node_b.orientation or absent for s in scenes]),
        hold_offsets=np.array([s.reference.offsets == "hold" for s in scenes]),
        hold_misalignment=np.array([s.reference.misalignment == "hold" for s in scenes]),
        pull_in_speed=_column([s.reference.pull_in_speed for s in scenes]),
        pull_in_rate=_column([s.reference.pull_in_rate for s in scenes]),
        reference=_column([(s.reference.length, s.reference.angle) for s in scenes]),
        stiffness=_column([(s.elasticity.k1, s.elasticity.kr1) for s in scenes]),
        damping=_column([(s.damping.c1, s.damping.cr1) for s in scenes]),
        on=np.array([f.on for f in friction]),
        kinetic=_column([0.5 * sum(_both(f)) for f in friction]),
        static=_column([_static(f) for f in friction]),
        decay=_column([f.decay for f in friction]),
        cap=_column([f.max_force for f in friction]),
        radius=_column([1.0 if math.isnan(f.radius) else f.radius for f in friction]),
        overlap=_column([f.overlap for f in friction]),
        overlap_slope=_column([_SLOPES[f.overlap_change] for f in friction]),
        overlap_at=_column([f.overlap_at for f in friction]),
        overlap_min=_column([f.overlap_min for f in friction]),
        overlap_max=_column([f.overlap_max for f in friction]),
        centre_slope=_column([_centre_slope(f) for f in friction]),
        centre=np.zeros(len(scenes)),
        overlap_size=np.ones(len(scenes)),
        centre_size=np.zeros(len(scenes)),
        preload=_column([f.preload if "preload" in f.inputs else 0.0 for f in friction]),
        radial=np.array(["radial" in f.inputs for f in friction]),
        bends=np.array(["bending" in f.inputs for f in friction]),
        direction=_column([_direction(*_both(f)) for f in friction]),
        offset=_column([(f.offset_force, 0.0) for f in friction]),
        table=np.where(has_table, np.cumsum(has_table) - 1, -1),
        explicit=np.array([s.plant_integration == "semi_implicit" for s in scenes]),
        held_in_body=np.array([s.wrench.hold == "body" for s in scenes]),
        world_axes=np.array([s.wrench.axes == "world" for s in scenes]),
        at_com=np.array([s.wrench.point == "com" for s in scenes]),
        force_limit=_column([s.limits.force for s in scenes]),
        torque_limit=_column([s.limits.torque for s in scenes]),
        stops=np.array([_stops(s) for s in scenes]),
        restitution=_column([s.stops.restitution for s in scenes]),
        lock=np.array([("none", "slide", "spin").index(s.lock.component) - 1 for s in scenes]),
        lock_position=_column([s.lock.position for s in scenes]),
        lock_force=_column([s.lock.force for s in scenes]),
        gains=_column([_gains(s) for s in scenes]),
        feedback=_column([_feedback(s) for s in scenes]),
        command=np.array([_command(s) for s in scenes]),
        drive=np.array([_drive(s) for s in scenes]),
        begins=np.zeros((len(scenes), 2), dtype=np.bool_),
    )


_SLOPES = {"constant": 0.0, "increasing": 1.0, "decreasing": -1.0}


def _centre_slope(friction: Friction) -> float:
    """0 if B carries the contact's middle, 1 if A does, 1/2 between them."""
    auto = "body_b" if friction.overlap_change == "constant" else "between"
    of = auto if friction.contact_centre == "auto" else friction.contact_centre
    return {"body_b": 0.0, "between": 0.5, "body_a": 1.0}[of]


def _stops(scene: Scene) -> list[list[float]]:
    """Rigid stops; the compliant ones are elements (elements.py)."""
    given = scene.stops
    pairs = (given.l_min, given.l_max), (given.theta_min, given.theta_max)
    return [
        [
            -math.inf if math.isnan(low) or soft else low,
            math.inf if math.isnan(high) or soft else high,
        ]
        for (low, high), soft in zip(pairs, given.compliant, strict=True)
    ]


def _gains(scene: Scene) -> tuple[float, ...]:
    """Gains of penalty and augmented_lagrangian, with their defaults."""
    given, friction = scene.penalty, scene.friction
    radius = 0.0 if math.isnan(friction.radius) else friction.radius
    arm = max(0.5 * friction.overlap, radius)
    swing = _or(given.rotational_stiffness, given.stiffness * arm**2)
    share = swing / given.stiffness if given.stiffness > 0.0 else math.nan
    swing_damping = _or(given.rotational_damping, given.damping * share)
    stick = given.stiffness
    greatest = max(0.5 * sum(_both(friction)), _or(friction.static_coefficient, 0.0))
    if friction.preload != 0.0 and greatest > 0.0 and not math.isnan(given.elastic_slip):
        stick = greatest * abs(friction.preload) / given.elastic_slip
    stick = _or(given.stick_stiffness, stick)
    damper = given.damping * stick / given.stiffness if given.stiffness > 0.0 else math.nan
    return given.stiffness, swing, given.damping, swing_damping, stick, damper


def _feedback(scene: Scene) -> tuple[float, float]:
    own = 0.2 / scene.period if scene.period > 0.0 else math.nan
    return _or(scene.baumgarte.alpha, own), _or(scene.baumgarte.beta, own)


def _or(given: float, otherwise: float) -> float:
    return otherwise if math.isnan(given) else given


def _command(scene: Scene) -> list[list[float]]:
    given = scene.command.slide, scene.command.spin
    return [[each.position, each.velocity, each.force] for each in given]


def _drive(scene: Scene) -> list[list[float]]:
    given = scene.command.slide, scene.command.spin
    return [[each.max_force, each.approach_speed] for each in given]


def _column(values: Sequence[object]) -> Array:
    return np.array(values, dtype=np.float64)


def _both(friction: Friction) -> tuple[float, float]:
    """Kinetic coefficients of a positive and of a negative slide."""
    given, forward, backward = (
        friction.coefficient,
        friction.coefficient_forward,
        friction.coefficient_backward,
    )
    return _or(forward, given), _or(backward, given)


def _direction(forward: float, backward: float) -> float:
    return (forward - backward) / (forward + backward) if forward != backward else 0.0


def _static(friction: Friction) -> float:
    return _or(friction.static_coefficient, 0.5 * sum(_both(friction)))


def _bodies(bodies: Sequence[Body], nodes: Sequence[tuple[float, ...]]) -> Bodies:
    """Bodies of one side, one row per scene. nodes: node positions in the body frames."""
    n = len(bodies)
    free = np.array([body.kind == "free" for body in bodies])
    has_com = np.array([body.kind in ("free", "unknown") for body in bodies])
    com = np.where(has_com[:, None], _column([body.com for body in bodies]), 0.0)
    inertia = np.broadcast_to(np.eye(3), (n, 3, 3)).copy()
    inverse = np.zeros((n, 3, 3))
    inverse_mass = np.zeros(n)
    for k in map(int, np.flatnonzero(free)):
        xx, xy, xz, yy, yz, zz = bodies[k].inertia
        inertia[k] = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
        inverse[k] = np.linalg.inv(inertia[k])
        inverse_mass[k] = 1.0 / bodies[k].mass
    return Bodies(free, inverse_mass, com, inertia, inverse, _column(nodes) - com)


def world(tensor: Array, axes: Array) -> Array:
    """(n, 3, 3) tensors transformed from body axes to world axes."""
    return np.asarray(axes @ tensor @ axes.transpose(0, 2, 1))


def with_period(p: Parameters, h: Array) -> Parameters:
    """The parameters with the period h (n,), s."""
    return dataclasses.replace(p, h=h)
