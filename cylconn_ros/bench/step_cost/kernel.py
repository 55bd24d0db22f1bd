"""CPU time of one connector step, beside MuJoCo's step of the same two bodies and joint.

All solvers of a case process the same recorded motion and are timed in turns.
"""

from __future__ import annotations

import dataclasses
import math
import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cylconn_ros.bench.common.errors import NotApplicableError, NotInstalledError
from cylconn_ros.bench.common.methods import METHODS, with_method
from cylconn_ros.bench.common.results import STEP, Findings, Measurement, NotMeasured, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Array, Block, Spread, ratio, time_interleaved, timed
from cylconn_ros.bench.peers.mujoco_scene import MujocoScene
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
NOT_COMPILED = "impulse, plain Python"
MJ_STEP = "MuJoCo mj_step Euler, a call from Python"
OVER_MJ_STEP = "over mj_step Euler"
INTEGRATORS = ("Euler", "implicitfast", "RK4")


@dataclass(frozen=True)
class StepCase:
    """A scene with the samples of its motion.

    ``samples`` (n, NSAMPLE); ``friction``: mean friction limit (N), for MuJoCo's ``frictionloss``.
    """

    name: str
    scene: Scene
    samples: Array
    friction: float


def measure(settings: Settings) -> Findings:
    """Every method and MuJoCo on a sleeve on a fixed shaft and on two free bodies, all slipping."""
    found = Findings()
    for case in step_cases(settings):
        with ExitStack() as stack:
            blocks = {**_methods(case, found), **_mujoco(case, found)}
            if case.name == SHAFT:
                blocks[f"{NOT_COMPILED}, {CALL}"] = _without_compiler(case, stack)
            times = time_interleaved(blocks, settings.rounds, settings.block)
        _report(case, times, found)
    return found


def step_cases(settings: Settings) -> list[StepCase]:
    """One second of each motion, in slip throughout."""
    steps = 100 if settings.quick else 1000
    pair = settings.load("free_flight")
    friction = Friction(coefficient=0.1, radius=0.02, overlap=0.08)
    pair = dataclasses.replace(pair, friction=friction)
    return [
        _step_case(SHAFT, settings.load("demo"), steps),
        _step_case(PAIR, pair, steps),
    ]


def _step_case(name: str, scene: Scene, steps: int) -> StepCase:
    run = simulate(scene, samples=steps)
    samples = np.zeros((steps, layout.NSAMPLE))
    samples[:, layout.MOTION] = run.states
    slipping = run.outs[:, layout.REGIME] == layout.SLIP
    if not slipping.all():
        raise ValueError(f"{name}: the joint does not slip throughout")
    return StepCase(name, scene, samples, float(run["friction_limit"].mean()))


def _methods(case: StepCase, found: Findings) -> dict[str, Block]:
    """Every method in a batch and called from Python; impulse also with the plant's step."""
    blocks = {}
    for method in METHODS:
        try:
            connector = Connector(with_method(case.scene, method))
        except NotApplicableError as reason:
            found.not_measured.append(NotMeasured(case.name, method, "not applicable", str(reason)))
            continue
        blocks[f"{method}, {BATCH}"] = timed(Batch(connector, case.samples))
        blocks[f"{method}, {CALL}"] = timed(_Calls(connector, case.samples))
        if method == "impulse":
            loop = _Loop(connector, Plant(case.scene), len(case.samples))
            blocks[f"{method}, {CALL}, {LOOP}"] = timed(loop)
    return blocks


class Batch:
    """Processes n samples in few calls; the connector is reset when the samples start again."""

    def __init__(self, connector: Connector, samples: Array) -> None:
        self.connector, self.samples = connector, samples

    def __call__(self, n: int) -> None:
        """Process n samples."""
        while n > 0:
            self.connector.reset()
            self.connector.run(self.samples[:n])
            n -= len(self.samples)


class _Calls:
    """Processes n samples, one call from Python each."""

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
    """Connector and plant in turn, one call each: together the work of a simulator's step."""

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


def _mujoco(case: StepCase, found: Findings) -> dict[str, Block]:
    """MuJoCo on the same motion: one step per call from Python, and many steps in one call."""
    blocks = {}
    try:
        for integrator in INTEGRATORS:
            peer = MujocoScene(case.scene, case.friction, integrator)
            name, length = f"MuJoCo mj_step {integrator}", len(case.samples)
            blocks[f"{name}, {CALL}"] = timed(_Restarted(peer, peer.step, length))
            blocks[f"{name}, {BATCH}"] = timed(_Restarted(peer, peer.run, length))
    except NotInstalledError as reason:
        found.not_measured.append(NotMeasured(case.name, "MuJoCo", "not installed", str(reason)))
    return blocks


@dataclass(frozen=True)
class _Restarted:
    """N steps of MuJoCo, reset after every ``length`` steps."""

    peer: MujocoScene
    step: Callable[[int], None]
    length: int

    def __call__(self, n: int) -> None:
        while n > 0:
            self.peer.reset()
            self.step(min(n, self.length))
            n -= self.length


def _without_compiler(case: StepCase, stack: ExitStack) -> Block:
    """The same sources without the compiler, in a process of their own."""
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
    scene, samples = write(case.scene, case.samples[:1000], folder)
    worker = stack.enter_context(Worker(scene, samples, {"CYLCONN_NO_COMPILER": "1"}))
    if worker.first["compiled"]:
        raise RuntimeError("the worker has compiled in spite of CYLCONN_NO_COMPILER")
    return worker.block


def write(scene: Scene, samples: Array, folder: Path) -> tuple[Path, Path]:
    """Write a scene and samples as files for a worker."""
    paths = folder / "scene.yaml", folder / "samples.npy"
    paths[0].write_text(parameter_file.dump(scene))
    np.save(paths[1], samples)
    return paths


def _report(case: StepCase, times: dict[str, Array], found: Findings) -> None:
    """Ratios, times and targets of one case."""
    base = times.get(MJ_STEP)
    for name, values in times.items():
        settings = {"frictionloss": case.friction} if name.startswith("MuJoCo") else None
        if base is not None and values is not base:
            spread = ratio(values, base)
            found.measurements.append(
                Measurement.of(case.name, name, OVER_MJ_STEP, spread, "1", settings=settings)
            )
        found.measurements.append(
            Measurement.of(
                case.name, name, STEP, Spread.of(values), "µs", scale=1e6, settings=settings
            )
        )
    if case.name == SHAFT:
        found.targets += [
            _step_target(times, f"impulse, {BATCH}", 0.8),
            _step_target(times, f"impulse, {CALL}", 2.0),
            _step_target(times, f"{NOT_COMPILED}, {CALL}", 60.0),
        ]
    for name in (f"impulse, {CALL}", f"impulse, {CALL}, {LOOP}"):
        value = math.nan if base is None else ratio(times[name], base).median
        found.targets.append(Target(f"{case.name}: {name}, over {MJ_STEP}", value, 1.0, ""))


def _step_target(times: dict[str, Array], name: str, limit: float) -> Target:
    """Target for the time of a step on the fixed shaft; ``limit`` in microseconds."""
    return Target(f"{SHAFT}: {name}", Spread.of(times[name]).median * 1e6, limit, "µs")
