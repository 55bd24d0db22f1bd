"""Method impulse: laws of a step, invariances, convergence to independent references."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import about_y, bundled, merged, order, pair, rotation, sleeve, with_period

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.core.layout import SLIP, STICK
from cylconn_ros.methods.predicted_end import MIN_TURN
from cylconn_ros.reference import free_pair, slide_and_spin
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.simulate import Run, simulate

FRICTION = {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1, "preload": 0.5}
PERIODS = [4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4]


def run(scene: Scene, duration: float) -> Run:
    return simulate(scene, samples=round(duration / scene.period) + 1)


def wrenches(out: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return out[layout.FORCE_A : layout.FORCE_B], out[layout.FORCE_B : layout.STATE0]


# --- laws of a step ---


@settings(max_examples=60)
@given(
    st.floats(-6.0, 6.0),
    st.one_of(st.just(0.0), st.floats(1e-6, 3.0)),
    st.floats(-5.0, 5.0),
    st.floats(-50.0, 50.0),
    st.sampled_from([0.0, 0.05, 0.3]),
    st.sampled_from(["world", "body"]),
)
def test_a_step_exchanges_momentum_and_dissipates_energy(
    exponent: float, mu: float, v: float, spin: float, overlap: float, axes: str
) -> None:
    """One body gains the momentum that the other loses; friction only dissipates."""
    friction = {"coefficient": mu, "radius": 0.02, "overlap": overlap, "preload": 1.0}
    scene = pair(mass_a=10.0**exponent, v=v, spin=spin, friction=friction, wrench={"axes": axes})
    plant, connector = Plant(scene), Connector(scene)
    before = plant.momentum()
    for _ in range(3):
        sample = np.concatenate([plant.state, np.zeros(12)])
        out = connector.step(sample)
        slide, turn = out[layout.FORCE_FRICTION], out[layout.MOMENT_FRICTION]
        velocity, rate = out[layout.VELOCITY], out[layout.ANGULAR_VELOCITY]
        if out[layout.REGIME] == SLIP and out[layout.SLIP_RATE] > 0.1:
            assert slide * velocity + turn * rate <= 0.0
        assert out[layout.TRACTION] <= out[layout.FRICTION_LIMIT] * (1.0 + 1e-12)
        assert out[layout.RESIDUAL] < 1e-12
        plant.step(*wrenches(out))
    scale = np.abs(before).max() + abs(v) + abs(spin) * 1e-2
    np.testing.assert_allclose(plant.momentum(), before, atol=1e-11 * scale)


def test_action_and_reaction() -> None:
    """Opposite forces; torques about any point cancel in the configuration half a period later."""
    scene = pair(friction=FRICTION, wrench={"axes": "world", "point": "com"})
    state = Plant(scene).state
    out = Connector(scene).step(np.concatenate([state, np.zeros(12)]))
    a, b = wrenches(out)
    np.testing.assert_array_equal(a[:3], -b[:3])
    # both mass centres at their mean over the free period: half a period on, without gravity
    h = scene.period
    mean = []
    for at, body in ((0, scene.body_a), (13, scene.body_b)):
        arm = rotation(state[at + 3 : at + 7]) @ body.com
        velocity = state[at + 7 : at + 10] + np.cross(state[at + 10 : at + 13], arm)
        mean.append(state[at : at + 3] + arm + 0.5 * h * velocity)
    for point in (np.zeros(3), np.array([10.0, -20.0, 5.0])):
        total = a[3:] + b[3:] + np.cross(mean[0] - point, a[:3]) + np.cross(mean[1] - point, b[:3])
        np.testing.assert_allclose(total, 0.0, atol=1e-12 * np.abs(b).max() * 30.0)


def test_parts_add_up_component_by_component() -> None:
    scene = pair(
        friction=FRICTION,
        elasticity={"k1": 30.0, "kr1": 0.2},
        damping={"c1": 2.0, "cr1": 0.01},
    )
    found = run(scene, 0.2)
    for total, name in (("force", "force"), ("moment", "moment")):
        parts = sum(
            found[f"{name}_{part}"]
            for part in ("elastic", "viscous", "friction", "actuation", "reaction")
        )
        np.testing.assert_allclose(parts, found[total][:, 0], rtol=1e-12, atol=1e-14)
        for part in ("elastic", "viscous", "friction"):
            assert np.abs(found[f"{name}_{part}"]).max() > 0.0
    for part in ("radial_force", "bending_force", "normal_force"):
        assert found[part].min() > 0.0
    np.testing.assert_allclose(
        found["normal_force"],
        found["radial_force"] + found["bending_force"] + 0.5,
    )


# --- what must not matter, and what must ---


def swapped(scene: Scene) -> Scene:
    """The same two bodies with their names exchanged; node b stays at the same point in space."""
    values: dict[str, Any] = dict(scene.parameters())
    for name in ("mass", "com", "inertia", "kind"):
        a, b = values[f"body_a.{name}"], values[f"body_b.{name}"]
        values[f"body_a.{name}"], values[f"body_b.{name}"] = b, a
    for name in ("pose", "twist"):
        a, b = values[f"plant.body_a.{name}"], values[f"plant.body_b.{name}"]
        values[f"plant.body_a.{name}"], values[f"plant.body_b.{name}"] = b, a
    values["node_b.position"] = scene.plant.body_b.pose[:3]  # in the old A, which is at the origin
    return Scene.from_parameters(values)


def parting(one: Scene, other: Scene, *, exchanged: bool = False) -> list[float]:
    """Differences between the motions of two scenes after 0.3 s, over decreasing periods."""
    apart = []
    for h in PERIODS:
        a, b = run(with_period(one, h), 0.3).states[-1], run(with_period(other, h), 0.3).states[-1]
        b = np.concatenate([b[13:], b[:13]]) if exchanged else b
        apart.append(float(np.abs(a - b).max()))
    return apart


FLAT = {"coefficient": 0.2, "radius": 0.02, "overlap": 0.0, "preload": 0.5}


@pytest.mark.parametrize("friction", [{}, FLAT])
def test_swapping_the_bodies_leaves_the_motion(friction: dict) -> None:
    """Without bending in the normal force the order of the nodes does not matter.

    The two runs differ by their own errors only, which are of second order.
    """
    scene = pair(friction=friction)
    apart = parting(scene, swapped(scene), exchanged=True)
    assert order(PERIODS, apart) > 1.8
    assert apart[2] < 1e-4


def test_the_position_of_node_b_matters_only_for_bending() -> None:
    """A shift along the axis changes nothing without friction or with L = 0; it does with L > 0."""
    far: dict[str, Any] = {"node_b": {"position": [0.15, 0.0, 0.0]}}
    for friction in ({}, FLAT):
        apart = parting(pair(friction=friction), pair(friction=friction, **far))
        assert order(PERIODS, apart) > 1.8
        assert apart[2] < 5e-5
    apart = parting(pair(friction=FRICTION), pair(friction=FRICTION, **far))
    assert min(apart) > 1e-3


def test_outputs_are_invariant_under_rotation_of_the_world() -> None:
    """A rotation of the whole scene leaves the numbers in the body's axes unchanged."""
    turn = about_y(0.7)
    plain = sleeve(v=0.5, spin=10.0, com=(0.01, 0.02, 0.0), friction=FRICTION)
    gravity = rotation(turn) @ np.array(plain.gravity)
    tilted = sleeve(
        v=0.5, spin=10.0, com=(0.01, 0.02, 0.0), friction=FRICTION, shaft=turn,
        gravity=[*map(float, gravity)], node_a={"orientation": list(turn)},
    )  # fmt: skip
    one, other = run(plain, 0.2), run(tilted, 0.2)
    np.testing.assert_allclose(one.outs[:, 6:12], other.outs[:, 6:12], atol=1e-9)
    np.testing.assert_allclose(one["displacement"], other["displacement"], atol=1e-12)


def test_a_reduced_model_equals_the_full_one_with_zeros() -> None:
    base = pair(friction={**FRICTION, "overlap": 0.0})
    full = dataclasses.replace(
        base, friction=dataclasses.replace(base.friction, overlap=1e300, static_coefficient=0.2)
    )
    np.testing.assert_allclose(run(base, 0.1).states, run(full, 0.1).states, atol=1e-12)
    without = pair()
    with_zero = pair(friction={"coefficient": 0.0, "radius": 0.02}, elasticity={"k1": 0.0})
    np.testing.assert_allclose(run(without, 0.1).states, run(with_zero, 0.1).states, atol=1e-12)


# --- convergence ---


def test_second_order_on_the_fixed_shaft() -> None:
    """The demo scene compared with the reduced equations, friction from the same reactions."""
    scene = bundled("demo")
    reference = slide_and_spin(scene)
    errors = []
    for h in PERIODS:
        found = run(with_period(scene, h), 4.0)
        errors.append(
            [
                abs(found["displacement"][-1] - reference.distance),
                abs(found["rotation"][-1] / (2.0 * math.pi) - reference.turns),
                found["offset_violation"].max(),
                found["velocity_violation"].max(),
            ]
        )
        assert found.outs[-1, layout.REGIME] == STICK
    orders = [order(PERIODS, list(column)) for column in np.array(errors).T]
    assert min(orders) > 1.8, orders
    slow = [k for k, h in enumerate(PERIODS) if 60.0 * h < MIN_TURN]  # beyond, the end is foreseen
    assert order([PERIODS[k] for k in slow], [errors[k][2] for k in slow]) > 2.8, "third order"


@pytest.mark.parametrize("friction", [{}, FRICTION])
def test_second_order_on_two_free_bodies(friction: dict) -> None:
    scene = pair(friction=friction, gravity=[0.0, 0.0, -1.0])
    reference = free_pair(scene, 0.48)
    assert reference.drift < 1e-11
    errors = []
    for h in PERIODS:
        found = run(with_period(scene, h), 0.48)
        state = found.states[-1]
        com_b = state[13:16] + rotation(state[16:20]) @ np.array(scene.body_b.com)
        errors.append(
            [
                abs(found["displacement"][-1] - reference.distance),
                abs(found["rotation"][-1] - reference.angle),
                np.abs(com_b - reference.com_b).max(),
            ]
        )
    orders = [order(PERIODS, list(column)) for column in np.array(errors).T]
    assert min(orders) > 1.8, orders
    assert max(errors[2]) < 5e-6


@pytest.mark.parametrize(
    ("change", "least"),
    [
        ({"wrench": {"hold": "body"}}, 1.8),
        ({"plant_integration": "semi_implicit"}, 0.9),
    ],
)
def test_every_form_of_hold_converges(change: dict, least: float) -> None:
    scene = pair(**merged({"friction": FRICTION}, change))
    reference = free_pair(scene, 0.4)
    errors = []
    for h in PERIODS:
        found = run(with_period(scene, h), 0.4)
        state = found.states[-1]
        com_b = state[13:16] + rotation(state[16:20]) @ np.array(scene.body_b.com)
        errors.append(float(np.abs(com_b - reference.com_b).max()))
    assert order(PERIODS, errors) > least


def test_driven_body_a_bead_on_a_turning_rod() -> None:
    """A driven rod rotates at w: l'' = w^2 l, so that l = l0 cosh(w t)."""
    scene = pair(v=0.0, spin=0.0, turning=(0.0, 0.0, 2.0), body_b={"com": [0.0, 0.0, 0.0]})
    values = {**scene.parameters(), "body_a.kind": "driven"}
    errors = []
    for h in PERIODS:
        found = run(with_period(Scene.from_parameters(values), h), 1.0)
        errors.append(abs(found["length"][-1] - 0.2 * math.cosh(2.0)))
    assert order(PERIODS, errors) > 1.8
    assert errors[2] < 1e-5


def test_spring_and_damper_on_the_slide() -> None:
    """Closed form of the damped oscillation m u'' + c u' + k u = 0; second order."""
    m, c, k, v0 = 2.0, 4.0, 800.0, 1.0
    scene = sleeve(mass=m, v=v0, elasticity={"k1": k}, damping={"c1": c})
    decay, beat = c / (2 * m), math.sqrt(k / m - (c / (2 * m)) ** 2)
    expected = v0 / beat * math.exp(-decay) * math.sin(beat)
    found = [run(with_period(scene, h), 1.0)["displacement"][-1] for h in PERIODS]
    errors = [abs(x - expected) for x in found]
    assert order(PERIODS, errors) > 1.8


def test_a_stiff_spring_stays_bounded() -> None:
    """Springs are implicit: k h^2/m = 1e6 is stable."""
    found = run(sleeve(v=1.0, elasticity={"k1": 2e12}), 0.5)
    assert np.abs(found["displacement"]).max() < 1e-3


# --- stick ---


def test_stick_does_not_creep_on_moving_bodies() -> None:
    """Two bodies rotating together in stick: s+ = 0 alone would creep by h w^2 l/2 per second."""
    scene = pair(v=0.0, spin=0.0, friction={**FRICTION, "coefficient": 3.0, "preload": 50.0})
    found = run(scene, 5.0)
    assert np.all(found.outs[:, layout.REGIME] == STICK)
    moved = found["displacement"]
    assert np.ptp(moved[100:]) < 1e-8
    assert abs(moved[-1]) < 1e-6
    assert int(found.outs[-1, layout.FLAGS]) & layout.STOPPED


def test_stick_holds_to_the_last_digit_on_a_fixed_shaft() -> None:
    scene = sleeve(shaft=about_y(0.1), friction=FRICTION, com=(0.01, 0.0005, 0.0))
    found = run(scene, 10.0)
    assert np.ptp(found["displacement"]) < 1e-16
    assert np.ptp(found["rotation"]) < 1e-13


def test_static_friction_breaks_away_at_its_own_limit() -> None:
    """mu_s holds 5 N at FN = 10 N; in slip friction is mu_k m g."""
    friction = {
        "coefficient": 0.2, "static_coefficient": 0.5, "decay": 100.0, "radius": 0.02,
    }  # fmt: skip
    for push, regime in ((4.99, STICK), (5.01, SLIP)):
        scene = sleeve(
            mass=1.0, gravity=[0.0, 0.0, -10.0], friction=friction,
            plant={"body_b": {"load": [push, 0.0, 0.0, 0.0, 0.0, 0.0]}},
        )  # fmt: skip
        found = run(scene, 1.0)
        assert found.outs[-1, layout.REGIME] == regime
        if regime == SLIP:
            assert found["friction_coefficient"][-1] == pytest.approx(0.2, rel=1e-6)
