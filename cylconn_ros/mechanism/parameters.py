"""The scene of a connector inside a mechanism: what acts on slide and spin, without its bodies."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import model
from cylconn_ros.errors import SceneError
from cylconn_ros.scene.behaviour import Friction
from cylconn_ros.scene.bodies import Body, Node
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene
from cylconn_ros.scene.schema import show

Array = NDArray[np.float64]

_UNIT_BODY = {
    "body_a.kind": "fixed",
    "body_b.kind": "free",
    "body_b.mass": 1.0,
    "body_b.inertia": (1.0, 0.0, 0.0, 1.0, 0.0, 1.0),
}
"""Bodies that satisfy the rules of a scene. Mass and inertia are the mechanism's."""


def mechanism_scene(scene: Scene | Friction) -> Scene:
    """The scene with the method, integration and bodies of a step inside a mechanism.

    ``scene``: a whole scene, or its friction alone. Raises SceneError for a parameter that has no
    effect inside a mechanism.
    """
    if isinstance(scene, Friction):
        scene = Scene(
            node_a=Node(orientation=(0.0, 0.0, 0.0, 1.0)),
            body_a=Body(kind="fixed"),
            body_b=Body(mass=1.0, inertia=_UNIT_BODY["body_b.inertia"]),  # type: ignore[arg-type]
            friction=scene,
        )
    for name in ("force", "torque"):
        limit = getattr(scene.limits, name)
        if math.isfinite(limit):
            raise SceneError(
                f"limits.{name} = {show(limit)}: is a limit of published wrenches; a connector "
                "inside a mechanism publishes none (friction.max_force limits the friction)"
            )
    if not scene.friction.on and not _acts(scene):
        raise SceneError(
            "friction.coefficient = 0.0: the scene has no friction, stop, spring, damper or drive, "
            "so that nothing acts on the joint"
        )
    return scene.replace(
        {
            **_UNIT_BODY,
            "method": "impulse",
            "constraint": "connector",
            "plant_integration": "semi_implicit",
            "latency": 0,
            "tolerance": 0.0,
        }
    )


def _acts(scene: Scene) -> bool:
    """Whether anything but friction acts on slide or spin."""
    par = pack(scene.replace({**_UNIT_BODY, "method": "impulse", "constraint": "connector"}))
    at = model.STOPS
    return bool(
        np.any(np.isfinite(par[at : at + 4]))
        or np.any(par[model.ELASTICITY : model.ELASTICITY + 4])
        or np.any(np.isfinite(par[model.COMMAND : model.COMMAND + 6]))
        or np.any(par[model.ELEMENTS : model.ELEMENTS + 2])
        or par[model.LOCK]
        or par[model.OFFSET]
    )
