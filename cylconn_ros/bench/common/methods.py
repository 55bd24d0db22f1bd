"""Every method of ours on a scene, each in the set-up that a user of it would choose."""

from __future__ import annotations

import dataclasses

import numpy as np

from cylconn_ros.bench.common.errors import LeftOutError
from cylconn_ros.bench.common.frames import inside, outside
from cylconn_ros.errors import SceneError
from cylconn_ros.methods.dispatch import NAMES
from cylconn_ros.scene.scene import Body, Node, Scene
from cylconn_ros.scene.validation import principal_moments

METHODS = ("penalty", "augmented_lagrangian", "baumgarte", "impulse", "minimal")
"""All methods that the interface names, from the least known to the most."""

# Gains of springs in the multiples of m/h^2 and m/h, I/h^2 and I/h that a sampled spring allows.
STIFFNESS = 0.05
DAMPING = 0.3


def available() -> list[str]:
    """The methods that there are, in the order of METHODS."""
    return [name for name in METHODS if name in NAMES]


def served_by(scene: Scene, method: str) -> Scene:
    """The scene as it is given to ``method``; gains of springs by the rule above.

    Raises LeftOutError where the scene cannot be served by it.
    """
    values = scene.parameters()
    values["method"] = method
    if method in ("penalty", "augmented_lagrangian"):
        mass, inertia = effective(scene)
        h = scene.period
        values["penalty.stiffness"] = STIFFNESS * mass / h**2
        values["penalty.damping"] = DAMPING * mass / h
        values["penalty.rotational_stiffness"] = STIFFNESS * inertia / h**2
        values["penalty.rotational_damping"] = DAMPING * inertia / h
    try:
        return Scene.from_parameters(values)
    except SceneError as error:
        raise LeftOutError(str(error)) from None


def effective(scene: Scene) -> tuple[float, float]:
    """Least mass (kg) and inertia (kg.m^2) that a force or torque at node b can meet.

    Bounds from below: the arms are taken whole, the moments at their least.
    """
    ends = (scene.body_a, scene.node_a), (scene.body_b, scene.node_b)
    compliance, turning = 0.0, 0.0
    for body, node in ends:
        if body.kind in ("free", "unknown"):
            least = _least_moment(body)
            compliance += 1.0 / body.mass + _arm(body, node, scene) ** 2 / least
            turning += 1.0 / least
    return 1.0 / compliance, 1.0 / turning


def _least_moment(body: Body) -> float:
    return min(principal_moments(body.inertia))


def _arm(body: Body, node: Node, scene: Scene) -> float:
    """From the mass centre to where node b is at the start, m."""
    place = np.array(node.position)
    if body is scene.body_a:
        at = outside(scene.initial_pose(1), scene.node_b.position)
        place = inside(scene.initial_pose(0), at)
    return float(np.linalg.norm(place - np.array(body.com)))


def with_period(scene: Scene, period: float) -> Scene:
    """The scene at another sample period."""
    return dataclasses.replace(scene, period=period)
