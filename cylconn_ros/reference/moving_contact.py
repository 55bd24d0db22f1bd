r"""Reference solution of a sleeve that slides on a fixed shaft, its overlap and contact moving.

Without spin, in the shaft's axes, W the weight and load on the sleeve, T the moment of the load
about node b, c the mass centre from node b:

    f2, f3 = -W2, -W3                                  force of the shaft, across
    (m2, m3) = -T - c x m g + m l'' (c x e1)           its moment about node b, by d'Alembert
    M   = (m2 - kappa D f3, m3 + kappa D f2)           about the middle of the contact, D = l - l_L
    FN  = |Fr + 2 |M| / L + FCint|,    L = L0 + sigma D within its bounds; with kappa = 1/2 the
                                       middle moves within them only
    m l'' = W1 - offset - P sgn l',    P = mu FN, of the direction of l'

M is linear in l'', hence in P, and P the least root of a quadratic equation; without one the slide
jams. Slide and stops are integrated with DOP853 (SciPy) and located as events. Nothing is taken
from the connector but its parameters.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]
SLOPES = {"constant": 0.0, "increasing": 1.0, "decreasing": -1.0}
SHARES = {"body_b": 0.0, "between": 0.5, "body_a": 1.0}


@dataclasses.dataclass(frozen=True)
class Slide:
    """Result: slide since the start (m), velocity (m/s), time of the final rest (s; inf: none)."""

    distance: float
    velocity: float
    stop_time: float


class _Sleeve:
    """The equation of one sleeve."""

    def __init__(self, scene: Scene) -> None:
        body, load = scene.body_b, scene.plant.body_b.load
        axes = _matrix(scene.node_a.orientation)
        self.friction, self.mass = scene.friction, body.mass
        weight = body.mass * (axes.T @ scene.gravity)
        # the sleeve starts with the shaft's orientation, or its own parallel axis
        com = axes.T @ _matrix(scene.initial_pose(1)[3:]) @ body.com
        self.force = weight + axes.T @ load[:3]
        self.moment = axes.T @ load[3:] + np.cross(com, weight)
        self.arm = np.array([com[2], -com[1]])  # c x e1, components 2 and 3
        start = axes.T @ np.subtract(scene.initial_pose(1)[:3], scene.initial_pose(0)[:3])
        self.start = float(start[0])
        f = self.friction
        self.at = self.start if math.isnan(f.overlap_at) else f.overlap_at
        auto = "body_b" if f.overlap_change == "constant" else "between"
        self.share = SHARES[auto if f.contact_centre == "auto" else f.contact_centre]

    def traction(self, length: float, side: float) -> float:
        """P (N) at the slide ``length`` for a slide in the direction ``side``; inf: it jams."""
        f, moved = self.friction, length - self.at
        slope = SLOPES[f.overlap_change]
        overlap = f.overlap
        if slope != 0.0:
            overlap = min(max(f.overlap + slope * moved, f.overlap_min), f.overlap_max)
            moved = slope * (overlap - f.overlap) if self.share == 0.5 else moved
        mu = f.coefficient_forward if side > 0.0 else f.coefficient_backward
        mu = f.coefficient if math.isnan(mu) else mu
        lever = 2.0 / overlap if f.overlap > 0.0 and "bending" in f.inputs else 0.0
        pressed = f.preload if "preload" in f.inputs else 0.0
        if "radial" in f.inputs:
            pressed += math.hypot(self.force[1], self.force[2])
        if lever == 0.0:
            return mu * abs(pressed)
        push = self.force[0] - f.offset_force
        f2, f3 = -self.force[1], -self.force[2]
        base = -self.moment[1:] + push * self.arm
        base = base + self.share * moved * np.array([-f3, f2])
        by = -side * self.arm
        if not by.any():
            return mu * abs(pressed + lever * math.hypot(*base))
        # (P/mu - pressed)^2 = lever^2 |base + P by|^2, P >= mu pressed
        square = np.array([
            1.0 / mu**2 - lever**2 * (by @ by),
            -2.0 * pressed / mu - 2.0 * lever**2 * (base @ by),
            pressed**2 - lever**2 * (base @ base),
        ])  # fmt: skip
        roots = np.roots(square)
        real = roots.real[np.abs(roots.imag) <= 1e-9 * np.abs(roots.real)]
        real = real[real >= mu * pressed * (1.0 - 1e-12)]
        return float(real.min()) if len(real) else math.inf

    def acceleration(self, length: float, side: float) -> float:
        push = self.force[0] - self.friction.offset_force
        return (push - side * self.traction(length, side)) / self.mass

    def leaves(self, length: float) -> float:
        """Direction in which it leaves rest at ``length``; 0: it rests."""
        side = math.copysign(1.0, self.force[0] - self.friction.offset_force)
        return side if side * self.acceleration(length, side) > 0.0 else 0.0


def _matrix(q: tuple[float, ...]) -> Array:
    x, y, z, w = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def slide(scene: Scene, duration: float) -> Slide:
    """Solve ``scene`` for ``duration`` s: a sleeve on a fixed shaft, node b at its origin, no spin.

    Raises ImportError without SciPy.
    """
    from scipy.integrate import solve_ivp

    sleeve = _Sleeve(scene)
    axes = _matrix(scene.node_a.orientation)
    time, place = 0.0, sleeve.start
    speed, stopped = float((axes.T @ scene.initial_twist(1)[:3])[0]), math.inf
    while time < duration:
        side = math.copysign(1.0, speed) if speed != 0.0 else sleeve.leaves(place)
        if side == 0.0:
            break

        def rate(_: float, y: Array, side: float = side) -> list[float]:
            return [y[1], sleeve.acceleration(y[0], side)]

        def rests(_: float, y: Array, side: float = side) -> float:
            return float(side * y[1])

        rests.terminal, rests.direction = True, -1.0  # type: ignore[attr-defined]
        begin = [place, speed if speed != 0.0 else side * 1e-300]
        found = solve_ivp(
            rate, (time, duration), begin, "DOP853", events=rests, rtol=1e-12, atol=1e-14
        )
        time, place, speed = float(found.t[-1]), float(found.y[0, -1]), float(found.y[1, -1])
        stopped = math.inf
        if found.status == 1:
            stopped, speed = time, 0.0
    return Slide(place - sleeve.start, speed, stopped)
