"""What peers share: where the joint is, Coulomb's law on last step's reaction, bounces, end states.

Peers have slide and spin as coordinates, from 0 at the start. Their loops are what a careful user
writes: the normal force of the *last* step's reaction, friction on one disc against the slip, and
no more of it than what brings the slip to rest within the step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cylconn_ros.bench.common.errors import LeftOutError
from cylconn_ros.bench.common.frames import inside, inverse, outside, product, rotation
from cylconn_ros.bench.peers.solver import Array
from cylconn_ros.scene.scene import Scene


class Joint:
    """The cylindrical joint of a scene at its start.

    Attributes
    ----------
        free: whether A moves. pose_a, pose_b (7,), twist_a, twist_b (6,): at the start.
        axis_a, axis_b (3,): the slot in body A's and in body B's axes.
        node_b (3,): in B's frame. place (3,), turn (4,): of B's frame in A's.
        slide, spin: rates at the start, m/s, rad/s.

    Raises LeftOutError for a scene that is not a free body B on a fixed or free A.
    """

    def __init__(self, scene: Scene) -> None:
        a, b = scene.body_a, scene.body_b
        if b.kind != "free" or a.kind not in ("free", "fixed"):
            raise LeftOutError("needs a free body B on a fixed or free body A")
        self.scene, self.free = scene, a.kind == "free"
        self.pose_a, self.pose_b = np.array(scene.initial_pose(0)), np.array(scene.initial_pose(1))
        self.twist_a, self.twist_b = (np.array(scene.initial_twist(k)) for k in (0, 1))
        if not self.free:
            self.twist_a = np.zeros(6)
        self.turn = product(inverse(self.pose_a[3:]), self.pose_b[3:])
        self.place = inside(self.pose_a, self.pose_b[:3])
        self.axis_a = rotation(scene.node_a.orientation)[:, 0]
        self.axis_b = rotation(self.turn).T @ self.axis_a
        self.node_b = np.array(scene.node_b.position)
        self.slide, self.spin = self.rates(self.pose_a, self.twist_a, self.pose_b, self.twist_b)

    def rates(
        self, pose_a: Array, twist_a: Array, pose_b: Array, twist_b: Array
    ) -> tuple[float, float]:
        """Rates of slide and spin."""
        axis = rotation(pose_a[3:]) @ self.axis_a
        xb = outside(pose_b, self.node_b)
        at_b = twist_b[:3] + np.cross(twist_b[3:], xb - pose_b[:3])
        of_a = twist_a[:3] + np.cross(twist_a[3:], xb - pose_a[:3])
        return float(axis @ (at_b - of_a)), float(axis @ (twist_b[3:] - twist_a[3:]))

    def state(
        self, pose_a: Array, twist_a: Array, slide: float, spin: float, rates: Sequence[float]
    ) -> Array:
        """(26,) as in a sample, of slide and spin since the start and their rates."""
        half = 0.5 * spin
        rolled = np.array([*(math.sin(half) * self.axis_a), math.cos(half)])
        hub = self.place + rotation(self.turn) @ self.node_b + slide * self.axis_a
        turn = product(rolled, self.turn)
        place = hub - rotation(turn) @ self.node_b
        state = np.empty(26)
        state[0:7], state[7:13] = pose_a, twist_a
        state[13:16], state[16:20] = outside(pose_a, place), product(pose_a[3:], turn)
        axis = rotation(pose_a[3:]) @ self.axis_a
        xb = outside(pose_a, hub)
        spin_b = twist_a[3:] + rates[1] * axis
        at_b = twist_a[:3] + np.cross(twist_a[3:], xb - pose_a[:3]) + rates[0] * axis
        state[20:23] = at_b + np.cross(spin_b, state[13:16] - xb)
        state[23:26] = spin_b
        return state


class Coulomb:
    """The law of friction as a user's loop has it, in plain floats."""

    def __init__(self, scene: Scene) -> None:
        f = scene.friction
        self.on = f.on
        self.mu, self.radius = (f.coefficient, f.radius) if f.on else (0.0, 1.0)
        self.bend = 2.0 / f.overlap if f.on and f.overlap > 0.0 else 0.0
        self.preload = f.preload if f.on else 0.0

    def limit(self, force: Sequence[float], moment: Sequence[float], e: Sequence[float]) -> float:
        """Mu FN of the reaction (force, moment about node b), in any axes; ``e`` the slot there."""
        fx, fy, fz = force
        mx, my, mz = moment
        along = fx * e[0] + fy * e[1] + fz * e[2]
        about = mx * e[0] + my * e[1] + mz * e[2]
        radial = math.sqrt(max(fx * fx + fy * fy + fz * fz - along * along, 0.0))
        bending = math.sqrt(max(mx * mx + my * my + mz * mz - about * about, 0.0))
        return self.mu * abs(radial + self.bend * bending + self.preload)

    def brake(
        self, limit: float, v: float, w: float, free: tuple[float, float],
        inverse_mass: tuple[float, float, float], h: float,
    ) -> tuple[float, float]:  # fmt: skip
        """Friction force and moment of one step.

        What brings slide and spin to rest at the step's end if the limit allows it; else the limit,
        against the slip.

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
        if size <= 1e-300:  # from rest: against what pulls it
            v, u = -f, -m / self.radius
            size = math.hypot(v, u)
        return -limit * v / size, -limit * self.radius * u / size

    def shares(self, limit: float, v: float, w: float, small: float) -> tuple[float, float]:
        """The limit shared by slide (N) and spin (N.m) as the slip is; whole for both at rest."""
        u = self.radius * w
        size = math.hypot(v, u)
        if size <= small:
            return limit, limit * self.radius
        return limit * abs(v) / size, limit * self.radius * abs(u) / size


class Stops:
    """Stops on the slide as a loop handles them: put back, and sent back with the restitution."""

    def __init__(self, scene: Scene, start: float) -> None:
        low, high = scene.stops.l_min, scene.stops.l_max
        self.low = -math.inf if math.isnan(low) else low - start
        self.high = math.inf if math.isnan(high) else high - start
        self.restitution = scene.stops.restitution
        self.on = math.isfinite(self.low) or math.isfinite(self.high)

    def bounced(self, slide: float, v: float) -> tuple[float, float] | None:
        """Slide and rate after a stop was run into; None where none was."""
        if slide > self.high and v > 0.0:
            return self.high, -self.restitution * v
        if slide < self.low and v < 0.0:
            return self.low, -self.restitution * v
        return None


class Spring:
    """The spring on the slide: ``stiffness`` (N/m), and at which slide it is ``slack`` (m)."""

    def __init__(self, scene: Scene) -> None:
        self.stiffness, self.slack = scene.elasticity.k1, 0.0
        if not math.isnan(scene.reference.length):
            self.slack = scene.reference.length - length(scene)

    def force(self, slide: float) -> float:
        """On B along the slot, N."""
        return -self.stiffness * (slide - self.slack)


def length(scene: Scene) -> float:
    """Position in the slot at the start, m."""
    pose_a = np.array(scene.initial_pose(0))
    axes = rotation(pose_a[3:]) @ rotation(scene.node_a.orientation)
    xa = outside(pose_a, scene.node_a.position)
    xb = outside(scene.initial_pose(1), scene.node_b.position)
    return float(axes[:, 0] @ (xb - xa))
