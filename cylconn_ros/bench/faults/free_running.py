"""Free-running plant sweep: library scenes with ``latency: -1`` and wrenches that act at any time.

The plant does not wait. The wrench of sample k acts from ``t_k + lag_k h`` on, ``lag_k`` in
periods, until a newer one arrives; a wrench that a newer one overtakes never acts. An exact plant
is integrated with short steps, a semi-implicit one takes up wrenches at its steps. The connector is
told neither the lag nor its kind.
"""

from __future__ import annotations

import dataclasses
import heapq
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from cylconn_ros.bench.common.settings import SceneLoader
from cylconn_ros.bench.common.timing import Array
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout, plant
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant

RATES = (100.0, 500.0, 1000.0)
LAGS = (0.0, 0.3, 1.0, 2.5, 5.0, 12.0)
KINDS = ("constant", "jitter", "drift", "stall")
"""Constant lag; +-50 % at random; slow change by +-50 %; stops of 50 ms every half second."""
INTEGRATIONS = ("exact", "semi_implicit")
_SHORT_STEPS = 10  # of an exact plant, per period
_STALL, _STALL_EVERY, _STALL_FROM = 0.05, 0.5, 0.3  # s
_DURATION = (0.6, 2.0)  # s, bounds of the length of a run
_SETTLED = 0.2  # s from which offset and angle count
_NEAR = 5.0  # periods: greatest lag for which offset and angle are limited
OFFSET, ANGLE, FORCE, ENERGY = 5e-3, 5e-2, 10.0, 0.05  # m, rad, and shares
FAR_OFFSET = 1.0  # m, beyond _NEAR


def _tumbling(spin: float) -> Scene:
    """A light body on an arm of five radii of gyration, turning with a heavy one; no load."""
    turn = np.full(3, spin / math.sqrt(3.0))
    arm = np.array([0.05, 0.25, 0.0])
    return Scene.from_parameters(
        {
            "gravity": [0.0, 0.0, 0.0],
            "body_a": {"kind": "free", "mass": 0.07,
                       "inertia": [1.6e-4, 2e-5, 0.0, 1.8e-4, 1e-5, 2.2e-4]},
            "body_b": {"kind": "free", "mass": 40.0, "inertia": [3.6, 0.4, 0.0, 3.5, 0.1, 2.8]},
            "node_a": {"position": arm.tolist(), "orientation": [0.0, 0.0, 0.0, 1.0]},
            "plant": {
                "body_a": {"twist": [*np.cross(turn, -arm).tolist(), *turn.tolist()]},
                "body_b": {"pose": [*arm.tolist(), 0.0, 0.0, 0.0, 1.0],
                           "twist": [0.0, 0.0, 0.0, *turn.tolist()]},
            },
        }
    )  # fmt: skip


TUMBLING: Final = {f"tumbling at {spin:g} rad/s": spin for spin in (10.0, 30.0)}
"""Pairs with long arms beside the scenes of the library: name and spin."""


@dataclass(frozen=True)
class Lag:
    """When wrenches act: the lag in periods and its kind (KINDS)."""

    periods: float
    kind: str = "constant"

    def of_sample(self, k: int, h: float, duration: float, rng: np.random.Generator) -> float:
        """The lag of sample k, periods; h: the period, s."""
        t, lag = k * h, self.periods
        if self.kind == "jitter":
            return lag * (1.0 + 0.5 * rng.uniform(-1.0, 1.0)) if lag > 0.0 else 0.5 * rng.random()
        if self.kind == "drift":
            return lag * (1.0 + 0.5 * math.sin(2.0 * math.pi * t / duration))
        into = t % _STALL_EVERY
        if self.kind == "stall" and t > _STALL_FROM and into < _STALL:
            return lag + (_STALL - into) / h
        return lag


@dataclass(frozen=True)
class Motion:
    """What a run reached.

    Attributes
    ----------
        offset (m), angle (rad): greatest violation after 0.2 s. force (N): greatest on B.
        gained: greatest energy of bodies and springs above the start, less the work of loads, J.
        exchanged: energy exchanged by the joint, J. latency, spread: as measured, periods.
    """

    offset: float = math.inf
    angle: float = math.inf
    force: float = math.inf
    gained: float = math.inf
    exchanged: float = math.inf
    latency: float = 0.0
    spread: float = 0.0


class FreeRunningPlant:
    """The plant with the wrenches that are on their way to it."""

    def __init__(self, scene: Scene) -> None:
        self.plant = Plant(scene)
        self.steps = _SHORT_STEPS if scene.plant_integration == "exact" else 1
        self._acting, self._newest, self.work = np.zeros(12), -1, 0.0
        self._coming: list[tuple[float, int, Array]] = []

    def put(self, k: int, at: float, wrench: Array) -> None:
        """Send the wrench (12,) of sample k, which acts from time ``at`` (s) on."""
        heapq.heappush(self._coming, (at, k, wrench))

    def move(self, t: float, h: float) -> bool:
        """Advance from t by h (s); return whether the state is still finite."""
        one, dt = self.plant, h / self.steps
        for i in range(self.steps):
            while self._coming and self._coming[0][0] <= t + i * dt + 1e-9:
                _, k, wrench = heapq.heappop(self._coming)
                if k > self._newest:
                    self._newest = k
                    for body in (0, 1):
                        plant.take_up(one.par, one.state, body, wrench, self._acting)
            before = one.state.copy()
            plant.advance(one.par, one.state, self._acting, one.loads, dt)
            mean = 0.5 * dt * (before + one.state)
            self.work += float(one.loads[:6] @ mean[7:13] + one.loads[6:] @ mean[20:26])
        return bool(np.isfinite(one.state).all() and np.abs(one.state).max() < 1e6)


def run(scene: Scene, lag: Lag | None, seed: int = 0) -> Motion:
    """Run a scene with ``latency: -1``; ``lag`` None: in lock step with ``latency: 0``, exactly."""
    h = scene.period
    duration = max(_DURATION[0], min(scene.plant.duration, _DURATION[1]))
    told = dataclasses.replace(scene, latency=0 if lag is None else -1)
    connector, free = Connector(told), FreeRunningPlant(scene)
    rng, sample, out = np.random.default_rng(seed), np.zeros(layout.NSAMPLE), np.empty(layout.NOUT)
    offset = angle = force = gained = 0.0
    start = 0.0
    for k in range(round(duration / h)):
        sample[layout.MOTION], sample[layout.LOADS] = free.plant.state, free.plant.loads
        connector.step(sample, out=out)
        energy = free.plant.energy() + _spring_energy(scene, out) - free.work
        start = energy if k == 0 else start
        gained = max(gained, energy - start)
        force = max(force, float(np.linalg.norm(out[layout.FORCE_B : layout.FORCE_B + 3])))
        if k * h > _SETTLED:
            offset = max(offset, float(out[layout.OFFSET_VIOLATION]))
            angle = max(angle, float(out[layout.ANGULAR_VIOLATION]))
        late = 0.0 if lag is None else lag.of_sample(k, h, duration, rng)
        free.put(k, (k + late) * h, out[: layout.STATE0].copy())
        if not free.move(k * h, h):
            return Motion()
    exchanged = float(out[layout.ENERGY_EXCHANGED])
    return Motion(
        offset, angle, force, gained, exchanged, connector.latency, connector.latency_spread
    )


def _spring_energy(scene: Scene, out: Array) -> float:
    slide, spin = out[layout.MATERIAL_DISPLACEMENT], out[layout.MATERIAL_ROTATION]
    return float(
        0.5 * scene.elasticity.k1 * slide * slide + 0.5 * scene.elasticity.kr1 * spin * spin
    )


def _start_energy(scene: Scene, lag: float) -> tuple[float, float]:
    """Kinetic energy at the start, and what the bodies take up while nothing acts, J.

    The latter as it is if one wrench removes the motion of ``lag`` periods within a period.
    """
    one, still = Plant(scene), Plant(scene)
    still.state[7:13] = still.state[20:26] = 0.0
    before, kinetic = one.state.copy(), one.energy() - still.energy()
    energy = one.energy()
    plant.advance(one.par, one.state, np.zeros(12), one.loads, lag * scene.period)
    taken = abs(one.energy() - energy)
    for body, at in ((scene.body_a, 7), (scene.body_b, 20)):
        if body.kind == "free":
            change = one.state[at : at + 3] - before[at : at + 3]
            taken += 0.5 * body.mass * float(change @ change)
    return kinetic, taken * (lag + 1.0) ** 2


def failures(scene: Scene, exact: Motion, motion: Motion, lag: Lag) -> list[str]:
    """What a run exceeded, compared with the exact one; empty if it survived."""
    if not math.isfinite(motion.offset):
        return ["not finite"]
    near = lag.periods <= _NEAR
    kinetic, taken = _start_energy(scene, 1.5 * lag.periods + 0.5)
    scale = max(kinetic, exact.exchanged, 1e-3)
    found = {
        "offset": motion.offset > exact.offset + (OFFSET if near else FAR_OFFSET),
        "angle": near and motion.angle > exact.angle + ANGLE,
        "force": motion.force > FORCE * exact.force + 1e-6,
        "energy": motion.gained > exact.gained + ENERGY * scale + taken,
    }
    return [name for name, exceeded in found.items() if exceeded]


Cell = tuple[str, float, str, Lag]
"""Name of the scene, rate (Hz), integration of the plant, lag."""


def sweep(
    names: list[str], rates: tuple[float, ...], lags: tuple[float, ...], kinds: tuple[str, ...],
    integrations: tuple[str, ...], load: SceneLoader,
) -> Iterator[tuple[Cell, Motion, list[str]]]:  # fmt: skip
    """Run every combination on the named scenes whose inertia is known, with method impulse."""
    for name, rate, integration in itertools.product(names, rates, integrations):
        given = _tumbling(TUMBLING[name]) if name in TUMBLING else load(name)
        if "unknown" in (given.body_a.kind, given.body_b.kind):
            continue
        scene = dataclasses.replace(
            given, method="impulse", tolerance=0.0, period=1.0 / rate,
            plant_integration=integration,
        )  # fmt: skip
        with np.errstate(all="ignore"):
            exact = run(scene, None)
            for periods, kind in itertools.product(lags, kinds):
                lag = Lag(periods, kind)
                motion = run(scene, lag)
                yield (name, rate, integration, lag), motion, failures(scene, exact, motion, lag)
