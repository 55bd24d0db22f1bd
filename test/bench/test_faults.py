"""Fault injection and soak benchmarks: their short forms with real processes, and their parts."""

import dataclasses
import json

import numpy as np
import pytest
from pipelines import Loop, make
from ros_processes import reported
from scenes import bundled

from cylconn_ros.bench.common.results import Findings, Target
from cylconn_ros.bench.faults import measure, sweep
from cylconn_ros.bench.stability.channel import Channel, Faults, first_response
from cylconn_ros.cli import main
from cylconn_ros.laws.runs import sample_keys
from cylconn_ros.ros.connector.diagnostics import ConnectionStatus, Monitor


def test_quick_fault_injection_meets_expectations(tmp_path, capsys):
    file = tmp_path / "faults.json"
    assert main.main(["bench", "faults", "--quick", "-o", str(file)]) == 0
    found = json.loads(file.read_text())
    cases = [m for m in found["measurements"] if m["case"] == measure.PROCESSES]
    met = {m["subject"]: m for m in cases if m["quantity"] == measure.MET}
    assert len(met) > 20
    failed = {n: (m["settings"]["failures"], m["note"]) for n, m in met.items() if not m["value"]}
    assert failed == {}
    targets = {t["name"]: t["value"] for t in found["targets"]}
    assert targets["wrenches published that are not finite"] == 0
    assert targets["latency set: constraint or energy not bounded"] == 0
    text = capsys.readouterr().out
    assert "| flood: ten times the rate" in text
    late = next(line for line in text.splitlines() if line.startswith("| 2 late "))
    assert late.count("3 of 3") >= 2  # latency set and measured
    assert "| 0 of 3 " in late  # latency not set


def test_quick_soak_meets_targets(tmp_path):
    file = tmp_path / "soak.json"
    assert main.main(["bench", "soak", "--samples", "8000", "-o", str(file)]) == 0
    found = json.loads(file.read_text())
    missed = [t for t in found["targets"] if not t["met"] and not t["name"].startswith("memory")]
    assert missed == []
    numbers = {m["quantity"]: m["value"] for m in found["measurements"]}
    assert numbers["restarts of the simulator"] == 3


def outcome(**changes):
    fine = {"offset": 1e-6, "angle": 1e-6, "energy": 0.1, "end": 0.0, "passivity": 0.0}
    return sweep.Outcome(**({"finite": True} | fine | changes))


@pytest.mark.parametrize(
    "change",
    [{"finite": False}, {"offset": 2e-3}, {"angle": 0.02}, {"energy": 1.5}, {"end": 0.1},
     {"offset": float("nan")}],
)  # fmt: skip
def test_an_unbounded_run_misses_the_target(change):
    cells = {
        ("2 late", "demo", sweep.SET, 7): outcome(),
        ("2 late", "coast", sweep.SET, 7): outcome(**change),
        ("2 late", "coast", sweep.SET, 1): outcome(**change),
    }
    found = measure._of_cells(cells)
    missed = [target for target in found.targets if target.met is False]
    assert [target.name for target in missed] == ["latency set: constraint or energy not bounded"]
    assert missed[0].note == "of 3 runs: 2 late (coast, 2 seeds)"


@pytest.mark.parametrize("name", ["three_answers", "incline_stick", "coast"])
@pytest.mark.parametrize("latency", [5, -1])
def test_five_samples_late_with_jitter(name, latency):
    """Correcting a whole error at once, five samples ahead, is unstable with irregular periods."""
    reference = sweep.FaultFreeRun(dataclasses.replace(bundled(name), method="auto"))
    for seed in (1, 2):
        found = sweep.run_case(reference, Faults(late=5, jitter=0.3, seed=seed), latency)
        assert found.bounded
        assert found.passive


def test_first_response_of_a_channel():
    assert first_response(Faults(), 20) == (0, 1)
    assert first_response(Faults(late=3), 20) == (3, 1)
    channel = Channel(Faults(drop=0.4, seed=5), [])
    arrivals = []
    for k in range(20):
        if channel.deliver(k, k, np.zeros(38)):
            arrivals.append(k)
        channel.period_factor()
    assert first_response(Faults(drop=0.4, seed=5), 20) == (
        arrivals[0],
        int(np.diff(arrivals).max()),
    )
    assert np.diff(arrivals).max() > 1


def test_a_failed_fault_case_misses_the_target():
    case = {"fault": "fire", "expected": "water", "observed": ["smoke"], "failures": ["burnt"],
           "numbers": {"not finite": 2.0}}  # fmt: skip
    found: Findings = measure._of_fault_cases([case])
    assert found.targets == [
        Target("faults of real processes, not as expected", 1, 0.0, "", "of 1: fire"),
        Target("wrenches published that are not finite", 2.0, 0.0, ""),
    ]


def test_earlier_stamps_begin_a_history_but_a_zero_wrench_does_not():
    stamps = np.array([0, 10, 20, 21, 20, 30, 0, 10], dtype=np.int64)
    histories = [history for history, _ in sample_keys(stamps)]
    assert histories == [0, 0, 0, 0, 0, 0, 1, 1]


def test_diagnostics_report_scaled_wrenches_and_latency():
    loop = Loop(make(limits__force=1e-3, latency=2))
    for _ in range(10):
        loop.step()
    monitor = Monitor("connector")
    status = reported(monitor, loop.pipeline, None, ConnectionStatus(state="active"))[1]
    values = {pair.key: pair.value for pair in status.values}
    assert int(values["saturated"]) > 3
    assert values["latency [samples]"] == "2"
    assert "wrenches are scaled down to the limits" in status.message
    status = reported(monitor, loop.pipeline, None, ConnectionStatus(state="active"))[1]
    assert "scaled down" not in status.message  # none since the last report
