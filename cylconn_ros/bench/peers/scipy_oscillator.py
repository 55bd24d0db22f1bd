r"""SciPy on hand-reduced equations: what one writes who has time to derive them for one scene.

Slide and spin under a constant normal force, x and s = (v, u = R w), a = mu FN/m, k = m R^2/I:

    x' = v      v' = -a v/|s|      u' = -k a u/|s|      until |s| = REST of its start

DOP853 with that event; what is left after it, v^2/(2a), is below 1e-12 of the distance. No array is
made by the equations, and tolerances are chosen by who measures.
"""

from __future__ import annotations

import math

import numpy as np

from cylconn_ros.bench.common.timing import Array
from cylconn_ros.scene.scene import Scene

REST = 1e-6


def slide_and_spin(scene: Scene, rtol: float) -> float:
    """Distance (m) to rest of a sleeve under its own weight across the shaft."""
    from scipy.integrate import solve_ivp

    v0, u0, a, k = reduced(scene)
    end = REST * math.hypot(v0, u0)

    def rates(_t: float, y: Array) -> tuple[float, float, float]:
        _, v, u = y.tolist()
        s = math.hypot(v, u)
        return v, -a * v / s, -k * a * u / s

    def rest(_t: float, y: Array) -> float:
        _, v, u = y.tolist()
        return math.hypot(v, u) - end

    rest.terminal = True  # type: ignore[attr-defined]
    longest = 10.0 * math.hypot(v0, u0) / (a * min(1.0, k))
    solution = solve_ivp(
        rates, (0.0, longest), np.array([0.0, v0, u0]), method="DOP853", rtol=rtol,
        atol=1e-2 * rtol, events=rest,
    )  # fmt: skip
    return float(solution.y[0, -1])


def reduced(scene: Scene) -> tuple[float, float, float, float]:
    """v0, u0, a and k of a sleeve whose mass centre is on a level shaft, at node b.

    Raises ValueError for any other scene.
    """
    body, friction = scene.body_b, scene.friction
    twist = scene.initial_twist(1)
    level = scene.node_a.orientation == (0.0, 0.0, 0.0, 1.0) and scene.gravity[0] == 0.0
    if not level or body.com != scene.node_b.position or friction.overlap > 0.0:
        raise ValueError("needs a mass centre at node b, a level shaft, and no bending")
    normal = body.mass * math.hypot(*scene.gravity) + friction.preload
    return (
        twist[0],
        friction.radius * twist[3],
        friction.coefficient * normal / body.mass,
        body.mass * friction.radius**2 / body.inertia[0],
    )
