"""Impulses of an impact: the restitution that acts is the largest without a gain of energy."""

import numpy as np

import cylconn_ros as cr
from cylconn_ros.methods.free_axes.complementarity import ReducedStep
from cylconn_ros.methods.free_axes.impact_friction import impulses
from cylconn_ros.scene.packing import pack


def _energy_change(a: np.ndarray, before: np.ndarray, after: np.ndarray) -> float:
    """Of slide and spin with the mobility a, relative to what they had."""
    inertia = np.linalg.inv(a)
    return float((after @ inertia @ after) / (before @ inertia @ before) - 1.0)


def test_friction_and_coupled_inertias_gain_no_energy() -> None:
    """Random mobilities and reactions: no gain, and one with a larger restitution."""
    rng = np.random.default_rng(5)
    scene = cr.Scene(
        body_a=cr.Body(kind="fixed"),
        body_b=cr.Body(kind="free", mass=1.0, inertia=(0.01, 0.0, 0.0, 0.01, 0.0, 0.01)),
        node_a=cr.Node(orientation=(0.0, 0.0, 0.0, 1.0)),
        friction=cr.Friction(coefficient=0.5, radius=1.0, overlap=1.0),
    )
    par, reduced, rubbed = pack(scene), 0, 0
    for _ in range(400):
        root = rng.normal(size=(2, 2))
        a = root @ root.T
        by = 1.5 * rng.normal(size=(2, 4))
        step = ReducedStep(
            (0.0, 0.0, 0.0, 0.0),
            tuple(by[0]),
            tuple(by[1]),
            (0.0, 0.0),
            (a[0, 0], a[0, 1], a[1, 1]),
        )
        rates = rng.normal(size=2)
        side = 1 if rates[0] > 0.0 else -1
        found = impulses(par, step, tuple(rates), 0, side, 1.0, False)
        after = np.array(found.after)
        assert _energy_change(a, rates, after) < 1e-9
        assert abs(after[0] + found.restitution * rates[0]) < 1e-9 * abs(rates[0])
        reduced += found.restitution < 0.999
        rubbed += found.ratio != (0.0, 0.0)
    assert rubbed > 100
    assert reduced > 10
