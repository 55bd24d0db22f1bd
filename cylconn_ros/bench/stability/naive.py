"""Naive penalty solver: cylindrical joint of springs, dampers and smoothed friction.

This is the joint as it is commonly written into a node.

    f = -k e - c e'                         offsets; for rotation, e is the sine of the angle
    FN = |f23| + (2/L) |m23| + FCint        of the same springs
    (f1, m1/R) = -mu FN tanh(|s|/vr) s/|s|  s = (v1, R w1)

It has no history, no stamps and no checks of its input. Its gains are those of the method penalty.
"""

from __future__ import annotations

import math

import numpy as np

from cylconn_ros.bench.common.frames import rotation
from cylconn_ros.bench.common.timing import Array
from cylconn_ros.scene.scene import Scene

SMOOTH = 1e-3  # vr, m/s


class NaivePenalty:
    """Computes wrenches from samples; the method of ``scene`` is ``penalty``, with its gains."""

    out: Array | None = None

    def __init__(self, scene: Scene) -> None:
        a, b, p = scene.body_a, scene.body_b, scene.penalty
        self.com_a, self.com_b = np.array(a.com), np.array(b.com)
        self.node_a, self.node_b = np.array(scene.node_a.position), np.array(scene.node_b.position)
        self.axes_a = rotation(scene.node_a.orientation)
        self.k, self.c = p.stiffness, p.damping
        self.kr, self.cr = p.rotational_stiffness, p.rotational_damping
        self.friction, self.stops = scene.friction, scene.stops
        turn_a = rotation(scene.initial_pose(0)[3:]) @ self.axes_a
        turn_b = rotation(scene.initial_pose(1)[3:])
        in_b = scene.node_b.orientation
        self.e1_b = rotation(in_b)[:, 0] if in_b else turn_b.T @ turn_a[:, 0]
        held = scene.reference.misalignment == "hold"
        self.direction = turn_a.T @ turn_b @ self.e1_b if held else np.array([1.0, 0.0, 0.0])
        at = turn_b @ self.node_b + scene.initial_pose(1)[:3] - self._a(scene.initial_pose(0))
        self.offset = (turn_a.T @ at)[1:] if scene.reference.offsets == "hold" else np.zeros(2)

    def _a(self, pose: Array | tuple[float, ...]) -> Array:
        return np.asarray(pose[:3]) + rotation(pose[3:]) @ self.node_a

    def receive(self, stamp: int, sample: Array) -> Array:
        """Process any sample that arrives."""
        return self.step(sample)

    def step(self, sample: Array) -> Array:
        """(12,) force and torque on A and B, world axes, about the mass centres."""
        with np.errstate(all="ignore"):  # such a node does not check its output
            return self._wrenches(sample)

    def _wrenches(self, sample: Array) -> Array:
        pa, va, wa = sample[0:7], sample[7:10], sample[10:13]
        pb, vb, wb = sample[13:20], sample[20:23], sample[23:26]
        turn_a, turn_b = rotation(pa[3:]), rotation(pb[3:])
        axes = turn_a @ self.axes_a
        xb = pb[:3] + turn_b @ self.node_b
        d = axes.T @ (xb - self._a(pa))
        v = axes.T @ (vb + np.cross(wb, xb - pb[:3]) - va - np.cross(wa, xb - pa[:3]))
        w = axes.T @ (wb - wa)
        swing = np.cross(axes.T @ turn_b @ self.e1_b, self.direction)

        f = -self.k * np.array([0.0, *(d[1:] - self.offset)]) - self.c * v
        m = self.kr * swing - self.cr * w
        f[0], m[0] = self._slide_and_spin(f, m, v[0], w[0])
        f[0] += self._stop(d[0], v[0])

        force, moment = axes @ f, axes @ m
        arm_a = xb - pa[:3] - turn_a @ self.com_a
        arm_b = xb - pb[:3] - turn_b @ self.com_b
        on_a = -moment - np.cross(arm_a, force)
        return np.concatenate([-force, on_a, force, moment + np.cross(arm_b, force)])

    def _slide_and_spin(self, f: Array, m: Array, v: float, w: float) -> tuple[float, float]:
        law = self.friction
        if not law.on:
            return 0.0, 0.0
        bend = 2.0 / law.overlap if law.overlap > 0.0 else 0.0
        normal = np.hypot(f[1], f[2]) + bend * np.hypot(m[1], m[2]) + law.preload
        slip = math.hypot(v, law.radius * w)
        traction = law.coefficient * abs(normal) * math.tanh(slip / SMOOTH) / max(slip, 1e-300)
        return -traction * v, -traction * law.radius**2 * w

    def _stop(self, length: float, v: float) -> float:
        low, high = self.stops.l_min, self.stops.l_max
        if length < low:  # False without a stop, which is NaN
            return max(self.k * (low - length) - self.c * v, 0.0)
        if length > high:
            return min(self.k * (high - length) - self.c * v, 0.0)
        return 0.0
