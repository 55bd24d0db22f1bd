"""The node of a careful user: impulses with known inertia, friction of the last step's reaction.

This is what a good engineer writes in an afternoon, and the guest that the default method has to
beat. Its reasoning, step by step:

- Masses are known, so springs are not needed: the impulse that ends the violation's rate within the
  sample follows from four linear equations, ``G Λ = -(J v + β e/h)`` with ``G = J M⁻¹ Jᵀ`` and the
  velocity ``v`` after gravity. Springs would need gains for every scene.
- Removing the whole violation in one sample rings, so a fifth of it is removed (β = 0.2).
- Friction and reaction depend on each other. The reaction changes little from sample to sample, so
  the friction limit comes from the last one, and no equation becomes nonlinear. The limit is
  averaged with the one before, because the pair of reaction and friction would otherwise alternate.
- Friction must not reverse the slip: the traction is the one that stops slide and spin within the
  sample, cut to the friction disc of radius ``μ FN h``. Then a stuck joint does not creep.
- A stop is a rate: what would carry the joint beyond it within the sample is removed.
- A sample that repeats an older stamp, or has a number that is not finite, or a quaternion that is
  none, does not count; the wrench of the last one remains.

It does not know how late its wrenches act, holds no misaligned joint that turns, evaluates all
matrices at the start of the sample (first order), and takes the twists as they come.
"""

from __future__ import annotations

import math

import numpy as np

from cylconn_ros.bench.common.errors import NotApplicableError
from cylconn_ros.bench.common.frames import inertia_tensor, rotation
from cylconn_ros.bench.common.timing import Array
from cylconn_ros.core import layout
from cylconn_ros.scene.scene import Body, Scene

PULL = 0.2  # share of the violation that a sample removes
MEMORY = 0.5  # share of the older friction limit
BACK = 100_000_000  # ns: a stamp that goes back further is a restart


class CarefulNode:
    """Computes wrenches from samples; knows the inertia and the period of ``scene``."""

    out: Array | None = None

    def __init__(self, scene: Scene) -> None:
        """Raises NotApplicableError if the scene needs what such a node does not have."""
        if scene.latency > 0:
            raise NotApplicableError("has no latency compensation")
        if scene.friction.overlap_change != "constant":
            raise NotApplicableError("has a constant overlap")
        self.scene, self.h = scene, scene.period
        self.coms = [np.array(body.com) for body in scene.bodies]
        self.axes_a = rotation(scene.node_a.orientation)
        turns = [rotation(scene.initial_pose(k)[3:]) for k in (0, 1)]
        axes = turns[0] @ self.axes_a
        in_b = scene.node_b.orientation
        self.e1_b = rotation(in_b)[:, 0] if in_b else turns[1].T @ axes[:, 0]
        held = scene.reference.misalignment == "hold"
        self.direction = axes.T @ turns[1] @ self.e1_b if held else np.array([1.0, 0.0, 0.0])
        points = [
            np.array(scene.initial_pose(k)[:3]) + turns[k] @ node.position
            for k, node in enumerate((scene.node_a, scene.node_b))
        ]
        d = axes.T @ (points[1] - points[0])
        self.start = float(d[0])
        self.offset = d[1:] if scene.reference.offsets == "hold" else np.zeros(2)
        self._reset()

    def _reset(self) -> None:
        self.limit = math.nan  # friction limit as an impulse, N.s
        self.last = -BACK
        self.wrench: Array = np.zeros(12)

    def receive(self, stamp: int, sample: Array) -> Array:
        """Process a sample that arrives; an older or unusable one gets the wrench of the last."""
        if self.last - BACK < stamp <= self.last:
            return self.wrench
        if stamp < self.last:
            self._reset()
        quaternions = [sample[at + 3 : at + 7] for at in (layout.A_POSE, layout.B_POSE)]
        usable = np.isfinite(sample).all() and all(abs(q @ q - 1.0) < 0.1 for q in quaternions)
        if usable:
            self.last = stamp
            self.step(sample)
        return self.wrench

    def step(self, sample: Array) -> Array:
        """(12,) force and torque on A and B, world axes, about the mass centres."""
        turns = [rotation(sample[at + 3 : at + 7]) for at in (0, 13)]
        arms = [turn @ com for turn, com in zip(turns, self.coms, strict=True)]
        centres = [sample[at : at + 3] + arm for at, arm in zip((0, 13), arms, strict=True)]
        axes = turns[0] @ self.axes_a
        node_a = sample[0:3] + turns[0] @ self.scene.node_a.position
        node_b = sample[13:16] + turns[1] @ self.scene.node_b.position
        d = axes.T @ (node_b - node_a)
        lever = [node_b - centre for centre in centres]
        j = np.array(
            [_row(lever, axes[:, k]) for k in range(3)] + [_turn(axes[:, k]) for k in range(3)]
        )
        inverse, velocity = self._bodies(sample, turns, arms)
        swing = np.cross(self.direction, axes.T @ turns[1] @ self.e1_b)
        error = np.array([*(d[1:] - self.offset), *swing[1:]])
        impulse = self._impulse(j @ inverse @ j.T, j @ velocity, error, float(d[0]))
        self.wrench = j.T @ impulse / self.h
        return self.wrench

    def _bodies(self, sample: Array, turns: list[Array], arms: list[Array]) -> tuple[Array, Array]:
        """Inverse mass matrix (12, 12) and the mass centres' velocities (12,) after gravity."""
        inverse, velocity = np.zeros((12, 12)), np.zeros(12)
        for k, body in enumerate(self.scene.bodies):
            at, w = 6 * k, sample[13 * k + 10 : 13 * k + 13]
            velocity[at : at + 3] = sample[13 * k + 7 : 13 * k + 10] + np.cross(w, arms[k])
            velocity[at + 3 : at + 6] = w
            if body.kind == "free":
                inertia = _inertia(body, turns[k])
                inverse[at : at + 3, at : at + 3] = np.eye(3) / body.mass
                inverse[at + 3 : at + 6, at + 3 : at + 6] = np.linalg.inv(inertia)
                velocity[at : at + 3] += self.h * np.array(self.scene.gravity)
                gyroscopic = np.cross(w, inertia @ w)
                velocity[at + 3 : at + 6] -= self.h * np.linalg.solve(inertia, gyroscopic)
        return inverse, velocity

    def _impulse(self, g: Array, rate: Array, error: Array, length: float) -> Array:
        """(6,) impulses along the axes and about them, from Delassus' matrix and rates."""
        fixed, free = [1, 2, 4, 5], [0, 3]
        g_cc, g_cf = g[np.ix_(fixed, fixed)], g[np.ix_(fixed, free)]
        target = rate[fixed] + PULL * error / self.h
        held: Array = np.asarray(np.linalg.solve(g_cc, np.column_stack([target, g_cf])), float)
        slip: Array = rate[free] - g_cf.T @ held[:, 0]
        schur: Array = g[np.ix_(free, free)] - g_cf.T @ held[:, 1:]
        active: Array = self._spring(schur, slip, length)
        active = active + self._traction(schur, slip + schur @ active, np.asarray(-held[:, 0]))
        active[0] += self._stop(schur, slip + schur @ active, length)
        found = np.zeros(6)
        found[free] = active
        found[fixed] = -held[:, 0] - held[:, 1:] @ active
        newest = self._friction_limit(found[fixed])
        self.limit = newest if math.isnan(self.limit) else (
            MEMORY * self.limit + (1.0 - MEMORY) * newest
        )  # fmt: skip
        return found

    def _spring(self, schur: Array, slip: Array, length: float) -> Array:
        """Impulses of the slide's spring, implicit in the rate after the sample."""
        stiffness = self.h * self.scene.elasticity.k1
        if stiffness == 0.0:
            return np.zeros(2)
        stretch = length - self.start + self.h * slip[0]
        return np.array([-stiffness * stretch / (1.0 + stiffness * self.h * schur[0, 0]), 0.0])

    def _traction(self, schur: Array, slip: Array, reactions: Array) -> Array:
        """Friction impulses on slide and spin: what stops the slip, cut to the disc."""
        law = self.scene.friction
        if not law.on:
            return np.zeros(2)
        stop = -np.asarray(np.linalg.solve(schur, slip), dtype=float)
        limit = self._friction_limit(reactions) if math.isnan(self.limit) else self.limit
        size = math.hypot(stop[0], stop[1] / law.radius)
        return stop if size <= limit else stop * (limit / size)

    def _friction_limit(self, reactions: Array) -> float:
        """``μ FN h`` of (4,) reaction impulses."""
        law = self.scene.friction
        bend = 2.0 / law.overlap if law.overlap > 0.0 else 0.0
        normal = math.hypot(*reactions[:2]) + bend * math.hypot(*reactions[2:])
        return law.coefficient * (normal + self.h * law.preload)

    def _stop(self, schur: Array, slip: Array, length: float) -> float:
        """Impulse of a stop that the slide would pass within the sample."""
        low, high = self.scene.stops.l_min, self.scene.stops.l_max
        after = length + self.h * slip[0]
        gap = min(after - low, 0.0) if after < low else max(after - high, 0.0)
        if not after < low and not after > high:  # both False without a stop, which is NaN
            return 0.0
        bounce = self.scene.stops.restitution * slip[0]
        return float(-(gap / self.h + bounce) / schur[0, 0])


def _row(levers: list[Array], u: Array) -> Array:
    """(12,) row of the relative velocity of node b along u."""
    return np.concatenate([-u, -np.cross(levers[0], u), u, np.cross(levers[1], u)])


def _turn(u: Array) -> Array:
    """(12,) row of the relative angular velocity about u."""
    return np.concatenate([np.zeros(3), -u, np.zeros(3), u])


def _inertia(body: Body, turn: Array) -> Array:
    return np.asarray(turn @ inertia_tensor(body) @ turn.T)
