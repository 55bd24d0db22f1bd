"""Our methods: in the compiled closed loop with the exact plant, and ``minimal`` as a simulation.

In the loop only wrenches go out, held over a step; the plant moves both bodies. ``minimal`` offline
owns the motion and takes a tolerance of its steps instead. Where the scene states a ``tolerance``,
method and steps follow from it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from cylconn_ros.bench.common.methods import METHODS, served_by, with_period
from cylconn_ros.bench.peers import loop
from cylconn_ros.bench.peers.solver import Array, Contestant, Read, Solve, Task
from cylconn_ros.bench.step_cost.whole_motion_minimal import Prepared
from cylconn_ros.core import layout, model, plant
from cylconn_ros.methods.dispatch import NAMES
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.to_tolerance import motion

STATED = "tolerance stated"
ABOUT = {
    "penalty": "gains by a rule: 0.05 m/h^2, 0.3 m/h",
    "augmented_lagrangian": "gains by the same rule",
    "baumgarte": "accelerations with feedback, regularised friction",
    "impulse": "the default with known inertia",
    "minimal": "the mean wrench of the coming step",
}


class Loop:
    """A scene in the compiled closed loop; called, it runs from the start.

    ``answered``: steps of the last run whose answer was OK.
    """

    def __init__(self, scene: Scene, steps: int) -> None:
        method = scene.method
        self.closed = _live_minimal if method == "minimal" else loop.closed
        self.method, self.steps = NAMES[method], steps
        moved = Plant(scene)
        self.par, self.of_plant = pack(scene), pack(scene, plant=True)
        self.start, self.loads, self.h = moved.state.copy(), moved.loads, scene.period
        self.state = self.start.copy()
        self.mem, self.sample = np.zeros(model.NMEM), np.zeros(layout.NSAMPLE)
        self.a, self.b, self.out = np.zeros(6), np.zeros(6), np.zeros(layout.NOUT)
        self.answered = 0

    def __call__(self) -> Read:
        """All steps."""
        self.state[:] = self.start
        self.mem[:] = 0.0
        self.answered = self.closed(
            self.method, self.par, self.of_plant, self.mem, self.sample, self.loads, self.state,
            self.a, self.b, self.h, self.steps, self.out,
        )  # fmt: skip
        return lambda: self.state


def _live_minimal(
    method: int, par: Array, of_plant: Array, mem: Array, sample: Array, loads: Array, state: Array,
    a: Array, b: Array, h: float, steps: int, out: Array,
) -> int:  # fmt: skip
    """As loop.closed, from Python: compiling an integrator once more takes a minute."""
    from cylconn_ros.methods.minimal import entry

    good, wrench_a, wrench_b = 0, out[layout.FORCE_A :][:6], out[layout.FORCE_B :][:6]
    sample[layout.LOADS] = loads
    motion = sample[layout.MOTION]
    for _ in range(steps):
        motion[:] = state
        good += entry.step(method, par, mem, sample, h, out) == layout.OK
        plant.step(of_plant, state, wrench_a, wrench_b, loads, h)
    return good


def looped(method: str) -> Callable[[Task], Solve]:
    """How ``method`` is prepared in the closed loop."""

    def prepare(task: Task) -> Solve:
        return Loop(served_by(with_period(task.scene, task.value), method), task.steps)

    return prepare


def offline(task: Task) -> Solve:
    """The whole motion by ``minimal``."""
    scene = dataclasses.replace(task.scene, method="minimal")
    prepared = Prepared(scene, task.duration, task.value)

    def solve() -> Read:
        prepared()
        return lambda: prepared.rows[-1, :26]

    return solve


def stated(task: Task) -> Solve:
    """What a scene's ``tolerance`` chooses; choosing is not timed, as models are not."""
    scene = dataclasses.replace(
        task.scene, method="auto", tolerance=task.value, period=task.duration
    )
    _, chosen = motion(scene, 1)
    if chosen.method == "minimal":
        return offline(dataclasses.replace(task, value=chosen.step_tolerance))
    return looped("impulse")(dataclasses.replace(task, value=task.duration / chosen.substeps))


CONTESTANTS = (
    *(
        Contestant(
            f"{name}, live" if name == "minimal" else name,
            "ours", "ours", "step", ABOUT[name], looped(name),
        )
        for name in METHODS
    ),
    Contestant(
        "minimal", "ours", "ours", "tolerance", "a simulation: adaptive, events located", offline
    ),
    Contestant(
        STATED, "ours", "ours", "tolerance", "`tolerance` in the scene, the rest follows", stated
    ),
)  # fmt: skip
