"""Benchmarks: settings of the methods, timing, results, and the quick forms of the commands.

No test depends on a measured time.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import bundled

from cylconn_ros.bench.common import methods, report, sources, timing
from cylconn_ros.bench.common.errors import NotApplicableError
from cylconn_ros.bench.common.results import (
    STEP,
    Findings,
    Measurement,
    NotMeasured,
    Report,
    Target,
)
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.convergence import orders
from cylconn_ros.bench.convergence.cases import convergence_cases
from cylconn_ros.bench.nodes import measure
from cylconn_ros.bench.step_cost import kernel, loop, startup, worker
from cylconn_ros.cli import main
from cylconn_ros.cli.benchmarks import BENCHMARKS, Benchmark
from cylconn_ros.process.child import module_command, private_environment
from cylconn_ros.simulation.simulate import simulate

QUICK = Settings.short(bundled)


# --- settings of the methods ---


def test_every_method_is_stable_with_its_settings() -> None:
    for case in convergence_cases(bundled):
        for method in methods.METHODS:
            scene = methods.with_method(methods.with_period(case.scene, 2e-3), method)
            errors = case.errors(simulate(scene, samples=round(case.duration / 2e-3) + 1))
            sizes = [size for size, _ in errors.values() if not math.isnan(size)]
            assert sizes, (case.name, method)
            assert max(sizes) < orders.DIVERGED, (case.name, method)


def test_effective_inertia_includes_the_lever_arm() -> None:
    """A load at the distance r from the centre of mass accelerates with 1/m + r^2/I."""
    scene = bundled("demo")
    mass, inertia = methods.effective_inertia(scene)
    assert inertia == pytest.approx(1.85e-3, rel=0.02)
    arm = np.subtract(scene.body_b.com, scene.node_b.position)
    assert mass == pytest.approx(1.0 / (1.0 / 2.13 + arm @ arm / inertia))


def test_a_method_that_does_not_support_a_scene_is_an_error() -> None:
    values = {**bundled("demo").parameters(), "body_b.kind": "unknown"}
    scene = type(bundled("demo")).from_parameters(values)
    with pytest.raises(NotApplicableError, match=r"body_b\.kind"):
        methods.with_method(scene, "impulse")


# --- timing and results ---


def test_turns_are_interleaved_and_ratios_formed_within_a_round() -> None:
    calls: list[str] = []
    slowdown = [1.0]

    def block(name: str, cost: float) -> timing.Block:
        def repeat(n: int) -> float:
            calls.append(name)
            slowdown[0] *= 1.01  # a machine that slows down all the time
            return n * cost * slowdown[0]

        return repeat

    blocks = {"a": block("a", 1.0), "b": block("b", 3.0)}
    times = timing.time_interleaved(blocks, 8, 1.0)
    assert calls[-16:-12] == ["a", "b", "b", "a"]
    assert timing.ratio(times["b"], times["a"]).median == pytest.approx(3.0, rel=0.02)
    assert times["a"][-1] > 1.1 * times["a"][0]


def test_a_turn_is_long_enough_for_the_clock() -> None:
    repetitions: list[int] = []

    def block(n: int) -> float:
        repetitions.append(n)
        return n * 1e-6

    timing.time_interleaved({"a": block}, 1, 1e-2)
    assert repetitions[-1] == pytest.approx(1e4, rel=0.3)


def test_every_function_has_one_turn_a_round() -> None:
    count = iter(range(100))
    found = timing.run_interleaved({key: lambda: next(count) for key in "abcdefgh"}, 2)
    assert sorted(value for values in found.values() for value in values) == list(range(16))
    assert [min(values) for values in found.values()] == list(range(8))
    assert found["e"][1] == 8, "the second round starts elsewhere"


def test_orders_are_slopes_over_the_stable_periods() -> None:
    periods = [8e-3, 4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4]
    assert orders.fit_order(periods, [h**2 for h in periods])[0] == pytest.approx(2.0)
    unstable = [math.inf, *(h**2 for h in periods[1:])]
    assert orders.fit_order(periods, unstable)[0] == pytest.approx(2.0)
    assert orders.fit_order(periods, unstable)[1] == "failed at 1 of 6 periods"
    slope, note = orders.fit_order(periods, [1e9, math.nan, *(h**2 for h in periods[2:])])
    assert math.isnan(slope)
    assert note == "failed at 2 of 6 periods"
    assert orders.fit_order(periods, [1e-16] * 6)[1] == "exact"


def test_targets_are_met_missed_or_not_measured() -> None:
    assert Target("a", 1.0, 1.0, "us").met is True
    assert Target("a", 1.1, 1.0, "us").met is False
    assert Target("a", math.nan, 1.0, "us").met is None


def test_results_are_complete_as_json_and_text() -> None:
    found = Findings(
        targets=[Target("fast", math.nan, 1.0, "us")],
        measurements=[Measurement("p", "a|b", "time", 1.5, "us", settings={"rtol": 1e-6})],
        not_measured=[NotMeasured("p", "peer", "not installed", "the reason")],
    )
    whole = Report("cylconn bench kernel", {"rounds": 3}, found)
    data = json.loads(whole.json())
    assert data["targets"][0]["value"] is None
    assert data["targets"][0]["met"] is None
    assert data["measurements"][0]["settings"] == {"rtol": 1e-6}
    assert {"processor", "python", "numpy", "numba", "mujoco"} <= set(data["machine"])
    printed = report.text(whole)
    for text in (
        "not measured",
        "a/b (rtol 1e-06)",
        "1.50 us",
        "not installed",
        "the reason",
        "processor",
    ):
        assert text in printed


def test_results_replace_the_old_ones_in_a_page() -> None:
    page = "a\n<!-- cylconn bench kernel -->\nold\n<!-- end -->\nb\n<!-- cylconn bench orders -->\n"
    new = report.replace_results(page, "cylconn bench kernel", "| new \\1 |\n")
    assert "old" not in new
    assert "<!-- cylconn bench kernel -->\n\n| new \\1 |\n\n<!-- end -->\nb\n" in new
    assert report.replace_results(new, "cylconn bench kernel", "| new \\1 |\n") == new
    with pytest.raises(ValueError, match="<!-- cylconn bench orders -->"):  # has no end
        report.replace_results(page, "cylconn bench orders", "")


# --- the commands ---


def test_quick_kernel_is_complete(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "kernel.json"
    assert main.main(["bench", "kernel", "--quick", "-o", str(output)]) == 0
    data = json.loads(output.read_text())
    assert data["settings"]["quick"] is True
    measured = {(m["case"], m["subject"], m["quantity"]): m for m in data["measurements"]}
    for subject in (
        "impulse, in a batch",
        "impulse, a call from Python",
        "impulse, plain Python, a call from Python",
        "penalty, in a batch",
        "MuJoCo mj_step Euler, a call from Python",
    ):
        m = measured[kernel.SHAFT, subject, STEP]
        assert m["value"] > 0.0
        assert m["low"] <= m["value"] <= m["high"]
        assert m["count"] == QUICK.rounds
    for name in (kernel.SHAFT, kernel.PAIR):
        case = f"{loop.LOOP}, {name}"
        for part in (loop.LOOP, loop.CONNECTOR, loop.PLANT, loop.ROLLOUT):
            assert measured[case, part, STEP]["value"] > 0.0
        for quantity in (loop.OVER_PARTS, loop.OVER_ROLLOUT):
            assert measured[case, loop.LOOP, quantity]["count"] == QUICK.rounds
        assert measured[case, loop.THREADS, loop.OVER_ONE]["value"] > 0.0
    assert measured[startup.CASE, startup.WARM, startup.WALL]["value"] > 0.0
    assert data["targets"]
    assert not [one for one in data["not_measured"] if one["status"] == "failed"]
    printed = capsys.readouterr().out
    assert printed.index("| target") < printed.index("**sleeve on a fixed shaft**")
    assert main.main(["bench", "kernel", "--quick", "-o", str(output)]) == main.USAGE_ERROR


def test_quick_orders_are_those_of_the_methods() -> None:
    found = orders.measure(QUICK)
    assert found.value("slide_and_spin", "impulse", "order: stop time") > 1.8
    assert found.value("slide_and_spin", "impulse", "order: distance") > 1.8
    assert found.value("slide_and_spin", "impulse", STEP) > 0.0
    printed = orders.text(found)
    assert "impulse" in printed.splitlines()[0]
    assert "order 2" in printed


def test_a_failed_measurement_fails_the_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(_: Settings) -> Findings:
        raise RuntimeError("out of order")

    def missing(_: Settings) -> Findings:
        return Findings(targets=[Target("fast", 2.0, 1.0, "us")])

    monkeypatch.setitem(
        BENCHMARKS, "kernel", lambda: Benchmark((("one", missing), ("two", broken)))
    )
    assert main.main(["bench", "kernel"]) == 1
    seen = capsys.readouterr()
    assert "MISSED" in seen.out, "the results of the other part are kept"
    assert "RuntimeError: out of order" in seen.err
    monkeypatch.setitem(BENCHMARKS, "kernel", lambda: Benchmark((("one", missing),)))
    assert main.main(["bench", "kernel"]) == 0
    assert main.main(["bench", "kernel", "--strict"]) == 1


def test_a_page_is_checked_before_measuring_and_written_afterwards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(BENCHMARKS, "kernel", lambda: Benchmark((("one", lambda _: Findings()),)))
    page = tmp_path / "page.md"
    for there in (None, "no place for results"):
        if there is not None:
            page.write_text(there)
        assert main.main(["bench", "kernel", "--document", str(page)]) == main.USAGE_ERROR
        assert "page.md" in capsys.readouterr().err
    page.write_text("<!-- cylconn bench kernel -->\n<!-- end -->\n")
    assert main.main(["bench", "kernel", "--document", str(page)]) == 0
    assert "processor" in page.read_text()


def test_sources_that_change_during_a_benchmark_fail_the_command(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def edit(_: Settings) -> Findings:
        monkeypatch.setattr(sources, "measured", lambda: "others")
        return Findings()

    monkeypatch.setitem(BENCHMARKS, "kernel", lambda: Benchmark((("one", edit),)))
    assert main.main(["bench", "kernel"]) == 1


def test_the_error_of_a_worker_that_ends_early_has_its_last_line(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="no_such_scene"):
        worker.Worker(tmp_path / "no_such_scene.yaml", tmp_path / "samples.npy", {})


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(["kernel", "-o", "results.txt"], ".json"), (["everything"], "invalid choice")],
)
def test_wrong_usage_is_refused(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code: Any
    try:
        code = main.main(["bench", *arguments])
    except SystemExit as end:
        code = end.code
    assert code == main.USAGE_ERROR
    assert words in capsys.readouterr().err


def test_quick_node_benchmark_is_complete() -> None:
    found = measure.measure(QUICK, private_environment())
    cases = {m.case for m in found.measurements}
    assert cases == {"at 500 samples/s", "closed loop", "at 2000 samples/s"}
    for node in (measure.CONNECTOR, measure.RECORDING, measure.RCLPY, measure.FORWARDER):
        assert found.value("closed loop", node, "lost") == 0.0
        for quantity in ("delay", "CPU time a step", "steps/s"):
            value = found.value("closed loop", node, quantity)
            assert 0.0 < value < math.inf, (node, quantity)
    assert len(found.targets) == 9
    assert all(target.met is not None for target in found.targets)


def test_the_error_of_a_node_that_ends_early_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    commands = measure._commands

    def with_a_missing_module(folder: Path) -> dict[str, list[str]]:
        return {**commands(folder), measure.FORWARDER: module_command("cylconn_ros.no_such_module")}

    monkeypatch.setattr(measure, "_commands", with_a_missing_module)
    with pytest.raises(RuntimeError, match="bare forwarder ended early"):
        measure.measure(QUICK, private_environment())
