"""Every form of a recording through every command: the same messages, the same result."""

from __future__ import annotations

from pathlib import Path

import any_bags
import pytest

from cylconn_ros.cli.main import main
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.run import read_run
from cylconn_ros.scene.resources import shipped

SCENE = str(shipped("slide_and_spin"))


@pytest.mark.parametrize("form", any_bags.FORMS)
def test_every_command_reads_every_form(
    form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    named = [str(path) for path in any_bags.build(form, tmp_path)]
    rows = [tuple(message) for message in Bag(named).messages() if message.topic in any_bags.TOPICS]
    assert rows == any_bags.motion()
    assert main(["info", *named]) == 0
    out = capsys.readouterr().out
    assert out.count(f"{any_bags.SAMPLES}  geometry_msgs") == 2
    if form == "schemaless":
        assert "left out    /notes: its messages are json, not cdr" in out
        assert "left out    /raw: it has no schema" in out
    kept = tmp_path / "kept"
    assert main(["replay", *named, "--params", SCENE, "-o", str(kept)]) == 0
    capsys.readouterr()
    state = read_run(kept).state
    assert len(state) == any_bags.SAMPLES
    assert state["displacement"][-1] == pytest.approx(any_bags.END, abs=1e-6)
    assert main(["identify", *named, "--params", SCENE, "--known", "overlap"]) == 0
    assert main(["report", *named]) == 2  # it has no states
    assert "cylconn replay" in capsys.readouterr().err
