"""Work and precision: the arithmetic of points and fronts, and every contestant's own set-up."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import math
from pathlib import Path

import numpy as np
import pytest
from scenes import bundled

from cylconn_ros.bench.common import results_kept
from cylconn_ros.bench.common.results import Findings, Gap, Measurement, Report, Setting
from cylconn_ros.bench.peers.common import Joint
from cylconn_ros.bench.peers.registry import CONTESTANTS
from cylconn_ros.bench.precision import cases, pareto, picture, run, text
from cylconn_ros.bench.precision.cases import CASES, PLACE
from cylconn_ros.bench.precision.pareto import Point
from cylconn_ros.bench.precision.trials import COST
from cylconn_ros.bench.step_cost import features
from cylconn_ros.cli import main
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.simulate import simulate

PACKAGES = {"drake": "pydrake", "ours": "numpy"}
INSTALLED = {
    contestant.name: contestant
    for contestant in CONTESTANTS.values()
    if importlib.util.find_spec(PACKAGES.get(contestant.family, contestant.family))
}
"""What the environment of the tests has; the others are to be said to be absent."""


# --- what is measured of a state ---


@pytest.mark.parametrize("name", ["demo", "free_flight", "hub_and_rotor", "free_slide"])
def test_measured_at_the_start_is_nothing(name: str) -> None:
    scene = bundled(name)
    found = cases.measured(scene, Plant(scene).state)
    for quantity in ("slide", "spin", "offset", "tilt"):
        assert abs(found[quantity]) < 1e-12
    assert found["energy"] == pytest.approx(Plant(scene).energy())


def test_measured_agrees_with_the_connector() -> None:
    scene = bundled("demo")
    run = simulate(scene, 400)
    found = cases.measured(scene, run.states[-1])
    assert found["slide"] == pytest.approx(run.state("displacement")[-1], abs=1e-12)
    assert math.remainder(found["spin"] - run.state("rotation")[-1], 2 * math.pi) == (
        pytest.approx(0.0, abs=1e-9)
    )
    assert found["v"] == pytest.approx(run.state("velocity")[-1, 0])
    assert found["w"] == pytest.approx(run.state("angular_velocity")[-1, 0])


def test_a_joint_gives_the_state_back() -> None:
    for name in ("demo", "hub_and_rotor"):
        scene = bundled(name)
        joint = Joint(scene)
        state = joint.state(joint.pose_a, joint.twist_a, 0.0, 0.0, (joint.slide, joint.spin))
        np.testing.assert_allclose(state, Plant(scene).state, atol=1e-13)
        found = cases.measured(
            scene, joint.state(joint.pose_a, joint.twist_a, 0.3, 1.0, (2.0, 5.0))
        )
        moved = [found[quantity] for quantity in ("slide", "spin", "v", "w")]
        assert moved == pytest.approx([0.3, 1.0, 2.0, 5.0])
        assert max(found["offset"], found["tilt"]) < 1e-12


def test_answers_that_are_worth_nothing_are_failures() -> None:
    case, scene = CASES["coast"], cases.scene_of(bundled, CASES["coast"])
    truth = case.answer(scene, case.duration)
    joint = Joint(scene)

    def judged(slide: float, v: float) -> str:
        state = joint.state(joint.pose_a, joint.twist_a, slide, 0.0, (v, 0.0))
        return cases.failure(case, scene, cases.errors(case, scene, truth, state), state)

    assert judged(truth["slide"] + 1e-3, 0.0) == ""
    assert "half of the motion" in judged(truth["slide"] + 0.15, 0.0)
    assert "rest" in judged(truth["slide"], 0.5)
    lost = np.full(26, math.nan)
    assert "blew up" in cases.failure(case, scene, cases.errors(case, scene, truth, lost), lost)
    state = joint.state(joint.pose_a, joint.twist_a, truth["slide"], 0.0, (0.0, 0.0))
    state[14] += 0.2
    assert "apart" in cases.failure(case, scene, cases.errors(case, scene, truth, state), state)


# --- fronts ---


def test_fronts_and_domination() -> None:
    ours = [Point("impulse", 1e-3, 1.0, 1e-4), Point("minimal", 1e-6, 2.0, 1e-8)]
    slow = Point("impulse", 1e-4, 3.0, 1e-6)
    lost = Point("penalty", 1e-3, 0.1, 1e-9, "blew up")
    assert pareto.front([slow, *ours, lost]) == ours
    peer = Point("MuJoCo RK4, loop", 1e-3, 2.5, 1e-5)
    assert pareto.at_equal_cost(ours, peer, 1e-13) == pytest.approx(1e-3)
    assert math.isnan(pareto.at_equal_cost(ours, dataclasses.replace(peer, cost=0.5), 1e-13))
    assert pareto.dominating(ours, [peer], 1e-13) == []
    better = dataclasses.replace(peer, cost=0.5, error=1e-5)
    assert pareto.dominating(ours, [better], 1e-13) == [better]
    rounding = [Point("impulse", 1e-3, 1.0, 1e-15)]
    same = dataclasses.replace(peer, cost=0.95, error=0.0)
    assert pareto.dominating(rounding, [same], 1e-13) == [], "within the clock's spread"


def test_targets_are_stricter_where_reactions_change() -> None:
    def point(problem: str, name: str, cost: float, off: float) -> list[Measurement]:
        knob = {"step": 1e-3}
        return [
            Measurement(problem, name, PLACE, off, "m", settings=knob),
            Measurement(problem, name, COST, cost, "ms", settings=knob),
        ]

    found = Findings()
    for problem in ("coast", "demo"):
        found.measurements += point(problem, "impulse", 1.0, 1e-5)
        found.measurements += point(problem, "MuJoCo RK4, loop", 2.0, 2e-5)
    met = {target.name.partition(":")[0]: target for target in pareto.targets(found)[::2]}
    assert met["coast"].met is True
    assert met["demo"].met is False
    assert met["demo"].value == pytest.approx(0.5)


# --- the command ---


def test_errors_of_rounding_are_equal() -> None:
    """A point of ours that is nearer by less than rounding, and dearer, is not on the front."""
    ours = [Point("minimal", 1e-2, 0.2, 4e-17), Point("minimal, live", 1e-3, 9.0, 1e-17)]
    theirs = [Point("SciPy LSODA", 1e-12, 5.0, 4e-15)]
    assert pareto.front(ours, 1e-13) == ours[:1]
    assert pareto.dominating(pareto.front(ours, 1e-13), theirs, 1e-13) == []
    assert pareto.dominating(ours, theirs, 1e-13) == theirs


def test_quick_precision_is_whole(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "precision.json"
    assert main.main(["bench", "precision", "--quick", "-o", str(output)]) == 0
    data = json.loads(output.read_text())
    names = {m["contestant"] for m in data["measurements"]}
    gaps = {(gap["contestant"], gap["status"]) for gap in data["gaps"]}
    for name in CONTESTANTS:
        assert name in names if name in INSTALLED else (name, "absent") in gaps, name
    assert {m["problem"] for m in data["measurements"]} == {"coast", "near_jam"}
    assert len(data["targets"]) == 4
    failed = [m["note"] for m in data["measurements"] if m["contestant"] == "penalty"]
    assert any(failed), "penalty comes apart near the jam"
    assert "coast: our error at equal CPU" in capsys.readouterr().out


def test_gaps_that_are_everywhere_are_one() -> None:
    gaps = [Gap(name, "peer", "absent", "is not installed") for name in ("a", "b")]
    assert run.merged(gaps) == [Gap("a, b", "peer", "absent", "is not installed")]


# --- results kept, drawn and written ---


def some() -> Report:
    """A scene with an answer, a failure and a gap."""
    found = Findings()
    for name, value, cost, off, note in (
        ("impulse", 1e-3, 1.0, 1e-5, ""),
        ("impulse", 1e-4, 9.0, 1e-7, ""),
        ("minimal", 1e-6, 0.1, 0.0, ""),
        ("MuJoCo RK4, loop", 1e-3, 5.0, 2e-3, ""),
        ("penalty", 1e-3, 0.5, math.nan, "blew up"),
        ("Drake RK3, loop", 1e-3, 20.0, 1e-3, ""),
    ):
        knob: dict[str, Setting] = {CONTESTANTS[name].knob: value}
        found.measurements += [
            Measurement("demo", name, PLACE, off, "m", settings=knob, note=note),
            Measurement("demo", name, COST, cost, "ms", settings=knob, note=note),
        ]
    found.targets = pareto.targets(found)
    found.gaps = [Gap("demo", "PyBullet, loop", "absent", "pybullet is not installed")]
    return Report("cylconn bench precision", {"quick": True}, found)


def test_results_are_read_back_as_they_were_kept(tmp_path: Path) -> None:
    whole = some()
    file = tmp_path / "kept.json"
    file.write_text(whole.json())
    assert results_kept.read(file).json() == whole.json()
    file.write_text('{"format": 1}')
    with pytest.raises(ValueError, match="no results of a benchmark"):
        results_kept.read(file)


def test_a_budget_buys_the_least_error() -> None:
    points = pareto.points(some().findings, "demo")

    def cell(name: str, budget: float) -> str:
        return text.cell([p for p in points if p.contestant == name], budget)

    assert cell("impulse", 1.0) == "1e-05"
    assert cell("impulse", 10.0) == "1e-07"
    assert cell("minimal", 1.0) == "exact"
    assert cell("penalty", 1.0) == text.FAILED
    assert cell("Drake RK3, loop", 10.0) == text.DEARER
    assert cell("PyBullet, loop", 10.0) == text.NONE
    body = text.body(some().findings)
    assert "| 1 of 1" in body
    assert "| blew up" in body
    assert "◆" in body


def test_every_contestant_is_on_one_curve() -> None:
    for name in CONTESTANTS:
        assert len([curve for curve in picture.CURVES if curve.holds(name)]) == 1, name


def test_kept_results_are_drawn_and_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, folder, text = tmp_path / "kept.json", tmp_path / "drawn", tmp_path / "page.md"
    file.write_text(some().json())
    text.write_text("<!-- cylconn bench precision -->\n<!-- end -->\n")
    command = ["bench", "precision", "--from", str(file)]
    assert main.main([*command, "--pictures", str(folder), "--document", str(text)]) == 0
    assert (folder / "precision.png").read_bytes().startswith(b"\x89PNG")
    svg = (folder / "precision.svg").read_text()
    assert "unbalanced sleeve" in svg
    assert "minimal" in svg
    page = (folder / "precision.html").read_text()
    embedded = json.loads(page.partition("const data = ")[2].partition(", off = new Set")[0])
    assert embedded["scenes"][0]["rows"]["penalty"] == [[1e-3, 0.5, None, "blew up", None, None]]
    assert "http" not in page.replace("http://www.w3.org/2000/svg", ""), "no network"
    assert "PyBullet" in text.read_text()
    capsys.readouterr()
    assert main.main(["bench", "model", "--from", str(file)]) == main.USAGE_ERROR
    assert "holds results of cylconn bench precision" in capsys.readouterr().err
    assert main.main(["bench", "model", "--pictures", str(folder)]) == main.USAGE_ERROR


# --- lean and full model ---


@pytest.mark.parametrize("name", ["coast", "between_stops", "dry_friction_oscillator", "demo"])
def test_features_without_effect_have_none(name: str) -> None:
    scenes = features.variants(cases.scene_of(bundled, CASES[name]))
    assert features.FULL in scenes
    ends = {key: simulate(scene, 300).states[-1, 13:] for key, scene in scenes.items()}
    for key, end in ends.items():
        if key == features.FULL or key.startswith(features.WITH):
            np.testing.assert_allclose(end, ends[features.LEAN], rtol=0.0, atol=1e-9, err_msg=key)


def test_features_left_out_are_missed() -> None:
    scenes = features.variants(cases.scene_of(bundled, CASES["demo"]))
    ends = {key: simulate(scene, 1000).states[-1, 13:16] for key, scene in scenes.items()}
    for name in ("friction", "bending"):
        off = np.abs(ends[features.WITHOUT + name] - ends[features.LEAN]).max()
        assert off > 1e-3, name


def test_a_pair_can_do_without_its_second_body() -> None:
    scenes = features.variants(cases.scene_of(bundled, CASES["hub_and_rotor"]))
    alone = scenes[features.WITHOUT + "second body"]
    start = simulate(alone, 1)
    assert start.state("velocity_violation")[0] < 1e-12
    assert start.state("spin_violation")[0] < 1e-12


def test_quick_model_is_whole(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["bench", "model", "--quick"]) == 0
    printed = capsys.readouterr().out
    for words in ("+ second body", "error of the full", "left out", "near_jam"):
        assert words in printed
