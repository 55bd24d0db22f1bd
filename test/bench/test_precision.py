"""Work-precision diagrams: errors, Pareto fronts, targets, tables, pictures; and model features."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import math
from pathlib import Path

import numpy as np
import pytest
from browser import browser
from scenes import bundled

from cylconn_ros.bench.common import published, results
from cylconn_ros.bench.common.results import (
    Findings,
    Measurement,
    NotMeasured,
    Report,
    Setting,
    merge_cases,
)
from cylconn_ros.bench.peers.common import Joint
from cylconn_ros.bench.peers.registry import SOLVERS
from cylconn_ros.bench.precision import cases, page, pareto, picture, text
from cylconn_ros.bench.precision.cases import CASES, ERROR
from cylconn_ros.bench.precision.pareto import Point
from cylconn_ros.bench.precision.trials import COST
from cylconn_ros.bench.step_cost import features
from cylconn_ros.cli import main
from cylconn_ros.reference import over_time_answers
from cylconn_ros.reference.answers import distance
from cylconn_ros.report.page import library
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.simulate import simulate

PACKAGES = {"drake": "pydrake", "ours": "numpy"}
INSTALLED = {
    solver.name: solver
    for solver in SOLVERS.values()
    if importlib.util.find_spec(PACKAGES.get(solver.family, solver.family))
}
"""Solvers whose package is installed in the test environment."""


# --- quantities and errors of an end state ---


@pytest.mark.parametrize("name", ["demo", "free_flight", "hub_and_rotor", "free_slide"])
def test_end_quantities_of_the_initial_state_are_zero(name: str) -> None:
    scene = bundled(name)
    found = cases.end_quantities(scene, Plant(scene).state)
    for quantity in ("slide", "spin", "offset", "tilt"):
        assert abs(found[quantity]) < 1e-12
    assert found["energy"] == pytest.approx(Plant(scene).energy())


def test_end_quantities_agree_with_the_connector() -> None:
    scene = bundled("demo")
    run = simulate(scene, samples=400)
    found = cases.end_quantities(scene, run.states[-1])
    assert found["slide"] == pytest.approx(run["displacement"][-1], abs=1e-12)
    assert math.remainder(found["spin"] - run["rotation"][-1], 2 * math.pi) == (
        pytest.approx(0.0, abs=1e-9)
    )
    assert found["v"] == pytest.approx(run["velocity"][-1, 0])
    assert found["w"] == pytest.approx(run["angular_velocity"][-1, 0])


def test_unusable_solutions_count_as_failed() -> None:
    case, scene = CASES["coast"], cases.scene_of(bundled, CASES["coast"])
    reference = case.reference(scene, case.duration)
    joint = Joint(scene)

    def failure(slide: float, v: float) -> str:
        state = joint.state(joint.pose_a, joint.twist_a, slide, 0.0, (v, 0.0))
        return cases.failure(case, scene, cases.errors(case, scene, reference, state), state)

    assert failure(reference["slide"] + 1e-3, 0.0) == ""
    assert "half of the motion" in failure(reference["slide"] + 0.15, 0.0)
    assert "rest" in failure(reference["slide"], 0.5)
    diverged = np.full(26, math.nan)
    assert "diverged" in cases.failure(
        case, scene, cases.errors(case, scene, reference, diverged), diverged
    )
    state = joint.state(joint.pose_a, joint.twist_a, reference["slide"], 0.0, (0.0, 0.0))
    state[14] += 0.2
    assert "apart" in cases.failure(case, scene, cases.errors(case, scene, reference, state), state)


# --- Pareto fronts and targets ---


def test_fronts_and_domination() -> None:
    own = [Point("impulse", 1e-3, 1.0, 1e-4), Point("minimal", 1e-6, 2.0, 1e-8)]
    slow = Point("impulse", 1e-4, 3.0, 1e-6)
    lost = Point("penalty", 1e-3, 0.1, 1e-9, "diverged")
    assert pareto.front([slow, *own, lost]) == own
    peer = Point("MuJoCo RK4, loop", 1e-3, 2.5, 1e-5)
    assert pareto.ratio_at_equal_cost(own, peer, 1e-13) == pytest.approx(1e-3)
    assert math.isnan(pareto.ratio_at_equal_cost(own, dataclasses.replace(peer, cost=0.5), 1e-13))
    assert pareto.dominating(own, [peer], 1e-13) == []
    better = dataclasses.replace(peer, cost=0.5, error=1e-5)
    assert pareto.dominating(own, [better], 1e-13) == [better]
    near_rounding = [Point("impulse", 1e-3, 1.0, 1e-15)]
    same = dataclasses.replace(peer, cost=0.95, error=0.0)
    assert pareto.dominating(near_rounding, [same], 1e-13) == [], "within the spread of the clock"


def test_targets_are_stricter_if_friction_depends_on_reactions() -> None:
    def point(case: str, name: str, cost: float, error: float) -> list[Measurement]:
        settings: dict[str, Setting] = {"step": 1e-3}
        return [
            Measurement(case, name, ERROR, error, "m", settings=settings),
            Measurement(case, name, COST, cost, "ms", settings=settings),
        ]

    found = Findings()
    for case in ("coast", "demo"):
        found.measurements += point(case, "impulse", 1.0, 1e-5)
        found.measurements += point(case, "MuJoCo RK4, loop", 2.0, 2e-5)
    met = {
        target.name.partition(":")[0]: target
        for target in pareto.targets(found)
        if "own error over" in target.name
    }
    assert met["coast"].met is True
    assert met["demo"].met is False
    assert met["demo"].value == pytest.approx(0.5)


def test_errors_below_rounding_are_equal() -> None:
    """An own point that is more accurate by less than rounding, and slower, is not on the front."""
    own = [Point("minimal", 1e-2, 0.2, 4e-17), Point("impulse", 1e-3, 9.0, 1e-17)]
    peers = [Point("SciPy LSODA", 1e-12, 5.0, 4e-15)]
    assert pareto.front(own, 1e-13) == own[:1]
    assert pareto.dominating(pareto.front(own, 1e-13), peers, 1e-13) == []
    assert pareto.dominating(own, peers, 1e-13) == peers


def test_cost_ratio_compares_the_cheapest_points_that_reach_an_error() -> None:
    own = [Point("minimal", 1e-8, 1.0, 1e-9), Point("minimal", 1e-10, 2.0, 1e-11)]
    peers = [Point("SciPy DOP853", 1e-11, 50.0, 1e-11), Point("SciPy DOP853", 1e-9, 40.0, 1e-10)]
    assert pareto.cost_ratio(own, peers, 1e-10) == pytest.approx(2.0 / 40.0)
    assert math.isnan(pareto.cost_ratio(own[:1], peers, 1e-10)), "not reached"


def test_impulse_alone_has_a_target_among_fixed_steps() -> None:
    def measured(case: str) -> Findings:
        found = Findings()
        for name, cost, error in (
            ("minimal", 0.1, 1e-12),
            ("impulse", 1.0, 1e-5),
            ("SciPy DOP853", 0.5, 1e-9),
            ("Drake RK3, loop", 2.0, 1e-6),
            ("MuJoCo Euler, loop", 0.9, 5e-6),
        ):
            settings: dict[str, Setting] = {SOLVERS[name].parameter: 1e-3}
            found.measurements += [
                Measurement(case, name, ERROR, error, "m", settings=settings),
                Measurement(case, name, COST, cost, "ms", settings=settings),
            ]
        return found

    target = pareto.targets(measured("coast"))[2]
    assert "fixed steps" in target.name
    assert target.note == "MuJoCo Euler, loop at 0.001", "Drake costs more, SciPy is adaptive"
    assert target.value == 1
    names = [each.name for each in pareto.targets(measured("free_slide"))]
    assert not any("fixed steps" in name for name in names), "no friction, no stops"


# --- references of further scenes ---


def test_one_slide_is_at_the_published_motions() -> None:
    """Turning points and rest of Modelica's example Friction, by an event-located integration."""
    scene = published.spring_hard_stop()
    for time, position in (
        (0.1, -0.349355511),
        (0.201105952, -0.122326718),
        (0.341617058, -0.356614630),
        (0.482138717, -0.163418215),
        (1.2, -0.247513987),
    ):
        assert published.slide(scene, time)[0] == pytest.approx(position, abs=2e-9)


def test_one_slide_with_a_table_is_near_the_published_result() -> None:
    found = published.slide(published.friction_table(), 1.0)
    assert found == pytest.approx((1.6992808, 6.9012951), abs=1e-5)


def test_siconos_oscillator_comes_to_rest_where_published() -> None:
    scene = published.friction_oscillator()
    assert published.oscillation(scene) == pytest.approx(0.682178937, abs=1e-9)
    assert published.slide(scene, 24.0)[0] + 12.0 == pytest.approx(0.682178937, abs=1e-9)


def test_stick_slip_as_a_load_is_the_bundled_scene() -> None:
    answers = {e.of: e.value for e in over_time_answers.stick_slip(bundled("stick_slip"), 20.0)}
    position = answers[distance]
    assert published.slide(published.stick_slip(), 20.0)[0] == pytest.approx(position, abs=1e-8)
    assert published.slide(published.stick_slip(), 7.4999)[0] == 0.0, "it holds until 7.5 s"


def test_bounce_heights_and_end() -> None:
    """Dropped from 1 m at restitution 0.8: apexes 0.64 and 0.4096 m."""
    first = math.sqrt(2.0 / 9.81)
    assert published.bounced(1.0, 9.81, 0.8, 1.8 * first) == pytest.approx((0.64, 0.0), abs=1e-12)
    apex = (1.0 + 1.6 + 0.64) * first
    assert published.bounced(1.0, 9.81, 0.8, apex) == pytest.approx((0.4096, 0.0), abs=1e-12)


def test_minimal_has_targets_beside_scipy_and_mujoco() -> None:
    found = Findings()
    for case, peer in (
        ("slide_and_spin", "SciPy DOP853"),
        ("free_flight", "MuJoCo RK4, constant"),
    ):
        for name, cost, error in (
            ("minimal", 1.0, 1e-11),
            (peer, 0.5, 1e-7),
            (peer, 40.0, 1e-10),
        ):
            settings: dict[str, Setting] = {SOLVERS[name].parameter: cost}
            found.measurements += [
                Measurement(case, name, ERROR, error, "m", settings=settings),
                Measurement(case, name, COST, cost, "ms", settings=settings),
            ]
    scipy, mujoco = pareto.targets(found)[-2:]
    assert "SciPy" in scipy.name
    assert scipy.value == pytest.approx(1.0 / 40.0)
    assert scipy.met is True
    assert "MuJoCo" in mujoco.name
    assert mujoco.value == pytest.approx(2e-11 / 1e-10), "rounding of the reference"


def test_quick_precision_is_complete(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "precision.json"
    assert main.main(["bench", "precision", "--quick", "-o", str(output)]) == 0
    data = json.loads(output.read_text())
    names = {m["subject"] for m in data["measurements"]}
    not_measured = {(one["subject"], one["status"]) for one in data["not_measured"]}
    for name in SOLVERS:
        if name in INSTALLED:
            assert name in names, name
        else:
            assert (name, "not installed") in not_measured, name
    assert {m["case"] for m in data["measurements"]} == {"coast", "near_jam"}
    assert len(data["targets"]) == 6
    failed = [m["note"] for m in data["measurements"] if m["subject"] == "penalty"]
    assert any(failed), "penalty fails near the jam"
    assert "coast: own error over the best simulator's at equal CPU time" in capsys.readouterr().out


def test_equal_reasons_on_several_cases_are_one_entry() -> None:
    missing = [NotMeasured(name, "peer", "not installed", "reason") for name in ("a", "b")]
    assert merge_cases(missing) == [NotMeasured("a, b", "peer", "not installed", "reason")]


# --- results stored, drawn and written ---


def some_report() -> Report:
    """A case with solutions, a failure and a solver that is not installed."""
    found = Findings()
    for name, value, cost, error, note in (
        ("impulse", 1e-3, 1.0, 1e-5, ""),
        ("impulse", 1e-4, 9.0, 1e-7, ""),
        ("minimal", 1e-6, 0.1, 0.0, ""),
        ("MuJoCo RK4, loop", 1e-3, 5.0, 2e-3, ""),
        ("penalty", 1e-3, 0.5, math.nan, "diverged"),
        ("Drake RK3, loop", 1e-3, 20.0, 1e-3, ""),
    ):
        settings: dict[str, Setting] = {SOLVERS[name].parameter: value}
        found.measurements += [
            Measurement("demo", name, ERROR, error, "m", settings=settings, note=note),
            Measurement("demo", name, COST, cost, "ms", settings=settings, note=note),
        ]
    found.targets = pareto.targets(found)
    reason = "pybullet is not installed"
    found.not_measured = [NotMeasured("demo", "PyBullet, loop", "not installed", reason)]
    return Report("cylconn bench precision", {"quick": True}, found)


def test_results_are_read_back_unchanged(tmp_path: Path) -> None:
    whole = some_report()
    file = tmp_path / "stored.json"
    file.write_text(whole.json())
    assert results.read(file).json() == whole.json()
    file.write_text(json.dumps({"format": results.FORMAT}))
    with pytest.raises(ValueError, match="no results of a benchmark"):
        results.read(file)


def test_cell_has_the_least_error_within_the_budget() -> None:
    points = pareto.points(some_report().findings, "demo")

    def cell(name: str, budget: float) -> str:
        return text.cell([p for p in points if p.solver == name], budget)

    assert cell("impulse", 1.0) == "1e-05"
    assert cell("impulse", 10.0) == "1e-07"
    assert cell("minimal", 1.0) == "exact"
    assert cell("penalty", 1.0) == text.FAILED
    assert cell("Drake RK3, loop", 10.0) == text.TOO_SLOW
    assert cell("PyBullet, loop", 10.0) == text.NO_RESULT
    body = text.body(some_report().findings)
    assert "| 1 of 1" in body
    assert "| diverged" in body
    assert "◆" in body


def test_every_solver_is_on_one_curve() -> None:
    for name in SOLVERS:
        assert len([curve for curve in picture.CURVES if curve.contains(name)]) == 1, name


def test_stored_results_are_drawn_and_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, folder, text = tmp_path / "stored.json", tmp_path / "drawn", tmp_path / "page.md"
    file.write_text(some_report().json())
    text.write_text("<!-- cylconn bench precision -->\n<!-- end -->\n")
    command = ["bench", "precision", "--from", str(file)]
    assert main.main([*command, "--pictures", str(folder), "--document", str(text)]) == 0
    assert (folder / "precision.png").read_bytes().startswith(b"\x89PNG")
    svg = (folder / "precision.svg").read_text()
    assert "unbalanced sleeve" in svg
    assert "minimal" in svg
    drawn = (folder / "precision.html").read_text().replace(library(), "")
    embedded = json.loads(drawn.partition("const data = ")[2].partition(", off = new Set")[0])
    assert embedded["cases"][0]["rows"]["penalty"] == [[1e-3, 0.5, None, "diverged", None, None]]
    assert "://" not in drawn, "no network"
    assert "PyBullet" in text.read_text()
    capsys.readouterr()
    assert main.main(["bench", "model", "--from", str(file)]) == main.USAGE_ERROR
    assert "holds results of cylconn bench precision" in capsys.readouterr().err
    assert main.main(["bench", "model", "--pictures", str(folder)]) == main.USAGE_ERROR


def test_the_page_in_a_browser(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_text(page.page(some_report()))
    with browser(tmp_path) as opened:
        opened.send("Page.navigate", url=path.as_uri())
        while "Page.loadEventFired" not in opened.events:
            opened.run("1")
        assert opened.run("ready.then(() => Object.keys(glyphs).length)") == 5
        assert opened.run("glyphs['penalty'][1].data_source.data.error") == ["failed: diverged"]
        # the numbers of the point at the pointer
        x, y = opened.run(
            "ready.then((view) => { const { x, y } = glyphs['impulse'][0].data_source.data;"
            " const { x_scale, y_scale } = view.frame, box = at('plot').getBoundingClientRect();"
            " return [box.left + x_scale.compute(x[0]), box.top + y_scale.compute(y[0])]; })"
        )
        for by in (-9, -3, 0):
            opened.mouse("mouseMoved", x + by, y)
            opened.run("new Promise((done) => setTimeout(done, 100))")
        text = opened.run(
            "(function texts(root) { return [...root.querySelectorAll('*')].map((e) =>"
            " e.shadowRoot ? texts(e.shadowRoot) : e.className === 'bk-tooltip-row-value' ?"
            " e.textContent : '').join(' '); })(document)"
        )
        assert "impulse" in text
        assert "1e-5 m" in text
        # a solver is hidden, and shown again in the next case that is chosen
        opened.run("document.querySelector('#names button').click()")
        name = opened.run("document.querySelector('#names button').textContent").split(" ", 1)[1]
        assert opened.run(f"glyphs['{name}'].map((part) => part.visible)") == [False] * 4
        assert opened.problems == []
        assert [url for url in opened.requests if not url.startswith(("file:", "data:"))] == []


# --- model features ---


@pytest.mark.parametrize("name", ["coast", "between_stops", "dry_friction_oscillator", "demo"])
def test_additional_features_do_not_change_the_motion(name: str) -> None:
    scenes = features.variants(cases.scene_of(bundled, CASES[name]))
    assert features.FULL in scenes
    ends = {key: simulate(scene, samples=300).states[-1, 13:] for key, scene in scenes.items()}
    for key, end in ends.items():
        if key == features.FULL or key.startswith(features.WITH):
            np.testing.assert_allclose(end, ends[features.LEAN], rtol=0.0, atol=1e-9, err_msg=key)


def test_omitted_features_change_the_motion() -> None:
    scenes = features.variants(cases.scene_of(bundled, CASES["demo"]))
    ends = {key: simulate(scene, samples=1000).states[-1, 13:16] for key, scene in scenes.items()}
    for name in ("friction", "bending"):
        off = np.abs(ends[features.WITHOUT + name] - ends[features.LEAN]).max()
        assert off > 1e-3, name


def test_a_pair_without_its_second_body_starts_on_the_constraint() -> None:
    scenes = features.variants(cases.scene_of(bundled, CASES["hub_and_rotor"]))
    alone = scenes[features.WITHOUT + "second body"]
    start = simulate(alone, samples=1)
    assert start["velocity_violation"][0] < 1e-12
    assert start["spin_violation"][0] < 1e-12


def test_quick_model_is_complete(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["bench", "model", "--quick"]) == 0
    printed = capsys.readouterr().out
    for words in ("+ second body", "error of the full model", "omitted", "near_jam"):
        assert words in printed
