"""Friction feed-forward: what it adds, and a simulated controller with and without it."""

import math

import numpy as np
import pytest

import cylconn_ros as cr
from cylconn_ros.connector.feed_forward import feed_forward
from cylconn_ros.core.layout import SLIP
from cylconn_ros.simulation.plant import Plant

STICK = SLIP - 1


def test_while_slipping_it_is_the_opposite_of_friction() -> None:
    assert feed_forward(SLIP, (-3.0, 0.2), 5.0, 0.02, (1.0, 0.0)) == (3.0, -0.2)


def test_while_sticking_it_does_not_feed_back_what_is_applied() -> None:
    assert feed_forward(STICK, (-3.0, 0.2), 5.0, 0.02) == (0.0, 0.0)
    force, moment = feed_forward(STICK, (-3.0, 0.2), 5.0, 0.02, (0.03, -2.0), share=1.0)
    assert math.hypot(force, moment / 0.02) == pytest.approx(5.0)  # on the disc
    assert force / moment == pytest.approx(0.03 / (0.02**2 * -2.0))
    assert feed_forward(STICK, (0.0, 0.0), math.inf, 0.02, (1.0, 0.0)) == (0.0, 0.0)


def greatest_error(scene: cr.Scene, share: float) -> float:
    """Of a controller that follows 50 mm sin(2 pi t) along the slot, with gravity across it, m.

    PD with the force that accelerates the mass. ``share`` 0: without friction's feed-forward.
    """
    plant, connector, errors, effort = Plant(scene), cr.Connector(scene), [], 0.0
    for k in range(2000):
        time = k * scene.period
        wanted, rate = (
            0.05 * math.sin(2 * math.pi * time),
            0.1 * math.pi * math.cos(2 * math.pi * time),
        )
        load = np.array([effort, 0.0, 0.0, 0.0, 0.0, 0.0])
        state = plant.state
        answer = connector.step(pose_b=state[13:20], twist_b=state[20:26], load_b=load)
        errors.append(abs(wanted - answer["length"]))
        plant.step(
            np.zeros(6), np.concatenate([answer.force_b, answer.torque_b]) + [effort, 0, 0, 0, 0, 0]
        )
        effort = -2.0 * (2 * math.pi) ** 2 * wanted
        effort += 800.0 * (wanted - answer["length"]) + 40.0 * (rate - answer["velocity"][0])
        if share > 0.0:
            effort += feed_forward(
                int(answer["regime"]), (answer["force_friction"], answer["moment_friction"]),
                answer["friction_limit"], scene.friction.radius, (rate, 0.0), share,
            )[0]  # fmt: skip
    return max(errors[1000:])


def test_a_controller_follows_its_reference_better_with_it() -> None:
    scene = cr.Scene(
        period=0.001, latency=0, body_a=cr.Body(kind="fixed"),
        body_b=cr.Body(mass=2.0, inertia=(0.01, 0.0, 0.0, 0.02, 0.0, 0.02)),
        node_a=cr.Node(orientation=(0.0, 0.0, 0.0, 1.0)),
        friction=cr.Friction(coefficient=0.3, radius=0.02, overlap=0.1),
    )  # fmt: skip
    without, with_it = greatest_error(scene, 0.0), greatest_error(scene, 0.9)
    assert without > 7e-3  # mu W/k = 7.4 mm
    assert with_it < 0.2 * without
