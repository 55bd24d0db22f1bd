"""PyBullet: a multibody of prismatic and revolute joint, friction by motors that want to stand.

A velocity motor with target 0 and the friction's limit as its greatest force is what PyBullet's
users brake a joint with: its solver holds implicitly. The limit is that of the last step's
reaction, shared by slide and spin as the slip is. The reaction is what changed B's momentum over
the step: the force-torque sensor counts gyroscopic torques twice. Damping, sleeping and the
solver's early end are switched off.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cylconn_ros.bench.common.frames import product, quaternion, rotation, tensor
from cylconn_ros.bench.peers.common import Coulomb, Joint, Spring, Stops, length
from cylconn_ros.bench.peers.solver import Array, Contestant, Read, Solve, Task, package
from cylconn_ros.scene.scene import Body

ITERATIONS = 100
SMALL = 1e-9  # m/s: at rest


class Peer:
    """A task in PyBullet, in a client of its own."""

    def __init__(self, task: Task) -> None:
        self.bullet = bullet = package("pybullet")
        self.task, scene = task, task.scene
        self.joint, self.law = Joint(scene), Coulomb(scene)
        self.stops = Stops(scene, length(scene))
        self.spring = Spring(scene)
        self.client = bullet.connect(bullet.DIRECT)
        self.body = self._made()
        self.saved = bullet.saveState(physicsClientId=self.client)
        self.axis = self.joint.axis_b.tolist()
        self.mass = scene.body_b.mass
        self.moments = _principal(scene.body_b)[1].tolist()
        self.weight = [self.mass * g for g in scene.gravity]
        self.first = self._first_limit()

    def _made(self) -> int:
        bullet, joint, scene, at = self.bullet, self.joint, self.task.scene, self.client
        bullet.setGravity(*scene.gravity, physicsClientId=at)
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=self.task.value, numSubSteps=0, numSolverIterations=ITERATIONS,
            solverResidualThreshold=0.0, deterministicOverlappingPairs=1, physicsClientId=at,
        )  # fmt: skip
        a, b = scene.body_a, scene.body_b
        axes_a, moments_a = _principal(a) if joint.free else (np.array([0.0, 0.0, 0.0, 1.0]), None)
        axes_b, moments_b = _principal(b)
        hub = joint.place + rotation(joint.turn) @ joint.node_b
        com_a = np.array(a.com) if joint.free else np.zeros(3)
        body: int = bullet.createMultiBody(
            baseMass=a.mass if joint.free else 0.0,
            basePosition=(joint.pose_a[:3]).tolist(),
            baseOrientation=joint.pose_a[3:].tolist(),
            baseInertialFramePosition=com_a.tolist(),
            baseInertialFrameOrientation=axes_a.tolist(),
            linkMasses=[0.0, b.mass],
            linkCollisionShapeIndices=[-1, -1],
            linkVisualShapeIndices=[-1, -1],
            linkPositions=[hub.tolist(), [0.0, 0.0, 0.0]],
            linkOrientations=[joint.turn.tolist(), [0.0, 0.0, 0.0, 1.0]],
            linkInertialFramePositions=[[0.0] * 3, (np.array(b.com) - joint.node_b).tolist()],
            linkInertialFrameOrientations=[[0.0, 0.0, 0.0, 1.0], axes_b.tolist()],
            linkParentIndices=[0, 1],
            linkJointTypes=[bullet.JOINT_PRISMATIC, bullet.JOINT_REVOLUTE],
            linkJointAxis=[joint.axis_b.tolist(), joint.axis_b.tolist()],
            physicsClientId=at,
        )
        for link in (-1, 0, 1):
            bullet.changeDynamics(
                body, link, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0,
                maxJointVelocity=1e9,
                activationState=bullet.ACTIVATION_STATE_DISABLE_SLEEPING, physicsClientId=at,
            )  # fmt: skip
        if moments_a is not None:
            bullet.changeDynamics(
                body, -1, localInertiaDiagonal=moments_a.tolist(), physicsClientId=at
            )
        bullet.changeDynamics(body, 1, localInertiaDiagonal=moments_b.tolist(), physicsClientId=at)
        for k in (0, 1):
            bullet.setJointMotorControl2(
                body, k, bullet.VELOCITY_CONTROL, force=0.0, physicsClientId=at
            )
        self._set_rates(body)
        return body

    def _set_rates(self, body: int) -> None:
        bullet, joint, at = self.bullet, self.joint, self.client
        if joint.free:  # PyBullet's is the velocity of the mass centre
            arm = rotation(joint.pose_a[3:]) @ np.array(self.task.scene.body_a.com)
            velocity = joint.twist_a[:3] + np.cross(joint.twist_a[3:], arm)
            bullet.resetBaseVelocity(
                body, velocity.tolist(), joint.twist_a[3:].tolist(), physicsClientId=at
            )
        for k, rate in enumerate((joint.slide, joint.spin)):
            bullet.resetJointState(body, k, 0.0, rate, physicsClientId=at)

    def _momentum(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Of B: linear and angular about its mass centre; arm from node b; the axis. World axes."""
        com, q, _, _, node, turn, velocity, spin = self.bullet.getLinkState(
            self.body, 1, 1, 1, physicsClientId=self.client
        )
        local = _turned(_conjugate(q), spin)
        own = _turned(q, tuple(i * w for i, w in zip(self.moments, local, strict=True)))
        arm = tuple(c - n for c, n in zip(com, node, strict=True))
        return tuple(self.mass * v for v in velocity), own, arm, _turned(turn, self.axis)

    def _limit(self, before: Sequence[Floats], after: Sequence[Floats]) -> float:
        """Mu FN of what changed the momentum in a step."""
        h, weight = self.task.value, self.weight
        fx, fy, fz = (
            (b - a) / h - w for a, b, w in zip(before[0], after[0], weight, strict=True)
        )  # fmt: skip
        mx, my, mz = ((b - a) / h for a, b in zip(before[1], after[1], strict=True))
        ax, ay, az = before[2]
        moment = mx + ay * fz - az * fy, my + az * fx - ax * fz, mz + ax * fy - ay * fx
        return self.law.limit((fx, fy, fz), moment, before[3])

    def _first_limit(self) -> float:
        """Of the reaction of a step that is taken back."""
        if not self.law.on:
            return 0.0
        before = self._momentum()
        self.bullet.stepSimulation(physicsClientId=self.client)
        return self._limit(before, self._momentum())

    def __call__(self) -> Read:
        """All steps."""
        bullet, body, at, law = self.bullet, self.body, self.client, self.law
        bullet.restoreState(self.saved, physicsClientId=at)
        self._set_rates(body)
        limit, spring, stops = self.first, self.spring, self.stops
        v, w, slide = self.joint.slide, self.joint.spin, 0.0
        last = self._momentum() if law.on else ()
        for _ in range(self.task.steps):
            if law.on:
                for k, force in enumerate(law.shares(limit, v, w, SMALL)):
                    bullet.setJointMotorControl2(
                        body, k, bullet.VELOCITY_CONTROL, 0, force=force, physicsClientId=at
                    )
            if spring.stiffness:
                bullet.setJointMotorControl2(
                    body, 0, bullet.TORQUE_CONTROL, force=spring.force(slide),
                    physicsClientId=at,
                )  # fmt: skip
            bullet.stepSimulation(physicsClientId=at)
            if law.on or stops.on:
                slide, v, _, _ = bullet.getJointState(body, 0, physicsClientId=at)
            if law.on:
                w = bullet.getJointState(body, 1, physicsClientId=at)[1]
                last, before = self._momentum(), last
                limit = self._limit(before, last)
            if stops.on:
                bounced = stops.bounced(slide, v)
                if bounced:
                    bullet.resetJointState(body, 0, *bounced, physicsClientId=at)
        return self.end

    def end(self) -> Array:
        """(26,) at the end."""
        bullet, joint, at = self.bullet, self.joint, self.client
        slide, v = bullet.getJointState(self.body, 0, physicsClientId=at)[:2]
        spin, w = bullet.getJointState(self.body, 1, physicsClientId=at)[:2]
        pose, twist = joint.pose_a, joint.twist_a
        if joint.free:
            pose, twist = self._base()
        return joint.state(pose, twist, slide, spin, (v, w))

    def _base(self) -> tuple[Array, Array]:
        """Pose and twist of A's frame from those of its inertial frame."""
        bullet, at, body_a = self.bullet, self.client, self.task.scene.body_a
        place, turn = bullet.getBasePositionAndOrientation(self.body, physicsClientId=at)
        velocity, spin = map(np.array, bullet.getBaseVelocity(self.body, physicsClientId=at))
        inertial = _principal(body_a)[0] * (-1.0, -1.0, -1.0, 1.0)
        q = product(turn, inertial)
        arm = rotation(q) @ np.array(body_a.com)
        return np.array([*(np.array(place) - arm), *q]), np.array(
            [*(velocity - np.cross(spin, arm)), *spin]
        )


Floats = tuple[float, ...]


def _conjugate(q: Sequence[float]) -> Floats:
    return -q[0], -q[1], -q[2], q[3]


def _turned(q: Sequence[float], v: Sequence[float]) -> Floats:
    """A vector turned by a quaternion x y z w, in plain floats."""
    x, y, z, w = q
    a, b, c = v
    tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return (
        a + w * tx + y * tz - z * ty,
        b + w * ty + z * tx - x * tz,
        c + w * tz + x * ty - y * tx,
    )


def _principal(body: Body) -> tuple[Array, Array]:
    """Quaternion of the principal axes in the body's frame, and the moments about them."""
    moments, axes = np.linalg.eigh(tensor(body))
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    return quaternion(axes), moments


def _prepare(task: Task) -> Solve:
    return Peer(task)


CONTESTANTS = (
    Contestant(
        "PyBullet, loop", "pybullet", "simulator", "step",
        "velocity motors with the limit of the last step's reaction", _prepare,
    ),
)  # fmt: skip
