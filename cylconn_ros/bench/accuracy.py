"""Error against CPU time of whole motions: ``minimal`` beside SciPy, and beside MuJoCo's RK4.

Errors are taken against closed forms and independent solutions, never against what the contestant
says of itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cylconn_ros.bench import frames, minimal, mujoco_peer, scipy_peer
from cylconn_ros.bench.errors import AbsentError
from cylconn_ros.bench.methods import with_period
from cylconn_ros.bench.results import Findings, Gap, Measurement, Setting, Target
from cylconn_ros.bench.settings import Settings
from cylconn_ros.bench.timing import Contestant, Spread, ratio, take_turns, timed
from cylconn_ros.connector.scene import Scene
from cylconn_ros.connector.simulation import simulate
from cylconn_ros.reference import constant_normal_force, free_pair

COAST = "slide-and-spin coast"
PAIR = "two free bodies 1000:1"
SMALL = 1e-10  # m, asked on the coast
SHARE = 1.0 / 20.0  # of SciPy's time
ERROR, COST = "error", "CPU time per simulated second"
Errors = dict[str, tuple[float, str]]  # by quantity, with unit


@dataclass(frozen=True)
class Run:
    """One set-up of a contestant: solves the problem; gives the errors of its last solution."""

    contestant: str
    settings: dict[str, Setting]
    solve: Callable[[], object]
    errors: Callable[[], Errors]

    @property
    def name(self) -> str:
        """Contestant and settings, unique in a problem."""
        return f"{self.contestant} {self.settings}"


def slide_and_spin(settings: Settings) -> Findings:
    """Who reaches 1e-10 m at what cost: the cheapest set-up of each that does."""
    scene = settings.load("slide_and_spin")
    v0, u0, a, _ = scipy_peer.reduced(scene)
    _, distance = constant_normal_force(u0 / v0, v0, v0 / a)
    found = Findings()
    tolerances = [10.0 ** (-0.5 * k) for k in range(8, 25, 4 if settings.quick else 1)]
    runs: list[Run] = []
    for rtol in tolerances:
        runs.append(_coast("SciPy DOP853", scene, rtol, distance))
        try:
            minimal.solve(scene, 1e-3, rtol)
            runs.append(_coast("minimal", scene, rtol, distance))
        except AbsentError as reason:
            found.gaps = [Gap(COAST, "minimal", "absent", str(reason))]
    errors = {run.name: _errors(run) for run in runs}
    good: list[Run] = []
    for contestant in dict.fromkeys(run.contestant for run in runs):
        reaching = [
            run
            for run in runs
            if run.contestant == contestant and errors[run.name][ERROR][0] <= SMALL
        ]
        if not reaching:
            found.gaps.append(Gap(COAST, contestant, "failed", f"never reaches {SMALL} m"))
            continue
        few = _time(reaching, settings, rounds=3)
        good.append(min(reaching, key=lambda run: few[run.name].median))
    times = _measured(COAST, good, errors, settings, scene.plant.duration, found)
    share = math.nan
    if len(good) == 2:
        scipy, ours = (times[run.name] for run in good)
        share = ratio(ours, scipy).median
    found.targets.append(
        Target(f"{COAST} to {SMALL:g} m: minimal, over SciPy DOP853", share, SHARE, "times")
    )
    return found


def _coast(contestant: str, scene: Scene, rtol: float, distance: float) -> Run:
    last: list[float] = []

    def solve() -> None:
        if contestant == "minimal":
            solution = minimal.solve(scene, scene.plant.duration, rtol)
            last[:] = [float(solution.length[-1] - solution.length[0])]
        else:
            last[:] = [scipy_peer.slide_and_spin(scene, rtol)]

    return Run(contestant, {"rtol": rtol}, solve, lambda: {ERROR: (abs(last[0] - distance), "m")})


def two_free_bodies(settings: Settings) -> Findings:
    """Work and precision on the frictionless tumbling pair, where MuJoCo's RK4 is at its best."""
    scene, duration = settings.load("free_flight"), 0.5 if settings.quick else 2.0
    truth = free_pair(scene, duration).com_b
    found = Findings()
    runs: list[Run] = []
    steps = (2e-2, 5e-3) if settings.quick else (5e-2, 2e-2, 1e-2, 5e-3, 2e-3, 1e-3)
    for h in steps:
        try:
            runs.append(_mujoco(scene, duration, h, truth))
        except AbsentError as reason:
            found.gaps = [Gap(PAIR, "MuJoCo RK4", "absent", str(reason))]
    for h in (2e-3,) if settings.quick else (4e-3, 2e-3, 1e-3, 5e-4):
        runs.append(_impulse(scene, duration, h, truth))
    tolerances = (1e-6, 1e-9) if settings.quick else (1e-4, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-12)
    try:
        for rtol in tolerances:
            minimal.solve(scene, 1e-3, rtol)
            runs.append(_minimal(scene, duration, rtol, truth))
    except AbsentError as reason:
        found.gaps.append(Gap(PAIR, "minimal", "absent", str(reason)))
    errors = {run.name: _errors(run) for run in runs}
    times = _measured(PAIR, runs, errors, settings, duration, found)
    points = {
        contestant: [
            (float(np.median(times[run.name])), errors[run.name][ERROR][0])
            for run in runs
            if run.contestant == contestant
        ]
        for contestant in ("minimal", "MuJoCo RK4")
    }
    worst = worst_at_equal_time(points["minimal"], points["MuJoCo RK4"])
    found.targets.append(
        Target(
            f"{PAIR}: error of minimal over MuJoCo RK4's at equal time", worst, 1.0, "times",
            "worst of minimal's set-ups within MuJoCo's range of cost",
        )
    )  # fmt: skip
    return found


def worst_at_equal_time(
    ours: Sequence[tuple[float, float]], theirs: Sequence[tuple[float, float]]
) -> float:
    """Largest ratio of our error to theirs at the same cost; NaN where costs do not overlap.

    Points are (cost, error); between theirs, the logarithms are interpolated.
    """
    if not ours or len(theirs) < 2:
        return math.nan
    cost, error = np.log(np.array(sorted(theirs))).T
    worst = math.nan
    for c, e in ours:
        if cost[0] <= math.log(c) <= cost[-1]:
            there = math.exp(float(np.interp(math.log(c), cost, error)))
            worst = max(e / there, worst) if not math.isnan(worst) else e / there
    return worst


def _mujoco(scene: Scene, duration: float, h: float, truth: frames.Array) -> Run:
    peer = mujoco_peer.MujocoScene(scene, integrator="RK4", timestep=h)
    steps = round(duration / h)

    def solve() -> None:
        peer.reset()
        peer.run(steps)

    return Run(
        "MuJoCo RK4", {"timestep": h}, solve, lambda: _pair_errors(scene, peer.state(), truth)
    )


def _impulse(scene: Scene, duration: float, h: float, truth: frames.Array) -> Run:
    scene = with_period(scene, h)
    steps = round(duration / h)
    last = np.zeros(26)

    def solve() -> None:
        last[:] = simulate(scene, steps).plant.state

    return Run(
        "impulse and plant, from Python", {"period": h}, solve,
        lambda: _pair_errors(scene, last, truth),
    )  # fmt: skip


def _minimal(scene: Scene, duration: float, rtol: float, truth: frames.Array) -> Run:
    last = np.zeros(26)

    def solve() -> None:
        last[:] = minimal.solve(scene, duration, rtol).states[-1]

    return Run("minimal", {"rtol": rtol}, solve, lambda: _pair_errors(scene, last, truth))


def _pair_errors(scene: Scene, state: frames.Array, truth: frames.Array) -> Errors:
    """Of the small body's mass centre, and relative ones of energy and momentum."""
    start = _start(scene)
    energy, momentum = frames.energy(scene, start), frames.momentum(scene, start)
    size = np.repeat([np.linalg.norm(momentum[:3]), np.linalg.norm(momentum[3:])], 3)
    drift = np.abs(frames.momentum(scene, state) - momentum) / np.maximum(size, 1e-300)
    place, _ = frames.com(scene.body_b, state[13:])
    return {
        ERROR: (float(np.abs(place - truth).max()), "m"),
        "energy error": (abs(frames.energy(scene, state) / energy - 1.0), "1"),
        "momentum error": (float(drift.max()), "1"),
    }


def _start(scene: Scene) -> frames.Array:
    parts = (scene.initial_pose(0), scene.initial_twist(0))
    return np.array([*parts[0], *parts[1], *scene.initial_pose(1), *scene.initial_twist(1)])


def _errors(run: Run) -> Errors:
    run.solve()
    return run.errors()


def _time(runs: Sequence[Run], settings: Settings, rounds: int) -> dict[str, Spread]:
    times = take_turns([_contestant(run) for run in runs], rounds, settings.block)
    return {name: Spread.of(values) for name, values in times.items()}


def _contestant(run: Run) -> Contestant:
    def repeat(n: int) -> None:
        for _ in range(n):
            run.solve()

    return Contestant(run.name, timed(repeat))


def _measured(
    problem: str,
    runs: Sequence[Run],
    errors: dict[str, Errors],
    settings: Settings,
    duration: float,
    found: Findings,
) -> dict[str, frames.Array]:
    """Add errors and costs of all runs, timed in turns; gives the times (rounds,)."""
    times = take_turns([_contestant(run) for run in runs], settings.rounds, settings.block)
    for run in runs:
        for quantity, (error, unit) in errors[run.name].items():
            found.measurements.append(
                Measurement(problem, run.contestant, quantity, error, unit, settings=run.settings)
            )
        spread = Spread.of(times[run.name])
        found.measurements.append(
            Measurement.of(
                problem, run.contestant, COST, spread, "ms",
                scale=1e3 / duration, settings=run.settings,
            )
        )  # fmt: skip
    return times
