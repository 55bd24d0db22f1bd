"""MuJoCo: slide and hinge on one axis, with three ways to set the joint friction.

- constant: ``frictionloss`` from the initial normal force, set once; all steps in one call.
- calibrated: one constant, fitted at a step of 1 ms to the reference solution of this scene at 0.8
  of its speed.
- loop: before each step, from Python, ``frictionloss`` from the reaction of the last step, split
  between slide and hinge in proportion to the slip. MuJoCo's solver then sticks or slips
  implicitly.

``solimpfriction`` and ``solreffriction`` are as stiff as the solver accepts: with the defaults a
sticking joint creeps. Stops: a joint range with a ``solreflimit`` that yields the restitution; the
loop reverses the rate itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from cylconn_ros.bench.common.errors import NotApplicableError
from cylconn_ros.bench.common.frames import rotation
from cylconn_ros.bench.peers.common import Coulomb, Spring, Stops
from cylconn_ros.bench.peers.mujoco_scene import MujocoScene
from cylconn_ros.bench.peers.solver import (
    Array,
    EndState,
    Problem,
    Solve,
    Solver,
    calibration_scene,
)
from cylconn_ros.scene.scene import Scene

CALIBRATION_STEP = 1e-3  # s
REST_SPEED = 1e-9  # m/s: below it, slide and hinge both get the whole limit


class MujocoSolver(MujocoScene):
    """A problem in MuJoCo; ``limits``: the model has the stops."""

    def __init__(self, problem: Problem, integrator: str, limits: bool) -> None:
        scene = problem.scene
        attributes = _slide_attributes(scene, problem.value, limits)
        super().__init__(scene, 0.0, integrator, problem.value, attributes)
        if scene.friction.on:
            self.harden_friction()
        self.problem, self.law = problem, Coulomb(scene)
        self.stops = Stops(scene)
        self.initial_limit = 0.0
        if self.law.on:
            self.set_friction(0.0, 0.0)
            self.mujoco.mj_forward(self.model, self.data)
            self.initial_limit = self.friction_limit(self.law)

    def set_limit(self, limit: float) -> None:
        """Set one constant friction limit (N) for slide and hinge."""
        self.set_friction(limit, limit * self.law.radius)

    def solve_in_loop(self) -> EndState:
        """All steps, each with the friction limit of the previous step's reaction."""
        self.reset()
        model, data, law, stops = self.model, self.data, self.law, self.stops
        mj_step, qvel, qpos = self.mujoco.mj_step, data.qvel, data.qpos
        friction, limit = model.dof_frictionloss, self.initial_limit
        for _ in range(self.problem.steps):
            if law.on:
                v, w = qvel[-2:].tolist()
                friction[-2:] = law.split(limit, v, w, REST_SPEED)
            mj_step(model, data)
            if law.on:
                limit = self.friction_limit(law)
            if stops.on:
                impact = stops.impact(float(qpos[-2]), float(qvel[-2]))
                if impact:
                    qpos[-2], qvel[-2] = impact
        return self.end_state

    def solve_in_one_call(self) -> EndState:
        """All steps in one call."""
        self.reset()
        self.run(self.problem.steps)
        return self.end_state

    def end_state(self) -> Array:
        """(26,) poses and twists after the last step."""
        qpos, qvel, joint = self.data.qpos, self.data.qvel, self.joint
        slide, spin = qpos[-2:].tolist()
        if not joint.free:
            return joint.state(joint.pose_a, joint.twist_a, slide, spin, qvel[-2:].tolist())
        w, x, y, z = qpos[3:7]
        pose = np.array([*qpos[:3], x, y, z, w])
        twist = np.array([*qvel[:3], *(rotation(pose[3:]) @ qvel[3:6])])
        return joint.state(pose, twist, slide, spin, qvel[-2:].tolist())


def _slide_attributes(scene: Scene, h: float, limits: bool) -> str:
    """MJCF attributes of the slide for its spring and stops; h: the step, s."""
    attributes = []
    spring = Spring(scene)
    if spring.stiffness:
        attributes.append(f'stiffness="{spring.stiffness!r}" springref="{spring.rest!r}"')
    stops = Stops(scene)
    if limits and stops.on:
        # A contact that lasts ten steps, with the damping ratio that yields the restitution.
        stiffness = (math.pi / (10.0 * h)) ** 2
        loss = -math.log(max(stops.restitution, 1e-3))
        ratio = loss / math.hypot(math.pi, loss)
        damping = 2.0 * ratio * math.sqrt(stiffness)
        attributes.append(
            f'limited="true" range="{stops.low!r} {stops.high!r}" '
            f'solreflimit="{-stiffness!r} {-damping!r}" solimplimit="0.9999 0.9999 0.001"'
        )
    return " ".join(attributes)


def _loop(integrator: str, problem: Problem) -> Solve:
    solver = MujocoSolver(problem, integrator, limits=False)
    if not solver.law.on and not solver.stops.on:
        raise NotApplicableError("no friction and no stops: a loop has nothing to do")
    return solver.solve_in_loop


def _constant(integrator: str, problem: Problem) -> Solve:
    solver = MujocoSolver(problem, integrator, limits=True)
    solver.set_limit(solver.initial_limit)
    return solver.solve_in_one_call


_CALIBRATED: dict[tuple[object, ...], float] = {}
"""Calibrated friction limits (N) by scene, duration and calibration data."""


def _calibrated(integrator: str, problem: Problem) -> Solve:
    if not problem.scene.friction.on:
        raise NotApplicableError("no friction: nothing to calibrate")
    key = problem.name, problem.duration, *problem.calibration.values()
    if key not in _CALIBRATED:
        _CALIBRATED[key] = calibrate(
            Problem(
                problem.name, calibration_scene(problem.scene), problem.duration,
                CALIBRATION_STEP, problem.calibration,
            )
        )  # fmt: skip
    solver = MujocoSolver(problem, integrator, limits=True)
    solver.set_limit(_CALIBRATED[key])
    return solver.solve_in_one_call


def calibrate(problem: Problem) -> float:
    """The constant friction limit (N) whose final slide and spin are nearest to the calibration.

    A grid search over three decades around the initial limit, then golden-section search.
    """
    solver = MujocoSolver(problem, "implicitfast", limits=True)

    def error(logarithm: float) -> float:
        solver.set_limit(solver.initial_limit * math.exp(logarithm))
        solver.solve_in_one_call()
        slide, spin = solver.slide()
        of_slide = slide - problem.calibration.get("slide", slide)
        of_spin = spin - problem.calibration.get("spin", spin)
        return math.hypot(of_slide, solver.law.radius * of_spin)

    grid = np.linspace(-3.5, 3.5, 57)
    best = int(np.argmin([error(x) for x in grid]))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    golden = 0.5 * (math.sqrt(5.0) - 1.0)
    for _ in range(40):
        left, right = high - golden * (high - low), low + golden * (high - low)
        if error(left) <= error(right):
            high = right
        else:
            low = left
    return float(solver.initial_limit * math.exp(0.5 * (low + high)))


INTEGRATORS = ("Euler", "implicitfast", "RK4")
VARIANTS: tuple[tuple[str, str, Callable[[str, Problem], Solve]], ...] = (
    ("constant", "frictionloss from the initial normal force", _constant),
    ("calibrated", "one frictionloss, fitted to the scene at 0.8 of its speed", _calibrated),
    ("loop", "frictionloss from the reaction of the last step, set from Python", _loop),
)
SOLVERS = tuple(
    Solver(
        f"MuJoCo {integrator}, {name}", "mujoco", "simulator", "step", description,
        partial(prepare, integrator),
    )
    for integrator in INTEGRATORS
    for name, description, prepare in VARIANTS
)  # fmt: skip
