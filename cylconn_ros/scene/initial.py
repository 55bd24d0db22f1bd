"""The configuration in which a plant starts: its slide, and the overlap there."""

from __future__ import annotations

import math

import numpy as np

from cylconn_ros.core.overlap import SLOPES
from cylconn_ros.core.vectors import into, matrix, out_of
from cylconn_ros.errors import SceneError
from cylconn_ros.scene.behaviour import Friction
from cylconn_ros.scene.fields import SceneFields
from cylconn_ros.scene.schema import show


def initial_length(scene: SceneFields) -> float:
    """Slide (m) in the initial poses of the plant, e1a . (xb - xa)."""
    places = []
    for k, node in enumerate((scene.node_a, scene.node_b)):
        pose = scene.initial_pose(k)
        x, y, z = node.position
        arm = out_of(matrix(_unit(pose[3:])), (x, y, z))
        places.append(np.add(pose[:3], arm))
    apart = np.subtract(places[1], places[0])
    in_body_a = into(matrix(_unit(scene.initial_pose(0)[3:])), tuple(apart))
    return float(into(matrix(_unit(scene.node_a.orientation)), in_body_a)[0])


def _unit(q: tuple[float, ...]) -> tuple[float, float, float, float]:
    x, y, z, w = np.array(q) / math.hypot(*q)
    return float(x), float(y), float(z), float(w)


def overlap_at(friction: Friction, length: float, start: float) -> float:
    """Overlap (m) at the slide ``length``, without its bounds; ``start``: the reference, m."""
    at = start if math.isnan(friction.overlap_at) else friction.overlap_at
    return friction.overlap + SLOPES[friction.overlap_change] * (length - at)


def apart_at(friction: Friction, length: float, start: float) -> str:
    """Why shaft and sleeve do not hold together at the slide ``length``; '' if they do."""
    overlap = overlap_at(friction, length, start)
    if friction.overlap_change == "constant" or not friction.on or overlap >= friction.overlap_min:
        return ""
    at = start if math.isnan(friction.overlap_at) else friction.overlap_at
    return (
        f"slide starts at {length:.6g} m with an overlap of {overlap:.6g} m, below "
        f"friction.overlap_min ({friction.overlap_min:g} m): friction.overlap is "
        f"{friction.overlap:g} m at the slide {at:.6g} m (friction.overlap_at) and "
        f"{friction.overlap_change}; check the initial pose, friction.overlap and "
        "friction.overlap_at"
    )


def check_start(scene: SceneFields) -> None:
    """Raise :class:`SceneError` if shaft and sleeve are apart in the plant's initial poses."""
    if scene.friction.overlap_change == "constant":
        return
    length = initial_length(scene)
    problem = apart_at(scene.friction, length, length)
    if problem:
        raise SceneError(f"friction.overlap = {show(scene.friction.overlap)}: {problem}")
