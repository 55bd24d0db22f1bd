"""A bag of other software through all commands: odometry at uneven rates, written by rosbags."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from odometry_bag import odometry_bag
from rosbags.rosbag2 import StoragePlugin
from scenes import bundled

from cylconn_ros.cli.main import main
from cylconn_ros.recording.run import read_run
from cylconn_ros.scene.parameter_file import dump

REMAP = ["--remap", "body_b/odom:=/robot/sleeve"]
STEPS = 3000


@pytest.fixture(scope="module", params=[StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("foreign")
    scene = dump(bundled("demo")).replace("input: pose_twist", "input: odometry")
    (path / "scene.yaml").write_text(scene)
    odometry_bag(path / "bag", uneven=True, steps=STEPS, storage=request.param)
    return path


def call(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    code = main(list(map(str, arguments)))
    printed = capsys.readouterr()
    return code, printed.out, printed.err


def test_commands_on_the_bag_state_what_it_lacks(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every command that fails states the remedy."""
    code, out, _ = call(capsys, "info", bag / "bag")
    assert code == 0
    assert "nav_msgs/msg/Odometry" in out
    assert "no state was recorded" in out
    for command, advice in (
        ("report", "-o RUN computes them from recorded inputs"),
        ("replay", "give --params FILE"),
        ("identify", "with --params FILE"),
    ):
        code, _, err = call(capsys, command, bag / "bag")
        assert code == 2
        assert advice in err
    given = ("--params", bag / "scene.yaml")
    code, _, err = call(capsys, "replay", bag / "bag", *given)
    assert code == 2
    assert "/robot/sleeve (nav_msgs/msg/Odometry)" in err
    code, _, err = call(capsys, "replay", bag / "bag", *given, *REMAP, "--compare")
    assert code == 2
    assert "holds no outputs to compare with" in err


def test_the_replayed_bag_is_a_run(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ("--params", bag / "scene.yaml", *REMAP)
    code, out, err = call(capsys, "replay", bag / "bag", *given, "-o", bag / "run")
    assert code == 0
    assert "not one period apart" in out
    assert "replay bag: 100%" in err, "progress"
    samples = read_run(bag / "run").counts["/connector/state"]
    assert 0.85 * STEPS < samples < 0.95 * STEPS
    code, out, _ = call(capsys, "replay", bag / "run", "--compare")
    assert code == 0
    assert f"/connector/state: {samples} compared, identical" in out
    code, out, _ = call(capsys, "info", bag / "run")
    assert code == 0
    assert f"samples     {samples} over" in out
    code, out, _ = call(capsys, "report", bag / "run", "-o", bag / "run.html")
    assert code == 0
    assert f"{samples} samples: every sample" in out


def test_identification_finds_the_friction_parameters(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the bag itself, and in the run replayed from it: the parameters of the demo."""
    friction = bundled("demo").friction
    inputs = [(bag / "bag", "--params", bag / "scene.yaml", *REMAP)]
    if not (bag / "run").exists():
        assert main(["replay", *map(str, inputs[0]), "-o", str(bag / "run")]) == 0
        capsys.readouterr()
    inputs.append((bag / "run",))
    for arguments in inputs:
        code, out, _ = call(capsys, "identify", *arguments, "--json", "-")
        assert code == 0
        found = json.loads(out)["estimates"]
        for name in ("coefficient", "preload", "overlap", "radius"):
            low, high = found[f"friction.{name}"]["interval_95"]
            assert low <= getattr(friction, name) <= high, name
