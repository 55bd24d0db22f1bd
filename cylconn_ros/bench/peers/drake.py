"""Drake: a MultibodyPlant with a prismatic and a revolute joint, and a friction loop around it.

Drake's joints have damping but no Coulomb friction. The loop reads the reaction port after a step
and applies during the next step the friction that its limit allows, and never more than brings the
slip to rest (from the plant's mass matrix and bias). Discrete plant: ``time_step`` is the step.
Continuous plant: third-order Runge-Kutta with fixed steps. Without friction and stops, one call of
``AdvanceTo`` covers the whole motion.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cylconn_ros.bench.common.frames import rotation
from cylconn_ros.bench.peers.common import Coulomb, Joint, Spring, Stops, check_plain
from cylconn_ros.bench.peers.solver import Array, EndState, Problem, Solve, Solver, package
from cylconn_ros.scene.scene import Body

DISCRETE, RK3, CENIC = "discrete", "runge_kutta3", "cenic"
SLIDER = 1e-9  # mass of the body between the joints over that of B
CENIC_ACCURACY = 1e-3  # 1/s, times the step: accuracy asked of CENIC, at least 1e-9


class DrakeSolver:
    """A problem in Drake; ``scheme``: discrete, or the integrator of a continuous plant."""

    def __init__(self, problem: Problem, scheme: str) -> None:
        package("pydrake")
        self.tree = package("pydrake.multibody.tree")
        self.math = package("pydrake.math")
        self.plants = package("pydrake.multibody.plant")
        self.analysis = package("pydrake.systems.analysis")
        self.problem, scene, self.scheme = problem, problem.scene, scheme
        check_plain(scene)
        self.joint, self.law = Joint(scene), Coulomb(scene)
        self.stops, self.spring = Stops(scene), Spring(scene)
        system: Any
        if scheme == CENIC:  # accepts a diagram only, with a scene graph beside the plant
            builder = package("pydrake.systems.framework").DiagramBuilder()
            plant, _ = self.plants.AddMultibodyPlantSceneGraph(builder, 0.0)
            self.plant = self._build(plant)
            system = builder.Build()
        else:
            step = problem.value if scheme == DISCRETE else 0.0
            self.plant = system = self._build(self.plants.MultibodyPlant(step))
        self.simulator = self.analysis.Simulator(system)
        if scheme != DISCRETE:
            self.analysis.ResetIntegratorFromFlags(self.simulator, scheme, problem.value)
            integrator = self.simulator.get_mutable_integrator()
            if scheme == CENIC:
                integrator.set_target_accuracy(max(CENIC_ACCURACY * problem.value, 1e-9))
            else:
                integrator.set_fixed_step_mode(True)
        whole = self.simulator.get_mutable_context()
        self.whole = whole
        self.context = self.plant.GetMyMutableContextFromRoot(whole)
        self.forces = self.plant.get_applied_generalized_force_input_port()
        self.reactions = self.plant.get_reaction_forces_output_port()
        self.zero = np.zeros(self.plant.num_velocities())
        self.input = self.forces.FixValue(self.context, self.zero)
        self._reset()
        self.simulator.Initialize()
        self.axis = self.joint.axis_b.tolist()
        if self.law.on:  # a discrete plant computes reactions in a step only
            self.simulator.AdvanceTo(problem.value)
        self.initial_limit = self._limit() if self.law.on else 0.0

    def _build(self, plant: Any) -> Any:
        tree, joint, scene = self.tree, self.joint, self.problem.scene
        plant.mutable_gravity_field().set_gravity_vector(np.array(scene.gravity))
        pose, axes = joint.pose_a, rotation(joint.orientation)
        if joint.free:
            body_a = plant.AddRigidBody("a", self._inertia(scene.body_a))
            frame = body_a.body_frame()
            joint_frame = self._pose(axes, joint.position + axes @ joint.node_b)
        else:
            frame = plant.world_frame()
            axes_a = rotation(pose[3:])
            position = pose[:3] + axes_a @ (joint.position + axes @ joint.node_b)
            joint_frame = self._pose(axes_a @ axes, position)
        between = tree.SpatialInertia(0.0, np.zeros(3), tree.UnitInertia(0.0, 0.0, 0.0))
        if self.scheme == CENIC:  # refuses a body without mass
            between = tree.SpatialInertia.SolidSphereWithMass(SLIDER * scene.body_b.mass, 0.01)
        slider = plant.AddRigidBody("slider", between)
        body_b = plant.AddRigidBody("b", self._inertia(scene.body_b))
        joint_a = plant.AddFrame(tree.FixedOffsetFrame("joint_a", frame, joint_frame))
        node_b = self._pose(np.eye(3), joint.node_b)
        joint_b = plant.AddFrame(tree.FixedOffsetFrame("joint_b", body_b.body_frame(), node_b))
        self.slide = plant.AddJoint(
            tree.PrismaticJoint("slide", joint_a, slider.body_frame(), joint.axis_b)
        )
        self.spin = plant.AddJoint(
            tree.RevoluteJoint("spin", slider.body_frame(), joint_b, joint.axis_b)
        )
        spring = self.spring
        if spring.stiffness:
            plant.AddForceElement(tree.PrismaticSpring(self.slide, spring.rest, spring.stiffness))
        plant.Finalize()
        return plant

    def _pose(self, axes: Array, position: Array) -> Any:
        return self.math.RigidTransform(self.math.RotationMatrix(axes), position)

    def _inertia(self, body: Body) -> Any:
        tree = self.tree
        ixx, ixy, ixz, iyy, iyz, izz = body.inertia
        central = tree.RotationalInertia(ixx, iyy, izz, ixy, ixz, iyz)
        return tree.SpatialInertia.MakeFromCentralInertia(body.mass, np.array(body.com), central)

    def _reset(self) -> None:
        """Return to the initial state."""
        joint, plant, context = self.joint, self.plant, self.context
        self.whole.SetTime(0.0)
        if joint.free:
            body = plant.GetBodyByName("a")
            pose = joint.pose_a
            plant.SetFreeBodyPose(context, body, self._pose(rotation(pose[3:]), pose[:3]))
            velocity = package("pydrake.multibody.math").SpatialVelocity(
                joint.twist_a[3:], joint.twist_a[:3]
            )
            plant.SetFreeBodySpatialVelocity(context, body, velocity)
        self.slide.set_translation(context, 0.0)
        self.slide.set_translation_rate(context, joint.slide_rate)
        self.spin.set_angle(context, 0.0)
        self.spin.set_angular_rate(context, joint.spin_rate)

    def _limit(self) -> float:
        """Friction limit mu FN (N) of the current reaction."""
        reaction = self.reactions.Eval(self.context)[int(self.spin.index())]
        return self.law.limit(
            reaction.translational().tolist(), reaction.rotational().tolist(), self.axis
        )

    def _friction(self, limit: float) -> Array:
        """Generalised forces for the next step, with friction up to ``limit`` (N)."""
        plant, context, law = self.plant, self.context, self.law
        forces = self.zero.copy()
        k, j = self.slide.velocity_start(), self.spin.velocity_start()
        if law.on:
            mass = plant.CalcMassMatrix(context)
            applied = plant.CalcGravityGeneralizedForces(context) - plant.CalcBiasTerm(context)
            applied[k] += self.spring.force(self.slide.get_translation(context))
            columns = np.zeros((len(forces), 3))
            columns[:, 0], columns[k, 1], columns[j, 2] = applied, 1.0, 1.0
            free, per_force, per_moment = np.linalg.solve(mass, columns).T
            v = self.slide.get_translation_rate(context), self.spin.get_angular_rate(context)
            f, m = law.friction(
                limit, *v, (float(free[k]), float(free[j])),
                (float(per_force[k]), float(per_force[j]), float(per_moment[j])),
                self.problem.value,
            )  # fmt: skip
            forces[k] += f
            forces[j] += m
        return forces

    def __call__(self) -> EndState:
        """Run all steps from the start."""
        self._reset()
        self.input.GetMutableData().set_value(self.zero)
        self.simulator.Initialize()
        advance, h = self.simulator.AdvanceTo, self.problem.value
        if not self.law.on and not self.stops.on:
            advance(self.problem.duration)
            return self.end_state
        limit = self.initial_limit
        for k in range(self.problem.steps):
            self.input.GetMutableData().set_value(self._friction(limit))
            advance((k + 1) * h)
            if self.law.on:
                limit = self._limit()
            if self.stops.on:
                impact = self.stops.impact(
                    self.slide.get_translation(self.context),
                    self.slide.get_translation_rate(self.context),
                )
                if impact:
                    self.slide.set_translation(self.context, impact[0])
                    self.slide.set_translation_rate(self.context, impact[1])
        return self.end_state

    def end_state(self) -> Array:
        """(26,) poses and twists after the last step."""
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


def _prepared(scheme: str) -> Callable[[Problem], Solve]:
    return lambda problem: DrakeSolver(problem, scheme)


SOLVERS = tuple(
    Solver(name, "drake", "simulator", "step", description, _prepared(scheme))
    for name, description, scheme in (
        (
            "Drake discrete, loop",
            "discrete plant, friction limit from the last step's reaction",
            DISCRETE,
        ),
        (
            "Drake RK3, loop",
            "continuous plant, fixed steps, friction limit from the last step's reaction",
            RK3,
        ),
        (
            "Drake CENIC, loop",
            "continuous plant, error-controlled convex integrator within each step of the loop",
            CENIC,
        ),
    )
)
