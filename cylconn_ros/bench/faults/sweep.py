"""Late, lost, jittered: every scene of the library through a faulty way, in process.

The same run with the latency told, with it measured, and without: violation and energy from
outside (bench/stability/criteria.py), the passivity account as it is published.
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
from cylconn_ros.bench.stability.channel import Faults, opening
from cylconn_ros.bench.stability.loop import Trace, closed, loads_of
from cylconn_ros.bench.stability.scenes import lasting
from cylconn_ros.bench.stability.solvers import Ours
from cylconn_ros.core import layout, plant
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene

TOLD, MEASURED, NOT_TOLD = "told", "measured", "not told"
LATE = (1, 2, 3, 4, 5)
WITH = 2  # samples late, where something else is wrong as well
WITH_CHANCE = 5  # and where that comes by chance
_ONE_BY_ONE = {
    "10 % lost": Faults(drop=0.1),
    "30 % jitter": Faults(jitter=0.3),
    "10 % twice": Faults(duplicate=0.1),
    "10 % out of order": Faults(reorder=0.1),
    "clock paused": Faults(pause=True),
    "clock back 0.3 s": Faults(jump=True),
    "plant anew": Faults(restart=True),
    "teleported": Faults(teleport=True),
}
_STEPS = (120, 1000)  # of a run, at least and at most
BOUND = 0.01  # of the energy exchanged, that the passivity account may gain
MOST, LEFT = 1.0, 0.05  # of what the scene has, that energy may exceed at most, and at the end
ROUNDING = 1e-4  # of what the scene has, that its account may be off
OPENING = 20  # samples, in which what was not held is brought back
SEEDS = (7, 1, 2, 3, 4)  # of faults that come by chance
SETTLED = 2  # samples after the last at which a body is pulled in, until it rests
_ACROSS = [*range(layout.VELOCITY + 1, layout.VELOCITY + 3),
           *range(layout.ANGULAR_VELOCITY + 1, layout.ANGULAR_VELOCITY + 3)]  # fmt: skip
_CONSTRAINT = [*range(layout.FORCE + 1, layout.FORCE + 3),
               *range(layout.MOMENT + 1, layout.MOMENT + 3)]  # fmt: skip


@dataclass(frozen=True)
class Fault:
    """One row: what goes wrong, and with which latencies it is run."""

    name: str
    faults: Faults
    latencies: dict[str, int]


@dataclass(frozen=True)
class Outcome:
    """What became of one scene under one fault.

    Attributes
    ----------
        finite: everything that was answered and every state.
        offset (m), angle (rad): worst violation where it counts.
        energy, end: by how much energy exceeds that of the run without faults, at most and at the
            end, over what the scene has (:attr:`Prompt.scale`).
        passivity: the most by which the published balance exceeds 1 % of the energy exchanged and
            the work of pulling in, over what the scene has.
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
        return self.finite and held and self.energy <= MOST and self.end <= LEFT

    @property
    def passive(self) -> bool:
        """Whether the published account keeps its bound."""
        return self.passivity <= ROUNDING


def rows() -> list[Fault]:
    """Every fault, alone; and with late wrenches."""
    alone = [Fault(name, faults, {TOLD: 0}) for name, faults in _ONE_BY_ONE.items()]
    late = [Fault(f"{d} late", Faults(late=d), _latencies(d)) for d in LATE]
    both = [
        Fault(f"{WITH} late, {name}", dataclasses.replace(faults, late=WITH), _latencies(WITH))
        for name, faults in _ONE_BY_ONE.items()
    ]
    most = [
        Fault(
            f"{WITH_CHANCE} late, {name}",
            dataclasses.replace(faults, late=WITH_CHANCE),
            _latencies(WITH_CHANCE),
        )
        for name, faults in _ONE_BY_ONE.items()
        if faults.by_chance
    ]
    return [*late, *alone, *both, *most]


def _latencies(late: int) -> dict[str, int]:
    return {TOLD: late, MEASURED: -1, NOT_TOLD: 0}


class Watched(Ours):
    """A connector whose published account is watched.

    Args:
        late: samples by which its wrenches act late.

    Attributes
    ----------
        exceeded: the most by which the balance has exceeded 1 % of the energy exchanged and the
            work of pulling in, J.
        finite: every answer.
    """

    def __init__(self, scene: Scene, late: int = 0) -> None:
        super().__init__(scene)
        self.exceeded = 0.0
        self.finite = True
        self._pulled, self._pulling = 0.0, 0
        self._on_the_way: deque[Array] = deque([np.zeros(4)] * (late + 1))
        self._last = self.out.copy()

    def receive(self, stamp: int, sample: Array) -> Array:
        """As any, and look at the answer."""
        answer = super().receive(stamp, sample)
        self._pulled += self._pull()
        exchanged = float(self.out[layout.ENERGY_EXCHANGED])
        beyond = float(self.out[layout.PASSIVITY_BALANCE]) - BOUND * exchanged - self._pulled
        self.exceeded = max(self.exceeded, beyond)
        self.finite &= bool(np.isfinite(self.out).all())
        return answer

    def _pull(self) -> float:
        """Work of the constraint since the last sample, while it says that it pulls in, J."""
        out, acted = self.out, self._on_the_way.popleft()
        self._on_the_way.append(out[_CONSTRAINT])
        moved = 0.5 * self.scene.period * (out[_ACROSS] + self._last[_ACROSS])
        self._last = out.copy()
        if int(out[layout.FLAGS]) & layout.MISALIGNED:
            self._pulling = len(self._on_the_way) + SETTLED
        self._pulling -= 1
        return float(acted @ moved) if self._pulling >= 0 else 0.0


class Prompt:
    """A scene's run without faults: what others are compared with.

    Attributes
    ----------
        energy: sample by sample, J.
        scale: what the scene has: what its energy turns over, what the joint exchanges, and the
            greatest kinetic energy, J.
    """

    def __init__(self, scene: Scene) -> None:
        steps = min(max(round(1.0 / scene.period), _STEPS[0]), _STEPS[1])
        self.scene = lasting(scene, steps * scene.period)
        self._par = pack(scene, plant=True)
        servant = Watched(self.scene)
        states = closed(self.scene, servant).states
        self.energy = self.energies(states)
        exchanged = float(servant.out[layout.ENERGY_EXCHANGED])
        kinetic, _ = criteria.energies(self.scene, states)
        self.scale = float(np.ptp(self.energy)) + exchanged + float(kinetic.max())
        self._begun: dict[int, tuple[float, float]] = {}

    def energies(self, states: Array) -> Array:
        """Kinetic and gravitational energy of (N, 26) states, J."""
        with np.errstate(all="ignore"):
            return np.array([plant.energy(self._par, state) for state in states])

    def begun(self, late: int) -> tuple[float, float]:
        """Energy at most and at the end where only the first wrench comes ``late``, J.

        What is not held at first goes on with what it has taken up: nothing that a wrench can do
        brings it back sooner than friction does.
        """
        if late in self._begun:
            return self._begun[late]
        servant = Watched(self.scene)
        wrench: Array = np.zeros(12)
        sample, energy = np.zeros(layout.NSAMPLE), self.energy.copy()
        state = sample[layout.MOTION]
        state[:], sample[layout.LOADS] = _start(self.scene), loads_of(self.scene)
        for k in range(len(energy)):
            energy[k] = plant.energy(self._par, state)
            if k >= late:
                wrench = servant.answer(sample)
            self._move(state, wrench)
        most = float(self.energy.max())
        self._begun[late] = max(most, float(energy.max())), max(most, float(energy[-1]))
        return self._begun[late]

    def unheld(self, late: int, held: int) -> float:
        """Energy that the bodies take up while no wrench acts, and in being brought back, J.

        Their fall in ``late`` periods is brought back by a wrench for one that acts for ``held``.
        """
        state = _start(self.scene)
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


def _start(scene: Scene) -> Array:
    return np.array(
        [
            *scene.initial_pose(0),
            *scene.initial_twist(0),
            *scene.initial_pose(1),
            *scene.initial_twist(1),
        ]
    )


def outcome(prompt: Prompt, faults: Faults, latency: int) -> Outcome:
    """Run a scene through a faulty way and look at it from outside."""
    scene = dataclasses.replace(prompt.scene, latency=latency)
    servant = Watched(scene, faults.late)
    with np.errstate(all="ignore"):
        trace = closed(scene, servant, faults)
        if trace.lost or not servant.finite or not np.isfinite(trace.states).all():
            return Outcome(False)
        return _judged(prompt, trace, servant, faults)


def _judged(prompt: Prompt, trace: Trace, servant: Watched, faults: Faults) -> Outcome:
    scene = prompt.scene
    offset, angle = criteria.errors(scene, criteria.look(scene, trace.states))
    counts, stretches = criteria.settled(scene, trace, offset, angle)
    first, held = opening(faults, OPENING)
    energy, fall = prompt.energies(trace.states), prompt.unheld(first, held)
    most, end = prompt.begun(first)
    scale = max(prompt.scale + fall, 1e-9)
    excess, put = -math.inf, 0.0
    for first, last in stretches:  # what somebody else has put in is nobody's gain here
        put = max(float(energy[first] - prompt.energy[0]), 0.0) if first else 0.0
        excess = max(excess, float(energy[first:last].max()) - most - put)
    return Outcome(
        True,
        float(offset[counts].max(initial=0.0)),
        float(angle[counts].max(initial=0.0)),
        excess / scale,
        (float(energy[-1]) - end - put) / scale,
        (servant.exceeded - fall * len(trace.begins)) / scale,
    )


Progress = Callable[[int, int], object]
Cell = tuple[str, str, str, int]
"""Name of a fault, of a scene, how the latency was known, and the seed."""


def run(
    names: list[str], faults: list[Fault], load: SceneLoader, progress: Progress
) -> Iterator[tuple[Cell, Outcome]]:
    """Faults on scenes, answered by what ``auto`` picks where inertia is known."""
    for done, name in enumerate(names):
        prompt = Prompt(dataclasses.replace(load(name), method="auto", tolerance=0.0))
        for row in faults:
            for seed in SEEDS if row.faults.by_chance else SEEDS[:1]:
                faults_now = dataclasses.replace(row.faults, seed=seed)
                for told, latency in row.latencies.items():
                    if told == NOT_TOLD and seed != SEEDS[0]:
                        continue  # it diverges whatever the chance
                    yield (row.name, name, told, seed), outcome(prompt, faults_now, latency)
        progress(done + 1, len(names))
