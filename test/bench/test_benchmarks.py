"""Benchmarks: peers solve the same problem, quick forms give whole results. No time is judged."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import bundled

from cylconn_ros.bench.common import frames, methods, report, timing
from cylconn_ros.bench.common.errors import AbsentError, LeftOutError
from cylconn_ros.bench.common.report_document import replaced
from cylconn_ros.bench.common.results import Findings, Gap, Measurement, Report, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.convergence import orders
from cylconn_ros.bench.convergence.problems import handful
from cylconn_ros.bench.nodes import measure
from cylconn_ros.bench.peers.mujoco_scene import MujocoScene, document
from cylconn_ros.bench.peers.scipy_oscillator import slide_and_spin
from cylconn_ros.bench.precision import trials
from cylconn_ros.bench.step_cost import kernel, whole_motion, whole_motion_minimal, worker
from cylconn_ros.cli import main
from cylconn_ros.cli.benchmarks import BENCHES, Bench
from cylconn_ros.process.child import private_environment
from cylconn_ros.reference import constant_normal_force, free_pair
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.simulate import simulate

QUICK = Settings.short(bundled)


# --- peers are set up as the scene is ---


@pytest.mark.parametrize("name", ["demo", "free_flight", "slide_and_spin", "incline"])
def test_mujoco_starts_where_the_plant_does(name: str) -> None:
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
    place, _ = frames.com(scene.body_b, peer.state()[13:])
    np.testing.assert_allclose(place, truth.com_b, atol=1e-11)
    np.testing.assert_allclose(peer.slide(), (truth.distance, truth.angle), atol=1e-9)
    peer.reset()
    peer.step(100)
    np.testing.assert_array_equal(frames.com(scene.body_b, peer.state()[13:])[0], place)


def test_mujoco_brakes_with_the_friction_it_is_given() -> None:
    scene = bundled("coast")
    force = 0.2 * (2.0 * 9.81 + 5.0)
    peer = MujocoScene(scene, friction=force, timestep=1e-4)
    peer.run(2000)
    assert peer.slide()[0] == pytest.approx(0.2 - 0.5 * force / 2.0 * 0.2**2, rel=1e-3)


def test_mujoco_refuses_what_it_does_not_cover() -> None:
    values = {**bundled("coast").parameters(), "body_a.kind": "driven"}
    scene = type(bundled("coast")).from_parameters(values)
    with pytest.raises(ValueError, match="fixed or free"):
        document(scene, 0.0, "Euler", 1e-3)


def test_scipy_reaches_the_closed_form() -> None:
    scene = bundled("slide_and_spin")
    _, distance = constant_normal_force(1.0, 1.0, 1.0 / (0.2 * 9.81))
    assert slide_and_spin(scene, 1e-10) == pytest.approx(distance, abs=1e-11)
    assert abs(slide_and_spin(scene, 1e-3) - distance) > 1e-9, "the tolerance is used"
    with pytest.raises(ValueError, match="level shaft"):
        slide_and_spin(bundled("demo"), 1e-6)


def test_minimal_prepared_is_minimal_solved() -> None:
    scene = bundled("slide_and_spin")
    prepared = whole_motion_minimal.Prepared(scene, 0.7, 1e-8)
    for _ in range(2):  # from the start each time
        prepared()
        np.testing.assert_array_equal(
            prepared.rows, whole_motion_minimal.solve(scene, 0.7, 1e-8).rows
        )


# --- methods are set up as a user would ---


def test_every_method_survives_its_set_up() -> None:
    for problem in handful(bundled):
        for method in methods.available():
            scene = methods.served_by(methods.with_period(problem.scene, 2e-3), method)
            errors = problem.errors(simulate(scene, round(problem.duration / 2e-3) + 1))
            sizes = [size for size, _ in errors.values() if not math.isnan(size)]
            assert sizes, (problem.name, method)
            assert max(sizes) < orders.LOST, (problem.name, method)


def test_least_mass_at_an_arm() -> None:
    """A rod pushed a distance r off its centre: 1/m + r^2/I."""
    scene = bundled("demo")
    mass, inertia = methods.effective(scene)
    assert inertia == pytest.approx(1.85e-3, rel=0.02)
    arm = np.subtract(scene.body_b.com, scene.node_b.position)
    assert mass == pytest.approx(1.0 / (1.0 / 2.13 + arm @ arm / inertia))


def test_a_method_that_does_not_go_with_a_scene_says_why() -> None:
    values = {**bundled("demo").parameters(), "body_b.kind": "unknown"}
    scene = type(bundled("demo")).from_parameters(values)
    with pytest.raises(LeftOutError, match=r"body_b\.kind"):
        methods.served_by(scene, "impulse")


# --- arithmetic of the results ---


def test_turns_are_fair_and_ratios_are_of_one_round() -> None:
    played: list[str] = []
    slow = [1.0]

    def contestant(name: str, cost: float) -> timing.Contestant:
        def block(n: int) -> float:
            played.append(name)
            slow[0] *= 1.01  # a machine that slows down all the time
            return n * cost * slow[0]

        return timing.Contestant(name, block)

    times = timing.take_turns([contestant("a", 1.0), contestant("b", 3.0)], 8, 1.0)
    assert played[-16:-12] == ["a", "b", "b", "a"]
    assert timing.ratio(times["b"], times["a"]).median == pytest.approx(3.0, rel=0.02)
    assert times["a"][-1] > 1.1 * times["a"][0]


def test_a_turn_is_long_enough_for_the_clock() -> None:
    asked: list[int] = []

    def block(n: int) -> float:
        asked.append(n)
        return n * 1e-6

    timing.take_turns([timing.Contestant("a", block)], 1, 1e-2)
    assert asked[-1] == pytest.approx(1e4, rel=0.3)


def test_orders_are_slopes_of_what_survived() -> None:
    periods = [8e-3, 4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4]
    assert orders.fitted(periods, [h**2 for h in periods])[0] == pytest.approx(2.0)
    lost = [math.inf, *(h**2 for h in periods[1:])]
    assert orders.fitted(periods, lost)[0] == pytest.approx(2.0)
    assert orders.fitted(periods, lost)[1] == "failed at 1 of 6 periods"
    slope, note = orders.fitted(periods, [1e9, math.nan, *(h**2 for h in periods[2:])])
    assert math.isnan(slope)
    assert note == "failed at 2 of 6 periods"
    assert orders.fitted(periods, [1e-16] * 6)[1] == "exact"


def test_the_worst_ratio_at_equal_time() -> None:
    theirs = [(1.0, 1e-4), (2.0, 1e-6), (4.0, 1e-8)]
    assert trials.worst_at_equal_time([(2.0, 1e-7)], theirs) == pytest.approx(0.1)
    assert trials.worst_at_equal_time([(2.0, 1e-7), (math.sqrt(2.0), 1e-4)], theirs) == (
        pytest.approx(10.0)
    )
    assert math.isnan(trials.worst_at_equal_time([(8.0, 1e-9)], theirs))
    assert math.isnan(trials.worst_at_equal_time([], theirs))


def test_targets_are_met_missed_or_not_measured() -> None:
    assert Target("a", 1.0, 1.0, "us").met is True
    assert Target("a", 1.1, 1.0, "us").met is False
    assert Target("a", math.nan, 1.0, "us").met is None


def test_results_are_json_without_holes() -> None:
    found = Findings(
        targets=[Target("fast", math.nan, 1.0, "us")],
        measurements=[Measurement("p", "a|b", "time", 1.5, "us", settings={"rtol": 1e-6})],
        gaps=[Gap("p", "peer", "absent", "is not installed")],
    )
    whole = Report("cylconn bench kernel", {"rounds": 3}, found)
    data = json.loads(whole.json())
    assert data["targets"][0]["value"] is None
    assert data["targets"][0]["met"] is None
    assert data["measurements"][0]["settings"] == {"rtol": 1e-6}
    assert {"processor", "python", "numpy", "numba", "mujoco"} <= set(data["machine"])
    printed = report.text(whole)
    for text in ("not measured", "a/b (rtol 1e-06)", "1.50 us", "is not installed", "processor"):
        assert text in printed


def test_results_take_their_place_in_a_page() -> None:
    page = "a\n<!-- cylconn bench kernel -->\nold\n<!-- end -->\nb\n<!-- cylconn bench orders -->\n"
    new = replaced(page, "cylconn bench kernel", "| new \\1 |\n")
    assert "old" not in new
    assert "<!-- cylconn bench kernel -->\n\n| new \\1 |\n\n<!-- end -->\nb\n" in new
    assert replaced(new, "cylconn bench kernel", "| new \\1 |\n") == new
    with pytest.raises(ValueError, match="<!-- cylconn bench orders -->"):  # has no end
        replaced(page, "cylconn bench orders", "")


# --- the commands ---


def test_quick_kernel_is_whole(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "kernel.json"
    assert main.main(["bench", "kernel", "--quick", "-o", str(output)]) == 0
    data = json.loads(output.read_text())
    assert data["settings"]["quick"] is True
    measured = {(m["problem"], m["contestant"], m["quantity"]): m for m in data["measurements"]}
    for contestant in (
        "impulse, in a batch",
        "impulse, a call from Python",
        "impulse, plain Python, a call from Python",
        "penalty, in a batch",
        "MuJoCo mj_step Euler, a call from Python",
    ):
        m = measured[kernel.SHAFT, contestant, kernel.STEP]
        assert m["value"] > 0.0
        assert m["low"] <= m["value"] <= m["high"]
        assert m["count"] == QUICK.rounds
    assert measured["start to first answer", "warm compile cache", "wall time"]["value"] > 0.0
    assert data["targets"]
    assert not [gap for gap in data["gaps"] if gap["status"] == "failed"]
    printed = capsys.readouterr().out
    assert printed.index("| target") < printed.index("**sleeve on a fixed shaft**")
    assert main.main(["bench", "kernel", "--quick", "-o", str(output)]) == main.USAGE_ERROR


def test_quick_orders_are_those_of_the_methods(capsys: pytest.CaptureFixture[str]) -> None:
    found = orders.measure(QUICK)
    assert found.value("slide_and_spin", "impulse", "order: stop time") > 1.8
    assert found.value("slide_and_spin", "impulse", "order: distance") > 1.8
    assert found.value("slide_and_spin", "impulse", kernel.STEP) > 0.0
    printed = report.orders(found)
    assert "impulse" in printed.splitlines()[0]
    assert "order 2" in printed


def test_absent_peers_are_said_to_be_absent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(AbsentError, match=r"\.\[bench\]"):
        MujocoScene(bundled("demo"))
    found = whole_motion.two_free_bodies(QUICK)
    assert ("MuJoCo RK4", "absent") in {(gap.contestant, gap.status) for gap in found.gaps}
    assert found.targets[0].met is None


def test_what_cannot_be_measured_fails_the_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(_: Settings) -> Findings:
        raise RuntimeError("out of order")

    def missing(_: Settings) -> Findings:
        return Findings(targets=[Target("fast", 2.0, 1.0, "us")])

    monkeypatch.setitem(BENCHES, "kernel", lambda: Bench((("one", missing), ("two", broken))))
    assert main.main(["bench", "kernel"]) == 1
    seen = capsys.readouterr()
    assert "MISSED" in seen.out, "the other part is not lost"
    assert "RuntimeError: out of order" in seen.err
    monkeypatch.setitem(BENCHES, "kernel", lambda: Bench((("one", missing),)))
    assert main.main(["bench", "kernel"]) == 0
    assert main.main(["bench", "kernel", "--strict"]) == 1


def test_a_page_is_checked_before_the_work_and_written_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(BENCHES, "kernel", lambda: Bench((("one", lambda _: Findings()),)))
    page = tmp_path / "page.md"
    for there in (None, "no place for results"):
        if there is not None:
            page.write_text(there)
        assert main.main(["bench", "kernel", "--document", str(page)]) == main.USAGE_ERROR
        assert "page.md" in capsys.readouterr().err
    page.write_text("<!-- cylconn bench kernel -->\n<!-- end -->\n")
    assert main.main(["bench", "kernel", "--document", str(page)]) == 0
    assert "processor" in page.read_text()


def test_sources_that_change_meanwhile_spoil_the_results(monkeypatch: pytest.MonkeyPatch) -> None:
    from cylconn_ros.bench.common import machine

    def edit(_: Settings) -> Findings:
        monkeypatch.setattr(machine, "sources", lambda: "others")
        return Findings()

    monkeypatch.setitem(BENCHES, "kernel", lambda: Bench((("one", edit),)))
    assert main.main(["bench", "kernel"]) == 1


def test_a_worker_that_dies_says_its_last_words(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="no_such_scene"):
        worker.Worker(tmp_path / "no_such_scene.yaml", tmp_path / "samples.npy", {})


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(["kernel", "-o", "results.txt"], ".json"), (["everything"], "invalid choice")],
)
def test_wrong_use_is_refused(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code: Any
    try:
        code = main.main(["bench", *arguments])
    except SystemExit as end:
        code = end.code
    assert code == main.USAGE_ERROR
    assert words in capsys.readouterr().err


def test_quick_nodes_are_asked_in_turns() -> None:
    found = measure.measure(QUICK, private_environment())
    problems = {m.problem for m in found.measurements}
    assert problems == {"at 500 samples/s", "closed loop", "at 2000 samples/s"}
    for contestant in (measure.OURS, measure.RECORDING, measure.PLAIN, measure.BARE):
        assert found.value("closed loop", contestant, "lost") == 0.0
        for quantity in ("delay", "CPU time a step", "steps/s"):
            value = found.value("closed loop", contestant, quantity)
            assert 0.0 < value < math.inf, (contestant, quantity)
    assert len(found.targets) == 9
    assert all(target.met is not None for target in found.targets)


def test_a_node_that_dies_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    commands = measure._commands

    def with_a_typing_error(folder: Path) -> dict[str, list[str]]:
        return {**commands(folder), measure.BARE: ["cylconn_ros.no_such_module"]}

    monkeypatch.setattr(measure, "_commands", with_a_typing_error)
    with pytest.raises(RuntimeError, match="bare forwarder ended too early"):
        measure.measure(QUICK, private_environment())
