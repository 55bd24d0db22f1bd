"""Reference values of the bundled scenes with springs and dampers by table and compliant stops."""

from __future__ import annotations

import math

from cylconn_ros.reference.answers import Expected, distance, velocity
from cylconn_ros.reference.nonlinear_slide import Slide, slide
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.run import Run


def reaction(run: Run) -> float:
    """Force of the stops at the end, N."""
    return float(run["force_reaction"][-1])


def gap_spring(scene: Scene, end: float) -> list[Expected]:
    """Flights through the gap and half oscillations of pi sqrt(m/k) on each spring."""
    table, v = scene.elasticity.table, scene.plant.body_b.twist[0]
    gap = table.positions[2]
    stiffness = table.forces[3] / (table.positions[3] - gap)
    contact = math.pi * math.sqrt(scene.body_b.mass / stiffness)
    half = 2.0 * gap / v + contact
    done = math.floor((end + gap / v) / half)  # half cycles from -gap
    since = end + gap / v - done * half
    side = 1.0 if done % 2 == 0 else -1.0
    w = math.pi / contact
    late = since - 2.0 * gap / v
    place = -gap + v * since if late < 0.0 else gap + v / w * math.sin(w * late)
    rate = v if late < 0.0 else v * math.cos(w * late)
    return [
        Expected("distance", "m", distance, side * place, 3e-4),
        Expected("velocity", "m/s", velocity, side * rate, 1e-9),
    ]


def _slide(scene: Scene, end: float) -> Slide:
    """The slide of a body whose weight acts along or across the slot, by events."""
    gravity, axes = scene.gravity, scene.initial_pose(1)[3:]
    x, y, z, w = axes
    e1 = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w))
    along = sum(g * e for g, e in zip(gravity, e1, strict=True))
    across = math.sqrt(max(sum(g * g for g in gravity) - along * along, 0.0))
    twist, pose = scene.plant.body_b.twist or (0.0,) * 6, scene.initial_pose(1)
    start = sum(p * e for p, e in zip(pose[:3], e1, strict=True))
    rate = sum(v * e for v, e in zip(twist[:3], e1, strict=True))
    mass = scene.body_b.mass
    drag = scene.friction.coefficient * mass * across
    return slide(scene, start, rate, mass * along, drag, end)


def gas_strut(scene: Scene, end: float) -> list[Expected]:
    """Position, velocity and force of the end stop."""
    found = _slide(scene, end)
    return [
        Expected("distance", "m", distance, found.position, 3e-6),
        Expected("velocity", "m/s", velocity, found.velocity, 3e-5),
        Expected("stop", "N", reaction, found.reaction, 0.3, 1.0),
    ]


def soft_close(scene: Scene, end: float) -> list[Expected]:
    """Where the drawer is, and what the soft-close stop bears."""
    found = _slide(scene, end)
    moved = found.position - scene.initial_pose(1)[0]
    return [
        Expected("distance", "m", distance, moved, 1e-7),
        Expected("stop", "N", reaction, found.reaction, 1e-6, 1.0),
    ]


def moving(scene: Scene, end: float) -> list[Expected]:
    """Position and velocity."""
    found = _slide(scene, end)
    hard = not math.isnan(scene.stops.stiffness)
    return [
        Expected("distance", "m", distance, found.position, 2e-3 if hard else 1e-6),
        Expected("velocity", "m/s", velocity, found.velocity, 2e-3 if hard else 1e-5),
    ]
