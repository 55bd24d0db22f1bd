"""Scenes for tests: a sleeve on a fixed shaft, two free bodies, everything to be varied."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from paths import CONFIG

from cylconn_ros.scene.scene import Scene, load

Array = NDArray[np.float64]
SKEW = [0.010, 0.001, 0.0005, 0.020, 0.0008, 0.018]  # kg.m^2 per kg: no principal axes


def bundled(name: str) -> Scene:
    """A scene file of config/."""
    return load(CONFIG / f"{name}.yaml")


def with_period(scene: Scene, period: float) -> Scene:
    """The scene at another sample period."""
    return dataclasses.replace(scene, period=period)


def sleeve(
    *,
    mass: float = 2.0,
    inertia: list[float] | None = None,
    com: tuple[float, float, float] = (0.0, 0.0, 0.0),
    l0: float = 0.2,
    v: float = 0.0,
    spin: float = 0.0,
    shaft: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0),
    **parameters: Any,
) -> Scene:
    """A free body B on a fixed shaft of orientation ``shaft``; node b at its frame's origin."""
    turn = rotation(shaft)
    values: dict[str, Any] = {
        "body_a": {"kind": "fixed"},
        "body_b": {
            "mass": mass,
            "inertia": inertia or [mass * x for x in SKEW],
            "com": list(com),
        },
        "node_a": {"orientation": list(shaft)},
        "plant": {
            "duration": 1.0,
            "body_b": {
                "pose": [*map(float, l0 * turn[:, 0]), *shaft],
                "twist": [*map(float, v * turn[:, 0]), *map(float, spin * turn[:, 0])],
            },
        },
    }
    return Scene.from_parameters(merged(values, parameters))


def pair(
    *,
    mass_a: float = 20.0,
    mass_b: float = 1.0,
    l0: float = 0.2,
    v: float = 0.3,
    spin: float = 5.0,
    turning: tuple[float, float, float] = (1.0, 3.0, 2.0),
    **parameters: Any,
) -> Scene:
    """Two free bodies turning together, B sliding and spinning on A; no gravity."""
    w = np.array(turning)
    velocity = np.cross(w, [l0, 0.0, 0.0]) + np.array([v, 0.0, 0.0])
    twist = [*map(float, velocity), *map(float, w + [spin, 0.0, 0.0])]
    values: dict[str, Any] = {
        "gravity": [0.0, 0.0, 0.0],
        "body_a": {
            "kind": "free",
            "mass": mass_a,
            "inertia": [mass_a * x for x in (0.02, 0.001, 0.0, 0.05, 0.002, 0.04)],
            "com": [0.02, 0.01, 0.0],
        },
        "body_b": {
            "mass": mass_b,
            "inertia": [mass_b * x for x in SKEW],
            "com": [0.03, 0.02, 0.01],
        },
        "node_a": {"orientation": [0.0, 0.0, 0.0, 1.0]},
        "plant": {
            "duration": 1.0,
            "body_a": {"twist": [0.0, 0.0, 0.0, *map(float, w)]},
            "body_b": {"pose": [l0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], "twist": twist},
        },
    }
    return Scene.from_parameters(merged(values, parameters))


def merged(base: dict[str, Any], change: dict[str, Any]) -> dict[str, Any]:
    """Nested dictionaries, ``change`` winning."""
    both = dict(base)
    for name, value in change.items():
        old = both.get(name)
        both[name] = merged(old, value) if isinstance(old, dict) else value
    return both


def about_y(angle: float) -> tuple[float, float, float, float]:
    """The quaternion of a turn about y: tips x downwards for a positive angle."""
    return (0.0, math.sin(0.5 * angle), 0.0, math.cos(0.5 * angle))


def rotation(q: tuple[float, ...] | Array) -> Array:
    """The matrix of a unit quaternion x, y, z, w, by SciPy."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(np.asarray(q)).as_matrix())


def xyzw(turn: Any) -> tuple[float, float, float, float]:
    """A SciPy rotation as a quaternion of floats."""
    x, y, z, w = map(float, turn.as_quat())
    return (x, y, z, w)


def order(periods: list[float], errors: list[float]) -> float:
    """The fitted slope of log(error) over log(period)."""
    slope: float = np.polyfit(np.log(periods), np.log(errors), 1)[0]
    return slope
