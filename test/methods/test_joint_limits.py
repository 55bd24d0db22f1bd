"""Stops with restitution, locks, imposed motion and force."""

import math
from typing import Any

import numpy as np
import pytest
from scenes import SKEW, about_y, pair, sleeve, with_period

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.core.layout import STICK
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.simulate import Run, simulate

FRICTION = {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1}
WEIGHTLESS: dict[str, Any] = {"gravity": [0.0, 0.0, 0.0]}


def run(scene: Scene, duration: float) -> Run:
    return simulate(scene, samples=round(duration / scene.period) + 1)


def crossings(width: float, v0: float, eps: float, duration: float) -> float:
    """Case 7: position of a body that bounces between stops 0 and ``width``, from 0 at v0."""
    t, place, speed, way = 0.0, 0.0, v0, 1.0
    while t + width / speed < duration:
        t, place, way = t + width / speed, width - place, -way
        speed *= eps
    return place + way * speed * (duration - t)


@pytest.mark.parametrize("eps", [1.0, 0.8, 0.5])
@pytest.mark.parametrize("period", [1e-3, 7.3e-4])
def test_7_between_two_stops(eps: float, period: float) -> None:
    """The n-th crossing takes w/(v0 eps^n): exact, as an impact leaves no timing error."""
    scene = with_period(
        sleeve(l0=0.0, v=1.0, stops={"l_min": 0.0, "l_max": 0.1, "restitution": eps}, **WEIGHTLESS),
        period,
    )
    found = run(scene, 0.9)
    expected = [crossings(0.1, 1.0, eps, t) if t > 0 else 0.0 for t in found.time]
    flight = found.outs[:, layout.STOP] == 0  # between an impact's two steps it is under way
    flight &= np.roll(flight, 1)
    np.testing.assert_allclose(found["length"][flight], np.array(expected)[flight], atol=1e-12)
    assert found["length"].max() < 0.1 + 1e-3 * eps
    assert (found.outs[:, layout.STOP] == 2).sum() >= 2


def test_7_without_restitution_one_contact_stops_it() -> None:
    for period in (1e-3, 9.1e-4, 5.3e-4):
        scene = with_period(sleeve(l0=0.0, v=1.0, stops={"l_max": 0.1}, **WEIGHTLESS), period)
        found = run(scene, 0.3)
        assert found["length"].max() <= 0.1 + 1e-15
        assert found["length"][-1] == pytest.approx(0.1, abs=1e-14)
        assert abs(found["velocity"][-1, 0]) < 1e-13


def test_stops_of_the_angle() -> None:
    stops = {"theta_max": 1.0, "restitution": 1.0}
    round_ = [2e-3, 0.0, 0.0, 3e-3, 0.0, 3e-3]
    found = run(sleeve(inertia=round_, spin=5.0, stops=stops, **WEIGHTLESS), 0.5)
    assert found["angle"].max() < 1.0 + 5e-3
    assert found["angle"][-1] == pytest.approx(2.0 - 5.0 * 0.5, abs=1e-12)
    assert 4 in found.outs[:, layout.STOP] or 8 in found.outs[:, layout.STOP]


def test_a_sleeve_rests_on_a_stop_under_its_weight() -> None:
    slope = 0.3
    scene = sleeve(shaft=about_y(slope), v=0.2, stops={"l_max": 0.25})
    found = run(scene, 1.0)
    weight = 2.0 * 9.81 * math.sin(slope)
    assert found["length"][-1] == pytest.approx(0.25, abs=1e-12)
    assert found["force_reaction"][-1] == pytest.approx(-weight, rel=1e-9)
    assert found.outs[-1, layout.STOP] == 2
    parts = sum(
        found[f"force_{p}"] for p in ("elastic", "viscous", "friction", "actuation", "reaction")
    )
    np.testing.assert_allclose(parts, found["force"][:, 0], rtol=1e-12, atol=1e-12)


def test_stop_and_stick_in_one_step() -> None:
    """The stop ends the slide at once, friction ends the spin; both come to rest."""
    scene = sleeve(
        v=1.0, spin=2.0, com=(0.0, 0.002, 0.001), friction=FRICTION, stops={"l_max": 0.22}
    )
    found = run(scene, 1.0)
    assert found.outs[-1, layout.REGIME] == STICK
    assert found["length"].max() <= 0.22 + 1e-9
    assert found.energy[-1] < found.energy[0]
    assert np.all(np.isfinite(found.outs))


@pytest.mark.parametrize("speed", [0.1, 1.0, 10.0, 100.0])
@pytest.mark.parametrize("width", [1e-4, 1e-2])
def test_both_stops_in_one_step(speed: float, width: float) -> None:
    stops = {"l_min": 0.2 - width, "l_max": 0.2 + width, "restitution": 0.9}
    for friction in ({}, FRICTION):
        scene = sleeve(v=speed, spin=5.0, com=(0.01, 0.02, 0.0), friction=friction, stops=stops)
        found = run(scene, 0.3)
        assert np.all(np.isfinite(found.outs))
        assert found.energy.max() <= found.energy[0] * (1.0 + 1e-6) + 1e-9
        late = np.abs(found["length"][20:] - 0.2)
        assert late.max() < width + 1.5e-3 * speed


def test_an_eccentric_impact_does_not_gain_energy() -> None:
    """Coupled inertias and friction: restitution is lowered if it would add energy."""
    lowered = 0
    for seed in (110, 159, 399, 1, 2, 3):
        rng = np.random.default_rng(seed)
        radius = 10 ** rng.uniform(-2, 0)
        scene = pair(
            mass_a=10.0 ** rng.uniform(-1, 2),
            v=float(rng.uniform(0.5, 3.0)),
            spin=float(rng.uniform(-3.0, 3.0) / radius),
            turning=(0.0, 0.0, 0.0),
            body_b={"com": [*map(float, 0.3 * rng.normal(size=3))], "inertia": SKEW},
            friction={
                "radius": radius,
                "coefficient": float(rng.uniform(0.0, 1.5)),
                "overlap": float(rng.choice([0.0, 0.1, 0.3])),
            },
            stops={"l_max": 0.203, "restitution": 1.0},
        )
        found = run(scene, 7e-3)
        assert found.energy.max() <= found.energy[0] * (1.0 + 1e-9)
        applied = found["restitution"][found.outs[:, layout.STOP] != 0]
        lowered += bool(len(applied) and 0.0 < applied.min() < 1.0)
    assert lowered >= 3


def test_a_sleeve_stopped_by_friction_does_not_bounce() -> None:
    """An impact has begun, but the sleeve comes to rest before it reaches the stop."""
    scene = sleeve(
        l0=0.0986,
        v=1.0,
        stops={"l_max": 0.1, "restitution": 1.0},
        friction={"coefficient": 0.5, "radius": 0.02, "overlap": 0.1, "preload": 4e3},
        **WEIGHTLESS,
    )
    found = run(with_period(scene, 1e-3), 0.01)
    assert (found.outs[:, layout.STOP] == 0).all()
    assert found["length"].max() < 0.1
    assert abs(found["velocity"][3:, 0]).max() < 1e-12


def test_a_lock_closes_at_its_position() -> None:
    scene = sleeve(v=1.0, lock={"component": "slide", "position": 0.25}, **WEIGHTLESS)
    found = run(scene, 0.2)
    assert found["length"][-1] == pytest.approx(0.25, abs=1e-14)
    assert found.outs[-1, layout.LOCK] == 1
    assert found.outs[10, layout.LOCK] == 0
    pulled = {"body_b": {"load": [-100.0, 0.0, 0.0, 0.0, 0.0, 0.0]}}
    held = sleeve(v=1.0, lock={"component": "slide", "position": 0.25}, plant=pulled, **WEIGHTLESS)
    assert run(held, 0.05).outs[-1, layout.LOCK] == 0  # turned back before it got there


def test_a_lock_closes_at_its_force() -> None:
    lock = {"component": "slide", "force": 15.0}
    found = run(sleeve(v=1.0, elasticity={"k1": 1000.0}, lock=lock, **WEIGHTLESS), 0.3)
    closed = np.flatnonzero(found.outs[:, layout.LOCK] == 1)
    assert abs(found["force"][closed[0] - 1, 0]) > 15.0
    assert abs(found["force"][closed[0] - 2, 0]) <= 15.0
    assert np.ptp(found["length"][closed[0] + 2 :]) < 1e-12


def test_imposed_motion_drives_the_slide() -> None:
    scene = sleeve(friction=FRICTION, command={"slide": {"velocity": 0.1}})
    found = run(scene, 1.0)
    assert found["displacement"][-1] == pytest.approx(0.1, rel=2e-3)
    drive = found["force_reaction"][-1]
    assert drive == pytest.approx(-found["force_friction"][-1], rel=1e-9)
    assert drive == pytest.approx(0.2 * found["normal_force"][-1], rel=1e-9)
    # what the drive puts in is not held against the connector
    assert abs(found["passivity_balance"][-1]) < 1.02 * drive * 0.1


def test_imposed_position_follows_its_ramp() -> None:
    command = {"spin": {"position": 0.0, "velocity": 2.0}}
    found = run(sleeve(friction=FRICTION, command=command), 1.0)
    np.testing.assert_allclose(found["angle"][5:], 2.0 * found.time[5:], atol=2e-3)
    np.testing.assert_allclose(found["angular_velocity"][5:, 0], 2.0, atol=1e-9)


def test_imposed_force_is_actuation() -> None:
    found = run(sleeve(command={"slide": {"force": 6.0}}, **WEIGHTLESS), 1.0)
    assert found["displacement"][-1] == pytest.approx(0.5 * 6.0 / 2.0, rel=1e-9)
    np.testing.assert_array_equal(found["force_actuation"], 6.0)
    assert abs(found["passivity_balance"][-1]) < 1e-6 * 9.0


def test_commands_can_be_set_and_released() -> None:
    scene = sleeve(**WEIGHTLESS)
    connector, plant = Connector(scene), Plant(scene)
    for command, expected in (
        ({"force": 4.0}, 4.0),
        ({}, 0.0),
        ({"velocity": 0.5}, None),
    ):
        connector.impose("slide", **command)
        for _ in range(3):
            out = connector.step(np.concatenate([plant.state, plant.loads]))
            plant.step(out[0:6], out[6:12])
        if expected is not None:
            assert out[layout.FORCE] == expected
    assert plant.state[20] == pytest.approx(0.5)
    with pytest.raises(ValueError, match="must be slide or spin"):
        connector.impose("tilt")
    with pytest.raises(ValueError, match="must not be given with a motion"):
        connector.impose("slide", velocity=1.0, force=1.0)
    with pytest.raises(ValueError, match="must be finite"):
        connector.impose("spin", force=math.inf)


def test_imposed_motion_causes_friction() -> None:
    """The slide of an imposed motion contributes to the slip direction."""
    command = {"slide": {"velocity": 0.3}}
    scene = sleeve(v=0.3, spin=0.4 / 0.02, friction={**FRICTION, "overlap": 0.0}, command=command)
    found = run(scene, 0.001)
    normal = found["normal_force"][0]
    slide, spin = found["force_friction"][0], found["moment_friction"][0] / 0.02
    assert math.hypot(slide, spin) == pytest.approx(0.2 * normal, rel=1e-12)
    assert slide / spin == pytest.approx(0.3 / 0.4, rel=0.05)
