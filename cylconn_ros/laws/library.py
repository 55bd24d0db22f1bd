"""Each method's own runs of the scene library, in process: the closed loop, sample by sample."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.errors import SceneError
from cylconn_ros.laws.runs import Recorded
from cylconn_ros.scene.scene import Body, Scene
from cylconn_ros.simulation.simulate import simulate

Array = NDArray[np.float64]
SPRUNG = ("penalty", "augmented_lagrangian")


def served(scenes: Mapping[str, Scene], method: str) -> tuple[dict[str, Scene], dict[str, str]]:
    """The scenes that the method serves, asked of it, and why it does not serve the others.

    Methods of unknown inertia get gains of a twentieth of m/h^2 and a third of m/h, m what the
    connector feels of the lighter body, where the scene gives none.
    """
    found, refused = {}, {}
    for name, scene in scenes.items():
        values: dict[str, Any] = {**scene.parameters(), "method": method}
        if method in SPRUNG and math.isnan(scene.penalty.stiffness):
            values.update(_gains(scene))
        try:
            asked = Scene.from_parameters(values)
            Connector(asked)
        except SceneError as error:
            refused[name] = str(error)
        else:
            found[name] = asked
    return found, refused


def run(scene: Scene, most: int) -> Recorded:
    """Simulate at most ``most`` samples of the scene's duration."""
    steps = min(most, round(scene.plant.duration / scene.period) + 1)
    ran = simulate(scene, steps)
    samples = np.zeros((steps, layout.NSAMPLE))
    samples[:, layout.MOTION] = ran.states
    samples[:, layout.LOADS] = (*scene.plant.body_a.load, *scene.plant.body_b.load)
    begins, periods = np.arange(steps) == 0, np.full(steps, scene.period)
    return Recorded(scene.method, scene, samples, ran.outs, periods, periods, begins, 0, "")


def _gains(scene: Scene) -> dict[str, float]:
    felt = [
        _felt(body, node.position)
        for body, node in ((scene.body_a, scene.node_a), (scene.body_b, scene.node_b))
        if body.kind == "free"
    ]
    mass, inertia = min(m for m, _ in felt), min(i for _, i in felt)
    h = scene.period
    return {
        "penalty.stiffness": 0.05 * mass / h**2,
        "penalty.damping": 0.3 * mass / h,
        "penalty.rotational_stiffness": 0.05 * inertia / h**2,
        "penalty.rotational_damping": 0.3 * inertia / h,
    }


def _felt(body: Body, node: tuple[float, ...]) -> tuple[float, float]:
    """Mass and inertia of a body, the mass as its node feels it at least."""
    xx, xy, xz, yy, yz, zz = body.inertia
    inertia = float(np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])[0])
    arm = float(np.linalg.norm(np.subtract(node, body.com)))
    return 1.0 / (1.0 / body.mass + arm**2 / inertia), inertia
