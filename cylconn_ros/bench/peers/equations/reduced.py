"""Equations of motion reduced for individual scenes to the fewest coordinates, in plain floats.

Coordinates are slide x and spin p with the slip s = (v, u = R w), its direction d = s/|s|, and the
friction P against it:

    slide_only(a, b)      v' = a - b d1                    weight along the axis, friction P = m b
    constant_load(b, k)   v' = -b d1, u' = -k b d2         constant normal force, k = m R^2/I
    rotor(q)              w' = -q w^2                      normal force from its own rotation
    self_loading(b, c)    v' = -b d1/(1 - c |d1|)          friction that increases the normal force
    Sleeve                an unbalanced sleeve on an inclined shaft: one scalar equation for FN
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cylconn_ros.bench.common.frames import inertia_tensor, rotation
from cylconn_ros.scene.scene import Scene

Accelerations = Callable[[float, float, float, float, float, float], tuple[float, float]]
"""(x, p, v, w, d1, d2) -> v', w'; friction opposes the direction d, |d| <= 1."""


def gravity_along(scene: Scene) -> float:
    """Component of gravity along the joint axis, m/s^2."""
    return float(np.array(scene.gravity) @ rotation(scene.node_a.orientation)[:, 0])


def gravity_across(scene: Scene) -> float:
    """Component of gravity normal to the joint axis, m/s^2."""
    square = sum(g * g for g in scene.gravity) - gravity_along(scene) ** 2
    return math.sqrt(max(square, 0.0))


def slide_only(a: float, b: float, spring: float = 0.0, rest: float = 0.0) -> Accelerations:
    """Slide with weight, constant friction, and a spring (1/s^2) without force at ``rest`` (m)."""
    return lambda x, _p, _v, _w, d1, _d2: (a - spring * (x - rest) - b * d1, 0.0)


def constant_load(b: float, k: float, radius: float) -> Accelerations:
    """Slide and spin under a constant normal force."""
    return lambda _x, _p, _v, _w, d1, d2: (-b * d1, -k * b * d2 / radius)


def rotor(q: float) -> Accelerations:
    """A spin braked by the friction of its own centrifugal load."""
    return lambda _x, _p, _v, w, _d1, d2: (0.0, -q * w * w * d2)


def self_loading(b: float, c: float) -> Accelerations:
    """Friction whose bending moment increases the normal force; no solution if c |d1| >= 1."""
    return lambda _x, _p, _v, _w, d1, _d2: (-b * d1 / (1.0 - c * abs(d1)), 0.0)


class Sleeve:
    """An unbalanced sleeve on a fixed shaft, in shaft axes; see reference/fixed_shaft.py."""

    def __init__(self, scene: Scene) -> None:
        shaft = rotation(scene.initial_pose(0)[3:]) @ rotation(scene.node_a.orientation)
        axes = shaft.T @ rotation(scene.initial_pose(1)[3:])
        body, f = scene.body_b, scene.friction
        self.m, self.mu, self.R, self.preload = body.mass, f.coefficient, f.radius, f.preload
        self.bend = 2.0 / f.overlap if f.overlap > 0.0 else 0.0
        self.rho = (axes @ (np.array(body.com) - np.array(scene.node_b.position))).tolist()
        inertia = axes @ inertia_tensor(body) @ axes.T
        self.i11, self.i12, self.i13 = inertia[0].tolist()
        self.g = (shaft.T @ np.array(scene.gravity)).tolist()
        self.J = self.i11 + self.m * (self.rho[1] ** 2 + self.rho[2] ** 2)
        self.last_normal_force = 0.0

    def __call__(
        self, _x: float, p: float, _v: float, w: float, d1: float, d2: float
    ) -> tuple[float, float]:
        """v', w'; FN by the secant method, started from its previous value."""
        c, s = math.cos(p), math.sin(p)
        r1, r2, r3 = (
            self.rho[0],
            c * self.rho[1] - s * self.rho[2],
            s * self.rho[1] + c * self.rho[2],
        )
        i12, i13 = c * self.i12 - s * self.i13, s * self.i12 + c * self.i13
        m, (g1, g2, g3), ww = self.m, self.g, w * w
        weight = m * (r2 * g3 - r3 * g2)

        def step(normal: float) -> tuple[float, float, float]:
            """Accelerations, and the normal force of the reactions, for a given FN."""
            f1 = -self.mu * normal * d1
            a = g1 + f1 / m
            b = (weight - self.mu * normal * self.R * d2) / self.J
            f2, f3 = m * (-b * r3 - ww * r2 - g2), m * (b * r2 - ww * r3 - g3)
            m2 = r3 * f1 - r1 * f3 + i12 * b - ww * i13
            m3 = r1 * f2 - r2 * f1 + i13 * b + ww * i12
            return a, b, abs(math.hypot(f2, f3) + self.bend * math.hypot(m2, m3) + self.preload)

        previous = self.last_normal_force
        a, b, new = step(previous)
        previous_residual = new - previous
        n = new
        for _ in range(50):
            a, b, new = step(n)
            residual = new - n
            if abs(residual) <= 1e-14 * n or residual == previous_residual:
                break
            slope = (n - previous) / (residual - previous_residual)
            n, previous, previous_residual = n - residual * slope, n, residual
        self.last_normal_force = n
        return a, b


def equations(name: str, scene: Scene) -> Accelerations:
    """The reduced equations of a benchmark scene, by its name. Raises KeyError."""
    body, f = scene.body_b, scene.friction
    m, mu = body.mass, f.coefficient
    b = mu * (gravity_across(scene) + f.preload / m)
    if name == "dry_friction_oscillator":
        deflection = scene.initial_pose(1)[0] - scene.reference.length
        return slide_only(0.0, b, scene.elasticity.k1 / m, -deflection)
    if name in ("free_slide", "coast", "incline_stick", "between_stops"):
        return slide_only(gravity_along(scene), b)
    if name == "slide_and_spin":
        return constant_load(b, m * f.radius**2 / body.inertia[0], f.radius)
    if name == "eccentric_rotor":
        r = math.hypot(*body.com)
        gamma = mu * f.radius * m * r / (body.inertia[0] + m * r * r)
        return rotor(gamma / math.sqrt(1.0 - gamma * gamma))
    if name in ("near_jam", "jam"):
        return self_loading(b, 2.0 * mu * abs(body.com[2]) / f.overlap)
    if name == "demo":
        return Sleeve(scene)
    raise KeyError(name)
