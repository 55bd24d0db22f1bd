"""Method minimal between events: accuracy, order, conservation, fixed-base reduction."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scenes import about_y, bundled, order, pair, rotation, sleeve

from cylconn_ros.core import plant
from cylconn_ros.methods.minimal import coordinates, dense_output
from cylconn_ros.methods.minimal.derivatives import INTEGRALS
from cylconn_ros.methods.minimal.events import LOG_WIDTH
from cylconn_ros.methods.minimal.initial import DEFAULT_TOLERANCE, tolerance_of
from cylconn_ros.reference import constant_normal_force, free_pair, slide_and_spin
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.minimal import Solution, initial, solve

FRICTION = {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1, "preload": 0.5}


def kinds(found: Solution) -> list[str]:
    return [event.kind for event in found.events]


def moved(found: Solution) -> float:
    return float(found.length[-1] - found.length[0])


def test_the_error_follows_the_tolerance_on_slide_and_spin() -> None:
    """Closed form; 1e-10 m and below, with an effort that grows with the eighth root."""
    time, distance = constant_normal_force(1.0, 1.0, 1.0 / (0.2 * 9.81))
    efforts = []
    for rtol, error in ((1e-6, 1e-8), (1e-8, 1e-10), (1e-10, 1e-11), (1e-12, 1e-13)):
        found = solve(bundled("slide_and_spin"), 1.0, rtol)
        assert kinds(found) == ["rests"]
        assert abs(moved(found) - distance) < error
        assert abs(found.stop_time - time) < error
        efforts.append(found.evaluations)
    assert efforts[2] < 3.0 * efforts[0] < 1000


def test_a_stated_tolerance_sets_that_of_the_steps() -> None:
    """A hundredth of the scene's tolerance, or the default."""
    scene = bundled("demo")
    rough = dataclasses.replace(scene, tolerance=1e-2)
    assert tolerance_of(pack(scene)) == DEFAULT_TOLERANCE
    assert tolerance_of(pack(rough)) == pytest.approx(1e-4)
    assert solve(rough, 1.0).evaluations < 0.5 * solve(scene, 1.0).evaluations


def test_at_least_fifth_order_on_smooth_pieces() -> None:
    """Error over effort for two free bodies: the slope is that of an order above five."""
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


def test_friction_dissipates_the_reported_energy() -> None:
    """Energy lost = integral of P |s|; friction is always at its limit and opposes slip."""
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


def test_the_motion_does_not_depend_on_which_body_is_fixed() -> None:
    """A sleeve free on a fixed shaft, and the same pair with exchanged names, without bending."""
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


def test_a_bead_on_a_rotating_rod() -> None:
    """A driven body keeps its twist: l = l0 cosh(w t)."""
    scene = pair(v=0.0, spin=0.0, turning=(0.0, 0.0, 2.0), body_b={"com": [0.0, 0.0, 0.0]})
    driven = Scene.from_parameters({**scene.parameters(), "body_a.kind": "driven"})
    assert abs(solve(driven, 1.0).length[-1] - 0.2 * math.cosh(2.0)) < 1e-11


def test_a_held_misalignment_stays_and_does_no_work() -> None:
    """B rotates about its own axis at a constant angle to the slot; energy is constant."""
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


# --- reduced models ---


def test_a_reduced_model_equals_the_full_one_with_zeros() -> None:
    base = pair(friction={**FRICTION, "overlap": 0.0})
    changes: dict[str, Any] = {"overlap": 1e300, "static_coefficient": 0.2}
    full = dataclasses.replace(base, friction=dataclasses.replace(base.friction, **changes))
    np.testing.assert_allclose(solve(base, 0.2).states, solve(full, 0.2).states, atol=1e-12)
    stops = {"l_min": -100.0, "l_max": 100.0, "theta_min": -1e3, "theta_max": 1e3}
    bounded = pair(friction={**FRICTION, "overlap": 0.0}, stops=stops)
    np.testing.assert_allclose(solve(base, 0.2).states, solve(bounded, 0.2).states, atol=1e-12)


@pytest.mark.parametrize("friction", [{}, {**FRICTION, "preload": -2.0}])
def test_the_fixed_base_reduction_equals_the_general_equations(friction: dict[str, Any]) -> None:
    """Evaluated at four configurations, it holds at all: the same motion to 1e-12, with loads."""
    load = [1.0, -2.0, 0.5, 0.1, 0.02, -0.03]
    scene = sleeve(
        v=1.0, spin=20.0, com=(0.01, 0.02, -0.015), shaft=about_y(0.4), friction=friction,
        elasticity={"k1": 30.0, "kr1": 0.1}, damping={"c1": 0.5},
        plant={"body_b": {"load": load}},
    )  # fmt: skip
    found = []
    for lean in (1.0, 0.0):
        par, joint, y = initial(scene)
        assert joint[coordinates.FIXED_SHAFT] == 1.0
        joint[coordinates.FIXED_SHAFT] = lean
        rows = np.zeros((3, dense_output.WIDTH))
        times = np.array([0.0, 0.15, 0.3])
        ran = dense_output.trajectory(
            par, joint, y, times, 1e-12, 0.01, rows, np.zeros((9, LOG_WIDTH)), 100000,
            np.zeros(0), np.zeros((0, 30)),
        )  # fmt: skip
        assert ran.complete
        found.append(rows)
    lean_one, general = (rows[:, : dense_output.INTEGRALS] for rows in found)
    np.testing.assert_allclose(lean_one, general, rtol=1e-12, atol=1e-12)


def test_the_number_of_coordinates_is_minimal() -> None:
    """Two with one body prescribed, eight with both free; velocities likewise."""
    for scene, size in ((sleeve(), 4), (pair(), 17)):
        _, _, y = initial(scene)
        assert len(y) == size + INTEGRALS
