"""Stops with known answers: bounces under gravity, rest, a return spring, a hard stop at speed."""

import math

import numpy as np

import cylconn_ros as cr

UPRIGHT = (0.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5))
INERTIA = (0.01, 0.0, 0.0, 0.02, 0.0, 0.02)
FIXED = cr.Body(kind="fixed")
G = 9.81


def _dropped(fall: float, restitution: float) -> cr.Scene:
    return cr.Scene(
        period=1e-3,
        body_a=FIXED,
        body_b=cr.Body(kind="free", mass=20.0, inertia=INERTIA),
        node_a=cr.Node(orientation=UPRIGHT),
        stops=cr.Stops(l_min=-fall, restitution=restitution),
    )


def test_bounces_reach_their_heights_and_end_when_the_series_ends() -> None:
    run = cr.simulate(_dropped(1.0, 0.8), duration=4.2)
    height, force = run["displacement"] + 1.0, run["force_reaction"]
    first = math.sqrt(2.0 / G)
    for n in (1, 2):  # the n-th hop begins at first (1 + 2 (0.8 + ... + 0.8^(n-1)))
        start = first * (1.0 + 2.0 * sum(0.8**k for k in range(1, n)))
        during = (run.time > start) & (run.time < start + 2.0 * first * 0.8**n)
        assert abs(height[during].max() - 0.64**n) < 2e-6  # between samples
    assert height.min() > -1e-12
    end = first * 1.8 / 0.2
    moving = np.abs(force - 20.0 * G) > 1e-6
    assert abs(run.time[moving][-1] - end) <= 1e-3


def test_an_elastic_bounce_keeps_its_energy() -> None:
    for fall in (0.013, 1.0):
        run = cr.simulate(_dropped(fall, 1.0), duration=20.0)
        free = run["force_reaction"] == 0.0
        energy = G * run["displacement"] + 0.5 * run["velocity"][:, 0] ** 2
        assert np.abs(energy[free]).max() < 1e-11


def test_short_bounces_come_to_rest() -> None:
    run = cr.simulate(_dropped(0.013, 0.5), duration=0.3)
    end = 3.0 * math.sqrt(0.026 / G)
    moving = np.abs(run["force_reaction"] - 20.0 * G) > 1e-6
    assert abs(run.time[moving][-1] - end) <= 1e-3


def test_a_body_pressed_onto_a_stop_rests_without_friction() -> None:
    scene = cr.Scene(
        period=1e-3,
        body_a=FIXED,
        body_b=cr.Body(kind="free", mass=2.0, inertia=INERTIA),
        node_a=cr.Node(orientation=(0.0, 0.0, 0.0, 1.0)),
        friction=cr.Friction(coefficient=0.6, radius=0.02, overlap=0.1),
        stops=cr.Stops(l_max=0.05),
        command=cr.Command(slide=cr.Imposed(force=50.0)),
        plant=cr.PlantSettings(body_b=cr.PlantBody(twist=(1.0, 0.0, 0.0, 5.0, 0.0, 0.0))),
    )
    run = cr.simulate(scene, duration=1.0)
    assert np.all(run["regime"][-500:] == 1)
    assert np.all(run["force_friction"][-500:] == 0.0)
    assert np.all(run["flags"][-500:] == 128)  # STOPPED
    assert np.abs(run["force_reaction"][-500:] + 50.0).max() < 1e-9
    assert run["residual"][-500:].max() < 1e-12
    assert np.nanmax(run["stop_time"]) > 0.0


def test_a_return_spring_presses_onto_its_stop() -> None:
    scene = cr.Scene(
        period=1e-3,
        body_a=FIXED,
        body_b=cr.Body(kind="free", mass=0.05, inertia=(5e-6, 0.0, 0.0, 5e-6, 0.0, 5e-6)),
        node_a=cr.Node(orientation=UPRIGHT),
        elasticity=cr.Elasticity(k1=400.0),
        reference=cr.Reference(length=0.005),
        stops=cr.Stops(l_min=-0.005, l_max=0.0),
    )
    run = cr.simulate(scene, duration=0.1)
    assert abs(run["force_reaction"][-1] + 400.0 * 0.005 - 0.05 * G) < 1e-9


def test_a_hard_stop_under_spring_and_friction_is_second_order() -> None:
    errors = []
    for period in (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4):
        scene = cr.Scene(
            period=period,
            gravity=(0.0, 0.0, 0.0),
            body_a=FIXED,
            body_b=cr.Body(kind="free", mass=1.0, inertia=INERTIA),
            node_a=cr.Node(orientation=(0.0, 0.0, 0.0, 1.0)),
            reference=cr.Reference(length=-0.25),
            friction=cr.Friction(
                coefficient=3.0, static_coefficient=8.0, decay=2.0, radius=0.02, preload=1.0
            ),
            elasticity=cr.Elasticity(k1=500.0),
            damping=cr.Damping(c1=1.0),
            stops=cr.Stops(l_min=-0.4, l_max=0.4),
            plant=cr.PlantSettings(body_b=cr.PlantBody(twist=(-5.0, 0.0, 0.0, 0.0, 0.0, 0.0))),
        )
        run = cr.simulate(scene, duration=0.1)
        errors.append(abs(run["length"][-1] + 0.349355511))  # Modelica, Translational.Friction
    assert errors[2] < 1.2e-4
    assert (errors[0] / errors[-1]) ** 0.25 > 3.5  # 4 per halving
