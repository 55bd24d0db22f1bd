"""The method minimal: the motion against closed forms and references, its events, and it live."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scenes import about_y, bundled, merged, order, pair, rotation, sleeve, with_period

from cylconn_ros.connector.connector import Connector
from cylconn_ros.connector.minimal_simulation import Solution, solve
from cylconn_ros.connector.packing import pack
from cylconn_ros.connector.parameters import SceneError
from cylconn_ros.connector.plant import Plant
from cylconn_ros.connector.scene import Scene
from cylconn_ros.connector.simulation import simulate
from cylconn_ros.core import layout, plant
from cylconn_ros.core.layout import SLIP, STICK
from cylconn_ros.reference import coast, constant_normal_force, free_pair, slide_and_spin

FRICTION = {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1, "preload": 0.5}


def kinds(found: Solution) -> list[str]:
    return [event.kind for event in found.events]


def moved(found: Solution) -> float:
    return float(found.length[-1] - found.length[0])


# --- smooth pieces: tolerance and order ---


def test_the_error_follows_the_tolerance_on_slide_and_spin() -> None:
    """Closed form; 1e-10 m and far below, at an effort that grows by an eighth root."""
    time, distance = constant_normal_force(1.0, 1.0, 1.0 / (0.2 * 9.81))
    efforts = []
    for rtol, error in ((1e-6, 1e-8), (1e-8, 1e-10), (1e-10, 1e-11), (1e-12, 1e-13)):
        found = solve(bundled("slide_and_spin"), 1.0, rtol)
        assert kinds(found) == ["rests"]
        assert abs(moved(found) - distance) < error
        assert abs(found.stop_time - time) < error
        efforts.append(found.evaluations)
    assert efforts[2] < 3.0 * efforts[0] < 1000


def test_at_least_fifth_order_on_smooth_pieces() -> None:
    """Error over effort, two free bodies: the slope of an order well beyond five."""
    scene = pair(friction=FRICTION, gravity=[0.0, 0.0, -1.0])
    exact = solve(scene, 0.48, 1e-14)
    errors, steps = [], []
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10):
        found = solve(scene, 0.48, rtol)
        errors.append(float(np.abs(found.states[-1] - exact.states[-1]).max()))
        steps.append(1.0 / found.evaluations)
    assert order(steps, errors) > 5.0


def test_the_demo_against_the_reduced_equations() -> None:
    """Mass centre off the axis, tilted inertia, bending in the normal force."""
    scene = bundled("demo")
    reference = slide_and_spin(scene)
    found = solve(scene, 5.0)
    assert abs(moved(found) - reference.distance) < 2e-11
    assert abs((found.angle[-1] - found.angle[0]) / (2.0 * math.pi) - reference.turns) < 1e-11
    assert abs(found.stop_time - reference.stop_time) < 2e-11
    times = reference.t[: int(0.9 * len(reference.t) * reference.stop_time / 5.0)]
    sampled = solve(scene, 5.0, times=times)
    np.testing.assert_allclose(
        sampled.normal_force, reference.normal_force[: len(times)], rtol=1e-8
    )


@pytest.mark.parametrize("friction", [{}, FRICTION])
def test_two_free_bodies_against_newton_and_euler(friction: dict[str, Any]) -> None:
    scene = pair(friction=friction, gravity=[0.0, 0.0, -1.0])
    reference = free_pair(scene, 0.48)
    found = solve(scene, 0.48)
    state = found.states[-1]
    com_b = state[13:16] + rotation(state[16:20]) @ np.array(scene.body_b.com)
    assert abs(moved(found) - reference.distance) < 2e-11
    assert abs(found.angle[-1] - found.angle[0] - reference.angle) < 2e-11
    assert np.abs(com_b - reference.com_b).max() < 2e-11


@pytest.mark.parametrize("mass_a", [1e-3, 1.0, 1e3])
def test_two_free_bodies_keep_momentum_and_energy(mass_a: float) -> None:
    scene = pair(mass_a=mass_a, spin=8.0)
    par = pack(scene, plant=True)
    found = solve(scene, 1.0, 1e-12, np.linspace(0.0, 1.0, 5).tolist())
    momentum = np.array([plant.momentum(par, state) for state in found.states])
    energy = np.array([plant.energy(par, state) for state in found.states])
    np.testing.assert_allclose(momentum, momentum[:1] + np.zeros((5, 6)), atol=1e-11)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-10)


def test_friction_takes_the_energy_that_it_reports() -> None:
    """Energy lost = integral of P |s|; pointwise, friction is on the disc and against slip."""
    scene = pair(friction=FRICTION)
    par = pack(scene, plant=True)
    times = np.linspace(0.0, 0.5, 2001)
    found = solve(scene, 0.5, times=times.tolist())
    energy = np.array([plant.energy(par, state) for state in found.states])
    radius = scene.friction.radius
    s = np.stack([found.velocity, radius * found.angular_velocity], axis=1)
    phi = found.friction / [1.0, radius]
    power = np.sum(phi * s, axis=1)
    lost = float(np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(times)))
    assert energy[-1] - energy[0] == pytest.approx(lost, rel=1e-6)
    f, m = found.forces[:, 1:3], found.forces[:, 4:6]
    normal = np.hypot(*f.T) + 2.0 / 0.1 * np.hypot(*m.T) + 0.5
    np.testing.assert_allclose(found.normal_force, normal, rtol=1e-12)
    np.testing.assert_allclose(np.hypot(*phi.T), 0.2 * normal, rtol=1e-12)
    np.testing.assert_allclose(power, -np.hypot(*phi.T) * np.hypot(*s.T), rtol=1e-12)


def test_which_body_is_grounded_does_not_matter() -> None:
    """The sleeve free on a fixed shaft, and the same pair with the names exchanged, no bending."""
    com = (0.01, 0.02, 0.0)
    one = sleeve(v=0.5, spin=10.0, com=com, l0=0.0, friction=FRICTION | {"overlap": 0.0})
    values = dict(one.parameters())
    for name in ("kind", "mass", "com", "inertia"):
        values[f"body_a.{name}"], values[f"body_b.{name}"] = (
            values[f"body_b.{name}"], values[f"body_a.{name}"],
        )  # fmt: skip
    values["plant.body_a.twist"] = values["plant.body_b.twist"]
    values["plant.body_b.twist"] = (0.0,) * 6
    other = Scene.from_parameters(values)
    a, b = solve(one, 0.2), solve(other, 0.2)
    np.testing.assert_allclose(b.states[-1, :13], a.states[-1, 13:], atol=1e-10)
    assert moved(a) == pytest.approx(-moved(b), abs=1e-11)


def test_a_bead_on_a_turning_rod() -> None:
    """A driven body keeps its twist: l = l0 cosh(w t)."""
    scene = pair(v=0.0, spin=0.0, turning=(0.0, 0.0, 2.0), body_b={"com": [0.0, 0.0, 0.0]})
    driven = Scene.from_parameters({**scene.parameters(), "body_a.kind": "driven"})
    assert abs(solve(driven, 1.0).length[-1] - 0.2 * math.cosh(2.0)) < 1e-11


def test_a_held_misalignment_stays_and_does_no_work() -> None:
    """B turns about its own axis, which keeps its angle to the slot; energy is kept."""
    tilt = about_y(0.3)
    scene = sleeve(v=0.5, spin=0.0, gravity=[0.0, 0.0, 0.0], com=(0.01, 0.02, 0.0))
    axis = rotation(tilt)[:, 0]
    values = {
        **scene.parameters(),
        "node_b.orientation": (0.0, 0.0, 0.0, 1.0),
        "plant.body_b.pose": (0.2, 0.0, 0.0, *tilt),
        "plant.body_b.twist": (0.5, 0.0, 0.0, *(10.0 * axis)),
    }
    scene = Scene.from_parameters(values)
    par = pack(scene, plant=True)
    found = solve(scene, 0.5, times=np.linspace(0.0, 0.5, 6).tolist())
    assert abs(found.angle[-1] - found.angle[0]) > 1.0
    for state in found.states:
        np.testing.assert_allclose(rotation(state[16:20])[:, 0], axis, atol=1e-12)
        np.testing.assert_allclose(state[14:16], 0.0, atol=1e-12)
        assert plant.energy(par, state) == pytest.approx(plant.energy(par, found.states[0]))


# --- events ---


def test_1_coast_on_a_loaded_sleeve() -> None:
    time, distance = coast(0.2, 9.81, 5.0, 2.0, 1.0)
    found = solve(bundled("coast"), 1.0)
    assert abs(found.stop_time - time) < 1e-13
    assert abs(moved(found) - distance) < 1e-13
    assert (found.velocity[-1], found.regime[-1]) == (0.0, STICK)


@pytest.mark.parametrize("mu", [0.1, 0.25])
def test_4_binding_ratio(mu: float) -> None:
    for share, binds in ((0.999, False), (1.001, True)):
        e = share * 0.1 / (2.0 * mu)
        scene = sleeve(
            mass=1.0,
            gravity=[0.0, 0.0, 0.0],
            friction={"coefficient": mu, "radius": 0.02, "overlap": 0.1},
            plant={"body_b": {"load": [10.0, 0.0, 0.0, 0.0, 10.0 * e, 0.0]}},
        )
        found = solve(scene, 0.1)
        expected = 0.0 if binds else 0.5 * 10.0 * (1.0 - share) * 0.01
        assert moved(found) == pytest.approx(expected, rel=1e-9, abs=1e-16)
        assert found.regime[-1] == (STICK if binds else SLIP)


@pytest.mark.parametrize("share", [0.9999, 1.0001, 1.1])
def test_5_journal_pendulum(share: float) -> None:
    """Just beyond the verge it creeps off: friction is 50000 times what accelerates it (stiff)."""
    theta = share * math.asin(0.3 * 0.02 / 0.1)
    com = (0.0, 0.1 * math.sin(theta), -0.1 * math.cos(theta))
    found = solve(sleeve(com=com, friction={"coefficient": 0.3, "radius": 0.02}), 0.5, 1e-10)
    assert found.evaluations < 20000
    if share < 1.0:
        assert (found.angle[-1], found.regime[-1]) == (0.0, STICK)
        return
    # the swing about the verge is a small oscillation from (share - 1) theta to its other side
    verge = math.asin(0.06)
    assert kinds(found)[:1] == ["rests"]
    assert found.angle[-1] == pytest.approx(-2.0 * (theta - verge), rel=2e-3)


def test_6_slider_on_an_incline() -> None:
    friction = {"coefficient": 0.3, "radius": 0.02, "overlap": 0.1}
    found = solve(sleeve(shaft=about_y(0.5), friction=friction), 1.0)
    a = 9.81 * (math.sin(0.5) - 0.3 * math.cos(0.5))
    assert moved(found) == pytest.approx(0.5 * a, rel=1e-13)
    below = solve(sleeve(shaft=about_y(math.atan(0.3) - 1e-9), friction=friction), 1000.0)
    assert moved(below) == 0.0


@pytest.mark.parametrize("eps", [1.0, 0.5, 0.0])
def test_7_between_two_stops(eps: float) -> None:
    """The n-th crossing takes w/(v0 eps^n); with eps = 0 one contact absorbs all."""
    stops = {"l_min": -0.1, "l_max": 0.1, "restitution": eps}
    found = solve(sleeve(v=1.0, l0=0.0, gravity=[0.0, 0.0, 0.0], stops=stops), 1.0)
    times = [event.time for event in found.events]
    expected = [0.1]
    while eps > 0.0 and expected[-1] + 0.2 / eps ** len(expected) < 1.0:
        expected.append(expected[-1] + 0.2 / eps ** len(expected))
    assert times == pytest.approx(expected, abs=1e-13)
    assert set(kinds(found)) == {"impact"}
    assert abs(found.velocity[-1]) == eps ** len(expected)
    if eps == 0.0:
        assert found.length[-1] == 0.1


def test_a_ball_bounces_to_rest() -> None:
    """Bounces on a stop under gravity end after t = v/g (1 + eps)/(1 - eps), then it lies."""
    eps, g = 0.5, 9.81
    stops = {"l_max": 0.2, "restitution": eps}
    scene = sleeve(shaft=about_y(0.5 * math.pi), v=-1.0, stops=stops)
    found = solve(scene, 1.0)
    end = 2.0 / g / (1.0 - eps)
    assert found.events[-1].time == pytest.approx(end, abs=1e-6)
    assert (found.length[-1], found.velocity[-1]) == (0.2, 0.0)
    assert found.reaction[-1, 0] == pytest.approx(-2.0 * g)


def test_a_stop_lets_go_when_its_reaction_would_pull() -> None:
    """A turning rod presses a bead against the outer stop; a spring takes it off, once."""
    scene = sleeve(
        v=1.0, l0=0.0, gravity=[0.0, 0.0, 0.0], stops={"l_max": 0.1}, elasticity={"k1": 50.0}
    )
    found = solve(scene, 0.5)
    assert kinds(found) == ["impact"]  # no push towards the stop: it leaves at once
    assert found.length[-1] == pytest.approx(0.1 * math.cos(5.0 * (0.5 - found.events[0].time)))


def test_8_dry_friction_oscillator() -> None:
    """It rests at the exact half-cycle value, 2F/k less each time."""
    k, force, m = 800.0, 0.3 * 2.0 * 9.81, 2.0
    friction = {"coefficient": 0.3, "radius": 0.02}
    scene = sleeve(mass=m, v=1.0, l0=0.0, elasticity={"k1": k}, friction=friction)
    a = force / k
    points = [math.sqrt(m / k + a * a) - a]
    while abs(points[-1]) > a:
        points.append(math.copysign(2.0 * a, points[-1]) - points[-1])
    found = solve(scene, 3.0)
    assert kinds(found) == ["reverses"] * (len(points) - 1) + ["rests"]
    assert [event.length for event in found.events] == pytest.approx(points, abs=1e-12)
    assert found.length[-1] == pytest.approx(points[-1], abs=1e-13)


def test_stick_breaks_away_where_it_must() -> None:
    """On a rod that tips over evenly: what stick needs meets mu_s FN, found to the last digits."""
    friction = {"coefficient": 0.2, "static_coefficient": 0.5, "decay": 50.0, "radius": 0.02}
    scene = pair(
        v=0.0, spin=0.0, turning=(0.0, 1.0, 0.0), gravity=[0.0, 0.0, -9.81], l0=0.05,
        friction=friction, body_b={"com": [0.0, 0.0, 0.0]},
    )  # fmt: skip
    driven = Scene.from_parameters({**scene.parameters(), "body_a.kind": "driven"})
    found = solve(driven, 0.6)
    assert kinds(found)[0] == "breaks away"
    t = found.events[0].time
    # along the rod g sin t + w^2 l, about it the products of inertia Iyz w^2, across it g cos t
    needed = math.hypot(9.81 * math.sin(t) + 0.05, 0.0008 / 0.02)
    assert needed == pytest.approx(0.5 * 9.81 * math.cos(t), rel=1e-9)


@pytest.mark.parametrize("d", [0.05, 0.0999, 0.1001, 0.2, 1.0])
def test_jam(d: float) -> None:
    """C = 2 mu d/L: below 1 |f1| = mu N0/(1 - c), from 1 on it stops at once and stays."""
    scene = sleeve(
        mass=1.0,
        com=(0.0, 0.0, d),
        v=1.0,
        gravity=[0.0, 0.0, 0.0],
        friction={"coefficient": 0.5, "radius": 0.02, "overlap": 0.1, "preload": 1.0},
    )
    c = 10.0 * d
    found = solve(scene, 1e-5)
    if c < 1.0:
        assert found.forces[0, 0] == pytest.approx(-0.5 / (1.0 - c), rel=1e-9)
        assert found.velocity[-1] < 1.0
    else:
        assert kinds(found) == ["jams"]
        assert found.integrals[-1, 2] == pytest.approx(-1.0)  # the impulse of friction: m v
        assert (moved(found), found.velocity[-1], found.regime[-1]) == (0.0, 0.0, STICK)


def test_11_three_answers() -> None:
    """From slip the least of three: f1 = 3.5 N."""
    scene = sleeve(
        mass=1.0,
        com=(0.0, 0.0, 0.2),
        v=1.0,
        gravity=[0.0, 0.0, 0.0],
        friction={"coefficient": 0.5, "radius": 0.02, "overlap": 0.1, "preload": 1.0},
        plant={"body_b": {"load": [0.0, 0.0, 0.0, 0.0, -1.0, 0.0]}},
    )
    assert solve(scene, 1e-6).forces[0, 0] == pytest.approx(-3.5, rel=1e-9)


@pytest.mark.parametrize("preload", [-30.0, -5.0])
def test_negative_preload(preload: float) -> None:
    """FN = |m g + FCint|."""
    scene = sleeve(v=1.0, friction={"coefficient": 0.2, "radius": 0.02, "preload": preload})
    a = 0.2 * abs(2.0 * 9.81 + preload) / 2.0
    assert solve(scene, 2.0).stop_time == pytest.approx(1.0 / a, rel=1e-12)


def test_cap_and_table() -> None:
    """A cap bounds P; a table of one value is the constant coefficient."""
    capped = sleeve(v=1.0, friction={"coefficient": 0.2, "radius": 0.02, "max_force": 1.0})
    assert solve(capped, 3.0).stop_time == pytest.approx(2.0, rel=1e-12)
    table = {"rates": [0.0, 1.0], "forces": [0.0, 100.0], "values": [0.2, 0.2, 0.2, 0.2]}
    tabled = sleeve(v=1.0, friction={"radius": 0.02, "table": table})
    assert solve(tabled, 3.0).stop_time == pytest.approx(1.0 / (0.2 * 9.81), rel=1e-12)


@pytest.mark.parametrize("criterion", [{"position": 0.3}, {"force": 4.0}])
def test_lock(criterion: dict[str, float]) -> None:
    """The slide locks where it is told, or when its spring pulls harder than told; spin goes on."""
    scene = sleeve(
        v=1.0, l0=0.0, spin=3.0, gravity=[0.0, 0.0, 0.0], elasticity={"k1": 20.0},
        lock={"component": "slide", **criterion},
    )  # fmt: skip
    found = solve(scene, 1.0)
    place = criterion.get("position", 0.2)
    assert kinds(found) == ["locks"]
    assert found.length[-1] == pytest.approx(place, abs=1e-13)
    assert (found.velocity[-1], found.angular_velocity[-1]) == (0.0, 3.0)


def test_a_lean_model_is_the_full_one_with_zeros() -> None:
    base = pair(friction={**FRICTION, "overlap": 0.0})
    changes: dict[str, Any] = {"overlap": 1e300, "static_coefficient": 0.2}
    full = dataclasses.replace(base, friction=dataclasses.replace(base.friction, **changes))
    np.testing.assert_allclose(solve(base, 0.2).states, solve(full, 0.2).states, atol=1e-12)
    stops = {"l_min": -100.0, "l_max": 100.0, "theta_min": -1e3, "theta_max": 1e3}
    bounded = pair(friction={**FRICTION, "overlap": 0.0}, stops=stops)
    np.testing.assert_allclose(solve(base, 0.2).states, solve(bounded, 0.2).states, atol=1e-12)


# --- what it refuses ---


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"body_b": {"kind": "unknown"}}, "body_b.kind = 'unknown'"),
        ({"command": {"slide": {"velocity": 0.1}}}, "command.slide.velocity = 0.1"),
    ],
)
def test_what_cannot_be_solved_is_refused(change: dict[str, Any], text: str) -> None:
    values = merged({"method": "penalty", "penalty": {"stiffness": 1e4, "damping": 20.0}}, change)
    if "command" in change:
        values = change
    with pytest.raises(SceneError, match=text):
        solve(sleeve(**values))


@pytest.mark.parametrize("times", [[0.0, math.nan], [1.0, 0.5], [-1.0, 0.0]])
def test_unusable_times_are_refused(times: list[float]) -> None:
    with pytest.raises(ValueError, match="must be finite, ascending"):
        solve(sleeve(), 1.0, times=times)


# --- live ---


def live(scene: Scene) -> Scene:
    return dataclasses.replace(scene, method="minimal")


def test_live_is_closer_than_impulse_and_converges_faster() -> None:
    """The demo in the closed loop: mean forces leave an error of nearly third order."""
    scene = bundled("demo")
    reference = slide_and_spin(scene)
    periods, errors, stops = [4e-3, 2e-3, 1e-3], [], []
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
    assert errors[-1] < 0.2 * abs(plain - reference.distance)
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
