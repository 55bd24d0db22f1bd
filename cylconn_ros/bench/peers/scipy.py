"""SciPy on hand-reduced equations: regularised with LSODA, and DOP853 with events.

- LSODA: the direction of friction is s/sqrt(s^2 + eps^2), eps = rtol of the scene's speed: one
  smooth stiff system from start to end. Stops on the slide end an integration and begin the next.
- DOP853: slip until it has died down to 1e-6 of its start; the rest, v^2/(2a), is added by hand.
  Then stick where friction holds, else on in the other direction.

Two free bodies: Newton-Euler with multipliers (reference/free_pair.py), in NumPy.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from cylconn_ros.bench.common.errors import LeftOutError
from cylconn_ros.bench.peers import reduced
from cylconn_ros.bench.peers.common import Stops, length
from cylconn_ros.bench.peers.solver import Array, Contestant, Read, Solve, Task, package
from cylconn_ros.reference.free_pair import Equations

REST = 1e-6  # of the speed at the start
EVIDENT = {"incline_stick", "jam"}
PAIRS = {"free_flight", "hub_and_rotor"}


class _Problem:
    """A task's equations in both forms."""

    def __init__(self, task: Task) -> None:
        self.task, self.rtol = task, task.value
        try:
            self.accelerations = reduced.equations(task.name, task.scene)
        except KeyError:
            raise LeftOutError("nobody has reduced this scene by hand") from None
        self.joint, self.start = reduced.start(task.scene)
        friction = task.scene.friction
        self.radius = friction.radius if friction.on else 1.0
        self.smooth = not friction.on
        self.speed = math.hypot(self.joint.slide, self.radius * self.joint.spin) or 1.0
        self.stops = Stops(task.scene, length(task.scene))
        self.solve_ivp = package("scipy.integrate").solve_ivp

    def state(self, y: Any) -> Array:
        slide, spin, v, w = map(float, y)
        return self.joint.state(self.joint.pose_a, self.joint.twist_a, slide, spin, (v, w))

    def regularised(self, eps: float) -> Callable[[float, Array], tuple[float, ...]]:
        radius, accelerations = self.radius, self.accelerations

        def rates(_t: float, y: Array) -> tuple[float, ...]:
            x, p, v, w = y.tolist()
            size = math.sqrt(v * v + (radius * w) ** 2 + eps * eps)
            return v, w, *accelerations(x, p, v, w, v / size, radius * w / size)

        return rates

    def sliding(self) -> Callable[[float, Array], tuple[float, ...]]:
        return self.regularised(1e-300)

    def impacts(self) -> list[Callable[[float, Array], float]]:
        """Events at the stops."""
        found: list[Callable[[float, Array], float]] = []
        for bound, side in ((self.stops.low, -1.0), (self.stops.high, 1.0)):
            if math.isfinite(bound):

                def at(_t: float, y: Array, bound: float = bound) -> float:
                    return float(y[0]) - bound

                at.terminal, at.direction = True, side  # type: ignore[attr-defined]
                found.append(at)
        return found


def lsoda(task: Task) -> Solve:
    """One smooth system, restarted at stops."""
    if task.name in PAIRS:
        return _pair(task, "LSODA")
    problem = _Problem(task)
    rates, impacts = problem.regularised(problem.rtol * problem.speed), problem.impacts()

    def solve() -> Read:
        t, y = 0.0, np.array(problem.start)
        while t < task.duration:
            found = problem.solve_ivp(
                rates, (t, task.duration), y, method="LSODA", rtol=problem.rtol,
                atol=1e-2 * problem.rtol, events=impacts or None,
            )  # fmt: skip
            if not found.success:
                raise RuntimeError(found.message)
            t, y = float(found.t[-1]), found.y[:, -1]
            if t < task.duration:
                y[2] *= -problem.stops.restitution
        return lambda: problem.state(y)

    return solve


def dop853(task: Task) -> Solve:
    """Phase by phase, each smooth."""
    if task.name in PAIRS:
        return _pair(task, "DOP853")
    if task.name in EVIDENT:
        raise LeftOutError("by hand it is evident that nothing moves: nothing is integrated")
    problem = _Problem(task)
    sliding = problem.sliding()

    def rest(_t: float, y: Array) -> float:
        _, _, v, w = y.tolist()
        return math.hypot(v, problem.radius * w) - REST * problem.speed

    rest.terminal, rest.direction = True, -1.0  # type: ignore[attr-defined]
    events = problem.impacts() + ([] if problem.smooth else [rest])
    at_rest = not problem.smooth and problem.joint.slide == problem.joint.spin == 0.0

    def solve() -> Read:
        t, y = 0.0, np.array(problem.start)
        if at_rest:
            t, y, _ = _rested(problem, t, y)
        while t < task.duration:
            found = problem.solve_ivp(
                sliding, (t, task.duration), y, method="DOP853", rtol=problem.rtol,
                atol=1e-2 * problem.rtol, events=events or None,
            )  # fmt: skip
            if not found.success:
                raise RuntimeError(found.message)
            t, y = float(found.t[-1]), found.y[:, -1]
            if t >= task.duration:
                break
            if not problem.smooth and rest(t, y) <= 1e-9 * problem.speed:
                t, y, held = _rested(problem, t, y)
                if held:
                    break
            else:
                y[2] *= -problem.stops.restitution
        return lambda: problem.state(y)

    return solve


def _rested(problem: _Problem, t: float, y: Array) -> tuple[float, Array, bool]:
    """The last of the slip as a straight line, and whether friction holds what then pulls."""
    x, p, v, w = y.tolist()
    size, left = math.hypot(v, problem.radius * w), 0.0
    if size > 0.0:
        d = v / size, problem.radius * w / size
        a, b = problem.accelerations(x, p, v, w, *d)
        left = size / -(a * d[0] + problem.radius * b * d[1])
    x, p = x + 0.5 * left * v, p + 0.5 * left * w
    pull = problem.accelerations(x, p, 0.0, 0.0, 0.0, 0.0)
    push = math.copysign(1.0, pull[0])
    back = problem.accelerations(x, p, 0.0, 0.0, push if pull[0] else 0.0, 0.0)
    held = pull[0] == 0.0 or back[0] * push <= 0.0
    speed = 0.0 if held else 2.0 * REST * problem.speed * push
    return t + left, np.array([x, p, speed, 0.0]), held


def _pair(task: Task, method: str) -> Solve:
    """Two free bodies, sliding throughout."""
    solve_ivp = package("scipy.integrate").solve_ivp
    pair = Equations(task.scene)
    if task.duration <= 0.0:
        raise LeftOutError("no motion")

    def solve() -> Read:
        found = solve_ivp(
            pair.rates, (0.0, task.duration), pair.start, method=method, rtol=task.value,
            atol=1e-2 * task.value,
        )  # fmt: skip
        if not found.success:
            raise RuntimeError(found.message)
        return lambda: pair.sample(found.y[:, -1])

    return solve


CONTESTANTS = (
    Contestant(
        "SciPy LSODA", "scipy", "hand", "tolerance", "reduced by hand, regularised", lsoda
    ),
    Contestant(
        "SciPy DOP853", "scipy", "hand", "tolerance", "reduced by hand, with events", dop853
    ),
)  # fmt: skip
