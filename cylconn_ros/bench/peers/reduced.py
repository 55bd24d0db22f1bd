"""Scenes reduced by hand to the fewest equations, in plain floats: what one derives for one scene.

Slide and spin with s = (v, u = R w) and its direction d, friction P against it:

    one_way(a, b)   v' = a - b d1                      weight along the slot, friction P = m b
    disc(b, k)      v' = -b d1, u' = -k b d2           constant normal force, k = m R^2/I
    rotor(q)        w' = -q w^2                        its own centrifugal load
    pressed(b, c)   v' = -b d1/(1 - c |d1|)            friction that presses itself on
    Sleeve          a sleeve off its balance on an inclined shaft: one scalar equation for FN
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cylconn_ros.bench.common.frames import rotation, tensor
from cylconn_ros.bench.peers.common import Joint
from cylconn_ros.scene.scene import Scene

Accelerations = Callable[[float, float, float, float, float, float], tuple[float, float]]
"""(slide, spin, v, w, d1, d2) -> v', w': d is the direction that friction opposes, |d| <= 1."""


def along(scene: Scene) -> float:
    """Gravity along the slot, m/s^2."""
    return float(np.array(scene.gravity) @ rotation(scene.node_a.orientation)[:, 0])


def across(scene: Scene) -> float:
    """Gravity across the slot, m/s^2."""
    return math.sqrt(max(sum(g * g for g in scene.gravity) - along(scene) ** 2, 0.0))


def one_way(a: float, b: float, spring: float = 0.0, rest: float = 0.0) -> Accelerations:
    """Slide alone: weight, constant friction, and a spring (1/s^2) that is slack at ``rest``."""
    return lambda x, _p, _v, _w, d1, _d2: (a - spring * (x - rest) - b * d1, 0.0)


def disc(b: float, k: float, radius: float) -> Accelerations:
    """Slide and spin under a constant normal force."""
    return lambda _x, _p, _v, _w, d1, d2: (-b * d1, -k * b * d2 / radius)


def rotor(q: float) -> Accelerations:
    """A spin that brakes itself."""
    return lambda _x, _p, _v, w, _d1, d2: (0.0, -q * w * w * d2)


def pressed(b: float, c: float) -> Accelerations:
    """Friction that bends the sleeve and so presses it on; no solution where c |d1| >= 1."""
    return lambda _x, _p, _v, _w, d1, _d2: (-b * d1 / (1.0 - c * abs(d1)), 0.0)


class Sleeve:
    """An unbalanced sleeve on a fixed shaft, in the shaft's axes: see reference/fixed_shaft.py."""

    def __init__(self, scene: Scene) -> None:
        shaft = rotation(scene.initial_pose(0)[3:]) @ rotation(scene.node_a.orientation)
        turn = shaft.T @ rotation(scene.initial_pose(1)[3:])
        body, f = scene.body_b, scene.friction
        self.m, self.mu, self.R, self.pre = body.mass, f.coefficient, f.radius, f.preload
        self.bend = 2.0 / f.overlap if f.overlap > 0.0 else 0.0
        self.rho = (turn @ (np.array(body.com) - np.array(scene.node_b.position))).tolist()
        inertia = turn @ tensor(body) @ turn.T
        self.i11, self.i12, self.i13 = inertia[0].tolist()
        self.g = (shaft.T @ np.array(scene.gravity)).tolist()
        self.J = self.i11 + self.m * (self.rho[1] ** 2 + self.rho[2] ** 2)
        self.last = 0.0

    def __call__(
        self, _x: float, p: float, _v: float, w: float, d1: float, d2: float
    ) -> tuple[float, float]:
        """v', w'; FN by the secant method from where it was last."""
        c, s = math.cos(p), math.sin(p)
        r1, r2, r3 = (
            self.rho[0],
            c * self.rho[1] - s * self.rho[2],
            s * self.rho[1] + c * self.rho[2],
        )
        i12, i13 = c * self.i12 - s * self.i13, s * self.i12 + c * self.i13
        m, (g1, g2, g3), ww = self.m, self.g, w * w
        weight = m * (r2 * g3 - r3 * g2)

        def of(normal: float) -> tuple[float, float, float]:
            f1 = -self.mu * normal * d1
            a = g1 + f1 / m
            b = (weight - self.mu * normal * self.R * d2) / self.J
            f2, f3 = m * (-b * r3 - ww * r2 - g2), m * (b * r2 - ww * r3 - g3)
            m2 = r3 * f1 - r1 * f3 + i12 * b - ww * i13
            m3 = r1 * f2 - r2 * f1 + i13 * b + ww * i12
            return a, b, abs(math.hypot(f2, f3) + self.bend * math.hypot(m2, m3) + self.pre)

        old = self.last
        a, b, new = of(old)
        gap = new - old
        n = new
        for _ in range(50):
            a, b, new = of(n)
            left = new - n
            if abs(left) <= 1e-14 * n or left == gap:
                break
            n, old, gap = n - left * (n - old) / (left - gap), n, left
        self.last = n
        return a, b


def equations(name: str, scene: Scene) -> Accelerations:
    """The equations of a scene of the benchmark, by its name. Raises KeyError."""
    body, f = scene.body_b, scene.friction
    m, mu = body.mass, f.coefficient
    b = mu * (across(scene) + f.preload / m)
    if name == "dry_friction_oscillator":
        at = scene.initial_pose(1)[0] - scene.reference.length
        return one_way(0.0, b, scene.elasticity.k1 / m, -at)
    if name in ("free_slide", "coast", "incline_stick", "between_stops"):
        return one_way(along(scene), b)
    if name == "slide_and_spin":
        return disc(b, m * f.radius**2 / body.inertia[0], f.radius)
    if name == "eccentric_rotor":
        r = math.hypot(*body.com)
        gamma = mu * f.radius * m * r / (body.inertia[0] + m * r * r)
        return rotor(gamma / math.sqrt(1.0 - gamma * gamma))
    if name in ("near_jam", "jam"):
        return pressed(b, 2.0 * mu * abs(body.com[2]) / f.overlap)
    if name == "demo":
        return Sleeve(scene)
    raise KeyError(name)


def start(scene: Scene) -> tuple[Joint, list[float]]:
    """The joint, and slide, spin and their rates at the start."""
    joint = Joint(scene)
    return joint, [0.0, 0.0, joint.slide, joint.spin]
