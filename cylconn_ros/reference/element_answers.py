"""Reference values of the bundled scenes with springs and dampers by table and compliant stops."""

from __future__ import annotations

import math

import numpy as np

from cylconn_ros.reference.answers import Expected, distance, stop_time, velocity
from cylconn_ros.reference.nonlinear_slide import Slide, slide, turn_as_slide
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


def one_slide(scene: Scene, end: float) -> Slide:
    """The slide of a body whose weight acts along or across the slot, by events."""
    gravity, axes = scene.gravity, scene.initial_pose(1)[3:]
    x, y, z, w = axes
    e1 = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w))
    along = sum(g * e for g, e in zip(gravity, e1, strict=True))
    across = math.sqrt(max(sum(g * g for g in gravity) - along * along, 0.0))
    twist, pose = scene.plant.body_b.twist or (0.0,) * 6, scene.initial_pose(1)
    start = sum(p * e for p, e in zip(pose[:3], e1, strict=True))
    rate = sum(v * e for v, e in zip(twist[:3], e1, strict=True))
    mass, f = scene.body_b.mass, scene.friction
    drag = f.coefficient * (mass * across + f.preload)
    return slide(scene, start, rate, mass * along - f.offset_force, drag, end)


def gas_strut(scene: Scene, end: float) -> list[Expected]:
    """Position, velocity and force of the end stop."""
    found = one_slide(scene, end)
    return [
        Expected("distance", "m", distance, found.position, 3e-6),
        Expected("velocity", "m/s", velocity, found.velocity, 3e-5),
        Expected("stop", "N", reaction, found.reaction, 0.3, 1.0),
    ]


def soft_close(scene: Scene, end: float) -> list[Expected]:
    """Where the drawer is, and what the soft-close stop bears."""
    found = one_slide(scene, end)
    moved = found.position - scene.initial_pose(1)[0]
    return [
        Expected("distance", "m", distance, moved, 1e-6),
        Expected("stop", "N", reaction, found.reaction, 6e-4),
    ]


def moving(scene: Scene, end: float) -> list[Expected]:
    """Position and velocity."""
    found = one_slide(scene, end)
    hard = not math.isnan(scene.stops.stiffness)
    return [
        Expected("distance", "m", distance, found.position, 2e-3 if hard else 1e-6),
        Expected("velocity", "m/s", velocity, found.velocity, 2e-3 if hard else 1e-5),
    ]


def window_balance(scene: Scene, end: float) -> list[Expected]:
    """Where the sash comes to rest, and when."""
    found = one_slide(scene, end)
    moved = found.position - scene.initial_pose(1)[2]
    return [
        Expected("stop time", "s", stop_time, found.stop_time, 3e-7),
        Expected("distance", "m", distance, moved, 1e-7),
    ]


def camera_slider(scene: Scene, end: float) -> list[Expected]:
    """Where the camera rests on the stop, and what the stop bears."""
    found = one_slide(scene, end)
    return [
        Expected("distance", "m", distance, found.position, 5e-7),
        Expected("stop", "N", reaction, found.reaction, 1.5e-3),
    ]


LOOK = 2.0  # s, at which the angle of the door is compared, on its way


def door_closer(scene: Scene, end: float) -> list[Expected]:
    """Angle on the way, the time at which the latch falls in, and rest in the latch."""
    f, body, turn = scene.friction, scene.body_b, turn_as_slide(scene)
    distance_of_centre = math.hypot(body.com[1], body.com[2])
    lever, weight = f.coefficient * f.radius, body.mass * abs(scene.gravity[2])
    # the weight at the distance d bends the hinges: 2 m g d/L
    drag = lever * 2.0 * weight * distance_of_centre / f.overlap
    x, y, z, w = scene.plant.body_b.pose[3:]
    # the turn about the vertical of the body's y axis, which is horizontal
    start = math.atan2(2.0 * (z * w - x * y), 1.0 - 2.0 * (x * x + z * z))
    eccentric = lever * body.mass * distance_of_centre

    given = (turn, start, 0.0, 0.0, drag)
    latched = slide(*given, end, eccentric, scene.lock.position).time
    return [
        Expected(
            "angle at 2 s", "rad", _angle_on_the_way, slide(*given, LOOK, eccentric).position, 1e-8
        ),
        # an impact is divided over two steps; the first begins up to two periods before
        Expected("latched", "s", _locked, latched, 2e-3, 1.0),
        Expected("angle", "rad", lambda run: run["angle"][-1], scene.lock.position, 0.0, 0.0),
    ]


def _angle_on_the_way(run: Run) -> float:
    """Angle at the time LOOK, rad."""
    return float(run["angle"][round(LOOK / run.scene.period)])


def _locked(run: Run) -> float:
    """Time of the first sample with a lock, s; NaN: none."""
    locked = np.flatnonzero(run["lock"])
    return float(run.time[locked[0]]) if len(locked) else math.nan
