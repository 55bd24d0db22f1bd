"""Frames and relative motion, against SciPy's rotations and finite differences."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import bundled, pair, xyzw
from scipy.spatial.transform import Rotation

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import kinematics, layout, vectors
from cylconn_ros.core.rigid_body import Motion
from cylconn_ros.simulation.plant import Plant

finite = st.floats(-2.0, 2.0)
vector = st.tuples(finite, finite, finite)


@st.composite
def rotations(draw: st.DrawFn) -> Rotation:
    """Rotations of all sizes, including those near zero and near a half turn."""
    axis = np.array(draw(vector))
    size = float(np.linalg.norm(axis))
    axis = axis / size if size > 1e-3 else np.array([0.0, 0.6, 0.8])
    near = st.sampled_from([0.0, 1e-7, 1e-4, math.pi - 1e-7, math.pi, math.pi + 1e-7])
    angle = draw(st.one_of(near, st.floats(-6.0, 6.0)))
    return Rotation.from_rotvec(angle * axis)


@given(rotations(), vector)
def test_rotations_agree_with_scipy(turn: Rotation, a: tuple[float, float, float]) -> None:
    q = xyzw(turn)
    axes = vectors.matrix(q)
    np.testing.assert_allclose(np.array(axes).T, turn.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(vectors.out_of(axes, a), turn.apply(a), atol=1e-13)
    np.testing.assert_allclose(vectors.into(axes, a), turn.inv().apply(a), atol=1e-13)


@given(rotations(), st.tuples(finite, finite, finite), st.sampled_from([1.0, 1e-3, 1e-5, 1e-9]))
def test_a_further_rotation_agrees_with_scipy(turn: Rotation, r: tuple, size: float) -> None:
    r = (size * r[0], size * r[1], size * r[2])
    q = vectors.turned(xyzw(turn), r)
    expected = (Rotation.from_rotvec(r) * turn).as_matrix()
    np.testing.assert_allclose(Rotation.from_quat(q).as_matrix(), expected, atol=1e-14)


@given(rotations(), st.tuples(*[st.floats(-1.0, 1.0)] * 6))
def test_tensors_rotate_with_their_frame(turn: Rotation, i: tuple) -> None:
    m = turn.as_matrix()
    full = np.array([[i[0], i[1], i[2]], [i[1], i[3], i[4]], [i[2], i[4], i[5]]])
    got = vectors.tensor_in(vectors.matrix(xyzw(turn)), i)
    expected = (m @ full @ m.T)[np.triu_indices(3)]
    np.testing.assert_allclose(got, expected, atol=1e-13)


@given(
    st.floats(-math.pi + 1e-6, math.pi),
    st.floats(0.0, math.pi - 1e-6),
    st.floats(-math.pi, math.pi),
)
def test_swing_and_twist_make_up_the_orientation(angle: float, size: float, way: float) -> None:
    swing = size * np.array([0.0, math.cos(way), math.sin(way)])  # takes e1a to e1b
    q = Rotation.from_rotvec(swing) * Rotation.from_rotvec([angle, 0.0, 0.0])
    found = kinematics.angles(xyzw(q))
    back = Rotation.from_rotvec([0.0, -found.misalignment_2, -found.misalignment_3])
    again = back * Rotation.from_rotvec([found.angle, 0.0, 0.0])
    np.testing.assert_allclose(again.as_matrix(), q.as_matrix(), atol=1e-7)
    # near a half turn of swing the twist is as uncertain as the swing is far from it
    assert math.hypot(found.misalignment_2, found.misalignment_3) == pytest.approx(size, abs=1e-7)
    np.testing.assert_allclose(
        [found.misalignment_2, found.misalignment_3],
        -swing[1:],
        atol=1e-14 / (math.pi - size) + 1e-9,
    )
    assert not found.half_turn


def test_a_half_turn_of_swing_is_flagged() -> None:
    found = kinematics.angles((0.0, 0.6, 0.8, 0.0))
    assert found.half_turn
    assert (found.misalignment_2, found.misalignment_3) == (-math.pi, 0.0)
    swing = Rotation.from_rotvec([0.0, math.pi, 0.0])
    again = swing * Rotation.from_rotvec([found.angle, 0.0, 0.0])
    expected = Rotation.from_quat([0.0, 0.6, 0.8, 0.0]).as_matrix()
    np.testing.assert_allclose(again.as_matrix(), expected, atol=1e-12)


def test_angle_is_the_formula_when_aligned() -> None:
    for angle in np.linspace(-3.1, 3.1, 41):
        turn = Rotation.from_rotvec([angle, 0.0, 0.0])
        e2b, e3b = turn.apply([0, 1, 0]), turn.apply([0, 0, 1])
        formula = math.atan2(-e3b[1], e3b[2])
        assert kinematics.angles(xyzw(turn)).angle == pytest.approx(formula)
        assert e2b[0] == 0.0


@given(rotations(), rotations(), vector, vector, vector, vector, vector)
def test_rates_are_the_derivatives_of_the_positions(
    turn_a: Rotation, turn_b: Rotation, d: tuple, va: tuple, wa: tuple, vb: tuple, wb: tuple
) -> None:
    swing = kinematics.swing_of(0.3, -1.1)
    nodes = kinematics.Nodes((0.1, -0.2, 0.3), (0.5, 0.5, -0.5, 0.5), (0.05, 0.02, -0.1), swing)

    def moved(t: float) -> tuple[Motion, Motion]:
        both = []
        for turn, x, v, w in ((turn_a, (0.0, 0.0, 0.0), va, wa), (turn_b, d, vb, wb)):
            q = xyzw(Rotation.from_rotvec(t * np.array(w)) * turn)
            com = (x[0] + t * v[0], x[1] + t * v[1], x[2] + t * v[2])
            both.append(Motion(com, q, v, w))
        return both[0], both[1]

    def position(t: float) -> np.ndarray:
        f = kinematics.frame(nodes, *moved(t))
        return np.array(vectors.into(f.axes, f.d))

    dt = 1e-4
    rate = (8 * (position(dt) - position(-dt)) - position(2 * dt) + position(-2 * dt)) / (12 * dt)
    a, b = moved(0.0)
    twist = kinematics.relative_twist(kinematics.frame(nodes, a, b), a, b)
    np.testing.assert_allclose(twist.v, rate, atol=1e-8)
    axes = np.array(kinematics.frame(nodes, a, b).axes)
    held = Rotation.from_rotvec([0.0, -0.3, 1.1]).as_matrix().T  # S: rows its axes
    np.testing.assert_allclose(twist.w, held @ axes @ (np.array(wb) - np.array(wa)), atol=1e-12)


def test_twenty_turns_are_counted() -> None:
    """Case 10: the angle passes several wraps; the material rotation starts from theta1ref."""
    scene = bundled("twenty_turns")
    from cylconn_ros.simulation.simulate import simulate

    run = simulate(scene, samples=round(scene.plant.duration / scene.period) + 1)
    assert run["rotation"][-1] == pytest.approx(40.0 * math.pi, rel=1e-9)
    expected = run["angle"] - scene.reference.angle
    np.testing.assert_allclose(run["material_rotation"], expected, rtol=1e-13)
    assert np.all(np.diff(run["angle"]) > 0.0)
    assert not np.any(run.outs[:, layout.FLAGS].astype(int) & layout.TURN_AMBIGUOUS)


def test_a_turn_that_cannot_be_counted_is_flagged() -> None:
    connector = Connector(pair(spin=0.0, turning=(0.0, 0.0, 0.0)))
    sample = np.zeros(layout.NSAMPLE)
    sample[[6, 19]] = 1.0
    connector.step(sample)
    sample[13:20] = [
        0,
        0,
        0,
        math.sin(1.0),
        0,
        0,
        math.cos(1.0),
    ]  # 2 rad on, the twist says nothing
    out = connector.step(sample)
    assert int(out[layout.FLAGS]) & layout.TURN_AMBIGUOUS


def test_a_twist_that_contradicts_the_poses_is_flagged() -> None:
    connector = Connector(pair(spin=0.0, turning=(0.0, 0.0, 0.0)))
    sample = np.zeros(layout.NSAMPLE)
    sample[[6, 19]] = 1.0
    sample[20] = 1.0  # 1 m/s along the slot, 1 mm a sample
    connector.step(sample)
    for moved, expected in ((1e-3, 0), (3e-3, layout.TWIST_CONTRADICTS)):
        sample[13] += moved
        out = connector.step(sample)
        assert int(out[layout.FLAGS]) & layout.TWIST_CONTRADICTS == expected


def test_another_integration_of_the_plant_is_flagged() -> None:
    """Positions compared with velocities show it; the wrong target leaves disturbances undamped."""
    for told, is_, flagged in (
        ("exact", "exact", False),
        ("exact", "semi_implicit", True),
        ("semi_implicit", "semi_implicit", False),
        ("semi_implicit", "exact", True),
    ):
        friction = {"coefficient": 0.2, "radius": 0.02}
        scene = pair(friction=friction, plant_integration=told)
        connector = Connector(scene)
        plant = Plant(pair(friction=friction, plant_integration=is_))
        for _ in range(50):
            out = connector.step(np.concatenate([plant.state, plant.loads]))
            plant.step(out[:6], out[6:12])
        assert bool(int(out[layout.FLAGS]) & layout.INTEGRATION) == flagged, (told, is_)
