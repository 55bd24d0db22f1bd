"""Faulty channel sweep: every library scene with late, lost or irregular samples, in process.

Each fault is run with the latency set, measured and not set. Constraint violation and energy are
evaluated from the bodies' motion (bench/stability/criteria.py), passivity from the published energy
account.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from cylconn_ros.bench.common.settings import SceneLoader
from cylconn_ros.bench.common.timing import Array
from cylconn_ros.bench.stability import criteria
from cylconn_ros.bench.stability.channel import Faults, first_response
from cylconn_ros.bench.stability.loop import Trace, closed_loop, initial_state, loads_of
from cylconn_ros.bench.stability.scenes import with_duration
from cylconn_ros.bench.stability.solvers import ConnectorSolver
from cylconn_ros.core import layout, plant
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene

SET, MEASURED, NOT_SET = "set", "measured", "not set"
"""How the parameter ``latency`` is given: the true one, -1, or 0."""
LATE = (1, 2, 3, 4, 5)
_COMBINED = 2  # samples late, together with another fault
_COMBINED_RANDOM = 5  # the same with a random fault
_SINGLE = {
    "10 % lost": Faults(drop=0.1),
    "30 % jitter": Faults(jitter=0.3),
    "10 % duplicated": Faults(duplicate=0.1),
    "10 % out of order": Faults(reorder=0.1),
    "clock paused": Faults(pause=True),
    "clock back 0.3 s": Faults(jump=True),
    "plant restarted": Faults(restart=True),
    "teleported": Faults(teleport=True),
}
_STEPS = (120, 1000)  # bounds of the length of a run
PASSIVITY = 0.01  # allowed gain of the passivity balance, relative to the energy exchanged
ENERGY, FINAL_ENERGY = 1.0, 0.05  # allowed excess of energy, at any time and at the end
ROUNDING = 1e-4  # tolerance of the passivity balance; these three relative to the energy scale
OPENING = 20  # samples until the motion before the first wrench is corrected
SEEDS = (7, 1, 2, 3, 4)  # of random faults
PULL_IN_END = 2  # samples after the last pull-in until the body rests
_ACROSS = [*range(layout.VELOCITY + 1, layout.VELOCITY + 3),
           *range(layout.ANGULAR_VELOCITY + 1, layout.ANGULAR_VELOCITY + 3)]  # fmt: skip
_CONSTRAINT = [*range(layout.FORCE + 1, layout.FORCE + 3),
               *range(layout.MOMENT + 1, layout.MOMENT + 3)]  # fmt: skip


@dataclass(frozen=True)
class SweepCase:
    """A fault and the values of ``latency`` it is run with, by SET, MEASURED or NOT_SET."""

    name: str
    faults: Faults
    latencies: dict[str, int]


@dataclass(frozen=True)
class Outcome:
    """Result of one scene with one fault.

    Attributes
    ----------
        finite: whether every output and every state is finite.
        offset (m), angle (rad): worst violation in the evaluation windows.
        energy, end: excess of energy over that of the run without faults, at most and at the end,
            relative to :attr:`FaultFreeRun.scale`.
        passivity: greatest excess of the published balance over 1 % of the energy exchanged and the
            work of pull-ins, relative to the same.
    """

    finite: bool
    offset: float = math.inf
    angle: float = math.inf
    energy: float = math.inf
    end: float = math.inf
    passivity: float = math.inf

    @property
    def bounded(self) -> bool:
        """Whether constraint and energy stay bounded."""
        held = self.offset <= criteria.OFFSET and self.angle <= criteria.ANGLE
        return self.finite and held and self.energy <= ENERGY and self.end <= FINAL_ENERGY

    @property
    def passive(self) -> bool:
        """Whether the published passivity balance keeps its bound."""
        return self.passivity <= ROUNDING


def cases() -> list[SweepCase]:
    """Every fault, alone and together with late wrenches."""
    alone = [SweepCase(name, faults, {SET: 0}) for name, faults in _SINGLE.items()]
    late = [SweepCase(f"{d} late", Faults(late=d), _latencies(d)) for d in LATE]
    both = [
        SweepCase(
            f"{_COMBINED} late, {name}",
            dataclasses.replace(faults, late=_COMBINED),
            _latencies(_COMBINED),
        )
        for name, faults in _SINGLE.items()
    ]
    both_random = [
        SweepCase(
            f"{_COMBINED_RANDOM} late, {name}",
            dataclasses.replace(faults, late=_COMBINED_RANDOM),
            _latencies(_COMBINED_RANDOM),
        )
        for name, faults in _SINGLE.items()
        if faults.is_random
    ]
    return [*late, *alone, *both, *both_random]


def _latencies(late: int) -> dict[str, int]:
    return {SET: late, MEASURED: -1, NOT_SET: 0}


class MonitoredConnector(ConnectorSolver):
    """A connector whose published passivity balance is monitored.

    Args:
        late: samples by which its wrenches act late.

    Attributes
    ----------
        exceeded: greatest excess of the balance over 1 % of the energy exchanged and the work of
            pull-ins, J.
        finite: whether every output was finite.
    """

    def __init__(self, scene: Scene, late: int = 0) -> None:
        super().__init__(scene)
        self.exceeded = 0.0
        self.finite = True
        self._pull_in_work, self._pull_in_samples = 0.0, 0
        self._in_transit: deque[Array] = deque([np.zeros(4)] * (late + 1))
        self._last = self.out.copy()

    def receive(self, stamp: int, sample: Array) -> Array:
        """Process a sample and check the output."""
        wrenches = super().receive(stamp, sample)
        self._pull_in_work += self._last_pull_in_work()
        exchanged = float(self.out[layout.ENERGY_EXCHANGED])
        excess = (
            float(self.out[layout.PASSIVITY_BALANCE]) - PASSIVITY * exchanged - self._pull_in_work
        )
        self.exceeded = max(self.exceeded, excess)
        self.finite &= bool(np.isfinite(self.out).all())
        return wrenches

    def _last_pull_in_work(self) -> float:
        """Work of the constraint since the last sample if the output reports a pull-in, J."""
        out, acting = self.out, self._in_transit.popleft()
        self._in_transit.append(out[_CONSTRAINT])
        moved = 0.5 * self.scene.period * (out[_ACROSS] + self._last[_ACROSS])
        self._last = out.copy()
        if int(out[layout.FLAGS]) & layout.MISALIGNED:
            self._pull_in_samples = len(self._in_transit) + PULL_IN_END
        self._pull_in_samples -= 1
        return float(acting @ moved) if self._pull_in_samples >= 0 else 0.0


class FaultFreeRun:
    """Run of a scene without faults, the reference of the others.

    Attributes
    ----------
        energy: sample by sample, J.
        scale: energy scale, J: range of the energy, energy exchanged by the joint, and greatest
            kinetic energy, summed.
    """

    def __init__(self, scene: Scene) -> None:
        steps = min(max(round(1.0 / scene.period), _STEPS[0]), _STEPS[1])
        self.scene = with_duration(scene, steps * scene.period)
        self._par = pack(scene, plant=True)
        solver = MonitoredConnector(self.scene)
        states = closed_loop(self.scene, solver).states
        self.energy = self.energies(states)
        exchanged = float(solver.out[layout.ENERGY_EXCHANGED])
        kinetic, _ = criteria.energies(self.scene, states)
        self.scale = float(np.ptp(self.energy)) + exchanged + float(kinetic.max())
        self._late_start: dict[int, tuple[float, float]] = {}

    def energies(self, states: Array) -> Array:
        """Kinetic and gravitational energy of (N, 26) states, J."""
        with np.errstate(all="ignore"):
            return np.array([plant.energy(self._par, state) for state in states])

    def late_start_energy(self, late: int) -> tuple[float, float]:
        """Greatest and final energy if only the first ``late`` wrenches are missing, J.

        The bodies keep the energy that they take up before the first wrench until friction
        dissipates it; no wrench of the joint can remove it earlier.
        """
        if late in self._late_start:
            return self._late_start[late]
        solver = MonitoredConnector(self.scene)
        wrench: Array = np.zeros(12)
        sample, energy = np.zeros(layout.NSAMPLE), self.energy.copy()
        state = sample[layout.MOTION]
        state[:], sample[layout.LOADS] = initial_state(self.scene), loads_of(self.scene)
        for k in range(len(energy)):
            energy[k] = plant.energy(self._par, state)
            if k >= late:
                wrench = solver.step(sample)
            self._move(state, wrench)
        most = float(self.energy.max())
        self._late_start[late] = max(most, float(energy.max())), max(most, float(energy[-1]))
        return self._late_start[late]

    def free_motion_energy(self, late: int, held: int) -> float:
        """Energy that the bodies take up while no wrench acts and in the correction after it, J.

        A wrench that is computed for one period and acts for ``held`` corrects the motion of
        ``late`` periods.
        """
        state = initial_state(self.scene)
        first, begin = state.copy(), plant.energy(self._par, state)
        for _ in range(late):
            self._move(state, np.zeros(12))
        gained = abs(plant.energy(self._par, state) - begin)
        for body, at in ((self.scene.body_a, 7), (self.scene.body_b, 20)):
            if body.kind == "free":
                change = state[at : at + 3] - first[at : at + 3]
                gained += 0.5 * body.mass * float(change @ change)
        return float(gained) * (late + held) ** 2

    def _move(self, state: Array, wrench: Array) -> None:
        loads, h = loads_of(self.scene), self.scene.period
        plant.step(self._par, state, wrench[:6], wrench[6:], loads, h)


def run_case(reference: FaultFreeRun, faults: Faults, latency: int) -> Outcome:
    """Run a scene over a faulty channel and evaluate its motion; latency as the parameter."""
    scene = dataclasses.replace(reference.scene, latency=latency)
    solver = MonitoredConnector(scene, faults.late)
    with np.errstate(all="ignore"):
        trace = closed_loop(scene, solver, faults)
        if trace.diverged or not solver.finite or not np.isfinite(trace.states).all():
            return Outcome(False)
        return _evaluate(reference, trace, solver, faults)


def _evaluate(
    reference: FaultFreeRun, trace: Trace, solver: MonitoredConnector, faults: Faults
) -> Outcome:
    scene = reference.scene
    offset, angle = criteria.errors(scene, criteria.joint_motion(scene, trace.states))
    counts, windows = criteria.evaluation_windows(scene, trace, offset, angle)
    first, held = first_response(faults, OPENING)
    energy = reference.energies(trace.states)
    taken_up = reference.free_motion_energy(first, held)
    most, end = reference.late_start_energy(first)
    scale = max(reference.scale + taken_up, 1e-9)
    excess, added = -math.inf, 0.0
    for first, last in windows:  # a restart or teleport adds energy that the joint does not gain
        added = max(float(energy[first] - reference.energy[0]), 0.0) if first else 0.0
        excess = max(excess, float(energy[first:last].max()) - most - added)
    return Outcome(
        True,
        float(offset[counts].max(initial=0.0)),
        float(angle[counts].max(initial=0.0)),
        excess / scale,
        (float(energy[-1]) - end - added) / scale,
        (solver.exceeded - taken_up * len(trace.starts)) / scale,
    )


Progress = Callable[[int, int], object]
Cell = tuple[str, str, str, int]
"""Names of the fault and the scene, how the latency is given (SET, ...), and the seed."""


def run(
    names: list[str], faults: list[SweepCase], load: SceneLoader, progress: Progress
) -> Iterator[tuple[Cell, Outcome]]:
    """Run all faults on the named scenes, with the method that ``auto`` selects."""
    for done, name in enumerate(names):
        reference = FaultFreeRun(dataclasses.replace(load(name), method="auto", tolerance=0.0))
        for case in faults:
            for seed in SEEDS if case.faults.is_random else SEEDS[:1]:
                faults_now = dataclasses.replace(case.faults, seed=seed)
                for given, latency in case.latencies.items():
                    if given == NOT_SET and seed != SEEDS[0]:
                        continue  # diverges with every seed
                    yield (case.name, name, given, seed), run_case(reference, faults_now, latency)
        progress(done + 1, len(names))
