"""Timing faults: samples repeated, reordered, lost, irregular in time, or after a jump."""

from __future__ import annotations

import functools
import random
from collections import deque
from collections.abc import Callable, Iterator

import numpy as np

from cylconn_ros.bench.faults.fault import ClosedLoop, FaultCase
from cylconn_ros.bench.faults.simulator import Array, Messages, Simulator

_PAUSE = 50  # samples that a paused simulator repeats
_JUMP = 0.3  # s by which the clock goes back
_TELEPORT = (0.1, 0.02, -0.01)  # m, of body B
_PULL_IN = 400  # samples for the correction of the teleport: 22 mm at 0.1 m/s, and a margin
_SHARE = 0.1  # of the samples that are lost or reordered
_JITTER = 0.3  # of the period


class StampFaults:
    """Closed loops with timing faults, one history each, on the node connected to a simulator."""

    def __init__(self, simulator: Simulator, quick: bool) -> None:
        self.simulator = simulator
        self.steps = 150 if quick else 1500
        self.loop = ClosedLoop(simulator)
        self._random = random.Random(9)
        self._delayed: Messages = []  # sent after the next sample

    def cases(self) -> Iterator[FaultCase]:
        """Run every fault."""
        yield self.repeated()
        yield self._lossy("10 % of the samples lost", self._lose)
        yield self._lossy("10 % of the samples after the next one", self._swap)
        yield self.jitter()
        yield self.clock_paused()
        yield self.clock_back()
        yield self.simulator_restarted()
        yield self.teleported()

    def _case(self, fault: str, expected: str = "constraint and energy kept") -> FaultCase:
        self.loop.restart()
        self.loop.sent = self.loop.unanswered = 0
        return FaultCase(fault, expected)

    def repeated(self) -> FaultCase:
        """Every sample three times."""
        case = self._case("every sample three times", "the same output again, no time step")
        loop, before = self.loop, self.simulator.counts()
        different = 0
        for _ in range(self.steps):
            loop.exchange()
            first, expected = loop.wrench, self.simulator.count + 1
            for _ in range(2):
                loop.send()
            self.simulator.spin_until(functools.partial(self._received, expected), 5.0)
            different += not np.array_equal(first, loop.wrench)
            loop.move()
        after = self.simulator.counts()
        repeated = after["duplicate samples"] - before["duplicate samples"]
        case.observe(f"{repeated} duplicate samples, {different} of them with another wrench",
                     duplicates=repeated)  # fmt: skip
        case.check(repeated >= self.steps and not different, "not the same output")
        loop.check(case)
        return case

    def _received(self, count: int) -> bool:
        return self.simulator.count >= count

    def _lossy(self, fault: str, send: Callable[[int], None]) -> FaultCase:
        case = self._case(fault)
        for k in range(self.steps):
            send(k)
            self.loop.move()
        case.observe(f"{self.loop.sent} of {self.steps} sent", sent=self.loop.sent)
        self.loop.check(case)
        return case

    def _lose(self, step: int) -> None:
        """Send the sample with a probability of 90 %."""
        if not step or self._random.random() >= _SHARE:
            self.loop.exchange()

    def _swap(self, step: int) -> None:
        """With a probability of 10 %, send the sample after the next one."""
        loop = self.loop
        if step and not self._delayed and self._random.random() < _SHARE:
            self._delayed = self.simulator.sample(loop.stamp, loop.bodies.state)
            return
        loop.exchange()
        self.simulator.send(self._delayed)
        self._delayed = []

    def jitter(self) -> FaultCase:
        """Periods of 0.7 to 1.3 times the nominal one."""
        case = self._case("30 % jitter of the period")
        for _ in range(self.steps):
            self.loop.exchange()
            self.loop.move(period_factor=1.0 + _JITTER * self._random.uniform(-1.0, 1.0))
        case.observe(f"{self.simulator.counts()['off period']} samples off the period counted")
        self.loop.check(case)
        return case

    def clock_paused(self) -> FaultCase:
        """The simulator repeats a sample, then continues."""
        case = self._case(f"clock paused: a sample {_PAUSE} times")
        loop = self.loop
        loop.run(self.steps // 2)
        for _ in range(_PAUSE):
            loop.exchange()
        loop.run(self.steps // 2)
        loop.check(case)
        return case

    def clock_back(self) -> FaultCase:
        """Stamps jump back while the bodies continue to move."""
        case = self._case(f"clock back by {_JUMP:g} s", "a new history; constraint kept")
        loop, before = self.loop, self.simulator.counts()["restarts"]
        loop.run(max(self.steps // 2, round(1.2 * _JUMP / loop.period * 1e9)))
        loop.stamp -= round(_JUMP * 1e9)
        case.observe(f"next output after {1e3 * loop.recovery_time():.1f} ms")
        loop.run(self.steps // 2)
        self._check_restarts(case, before)
        return case

    def simulator_restarted(self) -> FaultCase:
        """The simulator restarts from its initial state."""
        case = self._case("simulator restarted", "a new history; constraint kept")
        loop, before = self.loop, self.simulator.counts()["restarts"]
        loop.run(self.steps // 2)
        loop.restart()
        loop.run(self.steps // 2)
        self._check_restarts(case, before)
        return case

    def _check_restarts(self, case: FaultCase, before: int) -> None:
        restarts = self.simulator.counts()["restarts"] - before
        case.observe(f"restarts counted: {restarts}", restarts=restarts)
        case.check(restarts >= 1, "not counted")
        self.loop.check(case)

    def teleported(self) -> FaultCase:
        """Body B is displaced; it is pulled in with at most reference.pull_in_speed."""
        speed = self.simulator.scene.reference.pull_in_speed
        case = self._case("body teleported by (100, 20, −10) mm", f"pulled in at ≤ {speed:g} m/s")
        loop = self.loop
        loop.run(self.steps // 2)
        loop.bodies.state[13:16] += _TELEPORT
        loop.reset_worst()
        loop.run(_PULL_IN)
        case.observe(
            f"offset changes by ≤ {loop.offset_rate:.3f} m/s", offset_rate=loop.offset_rate
        )
        case.check(loop.offset_rate <= 1.01 * speed, "pulled in too fast")
        loop.reset_worst()
        loop.run(self.steps // 2)
        loop.check(case)
        return case


def late_wrenches(simulator: Simulator, samples: int, steps: int) -> FaultCase:
    """Wrenches that act ``samples`` late; the scene's ``latency`` is set, measured or 0."""
    latency = simulator.scene.latency
    compensation = {0: "latency not set", -1: "latency measured"}.get(latency, "latency set")
    expected = "constraint kept" if latency else "diverges, no wrench that is not finite"
    case = FaultCase(f"wrenches {samples} samples late, {compensation}", expected)
    loop = ClosedLoop(simulator)
    in_transit: deque[Array] = deque([np.zeros(6)] * samples)
    transient = steps // 4
    for k in range(steps):
        if k == transient and latency:
            loop.reset_worst()
        loop.exchange()
        in_transit.append(loop.wrench.copy())
        loop.move(in_transit.popleft())
        if not np.isfinite(loop.bodies.state).all() or loop.offset > 1e3:
            case.observe(f"offset beyond 1 km after {k} samples")
            break
    if latency:
        loop.check(case)
    else:
        case.observe(f"offset {loop.offset:.2g} m", offset=loop.offset)
    return case


def misaligned(simulator: Simulator, steps: int) -> FaultCase:
    """A large violation at the start: bounded correction rates and wrenches, no impulse."""
    reference, limits = simulator.scene.reference, simulator.scene.limits
    case = FaultCase(
        "misaligned by 30° and 50 mm at the start",
        f"pulled in at ≤ {reference.pull_in_speed:g} m/s, wrench within its limits",
    )
    loop = ClosedLoop(simulator)
    loop.run(steps)
    case.observe(
        f"offset changes by ≤ {loop.offset_rate:.3f} m/s; force ≤ {loop.force:.4g} N of "
        f"{limits.force:g}, torque ≤ {loop.torque:.4g} N·m of {limits.torque:g}",
        force=loop.force, torque=loop.torque, offset_rate=loop.offset_rate,
    )  # fmt: skip
    case.check(loop.force <= limits.force * (1 + 1e-12), "beyond limits.force")
    case.check(loop.torque <= limits.torque * (1 + 1e-12), "beyond limits.torque")
    case.check(loop.offset_rate <= 1.01 * reference.pull_in_speed, "pulled in too fast")
    loop.reset_worst()
    loop.run(steps // 4)
    loop.check(case)
    return case
