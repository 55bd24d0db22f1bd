"""Method baumgarte: first order, bounded drift, and creep in place of stick."""

import math

import numpy as np
import pytest
from scenes import about_y, bundled, order, pair, sleeve, with_period

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.core.layout import JAMMED, MISALIGNED, SLIP, STICK
from cylconn_ros.errors import SceneError
from cylconn_ros.reference import free_pair, slide_and_spin
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.simulate import Run, simulate

PERIODS = [4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4]
FRICTION = {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1}


def textbook(scene: Scene, **parameters: float) -> Scene:
    """The same scene with method baumgarte."""
    values = {**scene.parameters(), "method": "baumgarte"}
    values.update({f"baumgarte.{name}": value for name, value in parameters.items()})
    return Scene.from_parameters(values)


def run(scene: Scene, duration: float) -> Run:
    return simulate(scene, samples=round(duration / scene.period) + 1)


def test_its_equations_hold() -> None:
    """Accelerations by finite differences of the exact plant: -2 alpha w - beta^2 e."""
    h = 1e-6
    start = pair(friction=FRICTION, node_a={"position": [0.01, -0.02, 0.03]})
    scene = textbook(with_period(start, h), alpha=30.0, beta=50.0)
    scene = Scene.from_parameters(
        {**scene.parameters(), "reference.offsets": "zero", "reference.pull_in_speed": 1e3}
    )
    found = simulate(scene, samples=3)
    rates = np.column_stack([found["velocity"], found["angular_velocity"]])
    measured = (rates[1] - rates[0])[[1, 2, 4, 5]] / h
    error = np.array([*found["offset"][0], *-found["misalignment"][0]])
    wanted = -2.0 * 30.0 * rates[0][[1, 2, 4, 5]] - 50.0**2 * error
    assert np.linalg.norm(error) > 0.03
    np.testing.assert_allclose(measured, wanted, rtol=1e-4, atol=1e-2)
    assert found["residual"].max() < 1e-12


def test_distance_and_turns_are_of_first_order() -> None:
    scene = bundled("demo")
    expected = slide_and_spin(scene)
    errors = []
    for h in PERIODS:
        found = run(textbook(with_period(scene, h)), 5.0)
        at_stop = found["displacement"][round(expected.stop_time / h)]
        errors.append(abs(at_stop - expected.distance))
    assert 0.7 < order(PERIODS, errors) < 1.3
    assert errors[2] < 0.02


@pytest.mark.parametrize("friction", [{}, FRICTION])
def test_two_free_bodies_are_of_first_order(friction: dict[str, float]) -> None:
    expected = free_pair(pair(friction=friction), 0.2)
    errors = []
    for h in PERIODS[2:] + [1.25e-4]:
        found = run(textbook(with_period(pair(friction=friction), h)), 0.2)
        errors.append(abs(found["displacement"][-1] - expected.distance))
    assert order(PERIODS[2:] + [1.25e-4], errors) > 0.9
    assert errors[-1] < 1e-3


def test_the_feedback_bounds_the_drift() -> None:
    """Offsets are of second order or better; with negligible feedback they diverge."""
    scene = with_period(pair(friction=FRICTION), 1e-3)
    held = run(textbook(scene), 1.0)["offset_violation"]
    loose = run(textbook(scene, alpha=1e-3, beta=1e-3), 1.0)["offset_violation"]
    assert held.max() < 1e-5
    assert loose[-1] > 100.0 * held.max()
    errors = [run(textbook(with_period(scene, h)), 0.4)["offset_violation"].max() for h in PERIODS]
    assert order(PERIODS, errors) > 1.8


def test_friction_uses_the_normal_force_of_the_same_instant() -> None:
    """Mass centre d off node b along the load: |f1| = mu N0/(1 - c), c = 2 mu d/L (v0 aside)."""
    d, mu, overlap, v0 = 0.1, 0.2, 0.1, 1e-3
    scene = sleeve(
        mass=1.0,
        com=(0.0, 0.0, d),
        v=1.0,
        gravity=[0.0, 0.0, 0.0],
        friction={"coefficient": mu, "radius": 0.02, "overlap": overlap, "preload": 3.0},
    )
    found = run(textbook(scene, regularisation_velocity=v0), 0.0)
    share = 1.0 / math.hypot(1.0, v0)
    c = share * 2.0 * mu * d / overlap
    assert found["force"][0, 0] == pytest.approx(-share * mu * 3.0 / (1.0 - c), rel=1e-12)


def test_the_least_of_several_solutions_is_used() -> None:
    """Case 11: 3.5 N, not 9.5 N; in the limit of a small v0."""
    scene = sleeve(
        mass=1.0,
        com=(0.0, 0.0, 0.2),
        v=1.0,
        gravity=[0.0, 0.0, 0.0],
        friction={"coefficient": 0.5, "radius": 0.02, "overlap": 0.1, "preload": 1.0},
        plant={"body_b": {"load": [0.0, 0.0, 0.0, 0.0, -1.0, 0.0]}},
    )
    found = run(textbook(scene, regularisation_velocity=1e-9), 0.0)
    assert found["force"][0, 0] == pytest.approx(-3.5, rel=1e-9)


@pytest.mark.parametrize("preload", [30.0, -8.0])
@pytest.mark.parametrize("scene", [sleeve, pair])
def test_balance_friction_limit_and_dissipation(scene: object, preload: float) -> None:
    """On every sample; the published wrenches are opposite."""
    friction = {**FRICTION, "coefficient": 0.4, "preload": preload, "max_force": 11.0}
    start = scene(v=0.5, spin=20.0, friction=friction)  # type: ignore[operator]
    values = {**start.parameters(), "wrench.axes": "world"}
    found = run(textbook(Scene.from_parameters(values)), 0.5)
    assert np.all(found["traction"] <= found["friction_limit"] * (1.0 + 1e-12))
    assert found["friction_limit"].max() <= 11.0
    slip = found["slip_velocity"]
    power = found["force_friction"] * slip[:, 0]
    power += found["moment_friction"] / 0.02 * slip[:, 1]
    assert np.all(power <= 0.0)
    assert power.min() < -1.0
    outs, states = found.outs, found.states
    np.testing.assert_allclose(outs[:, 0:3], -outs[:, 6:9], rtol=0.0, atol=1e-12)
    about = [
        outs[:, 3 + at // 2 : 6 + at // 2]
        + np.cross(states[:, pose : pose + 3], outs[:, at // 2 : 3 + at // 2])
        for at, pose in ((0, 0), (12, 13))
    ]
    scale = max(np.abs(about[0]).max(), 1.0)
    np.testing.assert_allclose(about[0], -about[1], rtol=0.0, atol=1e-12 * scale)
    for total, parts in (("force", "force"), ("moment", "moment")):
        added = sum(
            found[f"{parts}_{part}"] for part in ("elastic", "viscous", "friction", "actuation")
        )
        np.testing.assert_allclose(found[total][:, 0], added, rtol=1e-12, atol=1e-15)


def test_it_creeps_in_place_of_stick() -> None:
    """On a slope below the friction angle: the faster the greater v0, or the longer the period."""
    slope = 0.5 * math.atan(0.3)
    friction = {**FRICTION, "coefficient": 0.3}
    speeds = []
    for v0, h in ((0.05, 1e-3), (0.1, 1e-3), (1e-9, 1e-3), (1e-9, 5e-4)):
        scene = with_period(sleeve(shaft=about_y(slope), friction=friction), h)
        found = run(textbook(scene, regularisation_velocity=v0), 1.0)
        speeds.append(found["velocity"][-1, 0])
        assert found.outs[-1, layout.REGIME] == STICK
    share = math.tan(slope) / 0.3
    assert speeds[0] == pytest.approx(0.05 * share / math.sqrt(1.0 - share**2), rel=1e-6)
    assert speeds[1] == pytest.approx(2.0 * speeds[0], rel=1e-6)
    assert speeds[2] == pytest.approx(9.81 * math.sin(slope) * 1e-3, rel=1e-6)  # gained a period
    assert speeds[3] == pytest.approx(0.5 * speeds[2], rel=1e-6)


def test_a_jam_stops_within_a_period() -> None:
    """No finite slip force (c > 1): friction removes the slip within the period and is flagged."""
    scene = sleeve(
        mass=1.0,
        com=(0.0, 0.0, 0.1),
        v=1.0,
        friction={"coefficient": 0.6, "radius": 0.02, "overlap": 0.1},
    )
    found = run(textbook(scene), 0.2)
    assert int(found.outs[0, layout.FLAGS]) & JAMMED
    assert found.outs[0, layout.REGIME] == STICK
    assert abs(found["velocity"][1, 0]) < 0.02
    assert np.all(np.isfinite(found.outs))
    assert found.energy[-1] < found.energy[0]


def test_the_correction_speed_of_a_large_error_is_bounded() -> None:
    scene = sleeve(node_a={"position": [0.0, 0.0, 0.1]}, reference={"offsets": "zero"})
    found = run(textbook(scene), 0.5)
    assert int(found.outs[0, layout.FLAGS]) & MISALIGNED
    assert np.abs(found["velocity"][:, 2]).max() <= 0.1 * (1.0 + 1e-3)
    assert run(textbook(scene), 1.5)["offset_violation"][-1] < 1e-6


def test_a_reduced_model_equals_the_full_one_with_zeros() -> None:
    """A coefficient that is zero everywhere is no friction."""
    lean = run(textbook(pair()), 0.2)
    table = {"rates": [0.0, 1.0], "forces": [0.0, 10.0], "values": [0.0] * 4}
    full = run(textbook(pair(friction={"radius": 0.02, "overlap": 0.1, "table": table})), 0.2)
    assert full.outs[-1, layout.REGIME] == SLIP
    np.testing.assert_allclose(full.states, lean.states, rtol=0.0, atol=1e-12)


def test_it_needs_inertia_and_has_no_stops() -> None:
    values = {**sleeve().parameters(), "method": "baumgarte"}
    with pytest.raises(SceneError, match="method = 'baumgarte': needs the inertia of both bodies"):
        Scene.from_parameters({**values, "body_b.kind": "unknown"})
    with pytest.raises(SceneError, match=r"stops\.l_max = 1\.0: the method baumgarte has no stops"):
        Scene.from_parameters({**values, "stops.l_max": 1.0})


def test_the_form_of_the_wrench_does_not_change_the_motion() -> None:
    """Axes, point and hold of the wrench change the motion by the order of the method only."""
    ends = []
    for axes, point in (("body", "origin"), ("world", "com"), ("world", "origin")):
        values = {
            **pair(friction=FRICTION).parameters(),
            "wrench.axes": axes,
            "wrench.point": point,
        }
        ends.append(run(textbook(Scene.from_parameters(values)), 0.2).states[-1])
    np.testing.assert_allclose(ends[1], ends[0], rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(ends[2], ends[0], rtol=0.0, atol=1e-11)


def test_momentum_is_exchanged_exactly_at_the_sample() -> None:
    scene = textbook(pair(friction=FRICTION))
    found = run(scene, 0.3)
    before = Plant(scene).momentum()
    np.testing.assert_allclose(found.plant.momentum()[:3], before[:3], atol=1e-11)
    np.testing.assert_allclose(found.plant.momentum()[3:], before[3:], rtol=2e-3)


def test_the_description_names_the_method() -> None:
    assert Connector(textbook(sleeve())).model.startswith("method baumgarte")


def test_imposed_force_acts_and_imposed_motion_is_refused() -> None:
    scene = textbook(sleeve(mass=2.0, gravity=[0.0, 0.0, 0.0]))
    connector = Connector(Scene.from_parameters({**scene.parameters(), "command.slide.force": 3.0}))
    sample = np.zeros(layout.NSAMPLE)
    sample[layout.MOTION] = Plant(scene).state
    out = connector.step(sample)
    assert out[layout.FORCE] == out[layout.FORCE_ACTUATION] == 3.0
    with pytest.raises(ValueError, match="spin: the method baumgarte has no imposed motion"):
        connector.impose("spin", velocity=1.0)


def test_the_laws_hold_for_random_extreme_scenes() -> None:
    """Outputs are finite, friction is within its limit and opposes slip, for all scales."""
    rng = np.random.default_rng(7)
    jammed = relieved = 0
    for k in range(200):
        mass = 10.0 ** rng.uniform(-3, 3)
        friction = {
            "coefficient": 10.0 ** rng.uniform(-2, 1),
            "radius": 10.0 ** rng.uniform(-5, 0),
            "overlap": 10.0 ** rng.uniform(-5, 0),
            "preload": float(rng.choice([-1.0, 0.0, 1.0])) * 10.0 ** rng.uniform(-3, 4),
        }
        if k % 5 == 0:
            friction |= {"max_force": 10.0 ** rng.uniform(-3, 3)}
        scene = sleeve(
            mass=mass,
            com=(rng.normal(), rng.normal(), rng.normal()),
            friction=friction,
            period=10.0 ** rng.uniform(-4, -1),
            method="baumgarte",
            reference={"offsets": "zero"},
        )
        samples = rng.normal(size=(20, layout.NSAMPLE))
        samples[:, 20:26] *= 10.0 ** rng.uniform(-6, 3)
        samples[:, layout.LOADS] *= 10.0 ** rng.uniform(-6, 4)
        outs = Connector(scene).run(samples)
        assert np.isfinite(outs).all()
        traction, limit = outs[:, layout.TRACTION], outs[:, layout.FRICTION_LIMIT]
        assert np.all(traction <= limit * (1.0 + 1e-12))
        slip = outs[:, layout.SLIP_VELOCITY : layout.SLIP_VELOCITY + 2]
        phi = outs[:, [layout.FORCE_FRICTION, layout.MOMENT_FRICTION]] / [1.0, friction["radius"]]
        power = (phi * slip).sum(axis=1)
        assert np.all(power <= 1e-12 * traction * np.hypot(*slip.T))
        assert outs[:, layout.RESIDUAL].max() < 1e-9
        jammed += int(((outs[:, layout.FLAGS].astype(int) & JAMMED) != 0).sum())
        pressed = outs[:, layout.RADIAL_FORCE] + outs[:, layout.BENDING_FORCE]
        relieved += int((pressed + friction["preload"] < 0.0).sum())
    assert min(jammed, relieved) > 50


@pytest.mark.parametrize("preload", [5.0, -30.0])
def test_a_table_over_the_force_and_a_constant_agree(preload: float) -> None:
    """The search with the greatest slopes compared with Newton's method."""
    law = {"radius": 0.02, "overlap": 0.1, "preload": preload}
    flat = {"rates": [0.0], "forces": [0.0, 1.0], "values": [0.3, 0.3 + 1e-13]}
    outs = [
        run(textbook(sleeve(com=(0.0, 0.01, 0.04), v=0.5, spin=9.0, friction=f)), 0.05).outs
        for f in ({**law, "coefficient": 0.3}, {**law, "table": flat})
    ]
    np.testing.assert_allclose(outs[1][:, :-1], outs[0][:, :-1], rtol=1e-9, atol=1e-9)
