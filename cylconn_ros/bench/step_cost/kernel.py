"""What one answer costs, and what others take for a step of the same two bodies and joint.

All contestants of a scene replay the same stretch of motion and take turns.
"""

from __future__ import annotations

import dataclasses
import math
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cylconn_ros.bench.common.errors import AbsentError, LeftOutError
from cylconn_ros.bench.common.methods import METHODS, available, served_by
from cylconn_ros.bench.common.results import STEP, Findings, Gap, Measurement, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Array, Contestant, Spread, ratio, take_turns, timed
from cylconn_ros.bench.peers import mujoco_scene
from cylconn_ros.bench.step_cost.worker import Worker
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.scene import parameter_file
from cylconn_ros.scene.scene import Friction, Scene
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.simulate import simulate

SHAFT = "sleeve on a fixed shaft"
PAIR = "two free bodies"
BATCH, CALL, LOOP = "in a batch", "a call from Python", "with the plant's step"
PLAIN = "impulse, plain Python"
MJ_STEP = "MuJoCo mj_step Euler, a call from Python"
OVER = "over mj_step Euler"


@dataclass(frozen=True)
class Stretch:
    """A problem for timing: a scene, samples of its motion (n, NSAMPLE), mean limit of friction."""

    name: str
    scene: Scene
    samples: Array
    friction: float


def measure(settings: Settings) -> Findings:
    """Every method and MuJoCo on a sleeve on a fixed shaft and on two free bodies, all slipping."""
    found = Findings()
    for method in METHODS:
        if method not in available():
            found.gaps.append(Gap("every problem", method, "absent", "is not written yet"))
    for stretch in stretches(settings):
        with ExitStack() as stack:
            contestants = _ours(stretch, found)
            contestants += _theirs(stretch, found)
            if stretch.name == SHAFT:
                contestants.append(_plain(stretch, stack))
            times = take_turns(contestants, settings.rounds, settings.block)
        _report(stretch, times, found)
    return found


def stretches(settings: Settings) -> list[Stretch]:
    """A second of each motion, friction slipping throughout."""
    steps = 100 if settings.quick else 1000
    pair = settings.load("free_flight")
    friction = Friction(coefficient=0.1, radius=0.02, overlap=0.08)
    pair = dataclasses.replace(pair, friction=friction)
    return [
        _stretch(SHAFT, settings.load("demo"), steps),
        _stretch(PAIR, pair, steps),
    ]


def _stretch(name: str, scene: Scene, steps: int) -> Stretch:
    run = simulate(scene, steps)
    samples = np.zeros((steps, layout.NSAMPLE))
    samples[:, layout.MOTION] = run.states
    slipping = run.outs[:, layout.REGIME] == layout.SLIP
    if not slipping.all():
        raise ValueError(f"{name}: friction does not slip throughout")
    return Stretch(name, scene, samples, float(run.state("friction_limit").mean()))


def _ours(stretch: Stretch, found: Findings) -> list[Contestant]:
    """Every method in a batch and called from Python; impulse also with the plant's step."""
    contestants = []
    for method in available():
        try:
            connector = Connector(served_by(stretch.scene, method))
        except LeftOutError as reason:
            found.gaps.append(Gap(stretch.name, method, "left out", str(reason)))
            continue
        contestants += [
            Contestant(f"{method}, {BATCH}", timed(Batch(connector, stretch.samples))),
            Contestant(f"{method}, {CALL}", timed(_Calls(connector, stretch.samples))),
        ]
        if method == "impulse":
            loop = _Loop(connector, Plant(stretch.scene), len(stretch.samples))
            contestants.append(Contestant(f"{method}, {CALL}, {LOOP}", timed(loop)))
    return contestants


class Batch:
    """Answers n samples in few calls; the history begins anew with the stretch."""

    def __init__(self, connector: Connector, samples: Array) -> None:
        self.connector, self.samples = connector, samples

    def __call__(self, n: int) -> None:
        """Do it."""
        while n > 0:
            self.connector.reset()
            self.connector.run(self.samples[:n])
            n -= len(self.samples)


class _Calls:
    """Answers n samples, a call each."""

    def __init__(self, connector: Connector, samples: Array) -> None:
        self.connector, self.rows = connector, list(samples)
        self.out = np.empty(layout.NOUT)

    def __call__(self, n: int) -> None:
        step, out = self.connector.step, self.out
        while n > 0:
            self.connector.reset()
            for sample in self.rows[:n]:
                step(sample, out=out)
            n -= len(self.rows)


class _Loop:
    """Connector and plant in turn, a call each: what a simulator's step does as a whole."""

    def __init__(self, connector: Connector, plant: Plant, steps: int) -> None:
        self.connector, self.plant, self.steps = connector, plant, steps
        self.start = plant.state.copy()
        self.sample = np.zeros(layout.NSAMPLE)
        self.out = np.empty(layout.NOUT)

    def __call__(self, n: int) -> None:
        sample, out, plant = self.sample, self.out, self.plant
        motion, state = sample[layout.MOTION], plant.state
        wrench_a = out[layout.FORCE_A : layout.FORCE_B]
        wrench_b = out[layout.FORCE_B : layout.STATE0]
        while n > 0:
            self.connector.reset()
            state[:] = self.start
            for _ in range(min(n, self.steps)):
                motion[:] = state
                self.connector.step(sample, out=out)
                plant.step(wrench_a, wrench_b)
            n -= self.steps


def _theirs(stretch: Stretch, found: Findings) -> list[Contestant]:
    """MuJoCo over the same stretch: as called from Python, and many steps in one call."""
    contestants = []
    try:
        for integrator in ("Euler", "implicitfast", "RK4"):
            peer = mujoco_scene.MujocoScene(stretch.scene, stretch.friction, integrator)
            name = f"MuJoCo mj_step {integrator}"
            one = _Restarted(peer, peer.step, len(stretch.samples))
            many = _Restarted(peer, peer.run, len(stretch.samples))
            contestants.append(Contestant(f"{name}, {CALL}", timed(one)))
            contestants.append(Contestant(f"{name}, {BATCH}", timed(many)))
    except AbsentError as reason:
        found.gaps.append(Gap(stretch.name, "MuJoCo", "absent", str(reason)))
    return contestants


@dataclass(frozen=True)
class _Restarted:
    """N steps of MuJoCo, back at the start whenever the stretch is over."""

    peer: mujoco_scene.MujocoScene
    step: mujoco_scene.Steps
    length: int

    def __call__(self, n: int) -> None:
        while n > 0:
            self.peer.reset()
            self.step(min(n, self.length))
            n -= self.length


def _plain(stretch: Stretch, stack: ExitStack) -> Contestant:
    """The same source without the compiler, in a process of its own."""
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
    scene, samples = write(stretch.scene, stretch.samples[:1000], folder)
    worker = stack.enter_context(Worker(scene, samples, {"CYLCONN_NO_COMPILER": "1"}))
    if worker.first["compiled"]:
        raise RuntimeError("the worker without the compiler has compiled")
    return Contestant(f"{PLAIN}, {CALL}", worker.block)


def write(scene: Scene, samples: Array, folder: Path) -> tuple[Path, Path]:
    """A scene and samples as files for a worker."""
    paths = folder / "scene.yaml", folder / "samples.npy"
    paths[0].write_text(parameter_file.dump(scene))
    np.save(paths[1], samples)
    return paths


def _report(stretch: Stretch, times: dict[str, Array], found: Findings) -> None:
    """Ratios first, then microseconds, then the targets."""
    base = times.get(MJ_STEP)
    for name, values in times.items():
        settings = {"frictionloss": stretch.friction} if name.startswith("MuJoCo") else None
        if base is not None and values is not base:
            spread = ratio(values, base)
            found.measurements.append(
                Measurement.of(stretch.name, name, OVER, spread, "1", settings=settings)
            )
        found.measurements.append(
            Measurement.of(
                stretch.name, name, STEP, Spread.of(values), "µs", scale=1e6, settings=settings
            )
        )
    if stretch.name == SHAFT:
        found.targets += [
            _microseconds(times, f"impulse, {BATCH}", 0.8),
            _microseconds(times, f"impulse, {CALL}", 2.0),
            _microseconds(times, f"{PLAIN}, {CALL}", 60.0),
        ]
    for ours in (f"impulse, {CALL}", f"impulse, {CALL}, {LOOP}"):
        value = math.nan if base is None else ratio(times[ours], base).median
        found.targets.append(Target(f"{stretch.name}: {ours}, over {MJ_STEP}", value, 1.0, ""))


def _microseconds(times: dict[str, Array], name: str, limit: float) -> Target:
    return Target(f"{SHAFT}: {name}", Spread.of(times[name]).median * 1e6, limit, "µs")
