"""The methods of this package as solvers.

Live methods run in the compiled closed loop with the exact plant: their wrenches, held over a step,
are all that couples them to the bodies. ``minimal`` integrates the whole motion to a step
tolerance. The third kind of solver sets the scene's parameter ``tolerance``, which selects method
and step.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from cylconn_ros.bench.common.methods import METHODS, with_method, with_period
from cylconn_ros.bench.peers import loop
from cylconn_ros.bench.peers.solver import EndState, Problem, Solve, Solver
from cylconn_ros.core import layout, model
from cylconn_ros.methods.dispatch import STEPS
from cylconn_ros.methods.minimal import dense_output
from cylconn_ros.methods.minimal.events import LOG_WIDTH
from cylconn_ros.methods.traits import TRAITS
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.minimal import initial
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
        self.start, self.loads, self.h = bodies.state.copy(), bodies.loads, scene.period
        self.state = self.start.copy()
        self.mem, self.sample = np.zeros(model.NMEM), np.zeros(layout.NSAMPLE)
        self.a, self.b, self.out = np.zeros(6), np.zeros(6), np.zeros(layout.NOUT)
        self.good = 0

    def __call__(self) -> EndState:
        """Run all steps."""
        self.state[:] = self.start
        self.mem[:] = 0.0
        self.good = loop.closed(
            self.handle, self.par, self.plant_par, self.mem, self.sample, self.loads, self.state,
            self.a, self.b, self.h, self.steps, self.out,
        )  # fmt: skip
        return lambda: self.state


class Minimal:
    """A scene in its joint coordinates; each call integrates it from its start.

    The same solution as :func:`cylconn_ros.simulation.minimal.solve`, without building the model:
    the models of the peer solvers are not timed either.

    ``rows`` (2, WIDTH): start and end of the last solution, see methods/minimal/dense_output.py.
    Raises RuntimeError if the end is not reached.
    """

    def __init__(self, scene: Scene, duration: float, rtol: float) -> None:
        self.times, self.rtol = np.array([0.0, duration]), rtol
        self.par, self.joint, self.start = initial(scene)
        self.y = self.start.copy()
        self.rows = np.zeros((2, dense_output.WIDTH))
        self.log = np.zeros((MAX_EVENTS, LOG_WIDTH))

    def __call__(self) -> EndState:
        """Integrate from the start to the end."""
        self.y[:] = self.start
        ran = dense_output.trajectory(
            self.par, self.joint, self.y, self.times, self.rtol, 0.1 * self.times[1] + 1e-9,
            self.rows, self.log, MAX_STEPS, np.zeros(0), np.zeros((0, 30)),
        )  # fmt: skip
        if not ran.complete:
            raise RuntimeError(f"stopped at t = {ran.t:.9g} s")
        return lambda: self.rows[-1, :26]


def in_closed_loop(method: str) -> Callable[[Problem], Solve]:
    """The ``prepare`` function of a live method."""

    def prepare(problem: Problem) -> Solve:
        scene = with_method(with_period(problem.scene, problem.value), method)
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
        Solver(name, "ours", "own", "step", _description(name), in_closed_loop(name))
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
