"""SciPy: reduced equations, regularised with LSODA, or with events and DOP853.

- LSODA: the friction direction is s/sqrt(s^2 + eps^2), eps = rtol times the initial speed: one
  smooth stiff system for the whole motion. An impact on a stop ends one integration and starts the
  next.
- DOP853: slip is integrated until its speed is 1e-6 of the initial one; the remaining distance,
  v^2/(2a), is added in closed form. Then the joint sticks if friction holds the load, else it slips
  in the other direction.

Two free bodies: Newton-Euler equations with multipliers (reference/free_pair.py), in NumPy.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from cylconn_ros.bench.common.errors import NotApplicableError
from cylconn_ros.bench.peers.common import Joint, Stops
from cylconn_ros.bench.peers.equations import reduced
from cylconn_ros.bench.peers.solver import Array, EndState, Problem, Solve, Solver, package
from cylconn_ros.reference.free_pair import Equations

REST = 1e-6  # of the initial speed
TRIVIAL = {"incline_stick", "jam"}
PAIRS = {"free_flight", "hub_and_rotor"}


class _Reduced:
    """The reduced equations of a problem in both forms; the state is y = (x, p, v, w)."""

    def __init__(self, problem: Problem) -> None:
        self.rtol, self.duration = problem.value, problem.duration
        try:
            self.accelerations = reduced.equations(problem.name, problem.scene)
        except KeyError:
            raise NotApplicableError("no reduced equations for this scene") from None
        self.joint = Joint(problem.scene)
        self.start = [0.0, 0.0, self.joint.slide_rate, self.joint.spin_rate]
        friction = problem.scene.friction
        self.radius = friction.radius if friction.on else 1.0
        self.frictionless = not friction.on
        self.speed = math.hypot(self.start[2], self.radius * self.start[3]) or 1.0
        self.stops = Stops(problem.scene)
        self.solve_ivp = package("scipy.integrate").solve_ivp

    def state(self, y: Array) -> Array:
        """(26,) poses and twists."""
        slide, spin, v, w = map(float, y)
        return self.joint.state(self.joint.pose_a, self.joint.twist_a, slide, spin, (v, w))

    def regularised(self, eps: float) -> Callable[[float, Array], tuple[float, ...]]:
        """Rates y' with the friction direction s/sqrt(s^2 + eps^2), eps in m/s."""
        radius, accelerations = self.radius, self.accelerations

        def rates(_t: float, y: Array) -> tuple[float, ...]:
            x, p, v, w = y.tolist()
            size = math.sqrt(v * v + (radius * w) ** 2 + eps * eps)
            return v, w, *accelerations(x, p, v, w, v / size, radius * w / size)

        return rates

    def impacts(self) -> list[Callable[[float, Array], float]]:
        """Event functions of the stops."""
        found: list[Callable[[float, Array], float]] = []
        for bound, side in ((self.stops.low, -1.0), (self.stops.high, 1.0)):
            if math.isfinite(bound):

                def event(_t: float, y: Array, bound: float = bound) -> float:
                    return float(y[0]) - bound

                event.terminal, event.direction = True, side  # type: ignore[attr-defined]
                found.append(event)
        return found

    def integrate(
        self, rates: Callable[[float, Array], tuple[float, ...]], t: float, y: Array, method: str,
        events: list[Callable[[float, Array], float]],
    ) -> tuple[float, Array]:  # fmt: skip
        """Time and state at the first event or at the end. Raises RuntimeError."""
        found = self.solve_ivp(
            rates, (t, self.duration), y, method=method, rtol=self.rtol, atol=1e-2 * self.rtol,
            events=events or None,
        )  # fmt: skip
        return _last(found)


def lsoda(problem: Problem) -> Solve:
    """One smooth system, restarted at impacts."""
    if problem.name in PAIRS:
        return _pair(problem, "LSODA")
    system = _Reduced(problem)
    rates, impacts = system.regularised(system.rtol * system.speed), system.impacts()

    def solve() -> EndState:
        t, y = 0.0, np.array(system.start)
        while t < problem.duration:
            t, y = system.integrate(rates, t, y, "LSODA", impacts)
            if t < problem.duration:
                y[2] *= -system.stops.restitution
        return partial(system.state, y)

    return solve


def dop853(problem: Problem) -> Solve:
    """Phase by phase between events; each phase is smooth."""
    if problem.name in PAIRS:
        return _pair(problem, "DOP853")
    if problem.name in TRIVIAL:
        raise NotApplicableError("the reduced equations show that nothing moves")
    system = _Reduced(problem)
    sliding = system.regularised(1e-300)

    def rest(_t: float, y: Array) -> float:
        _, _, v, w = y.tolist()
        return math.hypot(v, system.radius * w) - REST * system.speed

    rest.terminal, rest.direction = True, -1.0  # type: ignore[attr-defined]
    events = system.impacts() + ([] if system.frictionless else [rest])
    starts_at_rest = not system.frictionless and system.start[2] == system.start[3] == 0.0

    def solve() -> EndState:
        t, y = 0.0, np.array(system.start)
        if starts_at_rest:
            t, y, _ = _come_to_rest(system, t, y)
        while t < problem.duration:
            t, y = system.integrate(sliding, t, y, "DOP853", events)
            if t >= problem.duration:
                break
            if not system.frictionless and rest(t, y) <= 1e-9 * system.speed:
                t, y, sticks = _come_to_rest(system, t, y)
                if sticks:
                    break
            else:
                y[2] *= -system.stops.restitution
        return partial(system.state, y)

    return solve


def _come_to_rest(system: _Reduced, t: float, y: Array) -> tuple[float, Array, bool]:
    """Time and state when the slip ends, at constant deceleration; and whether the joint sticks."""
    x, p, v, w = y.tolist()
    size, remaining = math.hypot(v, system.radius * w), 0.0
    if size > 0.0:
        d = v / size, system.radius * w / size
        a, b = system.accelerations(x, p, v, w, *d)
        remaining = size / -(a * d[0] + system.radius * b * d[1])
    x, p = x + 0.5 * remaining * v, p + 0.5 * remaining * w
    load = system.accelerations(x, p, 0.0, 0.0, 0.0, 0.0)
    sign = math.copysign(1.0, load[0])
    with_friction = system.accelerations(x, p, 0.0, 0.0, sign if load[0] else 0.0, 0.0)
    sticks = load[0] == 0.0 or with_friction[0] * sign <= 0.0
    speed = 0.0 if sticks else 2.0 * REST * system.speed * sign
    return t + remaining, np.array([x, p, speed, 0.0]), sticks


def _pair(problem: Problem, method: str) -> Solve:
    """Two free bodies that slip all the time."""
    solve_ivp = package("scipy.integrate").solve_ivp
    pair = Equations(problem.scene)

    def solve() -> EndState:
        found = solve_ivp(
            pair.rates, (0.0, problem.duration), pair.start, method=method, rtol=problem.value,
            atol=1e-2 * problem.value,
        )  # fmt: skip
        return partial(pair.sample, _last(found)[1])

    return solve


def _last(solution: Any) -> tuple[float, Array]:
    """Last time and state of a SciPy solution. Raises RuntimeError if it failed."""
    if not solution.success:
        raise RuntimeError(solution.message)
    return float(solution.t[-1]), solution.y[:, -1]


SOLVERS = (
    Solver(
        "SciPy LSODA", "scipy", "reduced", "tolerance", "reduced equations, regularised friction",
        lsoda,
    ),
    Solver(
        "SciPy DOP853", "scipy", "reduced", "tolerance", "reduced equations with events", dop853
    ),
)  # fmt: skip
