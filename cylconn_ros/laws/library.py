"""Runs of the bundled scenes with each method, in process: the closed loop, sample by sample."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.connector import Connector
from cylconn_ros.errors import SceneError
from cylconn_ros.laws.runs import RunSamples, simulated
from cylconn_ros.methods.traits import TRAITS
from cylconn_ros.scene.scene import Body, Scene
from cylconn_ros.simulation.simulate import samples_of, simulate

Array = NDArray[np.float64]


def accepted_scenes(
    scenes: Mapping[str, Scene], method: str
) -> tuple[dict[str, Scene], dict[str, str]]:
    """The scenes that a method accepts, with that method, and its reasons to reject the others.

    A method that uses gains gets them if the scene has none: stiffness m/(20 h^2) and damping
    0.3 m/h, with m the lesser of the effective masses of the free bodies at their nodes.
    """
    accepted, rejected = {}, {}
    for name, scene in scenes.items():
        values: dict[str, Any] = {**scene.parameters(), "method": method}
        if TRAITS[method].uses_gains and math.isnan(scene.penalty.stiffness):
            values.update(_gains(scene))
        try:
            candidate = Scene.from_parameters(values)
            if TRAITS[method].live:
                Connector(candidate)
        except SceneError as error:
            rejected[name] = str(error)
        else:
            accepted[name] = candidate
    return accepted, rejected


def run(scene: Scene, most: int) -> RunSamples:
    """Simulate the scene's duration, but at most ``most`` samples."""
    result = simulate(scene, samples=min(most, samples_of(scene)))
    loads = (*scene.plant.body_a.load, *scene.plant.body_b.load)
    return simulated(scene, scene.method, result.states, result.outs, loads)


def _gains(scene: Scene) -> dict[str, float]:
    """Parameters ``penalty.*`` from the effective mass and inertia of the free bodies."""
    effective = [
        _effective(body, node.position)
        for body, node in ((scene.body_a, scene.node_a), (scene.body_b, scene.node_b))
        if body.kind == "free"
    ]
    mass, inertia = min(m for m, _ in effective), min(i for _, i in effective)
    h = scene.period
    return {
        "penalty.stiffness": 0.05 * mass / h**2,
        "penalty.damping": 0.3 * mass / h,
        "penalty.rotational_stiffness": 0.05 * inertia / h**2,
        "penalty.rotational_damping": 0.3 * inertia / h,
    }


def _effective(body: Body, node: tuple[float, ...]) -> tuple[float, float]:
    """Least effective mass of a body at its node (kg), and its least moment of inertia (kg m^2)."""
    xx, xy, xz, yy, yz, zz = body.inertia
    inertia = float(np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])[0])
    arm = float(np.linalg.norm(np.subtract(node, body.com)))
    return 1.0 / (1.0 / body.mass + arm**2 / inertia), inertia
