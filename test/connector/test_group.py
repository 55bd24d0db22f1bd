"""Connectors that share bodies: least reactions, Coulomb's law in each, nothing grows."""

from typing import Any

import numpy as np
import pytest
from bearings import MASS, OVERLAP, RADIUS, parameters

from cylconn_ros.connector.connector import Connector
from cylconn_ros.connector.group import Group
from cylconn_ros.core import layout
from cylconn_ros.core.least_norm import factor_projected, null_space, solve_projected
from cylconn_ros.scene.scene import SceneError, load, several, shipped
from cylconn_ros.simulation.group import Bodies, simulate_group
from cylconn_ros.simulation.simulate import simulate

ARM = 0.5 * OVERLAP
WEIGHT = MASS * 9.81
FORCE, MOMENT = slice(layout.FORCE, layout.FORCE + 3), slice(layout.MOMENT, layout.MOMENT + 3)


def shaft(*places, **changes):
    return list(several(parameters(places, **changes)).values())


def test_one_alone_is_the_connector_bit_for_bit():
    scene = load(shipped("demo"))
    run = simulate(scene, samples=300)
    group, connector = Group([scene]), Connector(scene)
    sample = np.zeros(layout.NSAMPLE)
    for state in run.states:
        sample[layout.MOTION] = state
        assert np.array_equal(group.step(sample[None])[0], connector.step(sample), equal_nan=True)


@pytest.mark.parametrize("com", [0.0, 0.1])
def test_two_bearings_share_the_weight_as_the_closed_form_says(com):
    """Least f1^2 + f2^2 + (m1^2 + m2^2)/a^2 with f1 + f2 = W, d (f2 - f1) + m = W c."""
    d = 0.3
    run = simulate_group(shaft(-d, d, com=com, friction={"coefficient": 0.0}), 100)
    couple = WEIGHT * com / (2.0 * (d**2 + ARM**2))
    for k, sign in ((0, -1.0), (1, 1.0)):
        np.testing.assert_allclose(
            run.outs[:, k, layout.FORCE + 2], 0.5 * WEIGHT + sign * couple * d, rtol=1e-9
        )
        np.testing.assert_allclose(
            run.outs[:, k, layout.MOMENT + 1], -couple * ARM**2, rtol=1e-9, atol=1e-12
        )
    assert run.outs[:, :, layout.RESIDUAL].max() < 1e-12
    assert run.outs[:, :, layout.OFFSET_VIOLATION].max() < 1e-12


def alone(scenes, steps):
    """Each with the others' bodies as they are, not with their wrenches: the largest force."""
    bodies, connectors = Bodies(scenes), [Connector(scene) for scene in scenes]
    outs = [np.zeros(layout.NOUT) for _ in scenes]
    sample, largest = np.zeros(layout.NSAMPLE), []
    for _ in range(steps):
        for state, connector, out in zip(bodies.states, connectors, outs, strict=True):
            sample[layout.MOTION] = state
            connector.step(sample, out=out)
        bodies.step([(out[0:6], out[6:12]) for out in outs])
        largest.append(max(np.abs(out[FORCE]).max() for out in outs))
    return largest


def test_solved_alone_they_grow_and_together_they_do_not():
    scenes = shaft(-0.3, 0.3, com=0.1, twist=(0.5, 0.0, 0.0, 20.0, 0.0, 0.0))
    largest = alone(scenes, 40)
    assert max(largest) > 1e6 * largest[0]
    run = simulate_group(scenes, 1000)
    assert np.abs(run.outs[:, :, FORCE]).max() < WEIGHT
    assert run.outs[:, :, layout.OFFSET_VIOLATION].max() < 1e-9
    assert np.all(np.diff(run.energy) <= 1e-12)


def test_coulomb_holds_in_each_with_its_own_reactions_of_the_step():
    changes = {"at1": {"friction": {"coefficient": 0.35}}}
    found = parameters((-0.3, 0.2, 0.4), com=0.05, twist=(0.6, 0.0, 0.0, 25.0, 0.0, 0.0))
    found["at1"] = {**found["at1"], **changes["at1"]}
    run = simulate_group(list(several(found).values()), 400)
    assert run.iterations.max() < 50
    for k, mu in enumerate((0.2, 0.35, 0.2)):
        outs = run.outs[:, k]
        f, m = outs[:, FORCE], outs[:, MOMENT]
        normal = np.hypot(f[:, 1], f[:, 2]) + np.hypot(m[:, 1], m[:, 2]) / ARM
        friction = np.column_stack(
            [outs[:, layout.FORCE_FRICTION], outs[:, layout.MOMENT_FRICTION] / RADIUS]
        )
        traction = np.hypot(*friction.T)
        slips = outs[:, layout.REGIME] == layout.SLIP
        np.testing.assert_allclose(traction[slips], mu * normal[slips], rtol=1e-9)
        assert np.all(traction <= mu * normal * (1.0 + 1e-9))
        slip = outs[:, layout.SLIP_VELOCITY : layout.SLIP_VELOCITY + 2]
        late = 0.5 * (slip[1:] + slip[:-1])  # theta = 1/2: against the mean over the step
        steady = slips[:-1] & slips[1:]
        cross = late[:, 0] * friction[:-1, 1] - late[:, 1] * friction[:-1, 0]
        size = np.hypot(*late.T) * traction[:-1]
        assert np.all(np.abs(cross[steady]) < 1e-4 * size[steady])
        assert np.all(np.sum(late * friction[:-1], axis=1)[steady] < 0.0)
    axial = run.outs[:-1, :, layout.FORCE].sum(axis=1)
    speed = run.outs[:, 0, layout.VELOCITY]
    np.testing.assert_allclose(np.diff(speed) / 0.001, axial / MASS, atol=1e-9)


def test_what_sticking_bearings_bear_is_the_least_that_their_discs_admit():
    pull = {"gravity": [1.0, 0.0, -9.81]}
    even = simulate_group(shaft(-0.3, 0.3, **pull), 50).outs
    np.testing.assert_allclose(even[:, :, layout.FORCE_FRICTION], -0.5 * MASS, rtol=1e-9)
    weak = {"friction": {"coefficient": 0.05}}
    found = parameters((-0.3, 0.3), **pull)
    found["at1"] = {**found["at1"], **weak}
    outs = simulate_group(list(several(found).values()), 50).outs
    assert np.abs(outs[:, :, layout.VELOCITY]).max() < 1e-12
    np.testing.assert_allclose(outs[:, :, layout.FORCE_FRICTION].sum(axis=1), -MASS, rtol=1e-9)
    limits = np.array([0.2, 0.05]) * outs[:, :, layout.NORMAL_FORCE]
    assert np.all(np.abs(outs[:, :, layout.FORCE_FRICTION]) <= limits * (1.0 + 1e-9))


CORNERS = [(x, y) for x in (-0.2, 0.3) for y in (-0.25, 0.15)]


def table():
    """A plate on four upright slides, pulled sideways: 16 reactions for 4 conditions."""
    upright = [0.0, -np.sqrt(0.5), 0.0, np.sqrt(0.5)]  # its x axis is the world's z
    found = {
        "connectors": [f"leg{k}" for k in range(4)],
        "gravity": [3.0, 2.0, 0.0],
        "body_b": {"frame": "plate", "mass": 4.0, "inertia": [0.1, 0.0, 0.0, 0.12, 0.0, 0.2]},
        "friction": {"coefficient": 0.0, "radius": RADIUS, "overlap": OVERLAP},
        "plant": {"body_b": {"twist": [0.0, 0.0, 0.4, 0.0, 0.0, 0.0]}},
    }
    for k, (x, y) in enumerate(CORNERS):
        found[f"leg{k}"] = {
            "node_a": {"position": [x, y, 0.0], "orientation": upright},
            "node_b": {"position": [x, y, 0.0]},
        }
    return list(several(found).values())


def test_four_slides_hold_a_plate_with_the_least_reactions():
    run = simulate_group(table(), 100)
    assert run.outs[:, :, layout.RESIDUAL].max() < 1e-11
    assert np.allclose(run.outs[:, :, layout.VELOCITY], 0.4, atol=1e-9)
    out = run.outs[-1]
    axes = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]).T  # e1 e2 e3 in the world
    columns = []
    for x, y in CORNERS:
        arm = np.array([x, y, 0.0])
        columns += [np.concatenate([axes[:, k], np.cross(arm, axes[:, k])]) for k in (1, 2)]
        columns += [np.concatenate([np.zeros(3), axes[:, k]]) for k in (1, 2)]
    net = np.array(columns).T  # (6, 16): what the reactions do to the plate
    found = np.array([np.concatenate([o[FORCE][1:], o[MOMENT][1:]]) for o in out]).ravel()
    np.testing.assert_allclose(net @ found, [-12.0, -8.0, 0.0, 0.0, 0.0, 0.0], atol=1e-8)
    arms = np.tile([1.0, 1.0, ARM, ARM], 4)
    least, *_ = np.linalg.lstsq(net * arms, np.array([-12.0, -8.0, 0, 0, 0, 0]), rcond=1e-10)
    np.testing.assert_allclose(found, least * arms, atol=1e-8)


def ring(coefficient, period=0.001):
    """A drawer on two slides of a carriage, both free and tumbling."""
    spin = np.array([3.0, 4.0, 5.0])
    away = [0.2, 0.0, 0.0]
    found = {
        "connectors": ["left", "right"],
        "period": period,
        "gravity": [0.0, 0.0, 0.0],
        "node_a": {"orientation": [0.0, 0.0, 0.0, 1.0]},
        "body_a": {"frame": "carriage", "kind": "free", "mass": 3.0,
                   "inertia": [0.05, 0.0, 0.0, 0.06, 0.0, 0.07]},
        "body_b": {"frame": "drawer", "mass": 1.0, "inertia": [0.01, 0.0, 0.0, 0.02, 0.0, 0.015]},
        "friction": {"coefficient": coefficient, "radius": RADIUS, "overlap": OVERLAP},
        "plant": {
            "body_a": {"twist": [0.0, 0.0, 0.0, *spin]},
            "body_b": {"pose": [*away, 0.0, 0.0, 0.0, 1.0],
                       "twist": [*np.cross(spin, away), *spin]},
        },
    }  # fmt: skip
    for name, y in (("left", 0.2), ("right", -0.2)):
        found[name] = {f"node_{x}": {"position": [0.0, y, 0.0]} for x in "ab"}
        found[name]["node_a"]["orientation"] = [0.0, 0.0, 0.0, 1.0]
    return list(several(found).values())


def test_a_drawer_on_two_slides_tumbles_with_its_energy_kept_to_second_order():
    errors = []
    for period in (0.002, 0.001):
        run = simulate_group(ring(0.0, period), round(0.5 / period))
        assert run.outs[:, :, layout.OFFSET_VIOLATION].max() < 1e-6
        errors.append(abs(run.energy[-1] / run.energy[0] - 1.0))
    assert errors[1] < 1e-5
    assert errors[1] < 0.3 * errors[0]


def test_a_drawer_on_two_slides_loses_energy_to_friction_only_and_always_settles():
    run = simulate_group(ring(0.2), 600)
    assert np.all(np.diff(run.energy) < 1e-7)
    assert run.energy[-1] < 0.8 * run.energy[0]
    assert run.iterations.max() < 60  # without acceleration 200 do not do
    assert run.outs[:, :, layout.RESIDUAL].max() < 1e-8
    assert run.outs[:, :, layout.OFFSET_VIOLATION].max() < 1e-6


def pulled(beside, coefficient=0.4):
    """A drawer on two slides 0.2 m apart, pulled by 10 N beside its middle."""
    found: dict[str, Any] = {
        "connectors": ["left", "right"],
        "body_b": {"frame": "drawer", "mass": 2.0, "inertia": [0.02, 0.0, 0.0, 0.03, 0.0, 0.04]},
        "friction": {"coefficient": coefficient, "radius": RADIUS, "overlap": 0.02},
        "plant": {"body_b": {"load": [10.0, 0.0, 0.0, 0.0, 0.0, -10.0 * beside]}},
    }
    for name, y in (("left", 0.1), ("right", -0.1)):
        found[name] = {f"node_{x}": {"position": [0.0, y, 0.0]} for x in "ab"}
        found[name]["node_a"]["orientation"] = [0.0, 0.0, 0.0, 1.0]
    return list(several(found).values())


def test_a_drawer_pulled_in_its_middle_slides_though_either_slide_alone_would_jam():
    run = simulate_group(pulled(0.0), 100)
    np.testing.assert_allclose(run.outs[:, :, layout.FORCE_FRICTION], -0.2 * WEIGHT, rtol=1e-9)
    speed = 100 * 0.001 * (10.0 - 0.4 * WEIGHT) / MASS
    assert run.bodies.states[0][layout.B_TWIST] == pytest.approx(speed, rel=1e-9)


def test_a_drawer_pulled_far_from_its_middle_jams():
    """Slides bear the couple by bending; mu 2/L times the arm between them is beyond 1."""
    run = simulate_group(pulled(1.0), 100)
    assert np.abs(run.outs[:, :, layout.VELOCITY]).max() < 1e-9
    np.testing.assert_allclose(run.outs[:, :, layout.FORCE].sum(axis=1), -10.0, rtol=1e-9)
    assert run.outs[:, :, layout.OFFSET_VIOLATION].max() < 1e-9


def test_motions_that_contradict_each_other_are_said_and_stay_finite():
    found = parameters((-0.3, 0.3))
    for name, speed in (("at0", 0.1), ("at1", 0.2)):
        found[name]["command"] = {"slide": {"velocity": speed}}
    run = simulate_group(list(several(found).values()), 20)
    assert np.abs(run.outs[:, :, FORCE]).max() < 1e7
    assert run.outs[:, :, layout.RESIDUAL].min() > 1e-6
    assert 0.0 < run.bodies.states[0][layout.B_TWIST] < 0.3


def test_a_stop_of_one_stops_all():
    found = parameters((-0.3, 0.3), twist=(0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    found["at1"]["stops"] = {"l_max": 0.02}
    outs = simulate_group(list(several(found).values()), 200).outs
    assert outs[:, 1, layout.LENGTH].max() < 0.02 + 1e-9
    np.testing.assert_allclose(outs[100:, :, layout.VELOCITY], 0.0, atol=1e-9)
    assert outs[:, 1, layout.FORCE_REACTION].min() < -100.0
    assert np.all(outs[:, 0, layout.FORCE_REACTION] == 0.0)


def test_what_cannot_be_used_gives_no_wrench_to_anybody_and_is_forgiven():
    group = Group(shaft(-0.3, 0.3))
    samples = np.zeros((2, layout.NSAMPLE))
    samples[:, [layout.A_POSE + 6, layout.B_POSE + 6]] = 1.0
    samples[:, layout.A_POSE] = -0.3, 0.3
    first = group.step(samples)
    assert np.all(first[:, layout.STATUS] == layout.OK)
    bad = samples.copy()
    bad[1, layout.B_TWIST] = np.nan
    outs = group.step(bad)
    assert np.all(outs[:, : layout.STATUS] == 0.0)
    assert np.all(outs[:, layout.STATUS] == layout.NOT_FINITE)
    again = group.step(samples)
    np.testing.assert_allclose(again[:, FORCE], first[:, FORCE], atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"at1": {"body_b": {"mass": 3.0}}},
         "at0.body_b.mass = 2.0, at1.body_b.mass = 3.0: must be the same, as both are the body "
         "shaft"),
        ({"at1": {"period": 0.002}}, "at0.period = 0.001, at1.period = 0.002: must be the same"),
        ({"latency": 2}, "at0.latency = 2: must be 0"),
        ({"plant": {"latency": 1.5}}, "at0.plant.latency = 1.5: must be 0"),
        ({"method": "baumgarte"}, "at0.method = 'baumgarte'"),
        ({"body_b": {"kind": "unknown", "frame": "shaft"}, "method": "penalty"},
         "at0.body_b.kind = 'unknown'"),
        ({"body_b": {"frame": "a shaft"}}, "at0.body_b.frame = 'a shaft': must be usable"),
        ({"at0": {"body_a": {"frame": "floor"}}, "at1": {"body_a": {"frame": "floor"}}},
         "at0.body_a.pose = "),
    ],
)  # fmt: skip
def test_who_cannot_share_a_body_is_told_so(changes, text):
    found = parameters((-0.3, 0.3))
    for name, value in changes.items():
        if isinstance(value, dict):
            inner = {k: {**found[name].get(k, {}), **v} if isinstance(v, dict) else v
                     for k, v in value.items()}  # fmt: skip
            found[name] = {**found[name], **inner}
        else:
            found[name] = value
    with pytest.raises(SceneError) as caught:
        several(found)
    assert text in str(caught.value)


def test_a_group_must_have_a_body_in_common():
    scene = load(shipped("demo"))
    other = several(parameters((-0.3,)))["at0"]
    with pytest.raises(SceneError, match="must have bodies in common"):
        Group([scene, other])


def test_least_norm_is_that_of_singular_values_in_any_units():
    rng = np.random.default_rng(3)
    jacobian = rng.normal(size=(8, 4)) @ rng.normal(size=(4, 6))
    jacobian *= 10.0 ** rng.uniform(-4, 4, size=(8, 1))  # rows in other units
    masses = 10.0 ** rng.uniform(-3, 3, size=6)
    g, like = (jacobian / masses) @ jacobian.T, jacobian @ jacobian.T
    arms = 10.0 ** rng.uniform(-2, 1, size=8)
    b = g @ rng.normal(size=8)
    scaled, order, z = arms[:, None] * g * arms, np.zeros(8), np.zeros((8, 8))
    rank = null_space(arms[:, None] * like * arms, 8, order, np.zeros(8), z)
    assert rank == 4
    factor_projected(scaled, 8, rank, order, z)
    weighed = arms * b
    assert solve_projected(scaled, 8, rank, order, z, weighed) < 1e-9 * np.linalg.norm(arms * b)
    np.testing.assert_allclose(g @ (arms * weighed), b, rtol=1e-6, atol=1e-9 * np.abs(b).max())
    open_ways = z[:4]
    np.testing.assert_allclose(open_ways @ open_ways.T, np.eye(4), atol=1e-12)
    size = np.linalg.norm(arms[:, None] * jacobian) * np.linalg.norm(weighed)
    assert np.abs((jacobian.T * arms) @ open_ways.T).max() < 1e-9 * size
    assert np.abs(open_ways @ weighed).max() < 1e-9 * np.linalg.norm(weighed)
