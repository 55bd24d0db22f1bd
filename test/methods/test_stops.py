"""Stops with known answers: bounces under gravity, rest, a return spring, a hard stop at speed."""

import dataclasses
import math

import numpy as np
import pytest

import cylconn_ros as cr
from cylconn_ros.connector.start import start_warnings

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


def _height(time: float, fall: float, restitution: float, g: float) -> float:
    """Distance from its stop of a body that falls onto it from rest."""
    first = math.sqrt(2.0 * fall / g)
    if time < first:
        return fall - 0.5 * g * time * time
    time, rate = time - first, restitution * g * first
    while rate > 1e-9:
        hop = 2.0 * rate / g
        if time < hop:
            return rate * time - 0.5 * g * time * time
        time, rate = time - hop, restitution * rate
    return 0.0


def test_bounces_in_a_tilted_slot_and_of_spin_follow_the_exact_motion() -> None:
    """Between bounces; a sample within the two steps of a bounce lies between its ends."""
    tilt = math.radians(-15.0)
    sliding = dataclasses.replace(
        _dropped(0.013, 0.7), node_a=cr.Node(orientation=(0.0, math.sin(tilt), 0.0, math.cos(tilt)))
    )
    spinning = cr.Scene(
        period=2e-3,
        gravity=(0.0, 0.0, 0.0),
        body_a=FIXED,
        body_b=cr.Body(kind="free", mass=2.0, inertia=INERTIA),
        node_a=cr.Node(orientation=(0.0, 0.0, 0.0, 1.0)),
        stops=cr.Stops(theta_max=0.1, restitution=0.6),
        command=cr.Command(spin=cr.Imposed(force=0.2)),
    )
    for scene, field, fall, restitution, g in (
        (sliding, "displacement", 0.013, 0.7, 0.5 * G),
        (spinning, "rotation", 0.1, 0.6, 20.0),
    ):
        run = cr.simulate(scene, duration=0.2)
        gap = fall - np.abs(run[field])
        exact = np.array([_height(t, fall, restitution, g) for t in run.time])
        bouncing = run["restitution"] > 0.0
        within = bouncing | np.roll(bouncing, 1)
        assert 0 < bouncing.sum() < 20
        assert np.abs(gap - exact)[~within].max() < 1e-12
        assert gap.min() > -1e-12


def test_bounces_of_a_semi_implicit_plant_are_first_order() -> None:
    errors = []
    for period in (1e-3, 5e-4):
        scene = dataclasses.replace(
            _dropped(0.013, 0.8), period=period, plant_integration="semi_implicit"
        )
        run = cr.simulate(scene, duration=0.15)
        gap = run["displacement"] + 0.013
        energy = G * gap + 0.5 * run["velocity"][:, 0] ** 2
        assert energy.max() <= G * 0.013
        errors.append(abs(gap[-1] - _height(0.15, 0.013, 0.8, G)))
    assert errors[0] < 1e-4
    assert 1.9 < errors[0] / errors[1] < 2.1


def test_a_rebound_under_constant_friction_is_exact() -> None:
    """Friction turns round with the slide, within the two steps of the impact."""
    friction = cr.Friction(coefficient=0.3, radius=0.02, preload=50.0)
    run = cr.simulate(dataclasses.replace(_dropped(0.0131, 0.9), friction=friction), duration=0.08)
    slowing = 0.3 * 50.0 / 20.0
    first = math.sqrt(2.0 * 0.0131 / (G - slowing))
    rate, t = 0.9 * (G - slowing) * first, 0.08 - first
    expected = rate * t - 0.5 * (G + slowing) * t * t
    assert abs(run["displacement"][-1] + 0.0131 - expected) < 1e-13


@pytest.mark.parametrize("lost", [1, 2, 3])
def test_a_lost_sample_does_not_prolong_an_impact(lost: int) -> None:
    """lost: the sample that does not arrive, counted from the one at which the impact begins."""
    h, mass, restitution = 1e-3, 20.0, 0.8
    connector = cr.Connector(dataclasses.replace(_dropped(0.013, restitution), latency=0))
    x, v, force, since, begun = 0.013, 0.0, 0.0, 0.0, 0
    for _ in range(75):
        since += h
        if begun != lost:
            pose, twist = [0.0, 0.0, x - 0.013, *UPRIGHT], [0.0, 0.0, v, 0.0, 0.0, 0.0]
            result = connector.step(pose_b=pose, twist_b=twist, h=since)
            force, since = result["force_reaction"], 0.0
        begun += 1 if begun or force > 0.0 else 0
        acceleration = force / mass - G
        x, v = x + h * v + 0.5 * h * h * acceleration, v + h * acceleration
    assert begun > 5
    # what the body moved too far in the lost period remains, at most its rate times the period
    assert abs(x - _height(75.0 * h, 0.013, restitution, G)) < 2e-3
    assert G * x + 0.5 * v * v < 1.15 * restitution**2 * G * 0.013


def test_a_start_beyond_a_stop_is_pulled_in_and_said() -> None:
    scene = dataclasses.replace(
        _dropped(0.013, 0.5), stops=cr.Stops(l_min=0.01, l_max=0.2, restitution=0.5), latency=0
    )
    run = cr.simulate(scene, duration=0.2)
    (warning,) = start_warnings(run.connector)
    assert "slide starts at 0 m, beyond stops.l_min (0.01 m)" in warning
    assert np.abs(run["velocity"][:, 0]).max() <= scene.reference.pull_in_speed * (1.0 + 1e-12)
    assert abs(run["length"][-1] - 0.01) < 1e-9  # at rest after a last bounce
    inside = dataclasses.replace(scene, stops=cr.Stops(l_min=0.0))
    assert start_warnings(cr.simulate(inside, duration=0.01).connector) == []
