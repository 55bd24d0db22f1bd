"""MuJoCo: slide and hinge on one axis, with three ways to set the joint friction.

- constant: ``frictionloss`` from the initial normal force, set once; all steps in one call.
- calibrated: one constant, fitted at a step of 1 ms to the reference solution of this scene at 0.8
  of its speed.
- loop: before each step ``frictionloss`` from the reaction of the last step, split between slide
  and hinge in proportion to the slip. MuJoCo's solver then sticks or slips implicitly. The loop is
  compiled (peers/compiled/mujoco.py) and calls MuJoCo's C functions.

A fourth configuration is this package's friction in MuJoCo's own loop (:mod:`.mujoco_friction`).

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
from cylconn_ros.bench.peers.common import Coulomb, Course, Spring, Stops
from cylconn_ros.bench.peers.compiled.mujoco import REST_SPEED, mujoco_loop
from cylconn_ros.bench.peers.mujoco_scene import MujocoScene
from cylconn_ros.bench.peers.solver import (
    EndState,
    Problem,
    Solve,
    Solver,
    calibration_scene,
)
from cylconn_ros.scene.scene import Scene

CALIBRATION_STEP = 1e-3  # s


class MujocoSolver(MujocoScene):
    """A problem in MuJoCo; ``limits``: the model has the stops."""

    def __init__(self, problem: Problem, integrator: str, limits: bool) -> None:
        scene = problem.scene
        attributes = slide_attributes(scene, problem.value, limits)
        super().__init__(scene, 0.0, integrator, problem.value, attributes)
        if scene.friction.on:
            self.harden_friction()
        self.problem, self.law = problem, Coulomb(scene)
        self.stops, self.course = Stops(scene), Course(scene, problem.value, problem.steps)
        bounds = (-math.inf, math.inf) if limits else (self.stops.low, self.stops.high)
        self.bounds = np.array([*bounds, self.stops.restitution])
        self.initial_pressing = 0.0
        if self.law.on:
            self.set_friction(0.0, 0.0)
            self.mujoco.mj_forward(self.model, self.data)
            self.initial_pressing = self.pressing(self.law)

    @property
    def initial_limit(self) -> float:
        """Friction limit mu FN (N) at the start, with the coefficient of a slip."""
        law = self.law
        slip = math.hypot(self.joint.slide_rate, law.radius * self.joint.spin_rate)
        return law.coefficient(slip) * abs(self.initial_pressing + law.preload)

    def set_limit(self, limit: float) -> None:
        """Set one constant friction limit (N) for slide and hinge."""
        self.set_friction(limit, limit * self.law.radius)

    def solve_in_python(self) -> EndState:
        """All steps, each with the friction limit of the previous step's reaction.

        The loop as users write it; not measured, because it pays for Python.
        """
        self.reset()
        model, data, law, stops = self.model, self.data, self.law, self.stops
        mj_step, qvel, qpos = self.mujoco.mj_step, data.qvel, data.qpos
        friction, pressing = model.dof_frictionloss, self.initial_pressing
        for push, preload in zip(self.course.push, self.course.preload, strict=True):
            data.qfrc_applied[-2] = push
            if law.on:
                v, w = qvel[-2:].tolist()
                slip = math.hypot(v, law.radius * w)
                limit = law.coefficient(slip) * abs(pressing + preload)
                friction[-2:] = law.split(limit, v, w, REST_SPEED)
            mj_step(model, data)
            if law.on:
                pressing = self.pressing(law)
            if stops.on:
                impact = stops.impact(float(qpos[-2]), float(qvel[-2]))
                if impact:
                    qpos[-2], qvel[-2] = impact
        return self.end_state

    def compiled(self, reacts: bool) -> Solve:
        """All steps in one compiled call; ``reacts``: friction follows the last step's reaction."""
        loop, model, data, course = mujoco_loop(), self.model, self.data, self.course
        arguments = (
            model._address, data._address, reacts, data.qpos, data.qvel, data.qfrc_applied,
            model.dof_frictionloss, self._reaction, self._reaction_point, self._anchor, self._axis,
            self.law.numbers(), self.law.table(), self.initial_pressing, course.push,
            course.preload, self.bounds,
        )  # fmt: skip

        def solve() -> EndState:
            self.reset()
            loop(*arguments)
            return self.end_state

        return solve

    def solve_in_one_call(self) -> EndState:
        """All steps in one call."""
        self.reset()
        self.run(self.problem.steps)
        return self.end_state


def slide_attributes(scene: Scene, h: float, limits: bool) -> str:
    """MJCF attributes of the slide for its spring and stops; h: the step, s."""
    attributes = []
    spring = Spring(scene)
    if spring.stiffness:
        attributes.append(f'stiffness="{spring.stiffness!r}" springref="{spring.rest!r}"')
    if spring.damping:
        attributes.append(f'damping="{spring.damping!r}"')
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
    return solver.compiled(reacts=solver.law.on)


def _with_constant_friction(solver: MujocoSolver, limit: float) -> Solve:
    if solver.course.moves:
        raise NotApplicableError("the preload changes over time: no constant friction can follow")
    solver.set_limit(limit)
    return solver.compiled(reacts=False) if solver.course.on else solver.solve_in_one_call


def _constant(integrator: str, problem: Problem) -> Solve:
    solver = MujocoSolver(problem, integrator, limits=True)
    return _with_constant_friction(solver, solver.initial_limit)


_CALIBRATED: dict[tuple[object, ...], float] = {}
"""Calibrated friction limits (N) by scene, duration and calibration data."""


def _calibrated(integrator: str, problem: Problem) -> Solve:
    if not problem.scene.friction.on:
        raise NotApplicableError("no friction: nothing to calibrate")
    if not problem.calibration:
        raise NotApplicableError("no solution of a slower form of the scene to calibrate with")
    key = problem.name, problem.duration, *problem.calibration.values()
    if key not in _CALIBRATED:
        _CALIBRATED[key] = calibrate(
            Problem(
                problem.name, calibration_scene(problem.scene), problem.duration,
                CALIBRATION_STEP, problem.calibration,
            )
        )  # fmt: skip
    solver = MujocoSolver(problem, integrator, limits=True)
    return _with_constant_friction(solver, _CALIBRATED[key])


def calibrate(problem: Problem) -> float:
    """The constant friction limit (N) whose final slide and spin are nearest to the calibration.

    A grid search over three decades around the initial limit, then golden-section search.
    """
    solver = MujocoSolver(problem, "implicitfast", limits=True)
    solve = _with_constant_friction(solver, solver.initial_limit)

    def error(logarithm: float) -> float:
        solver.set_limit(solver.initial_limit * math.exp(logarithm))
        solve()
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


INTEGRATORS = ("Euler", "implicitfast", "RK4", "discrete")
VARIANTS: tuple[tuple[str, str, Callable[[str, Problem], Solve]], ...] = (
    ("constant", "frictionloss from the initial normal force", _constant),
    ("calibrated", "one frictionloss, fitted to the scene at 0.8 of its speed", _calibrated),
    ("loop", "frictionloss from the reaction of the last step, compiled loop", _loop),
)
SOLVERS = tuple(
    Solver(
        f"MuJoCo {integrator}, {name}", "mujoco", "simulator", "step", description,
        partial(prepare, integrator),
    )
    for integrator in INTEGRATORS
    for name, description, prepare in VARIANTS
)  # fmt: skip
