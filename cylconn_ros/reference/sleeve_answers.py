"""Reference values of scenes whose contact moves, or whose friction differs by direction."""

from __future__ import annotations

import math

from cylconn_ros.reference import closed_forms
from cylconn_ros.reference.answers import Expected, distance, stop_time, velocity
from cylconn_ros.reference.moving_contact import slide
from cylconn_ros.scene.scene import Scene


def slides_to_rest(scene: Scene, end: float) -> list[Expected]:
    """Integrated up to its stop."""
    found = slide(scene, end)
    return [
        Expected("stop time", "s", stop_time, found.stop_time, 2e-5),
        Expected("distance", "m", distance, found.distance, 2e-6),
    ]


def slides_on(scene: Scene, end: float) -> list[Expected]:
    """Integrated, without a stop."""
    found = slide(scene, end)
    return [
        Expected("distance", "m", distance, found.distance, 2e-6),
        Expected("velocity", "m/s", velocity, found.velocity, 2e-5),
    ]


def telescope_binds(scene: Scene, _end: float) -> list[Expected]:
    """Thrown outwards with its mass centre below the axis."""
    f = scene.friction
    travel = closed_forms.telescope(
        f.coefficient, -scene.body_b.com[2], f.overlap, abs(scene.gravity[2]),
        scene.plant.body_b.twist[0],
    )  # fmt: skip
    return [Expected("distance", "m", distance, travel, 2e-6)]


def piston_rod(scene: Scene, _end: float) -> list[Expected]:
    """Half a period about the slide at which friction balances the pull."""
    f, body = scene.friction, scene.body_b
    time, travel = closed_forms.piston_rod(
        f.coefficient, f.overlap, body.mass, abs(scene.gravity[2]), scene.plant.body_b.load[0],
        scene.plant.body_b.pose[0],
    )  # fmt: skip
    return [
        Expected("stop time", "s", stop_time, time, 1e-5),
        Expected("distance", "m", distance, travel, 2e-6),
    ]


def sledge(scene: Scene, end: float) -> list[Expected]:
    """Up and down a slope, each with its coefficient."""
    f = scene.friction
    x, y, z, w = scene.node_a.orientation
    slope = math.asin(-2.0 * (x * z - w * y))
    gravity, speed = abs(scene.gravity[2]), math.hypot(*scene.plant.body_b.twist[:3])
    up = gravity * (math.sin(slope) + f.coefficient_backward * math.cos(slope))
    down = gravity * (math.sin(slope) - f.coefficient_forward * math.cos(slope))
    left = end - speed / up
    return [
        # a held wrench loses the rest of a period where it turns: first order
        Expected("distance", "m", distance, 0.5 * (down * left**2 - speed**2 / up), 4e-3, 1.0),
        Expected("velocity", "m/s", velocity, down * left, 4e-3, 1.0),
    ]


def hydraulic_ram(scene: Scene, end: float) -> list[Expected]:
    """Pressure against seals whose friction ignores the load, and their offset."""
    f, body, load = scene.friction, scene.body_b, scene.plant.body_b.load
    a = (load[0] - f.offset_force - f.coefficient_forward * f.preload) / body.mass
    return [
        Expected("distance", "m", distance, 0.5 * a * end**2, 0.0, 0.0),
        Expected("velocity", "m/s", velocity, a * end, 0.0, 0.0),
    ]
