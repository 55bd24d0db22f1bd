"""The command that compiles the physics: what it compiles is loaded by the programs."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from cylconn_ros.bench.identification import joints, sensors
from cylconn_ros.cli import compile as command
from cylconn_ros.cli import main, node_pair
from cylconn_ros.cli.progress import Progress
from cylconn_ros.core.jit import CACHE_DIRECTORY, COMPILED, is_ready
from cylconn_ros.identification.friction import estimate_friction
from cylconn_ros.identification.likelihood import search_kernel
from cylconn_ros.methods import dispatch
from cylconn_ros.methods.traits import LIVE
from cylconn_ros.scene.packing import choose_method


def cylconn(*arguments: str, **environment: str) -> tuple[str, str]:
    """Standard output and standard error of a command."""
    done = subprocess.run(
        [sys.executable, "-m", "cylconn_ros.cli.main", *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def test_the_command_compiles_what_a_scene_needs(tmp_path: Path) -> None:
    """With progress; a second call finds everything in the cache."""
    assert main.main(["compile", "demo"]) == 0
    assert is_ready(dispatch.STEPS["impulse"])
    directory = tmp_path / Path(CACHE_DIRECTORY).name
    shutil.copytree(CACHE_DIRECTORY, directory)
    (step,) = directory.glob("batch.step-*")
    step.unlink()
    cache = {"CYLCONN_CACHE_DIR": str(tmp_path)}
    out, err = cylconn("compile", "demo", **cache)
    assert "functions compiled in" in out
    assert not out.startswith("0 ")
    assert str(directory) in out
    assert err.splitlines()[0].startswith("compiling: the physics is compiled once")
    assert err.splitlines()[-1] == "compiling: 100%"
    assert step.exists()
    out, err = cylconn("compile", "demo", **cache)
    assert out.startswith("0 functions compiled")
    assert err == ""


def test_without_a_scene_every_method_is_compiled() -> None:
    scenes = command.every_method()
    assert [choose_method(scene) for scene in scenes.values()] == list(LIVE)


def test_what_is_compiled_for_identify_is_what_a_fit_needs() -> None:
    if not COMPILED:
        pytest.skip("no compiler is installed")
    command._compile_identification()
    search: Any = search_kernel.search
    compiled = len(search.signatures)
    samples = sensors.measured(joints.motion("Coulomb"), "white", 0)
    assert estimate_friction(joints.scene(), samples).accepted
    assert len(search.signatures) == compiled


def test_without_the_compiler_the_command_says_so() -> None:
    assert "nothing is compiled" in cylconn("compile", CYLCONN_NO_COMPILER="1")[0]


def test_the_demo_waits_while_the_connector_compiles(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each sign of progress begins the time limit anew; the line stays in the output."""
    now = [0.0]
    monkeypatch.setattr(node_pair.time, "monotonic", lambda: now[0])
    with Progress("demo") as bar:
        monitor = node_pair.PlantMonitor(bar, 10)
        first = monitor.deadline
        now[0] = 100.0
        assert not monitor.watch_connector("[INFO] model")
        assert monitor.deadline == first
        assert not monitor.watch_connector("[INFO] compiling the physics: 20 of 218 functions")
        assert monitor.deadline == first + 100.0
    assert "compiles the physics" in capsys.readouterr().err
