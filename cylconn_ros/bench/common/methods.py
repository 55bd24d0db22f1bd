"""The methods of this package on a scene, each with the settings that a user would choose."""

from __future__ import annotations

import dataclasses
from typing import Final

import numpy as np

from cylconn_ros.bench.common.errors import NotApplicableError
from cylconn_ros.bench.common.frames import to_body, to_world
from cylconn_ros.errors import SceneError
from cylconn_ros.methods import traits
from cylconn_ros.methods.traits import TRAITS
from cylconn_ros.scene.scene import Body, Node, Scene
from cylconn_ros.scene.validation import principal_moments

METHODS: Final = tuple(reversed(traits.SOLVERS))
"""Methods that compute a wrench per sample, from the least model knowledge to the most."""

# Gains of penalty springs, as multiples of m/h^2 and m/h (I/h^2 and I/h for rotation). A sampled
# spring is stable up to about this stiffness.
STIFFNESS = 0.05
DAMPING = 0.3


def with_method(scene: Scene, method: str) -> Scene:
    """The scene with ``method``; the gains of penalty springs follow from the rule above.

    Raises NotApplicableError if the method does not support the scene.
    """
    values = scene.parameters()
    values["method"] = method
    if TRAITS[method].uses_gains:
        mass, inertia = effective_inertia(scene)
        h = scene.period
        values["penalty.stiffness"] = STIFFNESS * mass / h**2
        values["penalty.damping"] = DAMPING * mass / h
        values["penalty.rotational_stiffness"] = STIFFNESS * inertia / h**2
        values["penalty.rotational_damping"] = DAMPING * inertia / h
    try:
        return Scene.from_parameters(values)
    except SceneError as error:
        raise NotApplicableError(str(error)) from None


def with_period(scene: Scene, period: float) -> Scene:
    """The scene with another sample period (s)."""
    return dataclasses.replace(scene, period=period)


def effective_inertia(scene: Scene) -> tuple[float, float]:
    """Lower bounds of the mass (kg) and inertia (kg.m^2) that a load at node b accelerates.

    1/m = sum over the moving bodies of 1/m_i + r_i^2/I_i, with the full lever arm r_i of the joint
    and the smallest principal moment I_i; 1/I = sum of 1/I_i.
    """
    ends = (scene.body_a, scene.node_a), (scene.body_b, scene.node_b)
    compliance, rotational_compliance = 0.0, 0.0
    for body, node in ends:
        if body.kind in ("free", "unknown"):
            moment = min(principal_moments(body.inertia))
            compliance += 1.0 / body.mass + _lever_arm(body, node, scene) ** 2 / moment
            rotational_compliance += 1.0 / moment
    return 1.0 / compliance, 1.0 / rotational_compliance


def _lever_arm(body: Body, node: Node, scene: Scene) -> float:
    """Distance (m) from the centre of mass to the initial position of node b."""
    position = np.array(node.position)
    if body is scene.body_a:
        node_b = to_world(scene.initial_pose(1), scene.node_b.position)
        position = to_body(scene.initial_pose(0), node_b)
    return float(np.linalg.norm(position - np.array(body.com)))
