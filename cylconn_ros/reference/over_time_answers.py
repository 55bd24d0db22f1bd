"""Reference values of the bundled scenes whose loads or commands change over time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from cylconn_ros.core import layout
from cylconn_ros.reference.answers import Expected, distance, length, stop_time, velocity
from cylconn_ros.scene.amplitude import Amplitude
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.run import Run

BREAKAWAY = "first jump"


def brake(scene: Scene, _end: float) -> list[Expected]:
    """Constant deceleration once the brake clamps; it closes over a microsecond."""
    f, v = scene.friction, scene.plant.body_b.twist[0]
    begin, closed = scene.plant.preload_amplitude.times
    a = f.coefficient * f.preload / scene.body_b.mass
    ramp = closed - begin
    lost = 0.5 * a * ramp
    rest = closed + (v - lost) / a
    moved = v * closed - a * ramp**2 / 6.0 + (v - lost) ** 2 / (2.0 * a)
    return [
        # the brake closes within a step, of which the mean force acts
        Expected("stop time", "s", stop_time, rest, 1e-9),
        Expected("distance", "m", distance, moved, 1e-9, 1.0),
    ]


def den_hartog(scene: Scene) -> tuple[float, float]:
    """Amplitude (m) and phase (rad) of the steady motion of an oscillator with dry friction.

    With the force P cos(w t + phase) the mass is at its turning point at t = 0, if it does not stop
    within a half cycle. a = P/k, f = F/k, b = w/wn, V = 1/(1 - b^2),
    H = sin(pi/b)/(b (1 + cos(pi/b))):

        amplitude = sqrt((a V)^2 - (f H)^2),    sin(phase) = -f H/(a V)
    """
    stiffness, load = scene.elasticity.k1, scene.plant.body_b
    a = load.load[0] / stiffness
    f = scene.friction.coefficient * scene.friction.preload / stiffness
    omega = 2.0 * math.pi * load.load_amplitude.frequency
    b = omega / math.sqrt(stiffness / scene.body_b.mass)
    half = math.pi / b
    v, h = 1.0 / (1.0 - b * b), math.sin(half) / (b * (1.0 + math.cos(half)))
    amplitude = math.sqrt((a * v) ** 2 - (f * h) ** 2)
    return amplitude, math.atan2(-f * h / (a * v), amplitude / (a * v))


def forced_oscillator(scene: Scene, end: float) -> list[Expected]:
    """Amplitude of the last cycle and position at the end, in closed form over a half cycle."""
    amplitude, phase = den_hartog(scene)
    stiffness, load = scene.elasticity.k1, scene.plant.body_b
    omega = 2.0 * math.pi * load.load_amplitude.frequency
    natural = math.sqrt(stiffness / scene.body_b.mass)
    f = scene.friction.coefficient * scene.friction.preload / stiffness
    half = math.floor(end * omega / math.pi)
    t = end - half * math.pi / omega
    forced = load.load[0] / stiffness / (1.0 - (omega / natural) ** 2)
    sine = omega / natural * forced * math.sin(phase)
    place = -f * math.cos(natural * t) + sine * math.sin(natural * t)
    place += forced * math.cos(omega * t + phase) + f
    return [
        # a reversal within a step is of first order
        Expected("amplitude", "m", _amplitude, amplitude, 7e-4, 1.0),
        Expected("position", "m", length, (-1.0) ** half * place, 3e-4, 1.0),
    ]


def _amplitude(run: Run) -> float:
    """Half the travel of the last cycle, its turning points by a parabola through samples, m."""
    cycle = 1.0 / run.scene.plant.body_b.load_amplitude.frequency
    count = math.ceil(cycle / run.scene.period) + 2
    x = run["length"][-count:]
    return 0.5 * (_extreme(x) + _extreme(-x))


def _extreme(x: np.ndarray) -> float:
    """Greatest value of a parabola through the greatest sample and its neighbours."""
    k = int(np.argmax(x[1:-1])) + 1
    before, at, after = (float(each) for each in x[k - 1 : k + 2])
    curve = before - 2.0 * at + after
    return at - (after - before) ** 2 / (8.0 * curve) if curve < 0.0 else at


def stick_slip(scene: Scene, end: float) -> list[Expected]:
    """The first jump, at F_s/(k v), exactly; the later ones by DOP853 with events."""
    f, stiffness = scene.friction, scene.elasticity.k1
    speed = scene.command.slide.force / scene.plant.slide_amplitude.times[1] / stiffness
    static, kinetic = (mu * f.preload for mu in (f.static_coefficient, f.coefficient))
    first = static / (stiffness * speed)
    jumps, place = _jumps(scene, speed, static, kinetic, end)
    period = jumps[1] - jumps[0] if len(jumps) > 1 else math.nan
    return [
        Expected(BREAKAWAY, "s", _jump(0), first, 1e-3, 1.0),
        Expected(
            "from jump to jump", "s", lambda run: _jump(1)(run) - _jump(0)(run), period, 1e-2, 1.0
        ),
        Expected("distance", "m", distance, place, 4e-4),
    ]


def _jumps(
    scene: Scene, speed: float, static: float, kinetic: float, end: float
) -> tuple[list[float], float]:
    """Times of the jumps, and the position at the end."""
    from scipy.integrate import solve_ivp

    mass, stiffness, viscous = scene.body_b.mass, scene.elasticity.k1, scene.damping.c1
    decay = scene.friction.decay

    def rates(t: float, y: Sequence[float]) -> list[float]:
        rough = kinetic + (static - kinetic) * math.exp(-decay * abs(y[1]))
        pull = stiffness * (speed * t - y[0]) - viscous * y[1] - rough
        return [y[1], pull / mass]

    def rests(_t: float, y: Sequence[float]) -> float:
        return y[1]

    rests.terminal, rests.direction = True, -1  # type: ignore[attr-defined]
    t, x = 0.0, 0.0
    found: list[float] = []
    while True:
        t = max(t, x / speed + static / (stiffness * speed))
        if t >= end:
            return found, x
        found.append(t)
        # From rest the pull exceeds friction by an amount that grows with the square of time.
        solved = solve_ivp(
            rates, (t, end), [x, 1e-12], method="DOP853", events=rests, rtol=1e-11, atol=1e-14
        )
        x, t = float(solved.y[0, -1]), float(solved.t[-1])
        if t >= end:
            return found, x


def _jump(number: int) -> Callable[[Run], float]:
    """A function of a run: the time of its jump of this number from rest, s."""

    def of(run: Run) -> float:
        slides = run["regime"] == layout.SLIP
        begins = np.flatnonzero(slides[1:] & ~slides[:-1]) + 1
        return float(run.time[begins[number]]) if len(begins) > number else math.nan

    return of


def linear_bearing(scene: Scene, end: float) -> list[Expected]:
    """The carriage under forces that are linear between kinks: cubics, with rest and breakaway."""
    f, mass = scene.friction, scene.body_b.mass
    brake_closes, pull = scene.plant.preload_amplitude, scene.plant.body_b.load_amplitude
    load = scene.plant.body_b.load[0]

    def forces(t: float) -> tuple[float, float]:
        """Load and greatest friction at t."""
        return load * _table(pull, t), f.coefficient * f.preload * _table(brake_closes, t)

    kinks = sorted({0.0, *brake_closes.times, *pull.times, end})
    x, v, stopped = 0.0, scene.plant.body_b.twist[0], math.nan
    for begin, until in itertools.pairwise(t for t in kinks if t <= end):
        t = begin
        while t < until:
            (p0, r0), (p1, r1) = forces(t), forces(until)
            h = until - t
            if v == 0.0:  # at rest until the load exceeds the friction
                if p0 <= r0 and p1 <= r1:
                    break
                t += h * max(r0 - p0, 0.0) / ((r0 - p0) - (r1 - p1)) if p0 < r0 else 0.0
                (p0, r0), h = forces(t), until - t
            a, slope = (p0 - r0) / mass, ((p1 - r1) - (p0 - r0)) / mass / h
            roots = np.roots([0.5 * slope, a, v]) if v > 0.0 else np.zeros(0)
            rest = [r.real for r in roots if abs(r.imag) < 1e-12 and 0.0 < r.real <= h]
            h = min([h, *rest])
            x += v * h + a * h**2 / 2.0 + slope * h**3 / 6.0
            v, t = (0.0 if rest else v + a * h + slope * h**2 / 2.0), t + h
            stopped = t if rest else stopped
    return [
        Expected("brake holds", "s", _first_stop, stopped, 1e-5),
        Expected("distance", "m", distance, x, 1e-5),
        Expected("velocity", "m/s", velocity, v, 3e-5),
    ]


def _table(given: Amplitude, t: float) -> float:
    return float(np.interp(t, given.times, given.values))


def _first_stop(run: Run) -> float:
    """Time at which it comes to rest for the first time, s; NaN: never."""
    stopped = np.flatnonzero(run["stop_time"] >= 0.0)
    if not len(stopped):
        return math.nan
    return float(run.time[stopped[0]] + run["stop_time"][stopped[0]])
