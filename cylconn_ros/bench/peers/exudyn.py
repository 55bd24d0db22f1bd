"""Exudyn: rigid bodies and a GenericJoint (slide and spin free), friction by a user function.

Before each step the user function reads the joint's force and torque and sets the friction that
their limit allows as a load for that step, no more of it than what brings the slip to rest.
Implicit generalised-alpha (index 3, its default), spectral radius 0.9, Newton to 1e-10.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cylconn_ros.bench.common.frames import outside, quaternion, rotation, tensor
from cylconn_ros.bench.peers.common import Coulomb, Joint, Spring, Stops, length
from cylconn_ros.bench.peers.solver import Array, Contestant, Read, Solve, Task, package
from cylconn_ros.scene.scene import Body


class Peer:
    """A task in Exudyn."""

    def __init__(self, task: Task) -> None:
        self.exu = package("exudyn")
        self.items = package("exudyn.itemInterface")
        self.rigid = package("exudyn.rigidBodyUtilities")
        self.task, scene = task, task.scene
        self.joint, self.law = Joint(scene), Coulomb(scene)
        self.stops = Stops(scene, length(scene))
        self.spring = Spring(scene)
        self.container = self.exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self._build()
        self._reduce()
        self.settings = self._settings()
        self.limit = self.first = 0.0
        if self.law.on:  # the reaction before friction has acted
            self._solve(1)
            self.first = self._limit_now()
            self.mbs.SetPreStepUserFunction(self._friction)
        elif self.stops.on:
            self.mbs.SetPreStepUserFunction(self._friction)

    def _build(self) -> None:
        mbs, joint, scene, items = self.mbs, self.joint, self.task.scene, self.items
        pose_a, pose_b = joint.pose_a, joint.pose_b
        if joint.free:
            self.a = self._body(scene.body_a, pose_a, joint.twist_a)
        else:
            self.a = mbs.AddObject(items.ObjectGround(
                referencePosition=pose_a[:3], referenceRotation=rotation(pose_a[3:])
            ))  # fmt: skip
        self.b = self._body(scene.body_b, pose_b, joint.twist_b)
        hub = outside(pose_b, joint.node_b)
        axes = rotation(pose_a[3:]) @ rotation(scene.node_a.orientation)
        self.axis = axes[:, 0]
        turn_a, turn_b = rotation(pose_a[3:]), rotation(pose_b[3:])
        at_a = turn_a.T @ (hub - pose_a[:3])
        self.on_a = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=self.a, localPosition=at_a))
        self.on_b = mbs.AddMarker(
            items.MarkerBodyRigid(bodyNumber=self.b, localPosition=joint.node_b)
        )
        self.link = mbs.AddObject(items.GenericJoint(
            markerNumbers=[self.on_a, self.on_b], constrainedAxes=[0, 1, 1, 0, 1, 1],
            rotationMarker0=turn_a.T @ axes, rotationMarker1=turn_b.T @ axes,
        ))  # fmt: skip
        self.loads = []
        for marker, axis, sign in (
            (self.on_b, joint.axis_b, 1.0), (self.on_a, joint.axis_a, -1.0),
        ):  # fmt: skip
            if marker == self.on_a and not joint.free:
                continue
            for kind in (items.Force, items.Torque):
                load = mbs.AddLoad(kind(markerNumber=marker, loadVector=[0.0] * 3, bodyFixed=True))
                self.loads.append((load, sign * axis, kind is items.Force))
        if self.spring.stiffness:
            self._add_spring()
        mbs.Assemble()

    def _add_spring(self) -> None:
        stiffness = np.zeros((6, 6))
        stiffness[0, 0] = self.spring.stiffness
        data = self.mbs.GetObject(self.link)
        self.mbs.AddObject(self.items.RigidBodySpringDamper(
            markerNumbers=[self.on_a, self.on_b], stiffness=stiffness, damping=np.zeros((6, 6)),
            offset=[self.spring.slack, 0.0, 0.0, 0.0, 0.0, 0.0],
            rotationMarker0=np.array(data["rotationMarker0"]),
            rotationMarker1=np.array(data["rotationMarker1"]),
        ))  # fmt: skip

    def _body(self, body: Body, pose: Array, twist: Array) -> int:
        com = np.array(body.com)
        about = tensor(body) + body.mass * (com @ com * np.eye(3) - np.outer(com, com))
        inertia = self.rigid.RigidBodyInertia(body.mass, about, com)
        made: dict[str, Any] = self.mbs.CreateRigidBody(
            inertia=inertia, referencePosition=pose[:3], referenceRotationMatrix=rotation(pose[3:]),
            initialVelocity=twist[:3], initialAngularVelocity=twist[3:],
            gravity=list(self.task.scene.gravity), returnDict=True,
        )  # fmt: skip
        return int(made["bodyNumber"])

    def _reduce(self) -> None:
        """Mass and inertia of slide and spin, and what pulls at them: A taken for fixed."""
        body, joint = self.task.scene.body_b, self.joint
        turn = rotation(joint.pose_b[3:])
        self.rho = turn @ (np.array(body.com) - joint.node_b)
        self.mass = body.mass
        e, rho = self.axis, self.rho
        self.inertia = float(e @ turn @ tensor(body) @ turn.T @ e)
        self.inertia += body.mass * float(rho @ rho - (e @ rho) ** 2)
        gravity = np.array(self.task.scene.gravity)
        self.along = float(gravity @ e)
        # the moment of the weight about the axis is p cos(spin) + q sin(spin)
        self.weight = (
            body.mass * float(e @ np.cross(rho, gravity)),
            body.mass * float(e @ np.cross(np.cross(e, rho), gravity)),
        )

    def _settings(self) -> Any:
        found = self.exu.SimulationSettings()
        time = found.timeIntegration
        time.generalizedAlpha.spectralRadius = 0.9
        time.newton.relativeTolerance = 1e-10
        time.newton.absoluteTolerance = 1e-12
        time.newton.useModifiedNewton = False
        time.verboseMode = 0
        found.displayGlobalTimers = False
        found.displayComputationTime = False
        found.displayStatistics = False
        found.solutionSettings.writeSolutionToFile = False
        found.solutionSettings.sensorsWritePeriod = 1e9
        found.solutionSettings.solutionInformation = ""
        found.parallel.numberOfThreads = 1
        return found

    def _solve(self, steps: int) -> None:
        self.settings.timeIntegration.numberOfSteps = steps
        self.settings.timeIntegration.endTime = steps * self.task.value
        self.mbs.SolveDynamic(self.settings, updateInitialValues=False)

    def _output(self, kind: Any) -> list[float]:
        found: list[float] = self.mbs.GetObjectOutput(self.link, kind).tolist()
        return found

    def _limit_now(self) -> float:
        kinds = self.exu.OutputVariableType
        return self.law.limit(
            self._output(kinds.ForceLocal), self._output(kinds.TorqueLocal), (1.0, 0.0, 0.0)
        )

    def _friction(self, _mbs: Any, t: float) -> bool:
        """Before a step: friction of the last one's reaction."""
        kinds, law = self.exu.OutputVariableType, self.law
        slide = self._output(kinds.DisplacementLocal)[0]
        v = self._output(kinds.VelocityLocal)[0]
        if law.on:
            limit = self._limit_now() if t > 0.5 * self.task.value else self.first
            w = self._output(kinds.AngularVelocityLocal)[0]
            spin = self._output(kinds.Rotation)[0]
            pull = (
                self.along + self.spring.force(slide) / self.mass,
                (self.weight[0] * math.cos(spin) + self.weight[1] * math.sin(spin)) / self.inertia,
            )
            inverse = 1.0 / self.mass, 0.0, 1.0 / self.inertia
            f, m = law.brake(limit, v, w, pull, inverse, self.task.value)
            for load, axis, force in self.loads:
                self.mbs.SetLoadParameter(load, "loadVector", (f if force else m) * axis)
        if self.stops.on:
            bounced = self.stops.bounced(slide, v)
            if bounced:
                self._put(bounced[0] - slide, bounced[1] - v)
        return True

    def _put(self, way: float, rate: float) -> None:
        """Move B along the slot, and change its rate."""
        data = self.mbs.systemData
        q, q_t = data.GetODE2Coordinates(), data.GetODE2Coordinates_t()
        q[-7:-4] += way * self.axis
        q_t[-7:-4] += rate * self.axis
        data.SetODE2Coordinates(q)
        data.SetODE2Coordinates_t(q_t)

    def __call__(self) -> Read:
        """All steps."""
        if self.law.on:
            for load, _, _ in self.loads:
                self.mbs.SetLoadParameter(load, "loadVector", [0.0, 0.0, 0.0])
        self._solve(self.task.steps)
        return self.end

    def end(self) -> Array:
        """(26,) at the end."""
        state = np.zeros(26)
        state[:7] = self.joint.pose_a
        kinds = self.exu.OutputVariableType
        for body, at in ((self.a, 0), (self.b, 13)):
            if body == self.a and not self.joint.free:
                continue
            state[at : at + 3], matrix, state[at + 7 : at + 10], state[at + 10 : at + 13] = (
                self.mbs.GetObjectOutputBody(body, kind)
                for kind in (
                    kinds.Position, kinds.RotationMatrix, kinds.Velocity, kinds.AngularVelocity,
                )
            )  # fmt: skip
            state[at + 3 : at + 7] = quaternion(np.reshape(matrix, (3, 3)))
        return state


def _prepare(task: Task) -> Solve:
    return Peer(task)


CONTESTANTS = (
    Contestant(
        "Exudyn, loop", "exudyn", "simulator", "step",
        "GenericJoint, friction of the last step's reaction by a user function", _prepare,
    ),
)  # fmt: skip
