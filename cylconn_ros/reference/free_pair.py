r"""Reference solution of two free bodies: Newton-Euler equations with constraint accelerations.

Unknowns: accelerations of both mass centres, both angular accelerations, and the multipliers of

    g2 = e2.d,   g3 = e3.d,   h2 = e2.e1b,   h3 = e3.e1b        e2, e3 of A; d = xb - xa

whose second derivatives are zero. On B the multipliers are f2 = lambda_g2, f3 = lambda_g3 at node
b, m3 = lambda_h2 and m2 = -lambda_h3. During slip, friction of size mu FN acts along and about e1a.
The multipliers are affine in it, so FN follows from one scalar equation. The constraints hold to
the tolerance of DOP853.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.reference.fixed_shaft import rotation, tensor
from cylconn_ros.scene.scene import Body, Scene

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pair:
    """End of the motion: slide (m), spin (rad), mass centres (m), constraint drift (m or 1)."""

    distance: float
    angle: float
    com_a: Array
    com_b: Array
    drift: float


def free_pair(scene: Scene, duration: float) -> Pair:
    """Integrate two free bodies from the scene's initial state for ``duration`` (s), with slip.

    Raises ValueError if a body is not free or slip ends before ``duration``.
    """
    pair = Equations(scene)
    y = _end(pair, duration)
    at = pair.geometry(y)
    return Pair(
        float(at.d @ at.axes[:, 0]) - pair.length0,
        float(y[26]),
        y[0:3],
        y[7:10],
        float(max(abs(at.d @ at.axes[:, 1] - pair.y0), abs(at.e1b @ at.axes[:, 1]))),
    )


def motion(scene: Scene, duration: float) -> Array:
    """(26,) poses and twists of both bodies after ``duration`` (s), as in a sample.

    Conditions and errors as for :func:`free_pair`.
    """
    pair = Equations(scene)
    return pair.sample(_end(pair, duration))


def _end(pair: Equations, duration: float) -> Array:
    from scipy.integrate import solve_ivp

    solution = solve_ivp(
        pair.rates, (0.0, duration), pair.start, method="DOP853", rtol=1e-12, atol=1e-13
    )
    if not solution.success:
        raise ValueError(f"the reference did not integrate: {solution.message}")
    y: Array = solution.y[:, -1]
    return y


@dataclass(frozen=True)
class _Geometry:
    axes: Array  # columns e1 e2 e3 of A's end
    arm_a: Array  # xa - mass centre of A
    arm_b: Array
    d: Array
    e1b: Array
    turn_a: Array
    turn_b: Array


class Equations:
    """Equations of motion of a scene's two free bodies.

    State y (27,): mass centre and quaternion of A, then of B (14); their linear and angular
    velocities (12); spin angle (1).
    """

    def __init__(self, scene: Scene) -> None:
        if (scene.body_a.kind, scene.body_b.kind) != ("free", "free"):
            raise ValueError("needs two free bodies")
        self.scene = scene
        self.masses = scene.body_a.mass, scene.body_b.mass
        self.inertia_a, self.inertia_b = tensor(scene.body_a.inertia), tensor(scene.body_b.inertia)
        self.end_a = np.array(scene.node_a.position) - np.array(scene.body_a.com)
        self.end_b = np.array(scene.node_b.position) - np.array(scene.body_b.com)
        self.axes_a = rotation(scene.node_a.orientation)
        qa, va = _initial(scene.body_a, scene.plant.body_a.pose, scene.plant.body_a.twist)
        qb, vb = _initial(scene.body_b, scene.plant.body_b.pose, scene.plant.body_b.twist)
        self.start = np.array([*qa, *qb, *va, *vb, 0.0])
        # node b's first axis in body B: along the slot at the start
        self.e1_in_b = rotation(qb[3:]).T @ rotation(qa[3:]) @ self.axes_a[:, 0]
        at = self.geometry(self.start)
        self.length0 = float(at.d @ at.axes[:, 0])
        self.y0 = float(at.d @ at.axes[:, 1])

    def geometry(self, y: Array) -> _Geometry:
        """Axes and arms in world axes for the state y."""
        turn_a = rotation(y[3:7] / np.linalg.norm(y[3:7]))
        turn_b = rotation(y[10:14] / np.linalg.norm(y[10:14]))
        arm_a, arm_b = turn_a @ self.end_a, turn_b @ self.end_b
        d = y[7:10] + arm_b - y[0:3] - arm_a
        axes = turn_a @ self.axes_a
        return _Geometry(axes, arm_a, arm_b, d, turn_b @ self.e1_in_b, turn_a, turn_b)

    def sample(self, y: Array) -> Array:
        """(26,) poses and twists of both bodies' frames, as in a sample."""
        at = self.geometry(y)
        found = []
        for body, k, turn in ((self.scene.body_a, 0, at.turn_a), (self.scene.body_b, 7, at.turn_b)):
            arm, j = turn @ np.array(body.com), 14 + 6 * (k > 0)
            q = y[k + 3 : k + 7] / np.linalg.norm(y[k + 3 : k + 7])
            spin = y[j + 3 : j + 6]
            found += [*(y[k : k + 3] - arm), *q, *(y[j : j + 3] - np.cross(spin, arm)), *spin]
        return np.array(found)

    def rates(self, _t: float, y: Array) -> Array:
        """(27,) derivatives of the state y."""
        va, wa, vb, wb = y[14:17], y[17:20], y[20:23], y[23:26]
        accelerations = self.accelerations(y)
        e1 = self.geometry(y).axes[:, 0]
        return np.array(
            [
                *va,
                *_quaternion_rate(y[3:7], wa),
                *vb,
                *_quaternion_rate(y[10:14], wb),
                *accelerations,
                e1 @ (wb - wa),
            ]
        )

    def accelerations(self, y: Array) -> Array:
        """(12,) accelerations of both mass centres and both angular accelerations."""
        at = self.geometry(y)
        va, wa, vb, wb = y[14:17], y[17:20], y[20:23], y[23:26]
        i_a = at.turn_a @ self.inertia_a @ at.turn_a.T
        i_b = at.turn_b @ self.inertia_b @ at.turn_b.T
        mass = np.zeros((12, 12))
        mass[0:3, 0:3], mass[3:6, 3:6] = self.masses[0] * np.eye(3), i_a
        mass[6:9, 6:9], mass[9:12, 9:12] = self.masses[1] * np.eye(3), i_b
        gravity = np.array(self.scene.gravity)
        applied = np.concatenate(
            [
                self.masses[0] * gravity,
                -np.cross(wa, i_a @ wa),
                self.masses[1] * gravity,
                -np.cross(wb, i_b @ wb),
            ]
        )
        rate = vb + np.cross(wb, at.arm_b) - va - np.cross(wa, at.arm_a)
        bend = np.cross(wb, np.cross(wb, at.arm_b)) - np.cross(wa, np.cross(wa, at.arm_a))
        rows, bias = [], []
        for e in (at.axes[:, 1], at.axes[:, 2]):
            de, dde = np.cross(wa, e), np.cross(wa, np.cross(wa, e))
            about_a = np.cross(e, at.d) - np.cross(at.arm_a, e)
            rows.append([*-e, *about_a, *e, *np.cross(at.arm_b, e)])
            bias.append(dde @ at.d + 2.0 * de @ rate + e @ bend)
        for e in (at.axes[:, 1], at.axes[:, 2]):
            de, dde = np.cross(wa, e), np.cross(wa, np.cross(wa, e))
            db, ddb = np.cross(wb, at.e1b), np.cross(wb, np.cross(wb, at.e1b))
            rows.append([*np.zeros(3), *np.cross(e, at.e1b), *np.zeros(3), *np.cross(at.e1b, e)])
            bias.append(dde @ at.e1b + 2.0 * de @ db + e @ ddb)
        jacobian = np.array(rows)
        system = np.block([[mass, -jacobian.T], [jacobian, np.zeros((4, 4))]])
        e1 = at.axes[:, 0]
        arm = at.d + at.arm_a
        slide = np.array([*-e1, *-np.cross(arm, e1), *e1, *np.cross(at.arm_b, e1)])
        spin = np.array([*np.zeros(3), *-e1, *np.zeros(3), *e1])
        right = np.zeros((16, 3))
        right[:12, 0], right[12:, 0] = applied, -np.array(bias)
        right[:12, 1], right[:12, 2] = slide, spin
        free, by_slide, by_spin = np.linalg.solve(system, right).T
        friction = self.scene.friction
        if not friction.on:
            return np.array(free[:12])
        v1 = e1 @ (rate - np.cross(wa, at.d))
        s = np.array([v1, friction.radius * (e1 @ (wb - wa))])
        along, around = s / np.linalg.norm(s)
        by_normal = -friction.coefficient * (along * by_slide + friction.radius * around * by_spin)
        return np.array(free[:12] + self._normal(free[12:], by_normal[12:]) * by_normal[:12])

    def _normal(self, free: Array, by_normal: Array) -> float:
        """Solution of FN = |Fr + Fbend + FCint| for the multipliers free + FN by_normal."""
        from scipy.optimize import brentq

        friction = self.scene.friction
        bending = 2.0 / friction.overlap if friction.overlap > 0.0 else 0.0

        def residual(normal: float) -> float:
            f2, f3, m3, m2 = free + normal * by_normal
            pressed = np.hypot(f2, f3) + bending * np.hypot(m2, m3) + friction.preload
            return normal - abs(float(pressed))

        most = 1.0
        while residual(most) < 0.0:
            most *= 2.0
        return float(brentq(residual, 0.0, most, xtol=1e-15 * most, rtol=1e-15))


def _initial(body: Body, pose: tuple[float, ...], twist: tuple[float, ...]) -> tuple[Array, Array]:
    """Mass centre and quaternion (7,), and linear and angular velocity (6,)."""
    start = np.array(pose or body.pose)
    arm = rotation(start[3:]) @ np.array(body.com)
    velocity = np.array(twist[:3]) + np.cross(twist[3:], arm)
    return np.array([*(start[:3] + arm), *start[3:]]), np.array([*velocity, *twist[3:]])


def _quaternion_rate(q: Array, w: Array) -> Array:
    """dq/dt = (w, 0) q / 2, world axes, x y z w."""
    return 0.5 * np.array([*(q[3] * w + np.cross(w, q[:3])), -w @ q[:3]])
