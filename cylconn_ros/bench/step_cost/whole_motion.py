"""Error against CPU time of whole motions: ``minimal`` beside SciPy, and beside MuJoCo's RK4.

Errors are taken against closed forms and independent solutions, never against what the contestant
says of itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cylconn_ros.bench.common import frames
from cylconn_ros.bench.common.errors import AbsentError
from cylconn_ros.bench.common.methods import with_period
from cylconn_ros.bench.common.results import Findings, Gap, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import ratio
from cylconn_ros.bench.peers import mujoco_scene, scipy_oscillator
from cylconn_ros.bench.precision import trials as work
from cylconn_ros.bench.precision.trials import ERROR, Errors, Trial
from cylconn_ros.bench.step_cost import whole_motion_minimal
from cylconn_ros.reference import constant_normal_force, free_pair
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.simulate import simulate

COAST = "slide-and-spin coast"
PAIR = "two free bodies 1000:1"
SMALL = 1e-10  # m, asked on the coast
SHARE = 1.0 / 20.0  # of SciPy's time
SCIPY, MINIMAL, MUJOCO = "SciPy DOP853", "minimal", "MuJoCo RK4"
WHOLE = "minimal, solve() as a whole"


def slide_and_spin(settings: Settings) -> Findings:
    """Who reaches 1e-10 m at what cost: the cheapest set-up of each that does."""
    scene = settings.load("slide_and_spin")
    v0, u0, a, _ = scipy_oscillator.reduced(scene)
    _, distance = constant_normal_force(u0 / v0, v0, v0 / a)
    found = Findings()
    trials: list[Trial] = []
    for k in range(8, 25, 4 if settings.quick else 1):
        rtol = 10.0 ** (-0.5 * k)
        trials += _coast(scene, rtol, distance)
    sizes = work.errors(trials)
    reaching = [trial for trial in trials if sizes[trial.name][ERROR][0] <= SMALL]
    seconds = work.times(reaching, settings)
    best: dict[str, Trial] = {}
    for contestant in (SCIPY, MINIMAL, WHOLE):
        own = [trial for trial in reaching if trial.contestant == contestant]
        if own:
            best[contestant] = min(own, key=lambda trial: float(np.median(seconds[trial.name])))
        else:
            found.gaps.append(Gap(COAST, contestant, "failed", f"never reaches {SMALL:g} m"))
    found.add(work.measured(COAST, [*best.values()], sizes, seconds, scene.plant.duration))
    for ours in (MINIMAL, WHOLE):
        share = math.nan
        if SCIPY in best and ours in best:
            share = ratio(seconds[best[ours].name], seconds[best[SCIPY].name]).median
        name = f"{COAST} to {SMALL:g} m: {ours}, over {SCIPY}"
        found.targets.append(Target(name, share, SHARE, ""))
    return found


def _coast(scene: Scene, rtol: float, distance: float) -> list[Trial]:
    """SciPy, minimal, and minimal with all that its Python function does around it."""
    duration = scene.plant.duration
    solution = whole_motion_minimal.solve(scene, duration, rtol)
    reached = float(solution.length[-1] - solution.length[0])

    def scipy() -> float:
        return scipy_oscillator.slide_and_spin(scene, rtol)

    def whole() -> object:
        return whole_motion_minimal.solve(scene, duration, rtol)

    def trial(contestant: str, solve: Callable[[], object], found: float) -> Trial:
        errors: Errors = {ERROR: (abs(found - distance), "m")}
        return Trial(contestant, {"rtol": rtol}, solve, lambda: errors)

    return [
        trial(SCIPY, scipy, scipy()),
        trial(MINIMAL, whole_motion_minimal.Prepared(scene, duration, rtol), reached),
        trial(WHOLE, whole, reached),
    ]


def two_free_bodies(settings: Settings) -> Findings:
    """Work and precision on the frictionless tumbling pair, where MuJoCo's RK4 is at its best."""
    scene, duration = settings.load("free_flight"), 0.5 if settings.quick else 2.0
    truth = free_pair(scene, duration).com_b
    found = Findings()
    trials: list[Trial] = []
    try:
        for h in (2e-2, 5e-3) if settings.quick else (5e-2, 2e-2, 1e-2, 5e-3, 2e-3, 1e-3):
            trials.append(_mujoco(scene, duration, h, truth))
    except AbsentError as reason:
        found.gaps.append(Gap(PAIR, MUJOCO, "absent", str(reason)))
    for h in (2e-3,) if settings.quick else (4e-3, 2e-3, 1e-3, 5e-4):
        trials.append(_impulse(scene, duration, h, truth))
    for k in (6, 9) if settings.quick else (4, 5, 6, 7, 8, 9, 10, 11, 12):
        trials.append(_minimal(scene, duration, 10.0**-k, truth))
    sizes, seconds = work.errors(trials), work.times(trials, settings)
    found.add(work.measured(PAIR, trials, sizes, seconds, duration))
    points = {
        contestant: [
            (float(np.median(seconds[trial.name])), sizes[trial.name][ERROR][0])
            for trial in trials
            if trial.contestant == contestant
        ]
        for contestant in (MINIMAL, MUJOCO)
    }
    found.targets.append(
        Target(
            f"{PAIR}: error of minimal at equal time, over {MUJOCO}'s",
            work.worst_at_equal_time(points[MINIMAL], points[MUJOCO]),
            1.0,
            "",
            "the worst of minimal's set-ups within MuJoCo's range of cost",
        )
    )
    return found


def _mujoco(scene: Scene, duration: float, h: float, truth: frames.Array) -> Trial:
    peer = mujoco_scene.MujocoScene(scene, integrator="RK4", timestep=h)
    steps = round(duration / h)

    def solve() -> None:
        peer.reset()
        peer.run(steps)

    return Trial(MUJOCO, {"timestep": h}, solve, lambda: _pair_errors(scene, peer.state(), truth))


def _impulse(scene: Scene, duration: float, h: float, truth: frames.Array) -> Trial:
    scene = with_period(scene, h)
    steps = round(duration / h)
    last = np.zeros(26)

    def solve() -> None:
        last[:] = simulate(scene, steps).plant.state

    return Trial(
        "impulse and plant, from Python", {"period": h}, solve,
        lambda: _pair_errors(scene, last, truth),
    )  # fmt: skip


def _minimal(scene: Scene, duration: float, rtol: float, truth: frames.Array) -> Trial:
    state = whole_motion_minimal.solve(scene, duration, rtol).states[-1]
    return Trial(
        MINIMAL, {"rtol": rtol}, whole_motion_minimal.Prepared(scene, duration, rtol),
        lambda: _pair_errors(scene, state, truth),
    )  # fmt: skip


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
