"""Exit codes of recordings of which nothing is usable, and of motions that leave the joint."""

from __future__ import annotations

from pathlib import Path

import any_bags
import pytest
import yaml

from cylconn_ros.cli.main import main
from cylconn_ros.scene.resources import shipped

WORDS = {
    "quaternions": ("all 700 were refused", "all 700 were refused"),
    "stamps": ("all stamps are equal", "1 complete samples"),
    "twists": ("no sample was complete", "0 complete samples"),
    "geometry": ("the motion leaves the joint", "the motion leaves the joint"),
}


def build(fault: str, folder: Path) -> list[str]:
    """A recording with the fault, and its parameters, as arguments of a command."""
    quaternion = {"quaternions": 0.0, "norm": 1.02}.get(fault, 1.0)
    rows = any_bags.motion(quaternion, same_stamp=fault == "stamps")
    if fault == "twists":
        rows = [row for row in rows if not row[0].endswith("twist")][:20] + rows[-1:]
    scene = yaml.safe_load(shipped("slide_and_spin").read_text())
    if fault == "geometry":  # the slot across the motion
        half = 0.5**0.5
        scene["/**"]["ros__parameters"]["node_a"]["orientation"] = [0.0, 0.0, half, half]
    parameters = folder / "scene.yaml"
    parameters.write_text(yaml.safe_dump(scene))
    return [str(any_bags.mcap(folder / "bag.mcap", rows)), "--params", str(parameters)]


@pytest.mark.parametrize("fault", WORDS)
@pytest.mark.parametrize("command", ["replay", "identify"])
def test_nothing_usable_is_exit_code_1_and_said(
    fault: str, command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, *build(fault, tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert WORDS[fault][command == "identify"] in out + err
    assert "bag.mcap" in out + err or "replay bag" in out + err


def test_a_replay_of_it_is_named_by_info_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = tmp_path / "kept"
    assert main(["replay", *build("geometry", tmp_path), "-o", str(kept)]) == 1
    capsys.readouterr()
    assert main(["info", str(kept)]) == 1
    assert "NOT USABLE  the motion leaves the joint" in capsys.readouterr().out


def test_quaternions_of_another_norm_are_counted_and_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", *build("norm", tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert "quaternion with a norm of 1.02: 700 samples" in out + err
