"""Pinocchio: accelerations in joint coordinates, with a user's own integration loop.

Prismatic and revolute joint at node b. The friction limit is that of the previous step's reaction
(``rnea``). The friction that brings the slip to rest within the step is exact here, because the
inverse mass matrix and the accelerations without friction are available. Integrators: semi-implicit
Euler, and RK4 with the reaction of the previous stage.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cylconn_ros.bench.common.frames import inertia_tensor, rotation
from cylconn_ros.bench.peers.common import Coulomb, Joint, Spring, Stops, check_plain
from cylconn_ros.bench.peers.solver import Array, EndState, Problem, Solve, Solver, package
from cylconn_ros.scene.scene import Body


class PinocchioSolver:
    """A problem in Pinocchio."""

    def __init__(self, problem: Problem) -> None:
        self.pin = pin = package("pinocchio")
        self.problem, scene = problem, problem.scene
        check_plain(scene)
        self.joint, self.law = Joint(scene), Coulomb(scene)
        self.stops, self.spring = Stops(scene), Spring(scene)
        joint = self.joint
        self.model = model = pin.Model()
        model.gravity.linear = np.array(scene.gravity)
        pose, identity = joint.pose_a, pin.SE3.Identity()
        base, base_frame = 0, pin.SE3(rotation(pose[3:]), pose[:3])
        if joint.free:
            base = model.addJoint(0, pin.JointModelFreeFlyer(), identity, "a")
            model.appendBodyToJoint(base, self._inertia(scene.body_a, np.zeros(3)), identity)
            base_frame = identity
        axes = rotation(joint.orientation)
        joint_frame = pin.SE3(axes, joint.position + axes @ joint.node_b)
        slide = model.addJoint(
            base, pin.JointModelPrismaticUnaligned(joint.axis_b), base_frame * joint_frame, "slide"
        )
        self.last = model.addJoint(
            slide, pin.JointModelRevoluteUnaligned(joint.axis_b), identity, "spin"
        )
        model.appendBodyToJoint(self.last, self._inertia(scene.body_b, joint.node_b), identity)
        self.data = model.createData()
        self.axis = joint.axis_b.tolist()
        self.q0, self.v0 = pin.neutral(model), np.zeros(model.nv)
        if joint.free:
            self.q0[:7] = pose
            self.v0[:3] = rotation(pose[3:]).T @ joint.twist_a[:3]
            self.v0[3:6] = rotation(pose[3:]).T @ joint.twist_a[3:]
        self.v0[-2:] = joint.slide_rate, joint.spin_rate
        self.tau = np.zeros(model.nv)
        self.initial_limit = self.limit(self.q0, self.v0, self.free(self.q0, self.v0))

    def _inertia(self, body: Body, origin: Array) -> Any:
        return self.pin.Inertia(body.mass, np.array(body.com) - origin, inertia_tensor(body))

    def free(self, q: Array, v: Array) -> Array:
        """Accelerations without friction."""
        if self.spring.stiffness:
            self.tau[-2] = self.spring.force(float(q[-2]))
        return np.array(self.pin.aba(self.model, self.data, q, v, self.tau))

    def limit(self, q: Array, v: Array, a: Array) -> float:
        """Friction limit mu FN (N) of the reaction at the acceleration ``a``."""
        if not self.law.on:
            return 0.0
        self.pin.rnea(self.model, self.data, q, v, a)
        force = self.data.f[self.last]
        return self.law.limit(force.linear.tolist(), force.angular.tolist(), self.axis)

    def acceleration(self, q: Array, v: Array, limit: float) -> Array:
        """Accelerations with friction up to a given limit (N)."""
        a = self.free(q, v)
        if not self.law.on:
            return a
        inverse = self.pin.computeMinverse(self.model, self.data, q)
        s = inverse[-2, -2], inverse[-2, -1], inverse[-1, -1]
        free = float(a[-2]), float(a[-1])
        f, m = self.law.friction(limit, float(v[-2]), float(v[-1]), free, s, self.problem.value)
        return np.array(a + f * inverse[:, -2] + m * inverse[:, -1])

    def euler(self) -> EndState:
        """Semi-implicit Euler."""
        q, v, limit, h = self.q0.copy(), self.v0.copy(), self.initial_limit, self.problem.value
        for _ in range(self.problem.steps):
            a = self.acceleration(q, v, limit)
            limit = self.limit(q, v, a)
            v += h * a
            q = self.pin.integrate(self.model, q, h * v)
            self._impact(q, v)
        return lambda: self.end_state(q, v)

    def rk4(self) -> EndState:
        """Classical Runge-Kutta; the orientation of A is a quaternion, normalised each step."""
        q, v, limit, h = self.q0.copy(), self.v0.copy(), self.initial_limit, self.problem.value
        for _ in range(self.problem.steps):
            accelerations, rates = [], []
            qi, vi = q, v
            for part in (0.5, 0.5, 1.0, 0.0):
                a = self.acceleration(qi, vi, limit)
                limit = self.limit(qi, vi, a)
                rate = self.rate(qi, vi)
                accelerations.append(a)
                rates.append(rate)
                if part:
                    qi, vi = q + part * h * rate, v + part * h * a
            q, v = q + h * _weighted(rates), v + h * _weighted(accelerations)
            if self.joint.free:
                q[3:7] /= np.linalg.norm(q[3:7])
            self._impact(q, v)
        return lambda: self.end_state(q, v)

    def rate(self, q: Array, v: Array) -> Array:
        """q'; the velocities of a free body are in body axes."""
        if not self.joint.free:
            return v
        x, y, z, w = q[3:7].tolist()
        a, b, c = v[3:6].tolist()
        quaternion_rate = (
            0.5 * (w * a + y * c - z * b),
            0.5 * (w * b + z * a - x * c),
            0.5 * (w * c + x * b - y * a),
            -0.5 * (x * a + y * b + z * c),
        )
        return np.array([*(rotation(q[3:7]) @ v[:3]), *quaternion_rate, v[-2], v[-1]])

    def _impact(self, q: Array, v: Array) -> None:
        if self.stops.on:
            impact = self.stops.impact(float(q[-2]), float(v[-2]))
            if impact:
                q[-2], v[-2] = impact

    def end_state(self, q: Array, v: Array) -> Array:
        """(26,) poses and twists."""
        joint = self.joint
        pose, twist = joint.pose_a, joint.twist_a
        if joint.free:
            pose = np.array(q[:7])
            axes = rotation(pose[3:])
            twist = np.array([*(axes @ v[:3]), *(axes @ v[3:6])])
        return joint.state(pose, twist, float(q[-2]), float(q[-1]), v[-2:].tolist())


def _weighted(stages: list[Array]) -> Array:
    """Weighted mean of the four stages of RK4."""
    mean: Array = (stages[0] + 2.0 * stages[1] + 2.0 * stages[2] + stages[3]) / 6.0
    return mean


def _prepared(integrator: Callable[[PinocchioSolver], Solve]) -> Callable[[Problem], Solve]:
    return lambda problem: integrator(PinocchioSolver(problem))


SOLVERS = (
    Solver(
        "Pinocchio Euler, loop", "pinocchio", "simulator", "step",
        "own semi-implicit loop, friction limit from the last step's reaction",
        _prepared(lambda solver: solver.euler),
    ),
    Solver(
        "Pinocchio RK4, loop", "pinocchio", "simulator", "step",
        "own RK4, friction limit from the last stage's reaction",
        _prepared(lambda solver: solver.rk4),
    ),
)  # fmt: skip
