"""Pinocchio: accelerations in minimal coordinates, with a loop of one's own around them.

Prismatic and revolute joint at node b. Friction of the last step's reaction (``rnea``), no more of
it than what brings the slip to rest within the step; that is exact here, as the inverse of the mass
matrix and the accelerations without friction are at hand. Semi-implicit Euler, and RK4 with the
reaction of the last stage.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cylconn_ros.bench.common.frames import rotation, tensor
from cylconn_ros.bench.peers.common import Coulomb, Joint, Spring, Stops, length
from cylconn_ros.bench.peers.solver import Array, Contestant, Read, Solve, Task, package
from cylconn_ros.scene.scene import Body


class Peer:
    """A task in Pinocchio."""

    def __init__(self, task: Task) -> None:
        self.pin = pin = package("pinocchio")
        self.task, scene = task, task.scene
        self.joint, self.law = Joint(scene), Coulomb(scene)
        self.stops = Stops(scene, length(scene))
        self.spring = Spring(scene)
        joint = self.joint
        self.model = model = pin.Model()
        model.gravity.linear = np.array(scene.gravity)
        pose = joint.pose_a
        base, place = 0, pin.SE3(rotation(pose[3:]), pose[:3])
        if joint.free:
            base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "a")
            model.appendBodyToJoint(base, self._inertia(scene.body_a, np.zeros(3)), _identity(pin))
            place = _identity(pin)
        turn = rotation(joint.turn)
        hub = pin.SE3(turn, joint.place + turn @ joint.node_b)
        slide = model.addJoint(
            base, pin.JointModelPrismaticUnaligned(joint.axis_b), place * hub, "slide"
        )
        self.last = model.addJoint(
            slide, pin.JointModelRevoluteUnaligned(joint.axis_b), _identity(pin), "spin"
        )
        model.appendBodyToJoint(
            self.last, self._inertia(scene.body_b, joint.node_b), _identity(pin)
        )
        self.data = model.createData()
        self.axis = joint.axis_b.tolist()
        self.q0, self.v0 = pin.neutral(model), np.zeros(model.nv)
        if joint.free:
            self.q0[:7] = pose
            self.v0[:3] = rotation(pose[3:]).T @ joint.twist_a[:3]
            self.v0[3:6] = rotation(pose[3:]).T @ joint.twist_a[3:]
        self.v0[-2:] = joint.slide, joint.spin
        self.tau = np.zeros(model.nv)
        self.first = self.limit(self.q0, self.v0, self.free(self.q0, self.v0))

    def _inertia(self, body: Body, origin: Array) -> Any:
        return self.pin.Inertia(body.mass, np.array(body.com) - origin, tensor(body))

    def free(self, q: Array, v: Array) -> Array:
        """Accelerations without friction."""
        if self.spring.stiffness:
            self.tau[-2] = self.spring.force(float(q[-2]))
        return np.array(self.pin.aba(self.model, self.data, q, v, self.tau))

    def limit(self, q: Array, v: Array, a: Array) -> float:
        """Mu FN of the reaction that goes with an acceleration."""
        if not self.law.on:
            return 0.0
        self.pin.rnea(self.model, self.data, q, v, a)
        force = self.data.f[self.last]
        return self.law.limit(force.linear.tolist(), force.angular.tolist(), self.axis)

    def acceleration(self, q: Array, v: Array, limit: float) -> Array:
        """With friction of a limit given."""
        a = self.free(q, v)
        if not self.law.on:
            return a
        inverse = self.pin.computeMinverse(self.model, self.data, q)
        s = inverse[-2, -2], inverse[-2, -1], inverse[-1, -1]
        pull = float(a[-2]), float(a[-1])
        f, m = self.law.brake(limit, float(v[-2]), float(v[-1]), pull, s, self.task.value)
        return np.array(a + f * inverse[:, -2] + m * inverse[:, -1])

    def euler(self) -> Read:
        """Semi-implicit."""
        q, v, limit, h = self.q0.copy(), self.v0.copy(), self.first, self.task.value
        for _ in range(self.task.steps):
            a = self.acceleration(q, v, limit)
            limit = self.limit(q, v, a)
            v += h * a
            q = self.pin.integrate(self.model, q, h * v)
            self._bounce(q, v)
        return lambda: self.end(q, v)

    def rk4(self) -> Read:
        """Classical, A's orientation as a quaternion of four numbers."""
        q, v, limit, h = self.q0.copy(), self.v0.copy(), self.first, self.task.value
        for _ in range(self.task.steps):
            stages, rates = [], []
            qi, vi = q, v
            for part in (0.5, 0.5, 1.0, 0.0):
                a = self.acceleration(qi, vi, limit)
                limit = self.limit(qi, vi, a)
                rate = self.rate(qi, vi)
                stages.append(a)
                rates.append(rate)
                if part:
                    qi, vi = q + part * h * rate, v + part * h * a
            q = q + h * (rates[0] + 2.0 * rates[1] + 2.0 * rates[2] + rates[3]) / 6.0
            v = v + h * (stages[0] + 2.0 * stages[1] + 2.0 * stages[2] + stages[3]) / 6.0
            if self.joint.free:
                q[3:7] /= np.linalg.norm(q[3:7])
            self._bounce(q, v)
        return lambda: self.end(q, v)

    def rate(self, q: Array, v: Array) -> Array:
        """Of the coordinates: a free body's velocities are in its own axes."""
        if not self.joint.free:
            return v
        x, y, z, w = q[3:7].tolist()
        a, b, c = v[3:6].tolist()
        turn = (
            0.5 * (w * a + y * c - z * b),
            0.5 * (w * b + z * a - x * c),
            0.5 * (w * c + x * b - y * a),
            -0.5 * (x * a + y * b + z * c),
        )
        return np.array([*(rotation(q[3:7]) @ v[:3]), *turn, v[-2], v[-1]])

    def _bounce(self, q: Array, v: Array) -> None:
        if self.stops.on:
            bounced = self.stops.bounced(float(q[-2]), float(v[-2]))
            if bounced:
                q[-2], v[-2] = bounced

    def end(self, q: Array, v: Array) -> Array:
        """(26,) at the end."""
        joint = self.joint
        pose, twist = joint.pose_a, joint.twist_a
        if joint.free:
            pose = np.array(q[:7])
            turn = rotation(pose[3:])
            twist = np.array([*(turn @ v[:3]), *(turn @ v[3:6])])
        return joint.state(pose, twist, float(q[-2]), float(q[-1]), v[-2:].tolist())


def _identity(pin: Any) -> Any:
    return pin.SE3.Identity()


def _prepared(how: Callable[[Peer], Solve]) -> Callable[[Task], Solve]:
    return lambda task: how(Peer(task))


CONTESTANTS = (
    Contestant(
        "Pinocchio Euler, loop", "pinocchio", "simulator", "step",
        "own semi-implicit loop, friction of the last step's reaction",
        _prepared(lambda peer: peer.euler),
    ),
    Contestant(
        "Pinocchio RK4, loop", "pinocchio", "simulator", "step",
        "own RK4, friction of the last stage's reaction", _prepared(lambda peer: peer.rk4),
    ),
)  # fmt: skip
