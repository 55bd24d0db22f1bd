"""The short forms of `cylconn bench faults` and `cylconn bench soak`, with real processes."""

import dataclasses
import json

import numpy as np
import pytest
from pipelines import Loop, make
from scenes import bundled
from test_diagnostics import reported

from cylconn_ros.bench.common.results import Findings, Target
from cylconn_ros.bench.faults import measure, sweep
from cylconn_ros.bench.stability.channel import Channel, Faults, opening
from cylconn_ros.cli import main
from cylconn_ros.laws.runs import _keys
from cylconn_ros.ros.connector.diagnostics import Links, Monitor


def test_quick_faults_are_met(tmp_path, capsys):
    file = tmp_path / "faults.json"
    assert main.main(["bench", "faults", "--quick", "-o", str(file)]) == 0
    found = json.loads(file.read_text())
    rows = [m for m in found["measurements"] if m["problem"] == measure.PROCESSES]
    met = {m["contestant"]: m for m in rows if m["quantity"] == measure.MET}
    assert len(met) > 20
    wrong = {name: (m["settings"]["wrong"], m["note"]) for name, m in met.items() if not m["value"]}
    assert wrong == {}
    targets = {t["name"]: t["value"] for t in found["targets"]}
    assert targets["wrenches published that are not finite"] == 0
    assert targets["latency told: constraint or energy not bounded"] == 0
    text = capsys.readouterr().out
    assert "| flood: ten times the rate" in text
    told = next(line for line in text.splitlines() if line.startswith("| 2 late "))
    assert told.count("3 of 3") >= 2  # told and measured
    assert "| 0 of 3 " in told  # not told


def test_quick_soak_is_met(tmp_path):
    file = tmp_path / "soak.json"
    assert main.main(["bench", "soak", "--samples", "8000", "-o", str(file)]) == 0
    found = json.loads(file.read_text())
    missed = [t for t in found["targets"] if not t["met"] and not t["name"].startswith("memory")]
    assert missed == []
    numbers = {m["quantity"]: m["value"] for m in found["measurements"]}
    assert numbers["simulators started anew"] == 3


def outcome(**changes):
    fine = {"offset": 1e-6, "angle": 1e-6, "energy": 0.1, "end": 0.0, "passivity": 0.0}
    return sweep.Outcome(**({"finite": True} | fine | changes))


@pytest.mark.parametrize(
    "change",
    [{"finite": False}, {"offset": 2e-3}, {"angle": 0.02}, {"energy": 1.5}, {"end": 0.1},
     {"offset": float("nan")}],
)  # fmt: skip
def test_what_is_not_bounded_is_a_missed_target(change):
    cells = {
        ("2 late", "demo", sweep.TOLD, 7): outcome(),
        ("2 late", "coast", sweep.TOLD, 7): outcome(**change),
        ("2 late", "coast", sweep.TOLD, 1): outcome(**change),
    }
    found = measure._of_cells(cells)
    missed = [target for target in found.targets if target.met is False]
    assert [target.name for target in missed] == ["latency told: constraint or energy not bounded"]
    assert missed[0].note == "of 3 runs: 2 late (coast, 2 seeds)"


@pytest.mark.parametrize("name", ["three_answers", "incline_stick", "coast"])
@pytest.mark.parametrize("latency", [5, -1])
def test_many_samples_late_at_uneven_periods(name, latency):
    """Removing all of an error at once, five samples ahead, is not stable where periods differ."""
    prompt = sweep.Prompt(dataclasses.replace(bundled(name), method="auto"))
    for seed in (1, 2):
        found = sweep.outcome(prompt, Faults(late=5, jitter=0.3, seed=seed), latency)
        assert found.bounded
        assert found.passive


def test_when_the_first_answer_acts_and_for_how_long():
    assert opening(Faults(), 20) == (0, 1)
    assert opening(Faults(late=3), 20) == (3, 1)
    way = Channel(Faults(drop=0.4, seed=5), [])
    got = []
    for k in range(20):
        if way.deliver(k, k, np.zeros(38)):
            got.append(k)
        way.stretch()
    assert opening(Faults(drop=0.4, seed=5), 20) == (got[0], int(np.diff(got).max()))
    assert np.diff(got).max() > 1


def test_a_row_that_is_not_as_expected_is_a_missed_target():
    row = {"fault": "fire", "expected": "water", "seen": ["smoke"], "wrong": ["burnt"],
           "numbers": {"not finite": 2.0}}  # fmt: skip
    found: Findings = measure._of_rows([row])
    assert found.targets == [
        Target("faults of real processes, not as expected", 1, 0.0, "", "of 1: fire"),
        Target("wrenches published that are not finite", 2.0, 0.0, ""),
    ]


def test_stamps_that_go_back_begin_a_history_and_a_zero_wrench_does_not():
    stamps = np.array([0, 10, 20, 21, 20, 30, 0, 10], dtype=np.int64)
    histories = [history for history, _ in _keys(stamps)]
    assert histories == [0, 0, 0, 0, 0, 0, 1, 1]


def test_diagnostics_say_what_is_scaled_down_and_how_late_wrenches_act():
    loop = Loop(make(limits__force=1.0, latency=2))
    for _ in range(10):
        loop.step()
    monitor = Monitor("connector")
    status = reported(monitor, loop.answering, None, Links(state="active"))[1]
    values = {pair.key: pair.value for pair in status.values}
    assert int(values["saturated"]) > 3
    assert values["latency [samples]"] == "2"
    assert "wrenches are scaled down to the limits" in status.message
    status = reported(monitor, loop.answering, None, Links(state="active"))[1]
    assert "scaled down" not in status.message  # nothing new since
