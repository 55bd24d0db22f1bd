"""Scenes of the precision benchmark beside the bundled ones: published cases, and further effects.

Their references are closed forms, or the one equation of motion of a slide,

    m x'' = P(t) + m g - k (x - x0) - c x' - F(|x'|) sign(x'),

integrated by SciPy's DOP853 to 1e-12 with stick, reversal and stop located as events. Nothing of
the connector's code is used.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cylconn_ros.scene.scene import Scene

BLOCK: Mapping[str, Any] = {
    "node_a.orientation": (0.0, 0.0, 0.0, 1.0),
    "period": 1e-3,
    "gravity": (0.0, 0.0, 0.0),
    "body_a.kind": "fixed",
    "body_b.kind": "free",
    "body_b.mass": 1.0,
    "body_b.inertia": (0.01, 0.0, 0.0, 0.01, 0.0, 0.01),
}
"""A block of 1 kg whose slot is the x axis of the world."""

_MOST_PIECES = 10_000


def spring_hard_stop() -> Scene:
    """Spring, Stribeck friction, damper and a hard stop (Modelica's example Friction)."""
    return Scene.from_parameters({
        **BLOCK,
        "friction.radius": 0.01, "friction.coefficient": 3.0, "friction.static_coefficient": 8.0,
        "friction.decay": 2.0, "friction.preload": 1.0,
        "elasticity.k1": 500.0, "damping.c1": 1.0, "reference.length": -0.25,
        "stops.l_min": -0.4,
        "plant.body_b.twist": (-5.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    })  # fmt: skip


def friction_table() -> Scene:
    """A mass with a table of friction over speed, driven (Modelica's example Friction)."""
    rates = [12.0 * i / 49.0 for i in range(50)]
    return Scene.from_parameters({
        **BLOCK,
        "friction.radius": 0.01, "friction.preload": 1.0,
        "friction.table.rates": rates, "friction.table.forces": [0.0],
        "friction.table.values": [5.0 + v + 10.0 * math.exp(-2.0 * v) for v in rates],
        "plant.body_b.load": (25.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        "plant.body_b.load_amplitude.frequency": 0.25,
    })  # fmt: skip


def friction_oscillator() -> Scene:
    """Siconos' FrictionOscillator: a mass on a spring with dry friction, unit numbers."""
    return Scene.from_parameters({
        **BLOCK,
        "friction.radius": 0.01, "friction.coefficient": 1.0, "friction.preload": 1.0,
        "elasticity.k1": 1.0, "reference.length": 0.0,
        "body_b.pose": (12.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        "plant.body_b.twist": (6.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    })  # fmt: skip


def stick_slip() -> Scene:
    """The bundled scene of that name, its pull as a load on the body."""
    return Scene.from_parameters({
        **BLOCK,
        "friction.radius": 0.01, "friction.coefficient": 1.0, "friction.static_coefficient": 1.5,
        "friction.decay": 1000.0, "friction.preload": 1.0,
        "elasticity.k1": 2.0, "damping.c1": 0.4,
        "plant.body_b.load": (4.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        "plant.body_b.load_amplitude.times": (0.0, 20.0),
        "plant.body_b.load_amplitude.values": (0.0, 1.0),
    })  # fmt: skip


def bounce_under_load() -> Scene:
    """A body dropped from 1 m on a stop, restitution 0.8; its weight acts along the slot."""
    return Scene.from_parameters({
        **BLOCK,
        "gravity": (-9.81, 0.0, 0.0),
        "body_b.pose": (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        "stops.l_min": 0.0, "stops.restitution": 0.8,
    })  # fmt: skip


def two_rails() -> tuple[Scene, Scene]:
    """A drawer on two rails without overlap, its mass centre 0.1 m from the middle."""
    rails = []
    for side in (0.25, -0.25):
        rails.append(Scene.from_parameters({
            **BLOCK,
            "gravity": (0.0, 0.0, -9.81),
            "body_b.mass": 12.0, "body_b.com": (0.0, 0.1, 0.0),
            "body_b.inertia": (0.3, 0.0, 0.0, 0.4, 0.0, 0.6),
            "node_a.position": (0.0, side, 0.0), "node_b.position": (0.0, side, 0.0),
            "friction.radius": 0.01, "friction.coefficient": 0.1,
            "plant.body_b.twist": (0.7, 0.0, 0.0, 0.0, 0.0, 0.0),
        }))  # fmt: skip
    return rails[0], rails[1]


def bounced(height: float, gravity: float, restitution: float, time: float) -> tuple[float, float]:
    """Height (m) and velocity (m/s) of a body dropped at rest from ``height``, closed form.

    The speed after impact n is e^n v1; a flight takes twice that over g. Not beyond its rest at
    t1 (1 + e)/(1 - e).
    """
    speed = math.sqrt(2.0 * gravity * height)
    t = speed / gravity
    if time <= t:
        return height - 0.5 * gravity * time**2, -gravity * time
    while True:
        speed *= restitution
        if time <= t + 2.0 * speed / gravity:
            t = time - t
            return speed * t - 0.5 * gravity * t**2, speed - gravity * t
        t += 2.0 * speed / gravity


def oscillation(scene: Scene) -> float:
    """Where a mass on a spring comes to rest under constant dry friction, m: closed form.

    Half oscillations about -+F/k; from one turning point to the next the deflection loses 2F/k.
    """
    k, f = scene.elasticity.k1, scene.friction.coefficient * scene.friction.preload
    x0, v0 = scene.initial_pose(1)[0] - scene.reference.length, scene.initial_twist(1)[0]
    dead = f / k
    x = math.hypot(x0 + dead, v0 / math.sqrt(k / scene.body_b.mass)) - dead  # v0 > 0
    while abs(x) > dead:
        x = -math.copysign(abs(x), x) + math.copysign(2.0 * dead, x)
    return x


def slide(scene: Scene, end: float) -> tuple[float, float]:
    """Slide (m) and velocity (m/s) of a body alone on its slot at ``end``, s.

    Its friction is F(|v|) = mu(|v|) FCint; its load and springs act along the slot.
    """
    from scipy.integrate import solve_ivp

    f, m, k, c = scene.friction, scene.body_b.mass, scene.elasticity.k1, scene.damping.c1
    start = scene.initial_pose(1)[0]
    rest = 0.0 if math.isnan(scene.reference.length) else scene.reference.length - start
    low = -math.inf if math.isnan(scene.stops.l_min) else scene.stops.l_min - start
    load, factor = scene.plant.body_b.load[0], scene.plant.body_b.load_amplitude

    def rough(v: float) -> float:
        if f.table is not None:
            return f.preload * float(np.interp(v, f.table.rates, f.table.values))
        static = f.coefficient if math.isnan(f.static_coefficient) else f.static_coefficient
        return f.preload * (f.coefficient + (static - f.coefficient) * math.exp(-f.decay * v))

    def push(t: float, x: float, v: float) -> float:
        return load * factor.at(t) - k * (x - rest) - c * v

    def breaks(t: float, y: Sequence[float]) -> float:
        return abs(push(t, y[0], 0.0)) - rough(0.0)

    def turns(_t: float, y: Sequence[float]) -> float:
        return y[1]

    def hits(_t: float, y: Sequence[float]) -> float:
        return y[0] - low

    for event in (breaks, turns, hits):
        event.terminal = True  # type: ignore[union-attr]
    hits.direction = -1.0  # type: ignore[attr-defined]
    options: dict[str, Any] = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14}
    t, y = 0.0, [0.0, scene.initial_twist(1)[0]]
    for _ in range(_MOST_PIECES):
        if t >= end:
            return y[0], y[1]
        if y[1] == 0.0 and breaks(t, y) <= 1e-12:  # at rest until the load exceeds the friction
            found = solve_ivp(
                lambda _t, _y: [0.0, 0.0], (t, end), y, events=breaks, max_step=0.1, **options
            )
            t = float(found.t[-1])
            if t >= end:
                return y[0], y[1]
        side = math.copysign(1.0, y[1] or push(t, y[0], 0.0))

        def rates(t: float, y: Sequence[float], side: float = side) -> list[float]:
            return [y[1], (push(t, y[0], y[1]) - side * rough(abs(y[1]))) / m]

        turns.direction = -side  # type: ignore[attr-defined]
        y[1] = y[1] or 1e-12 * side
        events = [turns, hits] if math.isfinite(low) else [turns]
        # a table has kinks, on which steps must not be long
        longest = 1e-3 if f.table is not None else math.inf
        found = solve_ivp(rates, (t, end), y, events=events, max_step=longest, **options)
        t, y = float(found.t[-1]), [float(each) for each in found.y[:, -1]]
        if found.t_events[0].size:
            y[1] = 0.0
        elif found.status == 1:
            y = [low, -scene.stops.restitution * y[1]]
    raise RuntimeError(f"stopped at t = {t:.9g} s after {_MOST_PIECES} pieces")
