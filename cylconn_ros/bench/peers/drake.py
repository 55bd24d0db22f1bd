"""Drake: a MultibodyPlant with a prismatic and a revolute joint, friction by a loop around it.

Drake's joints have damping and no Coulomb friction. The loop reads the reaction port after a step,
and holds over the next one the friction that its limit allows, no more than what brings the slip to
rest (from the plant's mass matrix and bias). Discrete: ``time_step`` is the step. Continuous:
Runge-Kutta of third order with fixed steps. Where there is neither friction nor a stop, one
``AdvanceTo`` runs through.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cylconn_ros.bench.common.frames import rotation
from cylconn_ros.bench.peers.common import Coulomb, Joint, Spring, Stops, length
from cylconn_ros.bench.peers.solver import Array, Contestant, Read, Solve, Task, package
from cylconn_ros.scene.scene import Body


class Peer:
    """A task in Drake."""

    def __init__(self, task: Task, discrete: bool) -> None:
        package("pydrake")
        self.tree = package("pydrake.multibody.tree")
        self.maths = package("pydrake.math")
        self.plants = package("pydrake.multibody.plant")
        self.analysis = package("pydrake.systems.analysis")
        self.task, scene = task, task.scene
        self.joint, self.law = Joint(scene), Coulomb(scene)
        self.stops = Stops(scene, length(scene))
        self.spring = Spring(scene)
        self.plant = self._made(task.value if discrete else 0.0)
        self.simulator = self.analysis.Simulator(self.plant)
        if not discrete:
            self.analysis.ResetIntegratorFromFlags(self.simulator, "runge_kutta3", task.value)
            self.simulator.get_mutable_integrator().set_fixed_step_mode(True)
        self.context = self.simulator.get_mutable_context()
        self.forces = self.plant.get_applied_generalized_force_input_port()
        self.reactions = self.plant.get_reaction_forces_output_port()
        self.zero = np.zeros(self.plant.num_velocities())
        self.input = self.forces.FixValue(self.context, self.zero)
        self._restart()
        self.simulator.Initialize()
        self.axis = self.joint.axis_b.tolist()
        if self.law.on:  # a discrete plant has a reaction after a step only
            self.simulator.AdvanceTo(task.value)
        self.first = self._limit() if self.law.on else 0.0

    def _made(self, time_step: float) -> Any:
        tree, joint, scene = self.tree, self.joint, self.task.scene
        plant = self.plants.MultibodyPlant(time_step)
        plant.mutable_gravity_field().set_gravity_vector(np.array(scene.gravity))
        pose, turn = joint.pose_a, rotation(joint.turn)
        if joint.free:
            body_a = plant.AddRigidBody("a", self._inertia(scene.body_a))
            frame = body_a.body_frame()
            place = self._pose(turn, joint.place + turn @ joint.node_b)
        else:
            frame = plant.world_frame()
            whole = rotation(pose[3:])
            place = self._pose(whole @ turn, pose[:3] + whole @ (joint.place + turn @ joint.node_b))
        nothing = tree.SpatialInertia(0.0, np.zeros(3), tree.UnitInertia(0.0, 0.0, 0.0))
        slider = plant.AddRigidBody("slider", nothing)
        body_b = plant.AddRigidBody("b", self._inertia(scene.body_b))
        hub_a = plant.AddFrame(tree.FixedOffsetFrame("hub_a", frame, place))
        hub_b = plant.AddFrame(
            tree.FixedOffsetFrame("hub_b", body_b.body_frame(), self._pose(np.eye(3), joint.node_b))
        )
        self.slide = plant.AddJoint(
            tree.PrismaticJoint("slide", hub_a, slider.body_frame(), joint.axis_b)
        )
        self.spin = plant.AddJoint(
            tree.RevoluteJoint("spin", slider.body_frame(), hub_b, joint.axis_b)
        )
        spring = self.spring
        if spring.stiffness:
            plant.AddForceElement(tree.PrismaticSpring(self.slide, spring.slack, spring.stiffness))
        plant.Finalize()
        return plant

    def _pose(self, turn: Array, place: Array) -> Any:
        return self.maths.RigidTransform(self.maths.RotationMatrix(turn), place)

    def _inertia(self, body: Body) -> Any:
        tree = self.tree
        ixx, ixy, ixz, iyy, iyz, izz = body.inertia
        about = tree.RotationalInertia(ixx, iyy, izz, ixy, ixz, iyz)
        return tree.SpatialInertia.MakeFromCentralInertia(body.mass, np.array(body.com), about)

    def _restart(self) -> None:
        """Back to the start of the scene."""
        joint, plant, context = self.joint, self.plant, self.context
        context.SetTime(0.0)
        if joint.free:
            body = plant.GetBodyByName("a")
            pose = joint.pose_a
            plant.SetFreeBodyPose(context, body, self._pose(rotation(pose[3:]), pose[:3]))
            velocity = package("pydrake.multibody.math").SpatialVelocity(
                joint.twist_a[3:], joint.twist_a[:3]
            )
            plant.SetFreeBodySpatialVelocity(context, body, velocity)
        self.slide.set_translation(context, 0.0)
        self.slide.set_translation_rate(context, joint.slide)
        self.spin.set_angle(context, 0.0)
        self.spin.set_angular_rate(context, joint.spin)

    def _limit(self) -> float:
        """Mu FN of the reaction port as it stands."""
        reaction = self.reactions.Eval(self.context)[int(self.spin.index())]
        return self.law.limit(
            reaction.translational().tolist(), reaction.rotational().tolist(), self.axis
        )

    def _friction(self, limit: float) -> Array:
        """Generalised forces of the coming step."""
        plant, context, law = self.plant, self.context, self.law
        forces = self.zero.copy()
        k, j = self.slide.velocity_start(), self.spin.velocity_start()
        if law.on:
            mass = plant.CalcMassMatrix(context)
            pull = plant.CalcGravityGeneralizedForces(context) - plant.CalcBiasTerm(context)
            pull[k] += self.spring.force(self.slide.get_translation(context))
            columns = np.zeros((len(forces), 3))
            columns[:, 0], columns[k, 1], columns[j, 2] = pull, 1.0, 1.0
            free, by_f, by_m = np.linalg.solve(mass, columns).T
            v = self.slide.get_translation_rate(context), self.spin.get_angular_rate(context)
            f, m = law.brake(
                limit, *v, (float(free[k]), float(free[j])),
                (float(by_f[k]), float(by_f[j]), float(by_m[j])), self.task.value,
            )  # fmt: skip
            forces[k] += f
            forces[j] += m
        return forces

    def __call__(self) -> Read:
        """All steps."""
        self._restart()
        self.input.GetMutableData().set_value(self.zero)
        self.simulator.Initialize()
        advance, h = self.simulator.AdvanceTo, self.task.value
        if not self.law.on and not self.stops.on:
            advance(self.task.duration)
            return self.end
        limit = self.first
        for k in range(self.task.steps):
            self.input.GetMutableData().set_value(self._friction(limit))
            advance((k + 1) * h)
            if self.law.on:
                limit = self._limit()
            if self.stops.on:
                bounced = self.stops.bounced(
                    self.slide.get_translation(self.context),
                    self.slide.get_translation_rate(self.context),
                )
                if bounced:
                    self.slide.set_translation(self.context, bounced[0])
                    self.slide.set_translation_rate(self.context, bounced[1])
        return self.end

    def end(self) -> Array:
        """(26,) at the end."""
        joint, context = self.joint, self.context
        pose, twist = joint.pose_a, joint.twist_a
        if joint.free:
            body = self.plant.GetBodyByName("a")
            found = self.plant.EvalBodyPoseInWorld(context, body)
            q = found.rotation().ToQuaternion()
            pose = np.array([*found.translation(), q.x(), q.y(), q.z(), q.w()])
            velocity = self.plant.EvalBodySpatialVelocityInWorld(context, body)
            twist = np.array([*velocity.translational(), *velocity.rotational()])
        return joint.state(
            pose, twist, self.slide.get_translation(context), self.spin.get_angle(context),
            (self.slide.get_translation_rate(context), self.spin.get_angular_rate(context)),
        )  # fmt: skip


def _prepared(discrete: bool) -> Callable[[Task], Solve]:
    return lambda task: Peer(task, discrete)


CONTESTANTS = (
    Contestant(
        "Drake discrete, loop", "drake", "simulator", "step",
        "discrete plant, friction of the last step's reaction", _prepared(True),
    ),
    Contestant(
        "Drake RK3, loop", "drake", "simulator", "step",
        "continuous plant, fixed steps, friction of the last step's reaction", _prepared(False),
    ),
)  # fmt: skip
