"""Peer solvers: each one is near the reference solution, and runs in a process of its own."""

from __future__ import annotations

import dataclasses
import functools
import importlib.util
import math
import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import Array, bundled

from cylconn_ros.bench.common import frames, published
from cylconn_ros.bench.common.errors import NotApplicableError, NotInstalledError
from cylconn_ros.bench.peers import isolated
from cylconn_ros.bench.peers.common import Coulomb, Course, Joint, Stops, check_plain
from cylconn_ros.bench.peers.compiled.mujoco import coefficient
from cylconn_ros.bench.peers.mujoco import MujocoSolver
from cylconn_ros.bench.peers.mujoco_scene import MujocoScene
from cylconn_ros.bench.peers.ours import Minimal
from cylconn_ros.bench.peers.registry import SOLVERS
from cylconn_ros.bench.peers.solver import Problem, calibration_scene, package
from cylconn_ros.bench.precision import cases
from cylconn_ros.bench.precision.cases import CASES, ERROR
from cylconn_ros.reference.free_pair import free_pair
from cylconn_ros.scene import parameter_file
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.minimal import solve
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.simulate import simulate

PACKAGES = {"drake": "pydrake", "ours": "numpy"}
INSTALLED = {
    solver.name: solver
    for solver in SOLVERS.values()
    if importlib.util.find_spec(PACKAGES.get(solver.family, solver.family))
}
"""Solvers whose package is installed in the test environment."""

REDUCED = list(CASES)[:12]
"""Cases whose equations are reduced by hand."""


def scene_of(name: str) -> Scene:
    return cases.scene_of(bundled, CASES[name])


@functools.cache
def reference(name: str) -> cases.Reference:
    """The reference solution at the end; some take seconds."""
    return CASES[name].reference(scene_of(name), CASES[name].duration)


def solved(name: str, solver: str, value: float) -> Array:
    case, scene = CASES[name], scene_of(name)
    calibration: cases.Reference = {}
    if "calibrated" in solver:
        calibration = case.reference(calibration_scene(scene), case.duration)
    problem = Problem(name, scene, case.duration, value, calibration)
    return np.array(SOLVERS[solver].prepare(problem)()())


def error(name: str, state: Array) -> float:
    return cases.errors(CASES[name], scene_of(name), reference(name), state)[ERROR][0]


# --- joint, friction and stops of a user's loop ---


def test_joint_state_matches_the_plant_and_the_end_quantities() -> None:
    for name in ("demo", "hub_and_rotor"):
        scene = bundled(name)
        joint = Joint(scene)
        rates = (joint.slide_rate, joint.spin_rate)
        state = joint.state(joint.pose_a, joint.twist_a, 0.0, 0.0, rates)
        np.testing.assert_allclose(state, Plant(scene).state, atol=1e-13)
        moved = joint.state(joint.pose_a, joint.twist_a, 0.3, 1.0, (2.0, 5.0))
        found = cases.end_quantities(scene, moved)
        quantities = [found[quantity] for quantity in ("slide", "spin", "v", "w")]
        assert quantities == pytest.approx([0.3, 1.0, 2.0, 5.0])
        assert max(found["offset"], found["tilt"]) < 1e-12


def test_friction_limit_is_that_of_the_friction_law() -> None:
    law = Coulomb(bundled("demo"))
    e = np.array([1.0, 2.0, 2.0]) / 3.0
    across = np.cross(e, [0.0, 0.0, 1.0])
    force, moment = 7.0 * e + 5.0 * across, 3.0 * e + 0.1 * across
    size = float(np.linalg.norm(across))
    expected = 0.2 * (5.0 * size + 2.0 / 0.08 * 0.1 * size + 4.0)
    assert law.limit(force.tolist(), moment.tolist(), e.tolist()) == pytest.approx(expected)


def test_loop_friction_sticks_or_opposes_the_slip() -> None:
    law = Coulomb(bundled("slide_and_spin"))
    inverse_mass = (0.5, 0.0, 2500.0)
    f, m = law.friction(10.0, 1e-3, 0.0, (-1.0, 0.0), inverse_mass, 1e-3)
    assert f == pytest.approx(0.0, abs=1e-12), "it comes to rest without friction"
    f, m = law.friction(0.5, 3.0, 200.0, (0.0, 0.0), inverse_mass, 1e-3)
    assert math.hypot(f, m / 0.02) == pytest.approx(0.5)
    assert f / m == pytest.approx(3.0 / (0.02**2 * 200.0))


def test_friction_limit_is_split_in_proportion_to_the_slip() -> None:
    law = Coulomb(bundled("slide_and_spin"))
    assert law.split(5.0, 3.0, 4.0 / law.radius, 1e-9) == pytest.approx((3.0, 4.0 * law.radius))
    assert law.split(5.0, 0.0, 0.0, 1e-9) == pytest.approx((5.0, 5.0 * law.radius))


def test_impact_on_a_stop_reverses_the_rate() -> None:
    stops = Stops(bundled("between_stops"))
    assert stops.impact(stops.high - 0.03, 1.0) is None
    high = stops.high
    assert np.array(stops.impact(high + 1e-3, 1.0)) == pytest.approx([high, -0.8])
    assert stops.impact(high + 1e-3, -1.0) is None


# --- the MuJoCo model ---


@pytest.mark.parametrize("name", ["demo", "free_flight", "slide_and_spin", "incline"])
def test_mujoco_starts_in_the_state_of_the_plant(name: str) -> None:
    scene = bundled(name)
    plant, peer = Plant(scene), MujocoScene(scene)
    np.testing.assert_allclose(peer.state(), plant.state, atol=1e-14)
    assert frames.energy(scene, peer.state()) == pytest.approx(plant.energy(), abs=1e-12)
    np.testing.assert_allclose(frames.momentum(scene, peer.state()), plant.momentum(), atol=1e-13)


def test_mujoco_moves_two_free_bodies_as_the_reference_does() -> None:
    scene = bundled("free_flight")
    truth = free_pair(scene, 0.5)
    peer = MujocoScene(scene, integrator="RK4", timestep=5e-3)
    peer.run(100)
    position, _ = frames.com(scene.body_b, peer.state()[13:])
    np.testing.assert_allclose(position, truth.com_b, atol=1e-11)
    np.testing.assert_allclose(peer.slide(), (truth.distance, truth.angle), atol=1e-9)
    peer.reset()
    peer.step(100)
    np.testing.assert_array_equal(frames.com(scene.body_b, peer.state()[13:])[0], position)


def test_mujoco_applies_the_given_friction() -> None:
    scene = bundled("coast")
    force = 0.2 * (2.0 * 9.81 + 5.0)
    peer = MujocoScene(scene, friction=force, timestep=1e-4)
    peer.run(2000)
    assert peer.slide()[0] == pytest.approx(0.2 - 0.5 * force / 2.0 * 0.2**2, rel=1e-3)


def test_mujoco_does_not_support_a_driven_body() -> None:
    values = {**bundled("coast").parameters(), "body_a.kind": "driven"}
    with pytest.raises(NotApplicableError, match="fixed or free"):
        MujocoScene(Scene.from_parameters(values))


def test_mujoco_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(NotInstalledError, match=r"\.\[bench\]"):
        MujocoScene(bundled("demo"))


@pytest.mark.parametrize("name", ["demo", "spring_hard_stop", "brake", "telescope_binds"])
@pytest.mark.parametrize("integrator", ["implicitfast", "discrete"])
def test_the_compiled_mujoco_loop_is_the_loop_in_python(name: str, integrator: str) -> None:
    """Friction by Stribeck, by overlap and by preload over time; a damper and a stop."""
    case = CASES[name]
    problem = Problem(name, scene_of(name), case.duration, 5e-3)
    solver = MujocoSolver(problem, integrator, limits=False)
    in_python = solver.solve_in_python()()
    compiled = solver.compiled(reacts=True)()()
    np.testing.assert_allclose(compiled, in_python, rtol=1e-9, atol=1e-9)
    assert error(name, compiled) < 0.1 * case.scale, "and it is the motion of the scene"


@pytest.mark.parametrize("slip", [0.0, 0.13, 3.7, 30.0])
@pytest.mark.parametrize("scene", [published.spring_hard_stop(), published.friction_table()])
def test_the_compiled_coefficient_is_that_of_the_law(scene: Scene, slip: float) -> None:
    law = Coulomb(scene)
    expected = 3.0 + 5.0 * math.exp(-2.0 * slip)
    if law.rates:
        k = min(int(slip * 49.0 / 12.0), 48)
        at = [5.0 + v + 10.0 * math.exp(-2.0 * v) for v in (12.0 * k / 49.0, 12.0 * (k + 1) / 49.0)]
        expected = at[0] + (min(slip, 12.0) * 49.0 / 12.0 - k) * (at[1] - at[0])
    assert law.coefficient(slip) == pytest.approx(expected, rel=1e-12)
    assert coefficient(law.numbers(), law.table(), slip) == pytest.approx(expected, rel=1e-12)


def test_a_loop_refuses_what_it_does_not_have() -> None:
    across = scene_of("coast").replace({"plant.body_b.load": (0.0, 1.0, 0.0, 0.0, 0.0, 0.0)})
    with pytest.raises(NotApplicableError, match="along the joint axis"):
        Course(across, 1e-3, 10)
    with pytest.raises(NotApplicableError, match="loads and preloads"):
        check_plain(scene_of("brake"))
    with pytest.raises(NotApplicableError, match="one coefficient"):
        check_plain(scene_of("telescope_binds"))


def test_loads_over_time_are_means_over_a_step() -> None:
    push = Course(published.stick_slip(), 0.5, 40).push
    np.testing.assert_allclose(push, 4.0 / 20.0 * (np.arange(40) + 0.5) * 0.5)


# --- solvers reach the reference solutions ---


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if not case.group])
def test_minimal_is_at_the_reference(name: str) -> None:
    # kinks of the table are not located by the reference
    allowed = {"friction_table": 1e-6, "stick_slip": 1e-9}.get(name, 1e-10)
    assert error(name, solved(name, "minimal", 1e-12)) < allowed


def test_minimal_solver_is_minimal_solve() -> None:
    scene = dataclasses.replace(bundled("slide_and_spin"), method="minimal")
    solver = Minimal(scene, 0.7, 1e-8)
    for _ in range(2):  # from the start each time
        solver()
        np.testing.assert_array_equal(solver.rows, solve(scene, 0.7, 1e-8).rows)


@pytest.mark.parametrize(
    "name",
    ["eccentric_rotor", "between_stops", "near_jam", "jam", "brake", "forced_oscillator"],
)
def test_impulse_in_the_compiled_loop_is_that_of_simulate(name: str) -> None:
    case = CASES[name]
    scene = dataclasses.replace(scene_of(name), period=2e-3, method="impulse")
    run = simulate(scene, samples=round(case.duration / 2e-3))
    np.testing.assert_allclose(solved(name, "impulse", 2e-3), run.plant.state, atol=1e-15)


@pytest.mark.parametrize("name", [n for n in REDUCED if n not in ("incline_stick", "jam")])
def test_scipy_with_events_reaches_the_reference(name: str) -> None:
    tolerance = 1e-6 if name == "hub_and_rotor" else 1e-9
    assert error(name, solved(name, "SciPy DOP853", tolerance)) < 1e-7


def test_regularised_scipy_creeps_and_does_not_jam() -> None:
    loose, tight = (error("incline_stick", solved("incline_stick", "SciPy LSODA", t))
                    for t in (1e-3, 1e-5))  # fmt: skip
    assert 1e-6 < tight < 0.02 * loose
    assert error("jam", solved("jam", "SciPy LSODA", 1e-6)) > 0.05


LOOPS = [name for name, s in INSTALLED.items() if s.kind == "simulator" and "loop" in name]


@pytest.mark.parametrize("solver", LOOPS)
@pytest.mark.parametrize("name", ["demo", "eccentric_rotor"])
def test_friction_loop_of_every_simulator_is_near_the_reference(name: str, solver: str) -> None:
    """A wrong reaction, lever arm, radius or axis would give a large error."""
    found = error(name, solved(name, solver, 1e-3))
    assert found < (0.02 if name == "demo" else 0.005)


def test_calibrated_friction_predicts_a_constant_normal_force() -> None:
    found = error("coast", solved("coast", "MuJoCo implicitfast, calibrated", 1e-3))
    assert 1e-9 < found < 5e-4


def test_two_rails_share_the_weight() -> None:
    found = [error("two_rails", solved("two_rails", "impulse", h)) for h in (2e-2, 1e-2)]
    assert found[1] < 2e-5
    assert found[0] / found[1] > 3.0, "second order"


@pytest.mark.parametrize("name", ["coast", "bounce_under_load", "stick_slip"])
def test_this_packages_friction_in_mujoco_is_near_the_reference(name: str) -> None:
    assert error(name, solved(name, "MuJoCo with this package's friction", 2e-3)) < 1e-3


# --- processes ---


def request(solver: str, folder: Path) -> dict[str, object]:
    file = folder / "coast.yaml"
    file.write_text(parameter_file.dump(bundled("coast")))
    return {
        "solver": solver, "case": "coast", "scene": str(file), "duration": 0.5,
        "value": 1e-2, "calibration": {}, "repeat": 0,
    }  # fmt: skip


def test_a_solver_process_responds_and_restarts(tmp_path: Path) -> None:
    with isolated.SolverProcess(60.0) as peer:
        one = request("SciPy DOP853", tmp_path)
        response = peer.request(**one)
        assert len(response["state"]) == 26
        assert peer.request(**{**one, "repeat": 2})["cpu"] > 0.0
        assert peer.request(**{**one, "solver": "no such solver"})["status"] == "failed"
        assert peer.pid is not None
        os.kill(peer.pid, signal.SIGKILL)
        assert peer.request(**one)["status"] == isolated.CRASHED
        assert peer.request(**one)["state"] == response["state"]
        peer.patience = 1e-3
        assert peer.request(**{**one, "repeat": 20})["status"] == isolated.TIMEOUT


def test_missing_packages_and_unsupported_cases_are_errors() -> None:
    with pytest.raises(NotInstalledError, match=r"no_such_peer is not installed.*\[peers\]"):
        package("no_such_peer.deep")
    with pytest.raises(NotApplicableError, match="nothing moves"):
        solved("jam", "SciPy DOP853", 1e-6)
