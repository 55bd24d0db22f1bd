"""Process faults: a plant or connector node is killed or paused; a third process observes.

Also free-running real processes: a simulator publishes a sample in every period of the clock and
moves at its end under the newest wrench that has arrived by then, or some samples later
(bench/faults/free_running.py). The connector is told nothing; the run is judged as in process.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np

from cylconn_ros.bench.faults import free_running
from cylconn_ros.bench.faults.fault import ANGLE, OFFSET, FaultCase, node, sleeve, violation
from cylconn_ros.bench.faults.free_running import FreeRunningPlant, Lag, Motion
from cylconn_ros.bench.faults.simulator import Simulator, Wrench
from cylconn_ros.errors import ProcessError
from cylconn_ros.messages import cdr_decoder
from cylconn_ros.process.child import Child
from cylconn_ros.recording.run import read_run
from cylconn_ros.recording.salvage import salvage
from cylconn_ros.scene.inputs import POSE
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
QUICK_CELLS: Final = CELLS[1:2]
_DURATION: Final = 2.0  # s
_FIRST: Final = 300.0  # s for the first response; a node may have to compile
_SETTLED: Final = 0.2  # s
_RESTART_TIMEOUT = 60.0  # s until a restarted process must run
_STEADY = 200  # wrenches received until a loop counts as running
PAUSE = 1.0  # s
_LOSS = 0.1  # s at the end of a recording that a killed node may lose
_LOSS_QUICK = 0.5  # s; the short form tolerates a busy machine


class Observer:
    """Observes a loop through its topics: wrenches, and the sleeve's violation from its poses."""

    def __init__(self, simulator: Simulator) -> None:
        self.simulator = simulator
        self.offset = self.angle = 0.0
        self._state = np.zeros(26)
        simulator.subscribe("/body_b/pose", POSE, self._take_pose)

    def _take_pose(self, data: bytes) -> None:
        self._state[13:20] = cdr_decoder.read_pose(data).values
        offset, angle = violation(self._state)
        self.offset, self.angle = max(self.offset, offset), max(self.angle, angle)

    def time_to_run(self, wrenches: int = _STEADY, timeout: float = _RESTART_TIMEOUT) -> float:
        """Wait for some wrenches; return the time until the first one, s; infinite if too few."""
        simulator = self.simulator
        count, begin = simulator.count, time.monotonic()
        first = simulator.spin_until(lambda: simulator.count > count, timeout)
        took = time.monotonic() - begin
        enough = simulator.spin_until(lambda: simulator.count >= count + wrenches, timeout)
        return took if first and enough else float("inf")

    def check(self, case: FaultCase) -> None:
        """Add the violation to a case, with its criteria."""
        case.observe(
            f"offset ≤ {1e3 * self.offset:.2g} mm, angle ≤ {1e3 * self.angle:.2g} mrad",
            offset=self.offset, angle=self.angle,
        )  # fmt: skip
        case.check(self.offset <= OFFSET, "offset")
        case.check(self.angle <= ANGLE, "angle")


@contextmanager
def _loop(
    folder: Path, simulator: Simulator, *parameters: str
) -> Iterator[tuple[Observer, Child, Child]]:
    """Connector and plant in lock step, and their observer."""
    observer = Observer(simulator)
    with (
        node("connector", simulator.scene, folder, *parameters) as connector,
        node("plant", simulator.scene, folder, "plant.timeout:=60.0") as plant,
    ):
        if not observer.time_to_run(timeout=300.0) < float("inf"):
            words = f"{connector.last_words()}\n{plant.last_words()}"
            raise ProcessError(f"connector and plant do not exchange samples\n{words}")
        yield observer, connector, plant


def cases(folder: Path, quick: bool) -> Iterator[tuple[FaultCase, Simulator]]:
    """Run every process fault; yield it with its observing simulator. Quick: connector only."""
    of_plant = () if quick else (plant_killed, plant_paused)
    killed = functools.partial(connector_killed, quick=quick)
    for fault in (*of_plant, connector_paused, killed):
        simulator = Simulator(sleeve())
        try:
            yield fault(folder, simulator), simulator
        finally:
            simulator.close()


def plant_killed(folder: Path, simulator: Simulator) -> FaultCase:
    """SIGKILL of the plant, then a new plant."""
    case = FaultCase("plant killed (SIGKILL) and restarted", "zero wrench, then a new history")
    with _loop(folder, simulator) as (observer, _, plant):
        plant.kill()
        zero = simulator.spin_until(lambda: not any(_newest(simulator).values), 5.0)
        case.check(zero, "no zero wrench after timeout")
        with node("plant", simulator.scene, folder):
            took = observer.time_to_run()
        restarts = simulator.counts()["restarts"]
        case.observe(f"outputs {took:.1f} s after the new start, restarts counted: {restarts}",
                     recovery=took, restarts=restarts)  # fmt: skip
        case.check(took < float("inf") and restarts == 1, "does not continue, or not counted")
        observer.check(case)
    return case


def _newest(simulator: Simulator) -> Wrench:
    newest = simulator.wrenches[simulator.moving[-1]]
    assert newest is not None
    return newest


def plant_paused(folder: Path, simulator: Simulator) -> FaultCase:
    """SIGSTOP and SIGCONT of the plant."""
    case = FaultCase(f"plant paused for {PAUSE:g} s (SIGSTOP)", "one zero wrench on timeout")
    with _loop(folder, simulator) as (observer, _, plant):
        with plant.paused():
            zero = simulator.spin_until(lambda: not any(_newest(simulator).values), 5.0)
            recorded = simulator.record()
            simulator.spin_for(PAUSE)
        case.check(zero, "no zero wrench after timeout")
        case.check(len(recorded) <= 1, f"{len(recorded)} further wrenches")
        took = observer.time_to_run()
        counts = simulator.counts()
        case.observe(f"continues after {1e3 * took:.0f} ms, timeouts counted: {counts['timeouts']}",
                     recovery=took, timeouts=counts["timeouts"])  # fmt: skip
        case.check(took < float("inf") and not counts["restarts"], "does not continue its history")
        observer.check(case)
    return case


def connector_paused(folder: Path, simulator: Simulator) -> FaultCase:
    """SIGSTOP and SIGCONT of the connector; the plant retransmits meanwhile."""
    case = FaultCase(f"connector paused for {PAUSE:g} s (SIGSTOP)", "lock step loses no sample")
    with _loop(folder, simulator) as (observer, connector, plant):
        with connector.paused():
            simulator.spin_for(PAUSE)
        took = observer.time_to_run()
        counts = simulator.counts()
        repeated = counts["repeated messages"]
        case.observe(f"continues after {1e3 * took:.0f} ms, {repeated} repeated messages",
                     recovery=took)  # fmt: skip
        case.check(took < float("inf"), "does not continue")
        case.check(counts["restarts"] == counts["incomplete samples"] == 0, "samples were lost")
        case.check(plant.running, "the plant has ended")
        observer.check(case)
    return case


def connector_killed(folder: Path, simulator: Simulator, quick: bool) -> FaultCase:
    """SIGKILL of a recording connector, then a new one; the plant waits and retransmits."""
    case = FaultCase("connector killed (SIGKILL) while recording, restarted",
                     f"all but the last {_LOSS:g} s recovered; the plant continues")  # fmt: skip
    record = ("record.enabled:=true", f"record.directory:={folder / 'killed'}")
    with _loop(folder, simulator, *record) as (observer, connector, plant):
        recorded = simulator.record()
        simulator.spin_for(1.0)
        killed = time.time()
        connector.kill()
        simulator.spin_for(0.2)
        recorded = list(recorded)
        begin = time.monotonic()
        with node("connector", simulator.scene, folder):
            observer.time_to_run()
            took = time.monotonic() - begin
            plant_running = plant.running
    (broken,) = (folder / "killed").iterdir()
    run = read_run(salvage(broken).directory)
    kept = {int(stamp) for stamp in run.table("/body_b/wrench").stamp}
    missing = [wrench for wrench in recorded if wrench.stamp not in kept]
    lost = max(0.0, killed - min((wrench.received for wrench in missing), default=killed))
    case.observe(
        f"{len(missing)} of {len(kept) + len(missing)} samples lost, from the last"
        f" {1e3 * lost:.0f} ms; the loop runs {took:.1f} s after the new start",
        lost=len(missing), seconds_lost=lost, recovery=took,
    )  # fmt: skip
    case.check(lost <= (_LOSS_QUICK if quick else _LOSS), f"more than {_LOSS:g} s lost")
    case.check(plant_running and took < _RESTART_TIMEOUT, "the plant does not continue")
    observer.check(case)
    return case


def _sleeve_at(rate: float) -> Scene:
    """A sleeve with friction on a fixed shaft, nothing declared."""
    settings: dict[str, Any] = {"period": 1.0 / rate, "latency": -1, "timeout": 60.0}
    return sleeve(plant__body_b__twist=[1.0, 0.0, 0.0, 5.0, 0.0, 0.0], **settings)


def free_running_cells(quick: bool) -> Iterator[tuple[Scene, Lag]]:
    """Scene and lag of every run."""
    for rate, lag in QUICK_CELLS if quick else CELLS:
        yield _sleeve_at(rate), lag


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
