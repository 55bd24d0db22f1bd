"""Base scenes of the hard conditions: a sleeve on a fixed shaft, and two free bodies.

Wrenches act at the mass centres in world axes, so that a late or held wrench remains the same force
when the body has moved.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from cylconn_ros.scene.scene import Scene

LENGTH = 0.2  # m, node b from node a at the start
SKEW = (0.010, 0.001, 0.0005, 0.020, 0.0008, 0.018)  # kg.m^2 per kg: no principal axes
BLOCK = (0.020, 0.0, 0.0, 0.050, 0.0, 0.040)
FRICTION = {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1, "preload": 2.0}
Vector = tuple[float, float, float]


def sleeve(
    *,
    velocity: float = 0.3,
    spin: float = 5.0,
    com: Vector = (0.03, 0.02, 0.01),
    slope: float = 0.0,
    tilt: float = 0.0,
    mass: float = 1.0,
    duration: float = 1.0,
    **more: Any,
) -> Scene:
    """An unbalanced sleeve on a fixed level shaft, sliding and spinning.

    Args:
        velocity: m/s. spin: rad/s. com: mass centre from node b, m. duration: s.
        slope: downward inclination of the shaft, rad; gravity is rotated instead.
        tilt: initial misalignment, rad; the sleeve's axis is then given.
        more: further parameters, nested; they override the others.
    """
    pose = [LENGTH, 0.0, 0.0, 0.0, math.sin(0.5 * tilt), 0.0, math.cos(0.5 * tilt)]
    spin_vector = [spin * math.cos(tilt), 0.0, -spin * math.sin(tilt)]  # about the sleeve's axis
    values = {
        "gravity": [9.81 * math.sin(slope), 0.0, -9.81 * math.cos(slope)],
        "body_a": {"kind": "fixed"},
        "body_b": {"mass": mass, "inertia": [mass * x for x in SKEW], "com": list(com)},
        "node_b": {"orientation": [0.0, 0.0, 0.0, 1.0]} if tilt else {},
        "plant": {"body_b": {"pose": pose, "twist": [velocity, 0.0, 0.0, *spin_vector]}},
    }
    return _scene(values, duration, more)


def pair(
    *,
    velocity: float = 0.3,
    spin: float = 5.0,
    turning: Vector = (0.3, 1.0, 0.5),
    mass_a: float = 5.0,
    inertia_a: float = 1.0,
    inertia_b: tuple[float, ...] = SKEW,
    duration: float = 1.0,
    **more: Any,
) -> Scene:
    """Two free bodies that rotate together, B sliding and spinning on A; no gravity.

    Args:
        velocity (m/s), spin (rad/s): of B relative to A. turning: angular velocity of A, rad/s.
        mass_a: kg; B has 1 kg. inertia_a: relative to a block of that mass.
        inertia_b: of B, kg.m^2. duration, more: as for :func:`sleeve`.
    """
    w = np.array(turning)
    rate = np.cross(w, [LENGTH, 0.0, 0.0]) + [velocity, 0.0, 0.0]
    twist = [*map(float, rate), *map(float, w + [spin, 0.0, 0.0])]
    values = {
        "gravity": [0.0, 0.0, 0.0],
        "body_a": {
            "kind": "free",
            "mass": mass_a,
            "inertia": [mass_a * inertia_a * x for x in BLOCK],
            "com": [0.02, 0.01, 0.0],
        },
        "body_b": {"mass": 1.0, "inertia": list(inertia_b), "com": [0.03, 0.02, 0.01]},
        "plant": {
            "body_a": {"twist": [0.0, 0.0, 0.0, *map(float, w)]},
            "body_b": {"pose": [LENGTH, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], "twist": twist},
        },
    }
    return _scene(values, duration, more)


def long_arm(ratio: float) -> Scene:
    """A body of radius of gyration 5 cm, on an arm ``ratio`` as long, turning with a heavy one.

    No friction, no load; 100 rad/s at 1 ms.
    """
    turning, arm = np.full(3, 100.0 / math.sqrt(3.0)), np.array([0.0, 0.05 * ratio, 0.0])
    values = {
        "gravity": [0.0, 0.0, 0.0],
        "body_a": {"kind": "free", "mass": 0.07,
                   "inertia": [1.6e-4, 2e-5, 0.0, 1.8e-4, 1e-5, 2.2e-4]},
        "body_b": {"mass": 40.0, "inertia": [3.6, 0.4, 0.0, 3.5, 0.1, 2.8]},
        "node_a": {"position": arm.tolist()},
        "friction": {"coefficient": 0.0},
        "plant": {
            "body_a": {"twist": [*np.cross(turning, -arm).tolist(), *turning.tolist()]},
            "body_b": {"pose": [*arm.tolist(), 0.0, 0.0, 0.0, 1.0],
                       "twist": [0.0, 0.0, 0.0, *turning.tolist()]},
        },
    }  # fmt: skip
    return _scene(values, 0.5, {})


def _scene(values: dict[str, Any], duration: float, more: dict[str, Any]) -> Scene:
    common = {
        "wrench": {"axes": "world", "point": "com"},
        "node_a": {"orientation": [0.0, 0.0, 0.0, 1.0]},
        "friction": FRICTION,
        "plant": {"duration": duration},
    }
    return Scene.from_parameters(merged(merged(common, values), more))


def merged(base: dict[str, Any], change: dict[str, Any]) -> dict[str, Any]:
    """Merge nested dictionaries; values of ``change`` override those of ``base``."""
    both = dict(base)
    for name, value in change.items():
        old = both.get(name)
        both[name] = merged(old, value) if isinstance(old, dict) else value
    return both


def with_duration(scene: Scene, duration: float) -> Scene:
    """The scene with another duration, s."""
    return dataclasses.replace(scene, plant=dataclasses.replace(scene.plant, duration=duration))
