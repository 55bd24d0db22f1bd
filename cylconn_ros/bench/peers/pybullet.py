"""PyBullet: a multibody with a prismatic and a revolute joint, friction by velocity motors.

PyBullet's users brake a joint with a velocity motor whose target is 0 and whose maximum force is
the friction limit: the constraint solver then sticks implicitly. The limit is that of the previous
step's reaction, split between slide and spin in proportion to the slip. The reaction follows from
the change of B's momentum over the step, because the force-torque sensor counts gyroscopic torques
twice. Damping, sleeping and early termination of the solver are switched off.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cylconn_ros.bench.common.frames import inertia_tensor, product, quaternion, rotation
from cylconn_ros.bench.peers.common import Coulomb, Joint, Spring, Stops, check_plain
from cylconn_ros.bench.peers.solver import Array, EndState, Problem, Solve, Solver, package
from cylconn_ros.scene.scene import Body

ITERATIONS = 100
REST_SPEED = 1e-9  # m/s: below it, slide and spin both get the whole limit


class PyBulletSolver:
    """A problem in PyBullet, in its own physics client."""

    def __init__(self, problem: Problem) -> None:
        self.bullet = bullet = package("pybullet")
        self.problem, scene = problem, problem.scene
        check_plain(scene)
        self.joint, self.law = Joint(scene), Coulomb(scene)
        self.stops, self.spring = Stops(scene), Spring(scene)
        self.client = bullet.connect(bullet.DIRECT)
        self.body = self._build()
        self.saved = bullet.saveState(physicsClientId=self.client)
        self.axis = self.joint.axis_b.tolist()
        self.mass = scene.body_b.mass
        self.moments = _principal(scene.body_b)[1].tolist()
        self.weight = [self.mass * g for g in scene.gravity]
        self.initial_limit = self._initial_limit()

    def _build(self) -> int:
        bullet, joint, scene, at = self.bullet, self.joint, self.problem.scene, self.client
        bullet.setGravity(*scene.gravity, physicsClientId=at)
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=self.problem.value, numSubSteps=0, numSolverIterations=ITERATIONS,
            solverResidualThreshold=0.0, deterministicOverlappingPairs=1, physicsClientId=at,
        )  # fmt: skip
        a, b = scene.body_a, scene.body_b
        axes_a, moments_a = _principal(a) if joint.free else (np.array([0.0, 0.0, 0.0, 1.0]), None)
        axes_b, moments_b = _principal(b)
        joint_position = joint.position + rotation(joint.orientation) @ joint.node_b
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
            linkPositions=[joint_position.tolist(), [0.0, 0.0, 0.0]],
            linkOrientations=[joint.orientation.tolist(), [0.0, 0.0, 0.0, 1.0]],
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
        if joint.free:  # PyBullet has the velocity of the centre of mass
            arm = rotation(joint.pose_a[3:]) @ np.array(self.problem.scene.body_a.com)
            velocity = joint.twist_a[:3] + np.cross(joint.twist_a[3:], arm)
            bullet.resetBaseVelocity(
                body, velocity.tolist(), joint.twist_a[3:].tolist(), physicsClientId=at
            )
        for k, rate in enumerate((joint.slide_rate, joint.spin_rate)):
            bullet.resetJointState(body, k, 0.0, rate, physicsClientId=at)

    def _momentum(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Momentum of B, linear and angular about its com; arm from node b; axis (world axes)."""
        com, q, _, _, node, joint_q, velocity, omega = self.bullet.getLinkState(
            self.body, 1, 1, 1, physicsClientId=self.client
        )
        local = _rotated(_conjugate(q), omega)
        angular = _rotated(q, tuple(i * w for i, w in zip(self.moments, local, strict=True)))
        arm = tuple(c - n for c, n in zip(com, node, strict=True))
        return tuple(self.mass * v for v in velocity), angular, arm, _rotated(joint_q, self.axis)

    def _limit(self, before: Sequence[Floats], after: Sequence[Floats]) -> float:
        """Friction limit mu FN (N) of the reaction that changed the momentum in a step."""
        h, weight = self.problem.value, self.weight
        fx, fy, fz = (
            (b - a) / h - w for a, b, w in zip(before[0], after[0], weight, strict=True)
        )  # fmt: skip
        mx, my, mz = ((b - a) / h for a, b in zip(before[1], after[1], strict=True))
        ax, ay, az = before[2]
        moment = mx + ay * fz - az * fy, my + az * fx - ax * fz, mz + ax * fy - ay * fx
        return self.law.limit((fx, fy, fz), moment, before[3])

    def _initial_limit(self) -> float:
        """Friction limit (N) of the reaction in a trial step, which is discarded."""
        if not self.law.on:
            return 0.0
        before = self._momentum()
        self.bullet.stepSimulation(physicsClientId=self.client)
        return self._limit(before, self._momentum())

    def __call__(self) -> EndState:
        """Run all steps from the start."""
        bullet, body, at, law = self.bullet, self.body, self.client, self.law
        bullet.restoreState(self.saved, physicsClientId=at)
        self._set_rates(body)
        limit, spring, stops = self.initial_limit, self.spring, self.stops
        v, w, slide = self.joint.slide_rate, self.joint.spin_rate, 0.0
        last = self._momentum() if law.on else ()
        for _ in range(self.problem.steps):
            if law.on:
                for k, force in enumerate(law.split(limit, v, w, REST_SPEED)):
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
                impact = stops.impact(slide, v)
                if impact:
                    bullet.resetJointState(body, 0, *impact, physicsClientId=at)
        return self.end_state

    def end_state(self) -> Array:
        """(26,) poses and twists after the last step."""
        bullet, joint, at = self.bullet, self.joint, self.client
        slide, v = bullet.getJointState(self.body, 0, physicsClientId=at)[:2]
        spin, w = bullet.getJointState(self.body, 1, physicsClientId=at)[:2]
        pose, twist = joint.pose_a, joint.twist_a
        if joint.free:
            pose, twist = self._base()
        return joint.state(pose, twist, slide, spin, (v, w))

    def _base(self) -> tuple[Array, Array]:
        """Pose and twist of A's frame from those of its inertial frame."""
        bullet, at, body_a = self.bullet, self.client, self.problem.scene.body_a
        position, orientation = bullet.getBasePositionAndOrientation(self.body, physicsClientId=at)
        velocity, spin = map(np.array, bullet.getBaseVelocity(self.body, physicsClientId=at))
        inertial = _principal(body_a)[0] * (-1.0, -1.0, -1.0, 1.0)
        q = product(orientation, inertial)
        arm = rotation(q) @ np.array(body_a.com)
        return np.array([*(np.array(position) - arm), *q]), np.array(
            [*(velocity - np.cross(spin, arm)), *spin]
        )


Floats = tuple[float, ...]


def _conjugate(q: Sequence[float]) -> Floats:
    return -q[0], -q[1], -q[2], q[3]


def _rotated(q: Sequence[float], v: Sequence[float]) -> Floats:
    """A vector rotated by a quaternion x y z w, in plain floats."""
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
    moments, axes = np.linalg.eigh(inertia_tensor(body))
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    return quaternion(axes), moments


def _prepare(problem: Problem) -> Solve:
    return PyBulletSolver(problem)


SOLVERS = (
    Solver(
        "PyBullet, loop", "pybullet", "simulator", "step",
        "velocity motors with the friction limit from the last step's reaction", _prepare,
    ),
)  # fmt: skip
