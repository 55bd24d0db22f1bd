"""Time of a step of the compiled closed loop, beside its parts and ``mujoco.rollout``.

The loop is what simulations and sweeps run: plant, connector, and all states and outputs stored. It
is compared with the connector and the plant in a batch, with ``mujoco.rollout`` of the same two
bodies and joint on one thread, which stores its states, and with itself on two threads.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from cylconn_ros.bench.common.errors import NotInstalledError
from cylconn_ros.bench.common.results import STEP, Findings, Measurement, NotMeasured, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import (
    Array,
    Block,
    Spread,
    ratio,
    run_interleaved,
    time_interleaved,
    timed,
)
from cylconn_ros.bench.peers.mujoco_scene import MujocoScene
from cylconn_ros.bench.peers.solver import package
from cylconn_ros.bench.step_cost.kernel import Batch, StepCase, step_cases
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout, plant
from cylconn_ros.core.jit import kernel
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.closed_loop import ClosedLoop
from cylconn_ros.simulation.plant import Plant

LOOP, CONNECTOR, PLANT = "closed loop", "connector, in a batch", "plant, in a batch"
ROLLOUT = "mujoco.rollout Euler, one thread"
OVER_ROLLOUT, OVER_PARTS = "over mujoco.rollout", "over connector plus plant"
THREADS, OVER_ONE = "closed loop, two threads", "wall time over that of one thread"
MOST_OF_ROLLOUT = 0.4  # 2.5 times the steps per second
MOST_OF_PARTS = 1.3
MOST_OF_ONE = 1.0 / 1.8  # two threads 1.8 times as fast as one
RUNS = 8  # for two threads
SHORTEST = 0.1  # s, of a turn of two threads


@kernel
def _run_plant(par: Array, state: Array, outs: Array, h: float) -> None:
    """Move the plant under the wrenches of ``outs`` (N, NOUT), one period each."""
    loads = outs[0, 0:12]
    for k in range(outs.shape[0]):
        plant.step(par, state, outs[k, 0:6], outs[k, 6:12], loads, h)


class _Loop:
    """Runs the closed loop for n periods; begins again after ``steps`` of them."""

    def __init__(self, scene: Scene, steps: int) -> None:
        self.loop, self.steps = ClosedLoop(scene), steps
        self.start = self.loop.plant.state.copy()
        self.rows, self.energy = np.empty((steps, layout.NSAMPLE)), np.empty(steps)
        self.outs = np.empty((steps, layout.NOUT))

    def __call__(self, n: int) -> None:
        """Run n periods."""
        while n > 0:
            self.loop.connector.reset()
            self.loop.plant.move(self.start, 0)
            part = slice(0, min(n, self.steps))
            self.loop.advance(self.rows[part], self.outs[part], self.energy[part])
            n -= self.steps


class _PlantAlone:
    """Moves the plant for n periods; the wrenches vary as little as the scene's do."""

    def __init__(self, scene: Scene, steps: int) -> None:
        self.plant, self.steps = Plant(scene), steps
        self.start = self.plant.state.copy()
        self.outs = np.zeros((steps, layout.NOUT))

    def __call__(self, n: int) -> None:
        """Move n periods."""
        par, state, h = self.plant.par, self.plant.state, self.plant.scene.period
        while n > 0:
            state[:] = self.start
            _run_plant(par, state, self.outs[: min(n, self.steps)], h)
            n -= self.steps


class _Rollout:
    """Runs ``mujoco.rollout`` for n steps into an array of states, as many in a call as it has."""

    def __init__(self, case: StepCase) -> None:
        rollout: Any = package("mujoco.rollout", "bench")
        self.peer, self.steps = MujocoScene(case.scene, case.friction), len(case.samples)
        mujoco, model = self.peer.mujoco, self.peer.model
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        self.start = np.empty((1, mujoco.mj_stateSize(model, kind)))
        mujoco.mj_getState(model, self.peer.data, self.start[0], kind)
        self.states = np.empty((1, self.steps, self.start.shape[1]))
        self.rollout = rollout.Rollout(nthread=0)

    def __call__(self, n: int) -> None:
        """Run n steps."""
        while n > 0:
            states = self.states if n >= self.steps else self.states[:, :n].copy()
            self.rollout.rollout(
                self.peer.model, self.peer.data, self.start, nstep=states.shape[1], state=states
            )
            n -= self.steps


def measure(settings: Settings) -> Findings:
    """The closed loop on a sleeve on a fixed shaft and on two free bodies."""
    found = Findings()
    for case in step_cases(settings):
        case = dataclasses.replace(case, name=f"{LOOP}, {case.name}")
        steps = len(case.samples)
        blocks: dict[str, Block] = {
            LOOP: timed(_Loop(case.scene, steps)),
            CONNECTOR: timed(Batch(_in_lock_step(case.scene), case.samples)),
            PLANT: timed(_PlantAlone(case.scene, steps)),
        }
        try:
            blocks[ROLLOUT] = timed(_Rollout(case))
        except NotInstalledError as reason:
            found.not_measured.append(NotMeasured(case.name, ROLLOUT, "not installed", str(reason)))
        _report(case, time_interleaved(blocks, settings.rounds, settings.block), found)
        _report_threads(case, settings, found)
    return found


def _in_lock_step(scene: Scene) -> Connector:
    """The connector as the closed loop runs it: its wrenches act at their samples."""
    return ClosedLoop(scene).connector


def _report(case: StepCase, times: dict[str, Array], found: Findings) -> None:
    """Times, ratios and targets of one case."""
    for name, values in times.items():
        settings = {"frictionloss": case.friction} if name == ROLLOUT else None
        found.measurements.append(
            Measurement.of(
                case.name, name, STEP, Spread.of(values), "µs", scale=1e6, settings=settings
            )
        )
    bases = {OVER_PARTS: (times[CONNECTOR] + times[PLANT], MOST_OF_PARTS)}
    if ROLLOUT in times:
        bases[OVER_ROLLOUT] = (times[ROLLOUT], MOST_OF_ROLLOUT)
    for quantity, (base, limit) in bases.items():
        spread = ratio(times[LOOP], base)
        found.measurements.append(Measurement.of(case.name, LOOP, quantity, spread, "1"))
        found.targets.append(Target(f"{case.name}, {quantity}", spread.median, limit, ""))
    if ROLLOUT not in times:
        found.targets.append(Target(f"{case.name}, {OVER_ROLLOUT}", math.nan, MOST_OF_ROLLOUT, ""))


def _report_threads(case: StepCase, settings: Settings, found: Findings) -> None:
    """Wall time of RUNS equal runs on two threads, over that on one; needs two free cores."""
    loops = [_Loop(case.scene, len(case.samples)) for _ in range(RUNS)]
    started = time.perf_counter()
    loops[0](loops[0].steps)
    once = time.perf_counter() - started
    least = settings.block if settings.quick else SHORTEST
    n = loops[0].steps * max(math.ceil(least / (RUNS * once)), 1)
    with ThreadPoolExecutor(1) as one, ThreadPoolExecutor(2) as two:
        turns: dict[str, Callable[[], float]] = {
            name: lambda pool=pool: _wall(pool, loops, n)  # type: ignore[misc]
            for name, pool in (("one", one), ("two", two))
        }
        times = {k: np.array(v) for k, v in run_interleaved(turns, settings.rounds).items()}
    spread = ratio(times["two"], times["one"])
    found.measurements.append(Measurement.of(case.name, THREADS, OVER_ONE, spread, "1"))
    found.targets.append(
        Target(f"{case.name}: two threads, {OVER_ONE}", spread.median, MOST_OF_ONE, "")
    )


def _wall(pool: ThreadPoolExecutor, loops: list[_Loop], n: int) -> float:
    """Wall time (s) of n periods of each loop in a pool of threads."""
    started = time.perf_counter()
    list(pool.map(lambda loop: loop(n), loops))
    return time.perf_counter() - started
