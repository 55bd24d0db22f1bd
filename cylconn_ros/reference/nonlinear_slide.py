"""Slide of one body with springs and dampers by table and compliant stops: m x'' = F(x, x').

Integrated from kink to kink (SciPy's DOP853, tolerance 1e-12): every knot of a table, the surface
of a stop, the depth at which its damping is full, and the rest of Coulomb friction are located as
events, so that each piece is smooth. Nothing of the connector's code is used.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.scene.scene import Scene
from cylconn_ros.scene.tables import DamperTable, SpringTable

Array = NDArray[np.float64]
Event = Callable[[float, Array], float]
Rates = Callable[[float, Array], list[float]]

SKIP = 1e-7  # s, over an event, by one step of a Runge-Kutta method of fourth order
CREEP = 1e-9  # m/s, below which a body within its friction rests
CREEPS = 1e-6  # of the friction, by which the force may exceed it there
_MOST_PIECES = 1000  # between kinks
_REPEATS = 8  # of a contraction by mu R m d/I, some thousandths


class Slide(NamedTuple):
    """State of the slide at the end, or where it passes the position asked for."""

    position: float  # m, in the slot
    velocity: float
    reaction: float  # N, of the stops
    stop_time: float  # s, when it came to rest to stay; inf: it did not
    time: float  # s, of this state


def slide(
    scene: Scene, start: float, rate: float, push: float, drag: float, end: float,
    eccentric: float = 0.0, until: float = math.nan,
) -> Slide:  # fmt: skip
    """The slide of a body from ``start`` (m) and ``rate`` to the time ``end``.

    Args:
        start: position in the slot, the reference of the elasticity unless the scene has one.
        push: constant force along the slot, N.
        drag: Coulomb friction, N.
        eccentric: of a turning body (:func:`turn_as_slide`), mu R m d: friction of the force m d
            sqrt(v^4 + a^2) that leads its mass centre around the axis, kg m.
        until: position at which it ends, if it passes it before the time ``end``.

    """
    from scipy.integrate import solve_ivp

    mass, rest = scene.body_b.mass, scene.reference.length
    rest = start if math.isnan(rest) else rest

    def total(x: float, v: float) -> float:
        return push + _elastic(scene, x - rest) + _viscous(scene, v) + stop_force(scene, x, v)

    def rates(_t: float, y: Sequence[float] | Array) -> list[float]:
        force = total(y[0], y[1])
        side = float(np.sign(y[1] or force))
        a = (force - drag * side) / mass
        for _ in range(_REPEATS if eccentric else 0):
            a = (force - side * (drag + eccentric * math.hypot(y[1] ** 2, a))) / mass
        return [y[1], a]

    functions: list[Event] = [_passes(0, rest + x) for x in scene.elasticity.table.positions]
    functions += [_passes(0, x) for x in _kinks(scene)]
    functions += [_passes(1, v) for v in (*scene.damping.table.rates, *((0.0,) if drag else ()))]
    functions += [_leaves(scene, each) for each in _sides(scene)]
    functions += [] if math.isnan(until) else [_passes(0, until)]
    for event in functions:
        event.terminal = True  # type: ignore[attr-defined]
    t, y = 0.0, [start, rate]
    for _ in range(_MOST_PIECES):
        if t >= end:
            break
        # a creep that an overdamped body never ends counts as rest, too
        if drag > 0.0 and abs(y[1]) < CREEP and abs(total(y[0], 0.0)) <= drag * (1.0 + CREEPS):
            return Slide(y[0], 0.0, stop_force(scene, y[0], 0.0), t, end)
        h = min(SKIP, end - t)
        y, t = _runge_kutta(rates, t, y, h), t + h
        if t >= end:
            break
        found = solve_ivp(
            rates, (t, end), y, method="DOP853", events=functions, rtol=1e-12, atol=1e-14
        )
        t, y = float(found.t[-1]), [float(each) for each in found.y[:, -1]]
        if not math.isnan(until) and len(found.t_events[-1]):
            break
    else:
        raise RuntimeError(f"stopped at t = {t:.9g} s after {_MOST_PIECES} pieces")
    return Slide(y[0], y[1], stop_force(scene, y[0], y[1]), math.inf, t)


def turn_as_slide(scene: Scene) -> Scene:
    """The scene whose slide is the turn of this one: angles for positions, moments for forces.

    Its mass is the moment of inertia about the slot of a body whose frame has the slot as x axis.
    """
    elastic, damping, stops, body = scene.elasticity, scene.damping, scene.stops, scene.body_b
    table, rates = elastic.rotational_table, damping.rotational_table
    inertia = body.inertia[0] + body.mass * (body.com[1] ** 2 + body.com[2] ** 2)
    return dataclasses.replace(
        scene,
        body_b=dataclasses.replace(body, mass=inertia),
        reference=dataclasses.replace(scene.reference, length=scene.reference.angle),
        elasticity=dataclasses.replace(
            elastic,
            k1=elastic.kr1,
            table=SpringTable(
                positions=table.angles, forces=table.moments, extrapolation=table.extrapolation
            ),
        ),
        damping=dataclasses.replace(
            damping,
            c1=damping.cr1,
            table=DamperTable(
                rates=rates.rates, forces=rates.moments, extrapolation=rates.extrapolation
            ),
        ),
        stops=dataclasses.replace(
            stops,
            l_min=stops.theta_min,
            l_max=stops.theta_max,
            stiffness=stops.rotational_stiffness,
            damping=stops.rotational_damping,
            damping_depth=stops.rotational_damping_depth,
        ),
    )


def _passes(k: int, at: float) -> Event:
    """Event: position (k = 0) or rate (1) passes a value."""
    return lambda _t, y: y[k] - at


def _leaves(scene: Scene, stop: tuple[float, float]) -> Event:
    """Event: the force of a compliant stop would change its sign."""
    return lambda _t, y: _push(scene, stop, y[0], y[1])


def _runge_kutta(rates: Rates, t: float, y: list[float], h: float) -> list[float]:
    y0 = np.array(y)
    k1 = np.array(rates(t, y0))
    k2 = np.array(rates(t + h / 2, y0 + h / 2 * k1))
    k3 = np.array(rates(t + h / 2, y0 + h / 2 * k2))
    k4 = np.array(rates(t + h, y0 + h * k3))
    return [float(each) for each in y0 + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)]


def _by_table(
    points: tuple[float, ...], values: tuple[float, ...], extrapolation: str, x: float
) -> float:
    if not points:
        return 0.0
    if extrapolation == "linear" and not points[0] <= x <= points[-1]:
        near, far = (0, 1) if x < points[0] else (-1, -2)
        slope = (values[near] - values[far]) / (points[near] - points[far])
        return values[near] + slope * (x - points[near])
    return float(np.interp(x, points, values))


def _elastic(scene: Scene, u: float) -> float:
    t = scene.elasticity.table
    return -scene.elasticity.k1 * u - _by_table(t.positions, t.forces, t.extrapolation, u)


def _viscous(scene: Scene, v: float) -> float:
    t = scene.damping.table
    return -scene.damping.c1 * v - _by_table(t.rates, t.forces, t.extrapolation, v)


def _sides(scene: Scene) -> list[tuple[float, float]]:
    """Side and position of each compliant stop."""
    stops = scene.stops
    both = ((-1.0, stops.l_min), (1.0, stops.l_max)) if not math.isnan(stops.stiffness) else ()
    return [(side, at) for side, at in both if not math.isnan(at)]


def _push(scene: Scene, stop: tuple[float, float], x: float, v: float) -> float:
    """Force k d + c min(d / d0, 1) d' of a stop, which acts where it and the depth d > 0, N."""
    stops, (side, at) = scene.stops, stop
    c = 0.0 if math.isnan(stops.damping) else stops.damping
    depth = side * (x - at)
    share = min(max(depth, 0.0) / stops.damping_depth, 1.0)
    return stops.stiffness * depth + c * share * side * v


def stop_force(scene: Scene, x: float, v: float) -> float:
    """Force of the compliant stops on the body, N."""
    found = 0.0
    for side, at in _sides(scene):
        if side * (x - at) > 0.0:
            found -= side * max(_push(scene, (side, at), x, v), 0.0)
    return found


def _kinks(scene: Scene) -> list[float]:
    """Positions at which the stops' force has a kink."""
    depth = scene.stops.damping_depth
    return [x for side, at in _sides(scene) for x in (at, at + side * depth)]
