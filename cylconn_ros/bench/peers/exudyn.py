"""Exudyn: rigid bodies and a GenericJoint with free slide and spin; friction by a user function.

Before each step the user function reads the force and torque of the joint and sets as a load for
that step the friction that their limit allows, and never more than brings the slip to rest.
Integrator: implicit generalised-alpha (index 3, Exudyn's default), spectral radius 0.9, Newton to
1e-10.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cylconn_ros.bench.common.frames import inertia_tensor, quaternion, rotation, to_world
from cylconn_ros.bench.peers.common import Coulomb, Joint, Spring, Stops, check_plain
from cylconn_ros.bench.peers.solver import Array, EndState, Problem, Solve, Solver, package
from cylconn_ros.scene.scene import Body


class ExudynSolver:
    """A problem in Exudyn."""

    def __init__(self, problem: Problem) -> None:
        self.exu = package("exudyn")
        self.items = package("exudyn.itemInterface")
        self.rigid = package("exudyn.rigidBodyUtilities")
        self.problem, scene = problem, problem.scene
        check_plain(scene)
        self.joint, self.law = Joint(scene), Coulomb(scene)
        self.stops, self.spring = Stops(scene), Spring(scene)
        self.container = self.exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self._build()
        self._reduced_inertia()
        self.settings = self._settings()
        self.initial_limit = 0.0
        if self.law.on:  # the reaction of one step without friction
            self._solve(1)
            self.initial_limit = self._limit()
            self.mbs.SetPreStepUserFunction(self._friction)
        elif self.stops.on:
            self.mbs.SetPreStepUserFunction(self._friction)

    def _build(self) -> None:
        mbs, joint, scene, items = self.mbs, self.joint, self.problem.scene, self.items
        pose_a, pose_b = joint.pose_a, joint.pose_b
        if joint.free:
            self.a = self._body(scene.body_a, pose_a, joint.twist_a)
        else:
            self.a = mbs.AddObject(items.ObjectGround(
                referencePosition=pose_a[:3], referenceRotation=rotation(pose_a[3:])
            ))  # fmt: skip
        self.b = self._body(scene.body_b, pose_b, joint.twist_b)
        node_b = to_world(pose_b, joint.node_b)
        axes = rotation(pose_a[3:]) @ rotation(scene.node_a.orientation)
        self.axis = axes[:, 0]
        axes_a, axes_b = rotation(pose_a[3:]), rotation(pose_b[3:])
        at_a = axes_a.T @ (node_b - pose_a[:3])
        self.on_a = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=self.a, localPosition=at_a))
        self.on_b = mbs.AddMarker(
            items.MarkerBodyRigid(bodyNumber=self.b, localPosition=joint.node_b)
        )
        self.link = mbs.AddObject(items.GenericJoint(
            markerNumbers=[self.on_a, self.on_b], constrainedAxes=[0, 1, 1, 0, 1, 1],
            rotationMarker0=axes_a.T @ axes, rotationMarker1=axes_b.T @ axes,
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
            offset=[self.spring.rest, 0.0, 0.0, 0.0, 0.0, 0.0],
            rotationMarker0=np.array(data["rotationMarker0"]),
            rotationMarker1=np.array(data["rotationMarker1"]),
        ))  # fmt: skip

    def _body(self, body: Body, pose: Array, twist: Array) -> int:
        com = np.array(body.com)
        about_origin = inertia_tensor(body) + body.mass * (
            com @ com * np.eye(3) - np.outer(com, com)
        )
        inertia = self.rigid.RigidBodyInertia(body.mass, about_origin, com)
        created: dict[str, Any] = self.mbs.CreateRigidBody(
            inertia=inertia, referencePosition=pose[:3], referenceRotationMatrix=rotation(pose[3:]),
            initialVelocity=twist[:3], initialAngularVelocity=twist[3:],
            gravity=list(self.problem.scene.gravity), returnDict=True,
        )  # fmt: skip
        return int(created["bodyNumber"])

    def _reduced_inertia(self) -> None:
        """Mass and inertia of slide and spin, and gravity on them, as if A were fixed."""
        body, joint = self.problem.scene.body_b, self.joint
        axes = rotation(joint.pose_b[3:])
        self.rho = axes @ (np.array(body.com) - joint.node_b)
        self.mass = body.mass
        e, rho = self.axis, self.rho
        self.inertia = float(e @ axes @ inertia_tensor(body) @ axes.T @ e)
        self.inertia += body.mass * float(rho @ rho - (e @ rho) ** 2)
        gravity = np.array(self.problem.scene.gravity)
        self.gravity_along = float(gravity @ e)
        # The moment of the weight about the axis is p cos(spin) + q sin(spin).
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
        self.settings.timeIntegration.endTime = steps * self.problem.value
        self.mbs.SolveDynamic(self.settings, updateInitialValues=False)

    def _output(self, kind: Any) -> list[float]:
        found: list[float] = self.mbs.GetObjectOutput(self.link, kind).tolist()
        return found

    def _limit(self) -> float:
        """Friction limit mu FN (N) of the current reaction."""
        kinds = self.exu.OutputVariableType
        return self.law.limit(
            self._output(kinds.ForceLocal), self._output(kinds.TorqueLocal), (1.0, 0.0, 0.0)
        )

    def _friction(self, _mbs: Any, t: float) -> bool:
        """User function before each step: set friction from the last reaction, and the stops."""
        kinds, law = self.exu.OutputVariableType, self.law
        slide = self._output(kinds.DisplacementLocal)[0]
        v = self._output(kinds.VelocityLocal)[0]
        if law.on:
            limit = self._limit() if t > 0.5 * self.problem.value else self.initial_limit
            w = self._output(kinds.AngularVelocityLocal)[0]
            spin = self._output(kinds.Rotation)[0]
            free = (
                self.gravity_along + self.spring.force(slide) / self.mass,
                (self.weight[0] * math.cos(spin) + self.weight[1] * math.sin(spin)) / self.inertia,
            )
            inverse = 1.0 / self.mass, 0.0, 1.0 / self.inertia
            f, m = law.friction(limit, v, w, free, inverse, self.problem.value)
            for load, axis, force in self.loads:
                self.mbs.SetLoadParameter(load, "loadVector", (f if force else m) * axis)
        if self.stops.on:
            impact = self.stops.impact(slide, v)
            if impact:
                self._shift(impact[0] - slide, impact[1] - v)
        return True

    def _shift(self, distance: float, rate: float) -> None:
        """Move B along the joint axis by ``distance`` (m) and change its velocity by ``rate``."""
        data = self.mbs.systemData
        q, q_t = data.GetODE2Coordinates(), data.GetODE2Coordinates_t()
        q[-7:-4] += distance * self.axis
        q_t[-7:-4] += rate * self.axis
        data.SetODE2Coordinates(q)
        data.SetODE2Coordinates_t(q_t)

    def __call__(self) -> EndState:
        """Run all steps from the start."""
        if self.law.on:
            for load, _, _ in self.loads:
                self.mbs.SetLoadParameter(load, "loadVector", [0.0, 0.0, 0.0])
        self._solve(self.problem.steps)
        return self.end_state

    def end_state(self) -> Array:
        """(26,) poses and twists after the last step."""
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


def _prepare(problem: Problem) -> Solve:
    return ExudynSolver(problem)


SOLVERS = (
    Solver(
        "Exudyn, loop", "exudyn", "simulator", "step",
        "GenericJoint, friction limit from the last step's reaction, set by a user function",
        _prepare,
    ),
)  # fmt: skip
