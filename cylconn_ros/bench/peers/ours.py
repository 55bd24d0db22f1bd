"""The methods of this package as solvers.

Live methods run in the compiled closed loop with the exact plant: their wrenches, held over a step,
are all that couples them to the bodies. ``minimal`` integrates the whole motion to a step
tolerance. The third kind of solver sets the scene's parameter ``tolerance``, which selects method
and step.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from cylconn_ros.bench.common import published
from cylconn_ros.bench.common.errors import NotApplicableError
from cylconn_ros.bench.common.methods import METHODS, with_method, with_period
from cylconn_ros.bench.peers import loop
from cylconn_ros.bench.peers.solver import Array, EndState, Problem, Solve, Solver
from cylconn_ros.connector.group import Group
from cylconn_ros.core import layout, model
from cylconn_ros.methods.dispatch import STEPS
from cylconn_ros.methods.minimal import dense_output
from cylconn_ros.methods.minimal.events import LOG_WIDTH
from cylconn_ros.methods.traits import TRAITS
from cylconn_ros.scene import over_time
from cylconn_ros.scene.packing import pack, pack_preload
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.group import Bodies
from cylconn_ros.simulation.minimal import initial, smooth_pieces
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.to_tolerance import motion

MINIMAL, TOLERANCE = "minimal", "tolerance parameter"
GAINS = "; gains by a rule: 0.05 m/h^2, 0.3 m/h"
MAX_STEPS = 1_000_000
MAX_EVENTS = 100


class ClosedLoop:
    """A scene in the compiled closed loop; each call runs it from its start.

    ``good``: number of steps with status OK in the last run.
    """

    def __init__(self, scene: Scene, steps: int) -> None:
        self.handle, self.steps = STEPS[scene.method].handle, steps
        bodies = Plant(scene)
        self.par, self.plant_par = pack(scene), pack(scene, plant=True)
        self.start, self.h = bodies.state.copy(), scene.period
        self.loads, self.changing = _over_time(scene, bodies, self.par, steps)
        self.state = self.start.copy()
        self.mem, self.sample = np.zeros(model.NMEM), np.zeros(layout.NSAMPLE)
        self.a, self.b, self.out = np.zeros(6), np.zeros(6), np.zeros(layout.NOUT)
        self.good = 0

    def __call__(self) -> EndState:
        """Run all steps."""
        self.state[:] = self.start
        self.mem[:] = 0.0
        self.good = loop.closed(
            self.handle, self.par, self.plant_par, self.mem, self.sample, self.loads,
            self.changing, self.state, self.a, self.b, self.h, self.steps, self.out,
        )  # fmt: skip
        return lambda: self.state


def _over_time(scene: Scene, bodies: Plant, par: Array, steps: int) -> tuple[Array, Array]:
    """``loads`` and ``changing`` of loop.closed. Raises NotApplicableError."""
    course = bodies.over_time
    if any(each.on for each in over_time.commands(scene)):
        raise NotApplicableError("the compiled loop imposes no motion over time")
    loads, changing = bodies.loads, np.zeros(0)
    if course.loads_change:
        loads = np.concatenate([course.loads(k) for k in range(steps)])
    if scene.plant.preload_amplitude.on:
        rows = np.tile(par[model.FRICTION : model.OUTPUT], (steps, 1))
        for k, row in enumerate(rows):
            preload = course.preload(k)
            assert preload is not None
            for part, numbers in pack_preload(scene, preload):
                row[part.start - model.FRICTION : part.stop - model.FRICTION] = numbers
        changing = rows.ravel()
    return loads, changing


class Minimal:
    """A scene in its joint coordinates; each call integrates it from its start.

    The same solution as :func:`cylconn_ros.simulation.minimal.solve`, without building the model:
    the models of the peer solvers are not timed either.

    ``rows`` (n, WIDTH): start, kinks over time and end of the last solution, see
    methods/minimal/dense_output.py.
    Raises RuntimeError if the end is not reached.
    """

    def __init__(self, scene: Scene, duration: float, rtol: float) -> None:
        self.rtol = rtol
        self.times, self.kinks, self.pieces = smooth_pieces(scene, np.array([0.0, duration]))
        self.par, self.joint, self.start = initial(scene)
        self.y, self.joint_start = self.start.copy(), self.joint.copy()
        self.rows = np.zeros((len(self.times), dense_output.WIDTH))
        self.log = np.zeros((MAX_EVENTS, LOG_WIDTH))

    def __call__(self) -> EndState:
        """Integrate from the start to the end."""
        self.y[:] = self.start
        self.joint[:] = self.joint_start
        ran = dense_output.trajectory(
            self.par, self.joint, self.y, self.times, self.rtol, 0.1 * self.times[-1] + 1e-9,
            self.rows, self.log, MAX_STEPS, self.kinks, self.pieces,
        )  # fmt: skip
        if not ran.complete:
            raise RuntimeError(f"stopped at t = {ran.t:.9g} s")
        return lambda: self.rows[-1, :26]


class GroupLoop:
    """Connectors that share a body, stepped together; one call from Python per step."""

    def __init__(self, scenes: Sequence[Scene], problem: Problem) -> None:
        self.scenes = [
            with_method(with_period(scene, problem.value), "impulse") for scene in scenes
        ]
        self.steps = problem.steps

    def __call__(self) -> EndState:
        """Run all steps from the start."""
        bodies, group = Bodies(self.scenes), Group(self.scenes)
        n = len(self.scenes)
        samples, outs = np.zeros((n, layout.NSAMPLE)), np.empty((n, layout.NOUT))
        for _ in range(self.steps):
            for c in range(n):
                samples[c, layout.MOTION] = bodies.states[c]
            group.step(samples, outs=outs)
            bodies.step([(out[0:6], out[6:12]) for out in outs])
        return lambda: bodies.states[0]


def in_closed_loop(method: str) -> Callable[[Problem], Solve]:
    """The ``prepare`` function of a live method."""

    def prepare(problem: Problem) -> Solve:
        scene = with_method(with_period(problem.scene, problem.value), method)
        if problem.name == "two_rails":
            return GroupLoop(published.two_rails(), problem)
        return ClosedLoop(scene, problem.steps)

    return prepare


def minimal(problem: Problem) -> Solve:
    """The whole motion by ``minimal``."""
    scene = dataclasses.replace(problem.scene, method="minimal")
    return Minimal(scene, problem.duration, problem.value)


def to_tolerance(problem: Problem) -> Solve:
    """Method and step selected by the parameter ``tolerance``; the selection is not timed."""
    scene = dataclasses.replace(
        problem.scene, method="auto", tolerance=problem.value, period=problem.duration
    )
    _, chosen = motion(scene, 1)
    if chosen.method == "minimal":
        return minimal(dataclasses.replace(problem, value=chosen.step_tolerance))
    step = problem.duration / chosen.substeps
    return in_closed_loop("impulse")(dataclasses.replace(problem, value=step))


def _description(method: str) -> str:
    traits = TRAITS[method]
    return traits.summary + (GAINS if traits.uses_gains else "")


SOLVERS = (
    *(
        Solver(name, "ours", "own", "step", _description(name), in_closed_loop(name),
               groups=name == "impulse")
        for name in METHODS
    ),
    Solver(
        MINIMAL, "ours", "own", "tolerance", "a simulation: adaptive steps, located events", minimal
    ),
    Solver(
        TOLERANCE, "ours", "own", "tolerance", "the scene's `tolerance` selects method and step",
        to_tolerance,
    ),
)  # fmt: skip
