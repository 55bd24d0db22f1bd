"""Whoever solves a scene: each in its own set-up, near the answer, in a process of its own."""

from __future__ import annotations

import dataclasses
import functools
import importlib.util
import math
import os
import signal
from pathlib import Path

import numpy as np
import pytest
from scenes import Array, bundled

from cylconn_ros.bench.common.errors import AbsentError, LeftOutError
from cylconn_ros.bench.peers import isolated
from cylconn_ros.bench.peers.common import Coulomb, Stops
from cylconn_ros.bench.peers.registry import CONTESTANTS
from cylconn_ros.bench.peers.solver import Task, milder, package
from cylconn_ros.bench.precision import cases
from cylconn_ros.bench.precision.cases import CASES, PLACE
from cylconn_ros.simulation.simulate import simulate

PACKAGES = {"drake": "pydrake", "ours": "numpy"}
INSTALLED = {
    contestant.name: contestant
    for contestant in CONTESTANTS.values()
    if importlib.util.find_spec(PACKAGES.get(contestant.family, contestant.family))
}
"""What the environment of the tests has; the others are to be said to be absent."""


@functools.cache
def truth_of(name: str) -> cases.Truth:
    """The answer; some take seconds."""
    case = CASES[name]
    return case.answer(cases.scene_of(bundled, case), case.duration)


def solved(name: str, contestant: str, value: float) -> Array:
    case = CASES[name]
    scene = cases.scene_of(bundled, case)
    mild: cases.Truth = {}
    if "calibrated" in contestant:
        mild = case.answer(milder(scene), case.duration)
    task = Task(name, scene, case.duration, value, mild)
    return np.array(CONTESTANTS[contestant].prepare(task)()())


def error(name: str, state: Array) -> float:
    case = CASES[name]
    scene = cases.scene_of(bundled, case)
    return cases.errors(case, scene, truth_of(name), state)[PLACE][0]


# --- the law of a user's loop ---


def test_the_loops_law_is_the_libraries() -> None:
    law = Coulomb(bundled("demo"))
    e = np.array([1.0, 2.0, 2.0]) / 3.0
    across = np.cross(e, [0.0, 0.0, 1.0])
    force, moment = 7.0 * e + 5.0 * across, 3.0 * e + 0.1 * across
    size = float(np.linalg.norm(across))
    expected = 0.2 * (5.0 * size + 2.0 / 0.08 * 0.1 * size + 4.0)
    assert law.limit(force.tolist(), moment.tolist(), e.tolist()) == pytest.approx(expected)


def test_a_brake_holds_or_slides_against_the_slip() -> None:
    law = Coulomb(bundled("slide_and_spin"))
    inverse = (0.5, 0.0, 2500.0)
    f, m = law.brake(10.0, 1e-3, 0.0, (-1.0, 0.0), inverse, 1e-3)
    assert f == pytest.approx(0.0, abs=1e-12), "it comes to rest by itself"
    f, m = law.brake(0.5, 3.0, 200.0, (0.0, 0.0), inverse, 1e-3)
    assert math.hypot(f, m / 0.02) == pytest.approx(0.5)
    assert f / m == pytest.approx(3.0 / (0.02**2 * 200.0))


def test_a_stop_sends_back() -> None:
    stops = Stops(bundled("between_stops"), 0.02)
    assert stops.bounced(0.05, 1.0) is None
    assert np.array(stops.bounced(0.081, 1.0)) == pytest.approx([0.08, -0.8])
    assert stops.bounced(0.081, -1.0) is None


# --- contestants reach the answers ---


@pytest.mark.parametrize("name", CASES)
def test_minimal_is_at_the_reference(name: str) -> None:
    assert error(name, solved(name, "minimal", 1e-12)) < 3e-11


@pytest.mark.parametrize("name", ["eccentric_rotor", "between_stops", "near_jam", "jam"])
def test_impulse_in_the_compiled_loop_is_that_of_simulate(name: str) -> None:
    case = CASES[name]
    scene = dataclasses.replace(cases.scene_of(bundled, case), period=2e-3, method="impulse")
    run = simulate(scene, round(case.duration / 2e-3))
    np.testing.assert_allclose(solved(name, "impulse", 2e-3), run.plant.state, atol=1e-15)


@pytest.mark.parametrize("name", [n for n in CASES if n not in ("incline_stick", "jam")])
def test_scipy_with_events_reaches_the_answer(name: str) -> None:
    tolerance = 1e-6 if name == "hub_and_rotor" else 1e-9
    assert error(name, solved(name, "SciPy DOP853", tolerance)) < 1e-7


def test_regularised_scipy_creeps_and_cannot_jam() -> None:
    loose, tight = (error("incline_stick", solved("incline_stick", "SciPy LSODA", t))
                    for t in (1e-3, 1e-5))  # fmt: skip
    assert 1e-6 < tight < 0.02 * loose
    assert error("jam", solved("jam", "SciPy LSODA", 1e-6)) > 0.05


LOOPS = [name for name, c in INSTALLED.items() if c.kind == "simulator" and "loop" in name]


@pytest.mark.parametrize("contestant", LOOPS)
@pytest.mark.parametrize("name", ["demo", "eccentric_rotor"])
def test_every_simulators_loop_comes_near_the_answer(name: str, contestant: str) -> None:
    """Set up wrongly (reaction, arm, radius, axis) it would be far off."""
    found = error(name, solved(name, contestant, 1e-3))
    assert found < (0.02 if name == "demo" else 0.005)


def test_a_calibrated_coefficient_predicts_where_the_law_is_constant() -> None:
    found = error("coast", solved("coast", "MuJoCo implicitfast, calibrated", 1e-3))
    assert 1e-9 < found < 5e-4


# --- processes ---


def request(contestant: str, tmp_path: Path) -> dict[str, object]:
    from cylconn_ros.scene import parameter_file

    file = tmp_path / "coast.yaml"
    file.write_text(parameter_file.dump(bundled("coast")))
    return {
        "contestant": contestant, "name": "coast", "scene": str(file), "duration": 0.5,
        "value": 1e-2, "truth": {}, "repeat": 0,
    }  # fmt: skip


def test_a_process_answers_times_and_survives_its_end(tmp_path: Path) -> None:
    with isolated.Process(60.0) as peer:
        asked = request("SciPy DOP853", tmp_path)
        answer = peer.ask(**asked)
        assert len(answer["state"]) == 26
        assert peer.ask(**{**asked, "repeat": 2})["cpu"] > 0.0
        assert peer.ask(**{**asked, "contestant": "nobody"})["status"] == "failed"
        assert peer._process is not None
        os.kill(peer._process.pid, signal.SIGKILL)
        assert peer.ask(**asked)["status"] == isolated.CRASHED
        assert peer.ask(**asked)["state"] == answer["state"]
        peer.patience = 1e-3
        assert peer.ask(**{**asked, "repeat": 20})["status"] == isolated.TIMEOUT


def test_absent_and_left_out_are_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(AbsentError, match=r"no_such_peer is not installed.*\[peers\]"):
        package("no_such_peer.deep")
    with pytest.raises(LeftOutError, match="evident"):
        solved("jam", "SciPy DOP853", 1e-6)
