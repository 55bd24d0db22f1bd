"""Closed loop from a recorded state: what it starts with, and what other parameters change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scenes import bundled

from cylconn_ros.cli.main import main
from cylconn_ros.recording.run import read_run
from cylconn_ros.replay.closed_loop import recorded_motion, simulate_from

COAST = 0.310641  # m, closed form at mu = 0.2; the way is proportional to 1 / mu


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("loop") / "run"
    assert main(["simulate", "slide_and_spin", "-o", str(path)]) == 0
    return path


def test_without_a_change_it_is_the_recorded_motion(recorded: Path) -> None:
    run, scene = read_run(recorded), bundled("slide_and_spin")
    motion = recorded_motion(run, scene)
    again = simulate_from(scene, motion)
    np.testing.assert_array_equal(again.states, motion.samples.samples[:, :26])


def test_other_friction_changes_the_motion(
    recorded: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Replay keeps the recorded motion and says so; the closed loop follows the closed form."""
    change = ["--set", "friction.coefficient=0.3"]
    assert main(["replay", str(recorded), *change, "-o", str(tmp_path / "same")]) == 0
    assert "computes the wrench for the recorded motion" in capsys.readouterr().out
    assert read_run(tmp_path / "same").state["displacement"][-1] == pytest.approx(COAST, abs=1e-6)
    arguments = ["replay", str(recorded), *change, "--closed-loop", "-o", str(tmp_path / "other")]
    assert main(arguments) == 0
    printed = capsys.readouterr()
    assert "slide at the end" in printed.out
    assert "preparing" in printed.err or "reading" in printed.err
    expected = COAST * 0.2 / 0.3
    state = read_run(tmp_path / "other").state
    assert state["displacement"][-1] == pytest.approx(expected, abs=1e-6)
    assert f"{expected:.5f}" in printed.out
    assert main(["simulate", "slide_and_spin", *change]) == 0
    out = capsys.readouterr().out
    assert "unchanged" in out
    assert f"{expected:.5f}" in out


def test_recorded_loads_act(tmp_path: Path) -> None:
    """A motion under a load: the loop with the recorded load repeats it."""
    path = tmp_path / "run"
    assert main(["simulate", "incline", "--duration", "0.2", "-o", str(path)]) == 0
    scene = bundled("incline")
    motion = recorded_motion(read_run(path), scene)
    again = simulate_from(scene, motion)
    np.testing.assert_allclose(again.states, motion.samples.samples[:, :26], atol=1e-12)


@pytest.mark.parametrize("value", ["friction.mu=1", "friction.coefficient", "period=[", "x=1"])
def test_wrong_changes_are_refused(value: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "coast", "--set", value]) == 2
    assert "--set" in capsys.readouterr().err
