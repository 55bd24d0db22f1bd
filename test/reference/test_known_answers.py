"""Cases with closed-form solutions, simulated with the plant and the connector."""

import math

import numpy as np
import pytest
from scenes import about_y, bundled, order, pair, rotation, sleeve, with_period

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.core.layout import SLIP, STICK
from cylconn_ros.reference import coast, constant_normal_force, slide_and_spin
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.simulate import Run, simulate

PERIODS = [8e-3, 4e-3, 2e-3, 1e-3, 5e-4]


def run(scene: Scene, duration: float) -> Run:
    return simulate(scene, duration)


def stop_time(found: Run) -> float:
    stops = np.flatnonzero(found["stop_time"] >= 0.0)
    assert len(stops) == 1, "the run comes to rest once"
    return float(found.time[stops[0]] + found["stop_time"][stops[0]])


def test_1_coast_on_a_loaded_sleeve() -> None:
    time, distance = coast(0.2, 9.81, 5.0, 2.0, 1.0)
    assert (time, distance) == pytest.approx((0.40617, 0.20309), abs=5e-6)
    scene = bundled("coast")
    assert (scene.friction.coefficient, scene.body_b.mass, scene.friction.preload) == (0.2, 2.0, 5)
    found = run(scene, 0.6)
    assert found["slip_rate"][0] == pytest.approx(1.0)
    assert stop_time(found) == pytest.approx(time, abs=1e-12)  # constant deceleration is exact
    errors = [abs(run(with_period(scene, h), 0.6)["displacement"][-1] - distance) for h in PERIODS]
    for h, error in zip(PERIODS, errors, strict=True):
        assert error <= 2.462 * h * h / 8.0 + 1e-15  # the last, partial period: at most a h^2/8
    held = found["displacement"][-100:]
    assert np.ptp(held) == 0.0, "rest has no creep"


def test_2_stick_ellipse() -> None:
    """Mu FN = 10 N, R = 0.02 m, f1 = 6 N: slip begins at m1 = 0.16 N m."""
    onset = math.sqrt(10.0**2 - 6.0**2) * 0.02
    assert onset == pytest.approx(0.16)
    for moment, regime in ((0.9999 * onset, STICK), (1.0001 * onset, SLIP)):
        scene = sleeve(
            friction={"coefficient": 0.5, "radius": 0.02, "overlap": 0.1, "preload": 20.0},
            gravity=[0.0, 0.0, 0.0],
            plant={"body_b": {"load": [6.0, 0.0, 0.0, moment, 0.0, 0.0]}},
        )
        found = run(scene, 0.1)
        assert found.outs[-1, layout.REGIME] == regime
        if regime == STICK:
            assert found["force"][-1, 0] == pytest.approx(-6.0)
            assert found["moment"][-1, 0] == pytest.approx(-moment)


def test_3_slide_and_spin_on_one_disc() -> None:
    scene = bundled("slide_and_spin")
    friction, body = scene.friction, scene.body_b
    v0 = slide_and_spin(scene, 1e-3).v[0]
    spin = np.linalg.norm(scene.plant.body_b.twist[3:])
    normal = run(scene, 1e-3)["normal_force"][0]
    tau = body.mass * v0 / (friction.coefficient * normal)
    assert friction.radius * spin / v0 == pytest.approx(1.0)  # c
    time, distance = constant_normal_force(1.0, v0, tau)
    assert (time / tau, distance / (tau * v0)) == pytest.approx((1.147794, 0.609476), abs=1e-6)

    times, distances = [], []
    for h in PERIODS:
        found = run(with_period(scene, h), 1.0)
        times.append(abs(stop_time(found) - time))
        distances.append(abs(found["displacement"][-1] - distance))
    assert order(PERIODS, times) > 1.8
    for h, error in zip(
        PERIODS, distances, strict=True
    ):  # the phase of the last period is not smooth
        assert error < 0.3 * h * h
    assert times[3] < 1e-7
    assert abs(distance - 0.5 * tau * v0) > 0.05 * tau * v0, (
        "independent limits for slide and spin give another distance"
    )


def test_3_the_slip_direction_never_turns_for_k_1() -> None:
    radius = 0.02
    inertia = 2.0 * radius * radius  # k = m R^2/I = 1
    scene = sleeve(
        mass=2.0,
        inertia=[inertia, 0.0, 0.0, inertia, 0.0, inertia],
        v=0.3,
        spin=0.4 / radius,
        friction={"coefficient": 0.2, "radius": radius, "overlap": 0.1},
    )
    found = run(scene, 0.3)
    slip = found["slip_velocity"][found.outs[:, layout.REGIME] == SLIP]
    np.testing.assert_allclose(slip[:, 1] / slip[:, 0], 0.4 / 0.3, rtol=1e-10)
    assert stop_time(found) == pytest.approx(0.5 / (0.2 * 9.81), abs=1e-9)


@pytest.mark.parametrize("mu", [0.1, 0.25])
def test_4_binding_ratio(mu: float) -> None:
    """An axial force F at distance e from the axis binds if e/L >= 1/(2 mu)."""
    overlap = 0.1
    for share, binds in ((0.99, False), (1.01, True)):
        e = share * overlap / (2.0 * mu)
        for push in (1.0, 1e4):
            scene = sleeve(
                gravity=[0.0, 0.0, 0.0],
                friction={"coefficient": mu, "radius": 0.02, "overlap": overlap},
                plant={"body_b": {"load": [push, 0.0, 0.0, 0.0, push * e, 0.0]}},
            )
            found = run(scene, 0.05)
            moved = found["displacement"][-1]
            assert (moved == pytest.approx(0.0, abs=1e-15)) == binds
            assert found.outs[-1, layout.REGIME] == (STICK if binds else SLIP)


def test_4_slides_below_the_binding_ratio() -> None:
    scene = sleeve(
        mass=1.0,
        gravity=[0.0, 0.0, 0.0],
        friction={"coefficient": 0.2, "radius": 0.02, "overlap": 0.1},
        plant={"body_b": {"load": [10.0, 0.0, 0.0, 0.0, 1.0, 0.0]}},
    )
    found = run(scene, 0.1)
    assert found["velocity"][-1, 0] == pytest.approx(6.0 * 0.1, rel=1e-9)


@pytest.mark.parametrize(("share", "regime"), [(0.999, STICK), (1.001, SLIP)])
def test_5_journal_pendulum(share: float, regime: int) -> None:
    """A body hanging on the sleeve at distance l rests if sin(theta) <= mu R/l."""
    onset = math.asin(0.3 * 0.02 / 0.1)
    assert math.degrees(onset) == pytest.approx(3.4398, abs=1e-4)
    theta = share * onset
    com = (0.0, 0.1 * math.sin(theta), -0.1 * math.cos(theta))
    friction = {"coefficient": 0.3, "radius": 0.02}
    found = run(sleeve(com=com, friction=friction), 0.5)
    assert found.outs[20, layout.REGIME] == regime
    if regime == STICK:
        assert np.abs(found["rotation"]).max() < 1e-14
    else:
        assert abs(found["rotation"][-1]) > 1e-5


def test_6_slider_on_an_incline() -> None:
    """Acceleration g (sin b - mu cos b) on a slope b; below the friction angle it rests."""
    slope, mu = 0.5, 0.3
    friction = {"coefficient": mu, "radius": 0.02, "overlap": 0.1}
    found = run(sleeve(shaft=about_y(slope), friction=friction), 1.0)
    a = 9.81 * (math.sin(slope) - mu * math.cos(slope))
    assert found["displacement"][-1] == pytest.approx(0.5 * a, rel=1e-9)
    below = math.atan(mu) - 1e-6
    found = run(sleeve(shaft=about_y(below), friction=friction), 20.0)
    assert np.abs(found["displacement"]).max() < 1e-16
    assert np.all(found.outs[:, layout.REGIME] == STICK)


@pytest.mark.parametrize("mass_a", [1e-4, 1.0, 1e3, 1e6])
def test_9_free_flight_keeps_momentum_and_energy(mass_a: float) -> None:
    """Momentum to rounding, energy to second order, for any mass ratio."""
    energies = []
    periods = [4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4]
    for h in periods:
        scene = with_period(pair(mass_a=mass_a, spin=8.0), h)
        found = run(scene, 0.4)
        start = simulate(scene, samples=0).plant
        before, size = start.momentum(), start.energy()
        scale = np.abs(before).max()
        np.testing.assert_allclose(found.plant.momentum(), before, atol=2e-12 * scale)
        own = (
            0.5 * 1.0 * 0.3**2
        )  # of the lighter body's slide, small against that of the heavy body
        energies.append(np.abs(found.energy - found.energy[0]).max() / min(size, own))
    assert energies[2] < 1e-3
    assert order(periods, energies) > 1.8


def test_11_three_solutions() -> None:
    """Slip, or no history: f1 = 3.5 N; after stick, stick. Mass centre 0.2 m off node b, N0 = 1 N.

    The load holds f2 at 1 N and bends by 1 N m, against the moment of friction.
    """
    scene = sleeve(
        mass=1.0,
        com=(0.0, 0.0, 0.2),
        v=1.0,
        gravity=[0.0, 0.0, 0.0],
        friction={"coefficient": 0.5, "radius": 0.02, "overlap": 0.1, "preload": 1.0},
    )
    connector = Connector(scene)
    sample = np.zeros(layout.NSAMPLE)
    sample[layout.MOTION] = simulate(scene, samples=0).plant.state
    sample[layout.B_LOAD + 4] = -1.0  # the reaction is m2 = 1 - 0.2 |f1|
    out = connector.step(sample)
    assert out[layout.FORCE] == pytest.approx(-3.5, rel=1e-9)
    assert out[layout.REGIME] == SLIP
    assert int(out[layout.FLAGS]) & layout.SEVERAL_ROOTS

    connector = Connector(scene)
    still = sample.copy()
    still[layout.B_TWIST] = 0.0
    assert connector.step(still)[layout.REGIME] == STICK
    pushed = still.copy()
    pushed[layout.B_LOAD] = 1000.0  # at the mass centre
    pushed[layout.B_LOAD + 4] += 200.0
    out = connector.step(pushed)
    assert out[layout.REGIME] == STICK
    assert out[layout.FORCE] == pytest.approx(-1000.0, rel=1e-9)


def test_rotation_helper_is_a_rotation() -> None:
    """The shaft of case 6 points down the slope."""
    assert rotation(about_y(0.5))[2, 0] == pytest.approx(-math.sin(0.5))
