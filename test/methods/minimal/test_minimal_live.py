"""The method minimal live: the mean wrench of the coming period, in the closed loop."""

import dataclasses
import math

import numpy as np
import pytest
from scenes import bundled, order, pair, sleeve, with_period

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.core.layout import SLIP, STICK
from cylconn_ros.methods.minimal.initial import LIVE, OFFLINE, tolerance_of
from cylconn_ros.reference import free_pair, slide_and_spin
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.minimal import solve
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.simulate import simulate

FRICTION = {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1, "preload": 0.5}


def live(scene: Scene) -> Scene:
    return dataclasses.replace(scene, method="minimal")


def test_live_is_closer_than_impulse_and_converges_faster() -> None:
    """The demo in the closed loop: mean forces leave an error of nearly third order."""
    scene = bundled("demo")
    reference = slide_and_spin(scene)
    periods, errors, stops = [1e-3, 5e-4, 2.5e-4], [], []  # slow turning: one formula
    for h in periods:
        run = simulate(with_period(live(scene), h), round(4.0 / h) + 1)
        errors.append(abs(run.state("displacement")[-1] - reference.distance))
        found = run.state("stop_time")
        at = np.flatnonzero(found >= 0.0)
        assert len(at) == 1
        stops.append(abs(run.time[at[0]] + found[at[0]] - reference.stop_time))
        assert not run.outs[:, layout.STATUS].any()
        assert run.outs[-1, layout.REGIME] == STICK
    plain = simulate(with_period(scene, 1e-3), 4001).state("displacement")[-1]
    assert errors[0] < 0.2 * abs(plain - reference.distance)
    assert order(periods, errors) > 2.3
    assert order(periods, stops) > 2.3


def test_live_on_two_free_bodies() -> None:
    """Second order or better, momentum kept, violations as impulse leaves them."""
    scene = live(pair(friction=FRICTION, gravity=[0.0, 0.0, -1.0]))
    reference = free_pair(scene, 0.48)
    periods, errors = [4e-3, 2e-3, 1e-3, 5e-4], []
    for h in periods:
        run = simulate(with_period(scene, h), round(0.48 / h) + 1)
        errors.append(abs(run.state("displacement")[-1] - reference.distance))
    assert order(periods, errors) > 1.8
    scene = live(pair(friction=FRICTION))
    before = Plant(scene).momentum()
    np.testing.assert_allclose(simulate(scene, 500).plant.momentum(), before, atol=1e-12)


def test_live_answers_the_laws_of_balance() -> None:
    """Parts add up, residuals vanish, stick and slip are what they are said to be."""
    scene = live(pair(friction=FRICTION, elasticity={"k1": 30.0}, damping={"c1": 2.0, "cr1": 0.01}))
    run = simulate(scene, 300)
    for total, name in (("force", "force"), ("moment", "moment")):
        parts = sum(
            run.state(f"{name}_{part}")
            for part in ("elastic", "viscous", "friction", "actuation", "reaction")
        )
        np.testing.assert_allclose(parts, run.state(total)[:, 0], rtol=1e-12, atol=1e-14)
    assert run.state("residual").max() < 1e-12
    assert np.all(run.outs[:, layout.REGIME] == SLIP)


def test_live_holds_and_stops_like_impulse() -> None:
    """Where something happens the answers are impulse's: stops, stick, stuck samples."""
    stops = {"l_max": 0.25, "restitution": 0.5}
    scene = sleeve(v=1.0, friction=FRICTION, stops=stops)
    one, other = simulate(scene, 600), simulate(live(scene), 600)
    assert other.state("length").max() <= 0.25 + 1e-9
    np.testing.assert_allclose(other.state("length")[-1], one.state("length")[-1], atol=1e-4)
    assert np.ptp(other.state("length")[-50:]) < 1e-15


def test_live_survives_any_sample() -> None:
    scene = live(pair(friction=FRICTION))
    good = np.concatenate([Plant(scene).state, np.zeros(12)])
    for field in range(layout.NSAMPLE):
        for value in (math.nan, math.inf, 1e200, 1e12):
            connector = Connector(scene)
            bad = good.copy()
            bad[field] = value
            connector.step(good)
            assert np.all(np.isfinite(connector.step(bad)))


def test_a_stated_tolerance_is_that_of_the_steps() -> None:
    """One place says how fine: a hundredth of what the scene asks for, or by default."""
    scene = live(bundled("demo"))
    assert tolerance_of(pack(scene), LIVE) == LIVE
    assert tolerance_of(pack(scene), OFFLINE) == OFFLINE
    rough = dataclasses.replace(scene, tolerance=1e-2)
    assert tolerance_of(pack(rough), LIVE) == pytest.approx(1e-4)
    assert solve(rough, 1.0).evaluations < 0.5 * solve(scene, 1.0).evaluations
    a, b = (simulate(each, 50).state("displacement")[-1] for each in (scene, rough))
    assert a == pytest.approx(b, abs=1e-4)
