"""The command that runs a MuJoCo model, a connector and a recording as two processes."""

import math
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from paths import ROOT
from ros_processes import Program, program

import cylconn_ros as cr
from cylconn_ros.mujoco.motion import Motion
from cylconn_ros.mujoco.plant import MujocoPlant
from cylconn_ros.recording.table import STAMP

COMMAND = [
    sys.executable, "-m", "cylconn_ros.cli.main", "mujoco", "drawer_arm", "--joint", "drawer",
    "--coefficient", "0.3", "--radius", "0.01", "--overlap", "0.1",
]  # fmt: skip
ARM = ROOT / "models" / "drawer_arm.xml"


def finished(folder: Path, *arguments: str) -> Program:
    with program([*COMMAND, *arguments, "-o", folder / "run"], folder) as run:
        assert run.wait() == 0, run.output
    return run


def recorded_lengths(folder: Path) -> np.ndarray:
    (recording,) = (folder / "run").glob("connector_*")
    state = cr.read_run(recording).state
    stamps = state[STAMP[0]] * 10**9 + state[STAMP[1]].astype(np.int64)
    _, first = np.unique(stamps, return_index=True)  # the first sample may be sent again
    return np.asarray(state["length"])[first]


@pytest.mark.parametrize("constraint", ["connector", "simulator"])
def test_in_lock_step_the_motion_is_that_of_one_process(tmp_path: Path, constraint: str) -> None:
    """The same numbers as model and connector in a loop, with contacts, bit for bit."""
    run = finished(tmp_path, "--constraint", constraint, "--duration", "0.6")
    assert "600 steps" in run.output
    scene = cr.load(tmp_path / "run" / "scene.yaml")
    plant, connector = MujocoPlant(scene, ARM, ["drawer"]), cr.Connector(scene)
    motion, length = Motion(ARM.with_suffix(".csv")), []
    for _ in range(600):
        plant.command(motion.at(plant.time_ns * 1e-9))
        load, state = plant.load(1), plant.state
        answer = connector.step(pose_b=state[13:20], twist_b=state[20:26], load_b=load)
        length.append(answer["length"])
        plant.step(np.zeros(6), np.concatenate([answer.force_b, answer.torque_b]))
    recorded = recorded_lengths(tmp_path)
    assert length[-1] > 0.02
    np.testing.assert_array_equal(recorded[:600], length)


def test_free_running_with_a_clock(tmp_path: Path) -> None:
    run = finished(tmp_path, "--duration", "1.5", "--real-time-factor", "0.5")
    assert "simulated in" in run.output
    assert recorded_lengths(tmp_path)[-1] == pytest.approx(0.1685, abs=0.02)


def test_without_a_duration_it_runs_until_it_is_interrupted(tmp_path: Path) -> None:
    with program([*COMMAND, "-o", tmp_path / "run"], tmp_path) as run:
        run.wait_for("slide 0.")
        assert run.stop(signal.SIGINT) == 0
    assert len(recorded_lengths(tmp_path)) > 1
    assert math.isinf(cr.load(tmp_path / "run" / "scene.yaml").plant.duration)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--joint", "lid"], "joint lid: not in the model; it has drawer, shoulder, elbow"),
        (["--scene", "demo"], "--coefficient: is for an imported scene"),
        (["--set", "friction.radius=-1"], "friction.radius = -1"),
        (["--motion", "none.csv"], "none.csv: cannot be read"),
        (["--view", "--duration", "1"], "there is no display"),
    ],
)
def test_what_cannot_be_run(
    tmp_path: Path, arguments: list[str], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with program([*COMMAND, *arguments], tmp_path) as run:
        assert run.wait() in (1, 2)
    assert said in run.output
    assert "Traceback" not in run.output
