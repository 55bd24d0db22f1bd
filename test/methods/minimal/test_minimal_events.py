"""The method minimal offline, at events: rest, breakaway, stops, locks, jams, imposed motion."""

import math

import numpy as np
import pytest
from scenes import about_y, bundled, pair, sleeve

from cylconn_ros.core import plant
from cylconn_ros.core.layout import SLIP, STICK
from cylconn_ros.errors import SceneError
from cylconn_ros.reference import coast
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.minimal import Solution, solve

FRICTION = {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1, "preload": 0.5}


def kinds(found: Solution) -> list[str]:
    return [event.kind for event in found.events]


def moved(found: Solution) -> float:
    return float(found.length[-1] - found.length[0])


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
    """Just beyond the limit it creeps: friction is 50000 times the accelerating force (stiff)."""
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
    """The n-th crossing takes w/(v0 eps^n); with eps = 0 one contact stops it."""
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
    """Bounces on a stop under gravity end after t = v/g (1 + eps)/(1 - eps), then it rests."""
    eps, g = 0.5, 9.81
    stops = {"l_max": 0.2, "restitution": eps}
    scene = sleeve(shaft=about_y(0.5 * math.pi), v=-1.0, stops=stops)
    found = solve(scene, 1.0)
    end = 2.0 / g / (1.0 - eps)
    assert found.events[-1].time == pytest.approx(end, abs=1e-6)
    assert (found.length[-1], found.velocity[-1]) == (0.2, 0.0)
    assert found.reaction[-1, 0] == pytest.approx(-2.0 * g)


def test_a_stop_releases_if_its_reaction_would_pull() -> None:
    """A rotating rod presses a bead against the outer stop; a spring pulls it off once."""
    scene = sleeve(
        v=1.0, l0=0.0, gravity=[0.0, 0.0, 0.0], stops={"l_max": 0.1}, elasticity={"k1": 50.0}
    )
    found = solve(scene, 0.5)
    assert kinds(found) == ["impact"]  # no push towards the stop: it leaves at once
    assert found.length[-1] == pytest.approx(0.1 * math.cos(5.0 * (0.5 - found.events[0].time)))


def test_8_dry_friction_oscillator() -> None:
    """It rests at the exact half-cycle value, 2F/k less per half cycle."""
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


def test_stick_breaks_away_at_the_limit() -> None:
    """On a rod that tilts at a constant rate: breakaway at mu_s FN, located to the last digits."""
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
    """For c = 2 mu d/L below 1 |f1| = mu N0/(1 - c); from 1 on it stops at once and stays."""
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


def test_11_three_solutions() -> None:
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
    """The slide locks at the position or at the spring force of the lock; spin continues."""
    scene = sleeve(
        v=1.0, l0=0.0, spin=3.0, gravity=[0.0, 0.0, 0.0], elasticity={"k1": 20.0},
        lock={"component": "slide", **criterion},
    )  # fmt: skip
    found = solve(scene, 1.0)
    place = criterion.get("position", 0.2)
    assert kinds(found) == ["locks"]
    assert found.length[-1] == pytest.approx(place, abs=1e-13)
    assert (found.velocity[-1], found.angular_velocity[-1]) == (0.0, 3.0)


# --- imposed motion ---


def test_an_imposed_slide_reduces_friction_of_the_spin() -> None:
    """With v constant u' = -k a u/s, s^2 = u^2 + v^2: v ln(u/(v + s)) + s decreases by k a t."""
    v, mu, radius, mass, inertia = 0.3, 0.2, 0.02, 2.0, 0.02
    friction = {"coefficient": mu, "radius": radius}
    scene = sleeve(spin=100.0, friction=friction, command={"slide": {"velocity": v}})
    found = solve(scene, 0.5)
    assert found.length[-1] == pytest.approx(0.2 + v * 0.5, abs=1e-14)
    assert np.all(found.velocity == v)
    fallen = []
    for u in radius * found.angular_velocity:
        s = math.hypot(u, v)
        fallen.append(v * math.log(u / (v + s)) + s)
    k = mass * radius**2 / inertia
    assert fallen[0] - fallen[1] == pytest.approx(0.5 * k * mu * 9.81, rel=1e-10)
    # what drives it balances friction; friction has no say in the slide
    assert found.reaction[:, 0] == pytest.approx(-found.friction[:, 0], rel=1e-12)
    assert np.all(found.reaction[:, 1] == 0.0)


def test_an_imposed_position_is_set_at_once_and_moves_at_its_rate() -> None:
    command = {"slide": {"position": 0.35, "velocity": -0.2}}
    found = solve(sleeve(v=1.0, spin=3.0, command=command), 0.5)
    assert found.length == pytest.approx([0.35, 0.25], abs=1e-14)
    held = solve(sleeve(v=1.0, friction=FRICTION, command={"slide": {"position": 0.35}}), 0.5)
    assert np.all(held.length == 0.35)
    assert np.all(held.regime == STICK)


def test_an_imposed_spin_exchanges_momentum() -> None:
    scene = pair(friction=FRICTION, command={"spin": {"velocity": 2.0}})
    par = pack(scene, plant=True)
    found = solve(scene, 0.5, times=np.linspace(0.0, 0.5, 4))
    momentum = np.array([plant.momentum(par, state) for state in found.states])
    before = plant.momentum(par, np.array([
        *scene.initial_pose(0), *scene.initial_twist(0),
        *scene.initial_pose(1), *scene.initial_twist(1),
    ]))  # fmt: skip
    np.testing.assert_allclose(momentum, before + np.zeros((4, 6)), atol=1e-11)
    np.testing.assert_allclose(found.angle, 2.0 * found.time, atol=1e-13)


def test_a_lock_ends_an_imposed_motion_and_a_stop_does_not() -> None:
    lock = {"component": "slide", "position": 0.3}
    command = {"slide": {"velocity": 1.0}}
    found = solve(sleeve(command=command, lock=lock), 0.5)
    assert kinds(found) == ["locks"]
    assert found.events[0].time == pytest.approx(0.1, abs=1e-15)
    assert found.length[-1] == 0.3
    found = solve(sleeve(command=command, stops={"l_max": 0.3}), 0.5)
    assert found.length[-1] == pytest.approx(0.7)


# --- refused scenes ---


def test_an_unknown_inertia_is_refused() -> None:
    gains = {"stiffness": 1e4, "damping": 20.0}
    scene = sleeve(method="penalty", penalty=gains, body_b={"kind": "unknown"})
    with pytest.raises(SceneError, match=r"body_b\.kind = 'unknown'"):
        solve(scene)


@pytest.mark.parametrize("times", [[0.0, math.nan], [1.0, 0.5], [-1.0, 0.0]])
def test_unusable_times_are_refused(times: list[float]) -> None:
    with pytest.raises(ValueError, match="must be finite, ascending"):
        solve(sleeve(), 1.0, times=times)
