"""What the peer solvers share: joint geometry, Coulomb friction, stops, spring, end states.

The simulators have slide and spin as generalised coordinates that start at 0, but no Coulomb
friction that depends on the reaction. A careful user adds a loop: friction on one disc against the
slip, its limit computed from the reaction of the *previous* step, and never more of it than brings
the slip to rest within the step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cylconn_ros.bench.common.errors import NotApplicableError
from cylconn_ros.bench.common.frames import inverse, product, rotation, to_body, to_world
from cylconn_ros.bench.peers.solver import Array
from cylconn_ros.scene.scene import Scene


class Joint:
    """Geometry and initial state of the cylindrical joint of a scene.

    Attributes
    ----------
        free: whether body A moves. pose_a, pose_b (7,), twist_a, twist_b (6,): initial values.
        axis_a, axis_b (3,): joint axis e1 in the axes of body A and of body B.
        node_b (3,): in the frame of B. position (3,), orientation (4,): of B's frame in A's.
        slide_rate, spin_rate: initial values, m/s, rad/s.

    Raises NotApplicableError unless body B is free and body A is fixed or free.
    """

    def __init__(self, scene: Scene) -> None:
        a, b = scene.body_a, scene.body_b
        if b.kind != "free" or a.kind not in ("free", "fixed"):
            raise NotApplicableError("needs a free body B on a fixed or free body A")
        self.scene, self.free = scene, a.kind == "free"
        self.pose_a, self.pose_b = np.array(scene.initial_pose(0)), np.array(scene.initial_pose(1))
        self.twist_a, self.twist_b = (np.array(scene.initial_twist(k)) for k in (0, 1))
        if not self.free:
            self.twist_a = np.zeros(6)
        self.orientation = product(inverse(self.pose_a[3:]), self.pose_b[3:])
        self.position = to_body(self.pose_a, self.pose_b[:3])
        self.axis_a = rotation(scene.node_a.orientation)[:, 0]
        self.axis_b = rotation(self.orientation).T @ self.axis_a
        self.node_b = np.array(scene.node_b.position)
        self.slide_rate, self.spin_rate = self.rates(
            self.pose_a, self.twist_a, self.pose_b, self.twist_b
        )

    def rates(
        self, pose_a: Array, twist_a: Array, pose_b: Array, twist_b: Array
    ) -> tuple[float, float]:
        """Rates of slide (m/s) and spin (rad/s)."""
        axis = rotation(pose_a[3:]) @ self.axis_a
        xb = to_world(pose_b, self.node_b)
        velocity_b = twist_b[:3] + np.cross(twist_b[3:], xb - pose_b[:3])
        velocity_a = twist_a[:3] + np.cross(twist_a[3:], xb - pose_a[:3])
        return float(axis @ (velocity_b - velocity_a)), float(axis @ (twist_b[3:] - twist_a[3:]))

    def state(
        self, pose_a: Array, twist_a: Array, slide: float, spin: float, rates: Sequence[float]
    ) -> Array:
        """(26,) poses and twists from slide (m) and spin (rad) since the start, and their rates."""
        half = 0.5 * spin
        about_axis = np.array([*(math.sin(half) * self.axis_a), math.cos(half)])
        node_in_a = self.position + rotation(self.orientation) @ self.node_b + slide * self.axis_a
        orientation = product(about_axis, self.orientation)
        position = node_in_a - rotation(orientation) @ self.node_b
        state = np.empty(26)
        state[0:7], state[7:13] = pose_a, twist_a
        state[13:16] = to_world(pose_a, position)
        state[16:20] = product(pose_a[3:], orientation)
        axis = rotation(pose_a[3:]) @ self.axis_a
        xb = to_world(pose_a, node_in_a)
        omega_b = twist_a[3:] + rates[1] * axis
        velocity = twist_a[:3] + np.cross(twist_a[3:], xb - pose_a[:3]) + rates[0] * axis
        state[20:23] = velocity + np.cross(omega_b, state[13:16] - xb)
        state[23:26] = omega_b
        return state


class Coulomb:
    """The friction law of a scene as a user's loop computes it, in plain floats.

    Its coefficient may decay from a static one or follow a table over the slip rate, and its
    overlap may change with the slide about a contact fixed on body B. Raises NotApplicableError for
    what else a scene's friction may have.
    """

    def __init__(self, scene: Scene) -> None:
        f = scene.friction
        self.on = f.on
        self.mu, self.radius = (f.coefficient, f.radius) if f.on else (0.0, 1.0)
        self.preload = f.preload if f.on else 0.0
        static = self.mu if math.isnan(f.static_coefficient) else f.static_coefficient
        self.static, self.decay = (static, f.decay) if f.on else (0.0, 0.0)
        self.rates: tuple[float, ...] = ()
        self.values: tuple[float, ...] = ()
        if f.table is not None:
            self.rates, self.values = f.table.rates, f.table.values
        self.overlap, self.growth = f.overlap, _growth(scene)
        by_direction = not (
            math.isnan(f.coefficient_forward) and math.isnan(f.coefficient_backward)
        )
        by_force = f.table is not None and len(f.table.forces) > 1
        if f.on and (by_direction or by_force or f.offset_force or math.isfinite(f.max_force)):
            raise NotApplicableError("the loop has no such friction law")

    @property
    def constant(self) -> bool:
        """Whether coefficient and overlap are constant."""
        return not self.rates and self.static == self.mu and not self.growth

    def coefficient(self, slip: float) -> float:
        """Friction coefficient at a slip rate, m/s."""
        if self.rates:
            return float(np.interp(slip, self.rates, self.values))
        return self.mu + (self.static - self.mu) * math.exp(-self.decay * slip)

    def numbers(self) -> Array:
        """The law for compiled loops: mu, static coefficient, decay, R, overlap, its growth."""
        return np.array(
            [self.mu, self.static, self.decay, self.radius, self.overlap, float(self.growth)]
        )

    def table(self) -> Array:
        """(2, n) rates and coefficients of the table, for compiled loops."""
        return np.array([self.rates, self.values], dtype=np.float64)

    def pressing(
        self, force: Sequence[float], moment: Sequence[float], axis: Sequence[float],
        slide: float = 0.0,
    ) -> float:  # fmt: skip
        """Radial force and bending (N) of a reaction (force, moment about node b) at a slide (m).

        All three vectors are in the same axes; ``axis`` is the joint axis e1.
        """
        fx, fy, fz = force
        mx, my, mz = moment
        along = fx * axis[0] + fy * axis[1] + fz * axis[2]
        about = mx * axis[0] + my * axis[1] + mz * axis[2]
        radial = math.sqrt(max(fx * fx + fy * fy + fz * fz - along * along, 0.0))
        if self.overlap <= 0.0:
            return radial
        bending = math.sqrt(max(mx * mx + my * my + mz * mz - about * about, 0.0))
        return radial + 2.0 / (self.overlap + self.growth * slide) * bending

    def limit(
        self, force: Sequence[float], moment: Sequence[float], axis: Sequence[float]
    ) -> float:
        """Friction limit mu FN (N) of a reaction, with the kinetic coefficient."""
        return self.mu * abs(self.pressing(force, moment, axis) + self.preload)

    def friction(
        self, limit: float, v: float, w: float, free: tuple[float, float],
        inverse_mass: tuple[float, float, float], h: float,
    ) -> tuple[float, float]:  # fmt: skip
        """Friction force (N) and moment (N.m) of one step of length ``h`` (s).

        The friction that brings slide and spin to rest at the end of the step, if it is within the
        limit; else the limit, against the slip.

        Args:
            v, w: rates of slide and spin. free: their accelerations without friction.
            inverse_mass: s11, s12, s22 of (acceleration) = S (force, moment).
        """
        s11, s12, s22 = inverse_mass
        det = s11 * s22 - s12 * s12
        a1, a2 = v / h + free[0], w / h + free[1]
        f, m = -(s22 * a1 - s12 * a2) / det, -(s11 * a2 - s12 * a1) / det
        if math.hypot(f, m / self.radius) <= limit:
            return f, m
        u = self.radius * w
        size = math.hypot(v, u)
        if size <= 1e-300:  # starts from rest: against the applied load
            v, u = -f, -m / self.radius
            size = math.hypot(v, u)
        return -limit * v / size, -limit * self.radius * u / size

    def split(self, limit: float, v: float, w: float, rest: float) -> tuple[float, float]:
        """The limit split into slide (N) and spin (N.m) in proportion to the slip components.

        Below the slip speed ``rest`` (m/s) both get the whole limit.
        """
        u = self.radius * w
        size = math.hypot(v, u)
        if size <= rest:
            return limit, limit * self.radius
        return limit * abs(v) / size, limit * self.radius * abs(u) / size


class Stops:
    """Stops of the slide, handled by a loop: it resets the position and reverses the rate."""

    def __init__(self, scene: Scene) -> None:
        low, high, start = scene.stops.l_min, scene.stops.l_max, initial_length(scene)
        self.low = -math.inf if math.isnan(low) else low - start
        self.high = math.inf if math.isnan(high) else high - start
        self.restitution = scene.stops.restitution
        self.on = math.isfinite(self.low) or math.isfinite(self.high)

    def impact(self, slide: float, v: float) -> tuple[float, float] | None:
        """Slide and rate after an impact on a stop; None if there is no impact."""
        if slide > self.high and v > 0.0:
            return self.high, -self.restitution * v
        if slide < self.low and v < 0.0:
            return self.low, -self.restitution * v
        return None


class Spring:
    """The spring on the slide: ``stiffness`` (N/m), and the slide without force, ``rest`` (m).

    ``damping`` (N.s/m): of the damper beside it.
    """

    def __init__(self, scene: Scene) -> None:
        self.stiffness, self.rest = scene.elasticity.k1, 0.0
        self.damping = scene.damping.c1
        if scene.elasticity.table.positions or scene.damping.table.rates:
            raise NotApplicableError("the loop has no springs or dampers by table")
        if not math.isnan(scene.reference.length):
            self.rest = scene.reference.length - initial_length(scene)

    def force(self, slide: float) -> float:
        """Force on B along the joint axis, N."""
        return -self.stiffness * (slide - self.rest)


class Course:
    """What changes over time, as its mean over each step of length h (s).

    Attributes
    ----------
        push: (n,) N, load on B along the joint axis. preload: (n,) N. on: whether there is any
        push or the preload changes.

    Raises NotApplicableError for a load across the axis or on a body that turns: the loops apply
    loads as generalised forces of the slide.
    """

    def __init__(self, scene: Scene, h: float, steps: int) -> None:
        load, friction = np.array(scene.plant.body_b.load), scene.friction
        pose = scene.initial_pose(0)
        axis = rotation(pose[3:]) @ rotation(scene.node_a.orientation)[:, 0]
        along = float(axis @ load[:3])
        across = np.linalg.norm(load[:3] - along * axis) + np.linalg.norm(load[3:])
        if across > 0.0 or any(scene.plant.body_a.load) or scene.command.slide.force > 0.0:
            raise NotApplicableError("the loop has no loads but those along the joint axis")
        self.moves = scene.plant.preload_amplitude.on
        self.on = along != 0.0 or self.moves
        self.push, self.preload = np.full(steps, along), np.full(steps, friction.preload)
        for values, factor in (
            (self.push, scene.plant.body_b.load_amplitude),
            (self.preload, scene.plant.preload_amplitude),
        ):
            if factor.on:
                values *= [factor.average(k * h, (k + 1) * h) for k in range(steps)]


def check_plain(scene: Scene) -> None:
    """Raise NotApplicableError for a scene beyond constant friction without loads."""
    if Course(scene, scene.plant.duration, 1).on:
        raise NotApplicableError("this loop has no loads and preloads over time")
    if not Coulomb(scene).constant:
        raise NotApplicableError("this loop has one coefficient and one overlap")
    if Spring(scene).damping:
        raise NotApplicableError("this loop has no damper")


def _growth(scene: Scene) -> int:
    """Change of the overlap with the slide: 0, 1 or -1. Raises NotApplicableError."""
    f = scene.friction
    if not f.on or f.overlap_change == "constant":
        return 0
    if f.contact_centre != "body_b" or not math.isnan(f.overlap_at):
        raise NotApplicableError("the loop has no contact whose middle moves")
    return 1 if f.overlap_change == "increasing" else -1


def initial_length(scene: Scene) -> float:
    """Initial position of node b along the joint axis, from node a, m."""
    pose_a = np.array(scene.initial_pose(0))
    axes = rotation(pose_a[3:]) @ rotation(scene.node_a.orientation)
    xa = to_world(pose_a, scene.node_a.position)
    xb = to_world(scene.initial_pose(1), scene.node_b.position)
    return float(axes[:, 0] @ (xb - xa))
