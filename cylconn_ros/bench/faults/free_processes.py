"""Free-running real processes: a simulator that does not wait, and a connector node.

The simulator publishes a sample in every period of the clock and moves at the end of the period
under the newest wrench that has arrived by then, or some samples later (bench/faults/
free_running.py), and the connector is told nothing. What a run reached is judged as in process.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from cylconn_ros.bench.faults import free_running
from cylconn_ros.bench.faults.fault import FaultCase, sleeve, violation
from cylconn_ros.bench.faults.free_running import FreeRunningPlant, Lag, Motion
from cylconn_ros.bench.faults.simulator import Simulator
from cylconn_ros.errors import ProcessError
from cylconn_ros.scene.scene import Scene

CELLS: Final = (
    (100.0, Lag(0.0)),
    (100.0, Lag(1.0)),
    (500.0, Lag(0.0)),
    (500.0, Lag(1.0)),
    (500.0, Lag(5.0)),
    (500.0, Lag(1.0, "stall")),
    (1000.0, Lag(0.0)),
    (1000.0, Lag(1.0)),
    (1000.0, Lag(5.0)),
)
"""Rate (Hz) and lag."""
QUICK: Final = CELLS[3:4]
_DURATION: Final = 2.0  # s
_FIRST: Final = 300.0  # s for the first response; a node may have to compile
_SETTLED: Final = 0.2  # s


def scene_of(rate: float) -> Scene:
    """A sleeve with friction on a fixed shaft, nothing declared."""
    settings: dict[str, Any] = {"period": 1.0 / rate, "latency": -1, "timeout": 60.0}
    return sleeve(plant__body_b__twist=[1.0, 0.0, 0.0, 5.0, 0.0, 0.0], **settings)


def cells(quick: bool) -> Iterator[tuple[Scene, Lag]]:
    """Scene and lag of every run."""
    for rate, lag in QUICK if quick else CELLS:
        yield scene_of(rate), lag


def free_run(simulator: Simulator, lag: Lag) -> FaultCase:
    """Run freely; the wrenches act as late as they arrive, and ``lag`` later."""
    scene, h = simulator.scene, simulator.scene.period
    case = FaultCase(
        f"free running at {1.0 / h:g} Hz, {lag.periods:g} samples, {lag.kind}", "survives"
    )
    free, rng = FreeRunningPlant(scene), np.random.default_rng(1)
    motion, delays = _moved(simulator, free, lag, rng)
    exact = free_running.run(scene, None)
    late = Lag(lag.periods + 1.0, lag.kind)  # beside the stated lag, what arrives late
    case.observe(
        f"offset {1e3 * motion.offset:.2g} mm, angle {1e3 * motion.angle:.2g} mrad after "
        f"{_SETTLED:g} s, force {motion.force:.3g} N (exact {exact.force:.3g} N); "
        f"{100.0 * float(np.mean(np.array(delays) > h)):.0f} % of the periods began late",
        offset=motion.offset, angle=motion.angle, force=motion.force, gained=motion.gained,
    )  # fmt: skip
    for failure in free_running.failures(scene, exact, motion, late):
        case.check(False, failure)
    return case


def _moved(
    simulator: Simulator, free: FreeRunningPlant, lag: Lag, rng: np.random.Generator
) -> tuple[Motion, list[float]]:
    """The motion of a run, and how late its periods began, s."""
    h, n = simulator.scene.period, round(_DURATION / simulator.scene.period)
    period = round(h * 1e9)
    wrenches, taken, delays = simulator.record(), 0, []
    offset = angle = force = gained = 0.0
    start = free.plant.energy()
    simulator.send(simulator.sample(0, free.plant.state))
    if not simulator.spin_until(lambda: simulator.has_response(0), _FIRST):
        raise ProcessError(f"no response to the first sample within {_FIRST:g} s")
    begin = time.monotonic()
    for k in range(n):
        if k:
            simulator.send(simulator.sample(k * period, free.plant.state))
        end = begin + (k + 1) * h
        while (left := end - time.monotonic()) > 0.0:
            simulator.take(round(left * 1e9))
        delays.append(-left)
        begin += max(-left - h, 0.0)  # a simulator that fell behind does not catch up
        simulator.take(0)
        for wrench in wrenches[taken:]:
            of = wrench.stamp // period
            values = np.concatenate([np.zeros(6), wrench.values])
            free.put(of, (of + lag.of_sample(of, h, _DURATION, rng)) * h, values)
            force = max(force, float(np.linalg.norm(wrench.values[:3])))
        taken = len(wrenches)
        if not free.move(k * h, h):
            return Motion(), delays
        gained = max(gained, free.plant.energy() - start)
        if k * h > _SETTLED:
            off, askew = violation(free.plant.state)
            offset, angle = max(offset, off), max(angle, askew)
    return Motion(offset, angle, force, gained), delays
