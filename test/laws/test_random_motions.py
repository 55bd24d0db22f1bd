"""Whole random motions: what each method does with the energy, and against joint coordinates."""

import numpy as np
import pytest

import cylconn_ros as cr
from cylconn_ros.connector.connector import Connector
from cylconn_ros.laws import random_motions
from cylconn_ros.laws.random_motions import MotionResult


def checked(number: int, method: str) -> MotionResult:
    results: dict[str, MotionResult] = {}
    random_motions.check(1, number, results, (method,))
    return results[method]


def test_the_first_motions_hold() -> None:
    results: dict[str, MotionResult] = {}
    for number in range(40):
        random_motions.check(1, number, results)
    assert set(results) >= {"impulse", "penalty", "augmented_lagrangian", "baumgarte"}
    failures = {name: one.failures for name, one in results.items() if one.failures}
    assert failures == {}
    assert results["impulse"].references > 3


@pytest.mark.parametrize("number", [268, 373, 448, 823])
def test_weakened_wrenches_gain_nothing_from_springs_and_pull_in(number: int) -> None:
    """A spring stored what a weakened wrench did not take: up to 1.5 times the kinetic energy."""
    assert checked(number, "impulse").failures == []


@pytest.mark.parametrize("number", [0, 75, 574, 802])
def test_gains_that_no_longer_suit_the_arms_are_lowered(number: int) -> None:
    """The slide lengthens the arms; with ``latency: 0`` the bodies ran away to infinity."""
    assert checked(number, "penalty").failures == []


@pytest.mark.parametrize("method", ["penalty", "baumgarte", "augmented_lagrangian"])
def test_springs_of_the_sample_keep_the_energy(method: str) -> None:
    """Taken at the sample, an oscillator of 30 rad/s gains (w h)^2/2 per step: 57 % in a second."""
    scene = cr.load(cr.shipped("coast"))
    mass = scene.body_b.mass
    values = {
        "method": method, "period": 1e-3, "latency": 0, "gravity": [0.0, 0.0, 0.0],
        "friction.coefficient": 0.0, "elasticity.k1": 900.0 * mass,
    }  # fmt: skip
    if method != "baumgarte":
        values |= {
            "penalty.stiffness": 1e4, "penalty.damping": 100.0,
            "penalty.rotational_stiffness": 10.0, "penalty.rotational_damping": 0.1,
        }  # fmt: skip
    run = cr.simulate(scene.replace(values), duration=1.0)
    rate, u = run["velocity"][:, 0], run["material_displacement"]
    energy = 0.5 * mass * rate**2 + 450.0 * mass * u**2
    assert np.max(np.abs(energy / energy[0] - 1.0)) < 5e-3


def test_beyond_a_stop_the_sign_of_rounding_begins_no_impact() -> None:
    """At a rate that is rounding, a component is pulled in by the stop, not rebound."""
    scene = cr.load(cr.shipped("end_stop"))
    away = {"gravity": [0.0, 0.0, 0.1], "friction.coefficient": 0.0, "stops.l_max": -0.5}
    scene = scene.replace(away)
    forces = []
    for rate in (-1e-20, 0.0, 1e-20):
        twist = rate * np.array([0.866, 0.0, -0.5, 0.0, 0.0, 0.0])
        answer = Connector(scene).step(pose_b=scene.body_b.pose, twist_b=twist, h=scene.period)
        assert answer["stop"] == 2
        forces.append(answer.force_b)
    assert np.allclose(forces, forces[1], rtol=1e-9)
