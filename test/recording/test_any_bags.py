"""Every form of a recording through every command: the same messages, the same result."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import any_bags
import pytest
from mcap.writer import Writer

from cylconn_ros.cli.main import main
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.files import definitions
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


def test_a_run_that_rosbag2_recorded_goes_through_every_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    assert main(["simulate", "slide_and_spin", "--duration", "0.3", "-o", str(run)]) == 0
    bag = str(any_bags.as_recorded_by_rosbag2(tmp_path / "bag", run, "message"))
    assert main(["replay", bag, "--params", SCENE, "--compare"]) == 0
    assert "outputs identical" in capsys.readouterr().out
    assert main(["report", bag, "-o", str(tmp_path / "page.html")]) == 0
    assert main(["info", bag, "--csv", str(tmp_path / "states.csv")]) == 0
    assert main(["identify", bag, "--params", SCENE, "--known", "overlap"]) == 0
    capsys.readouterr()
    assert main(["laws", "--run", bag]) == 2
    assert "give --params FILE" in capsys.readouterr().err
    assert main(["laws", "--run", bag, "--params", SCENE]) == 0
    assert "all laws hold" in capsys.readouterr().out
    late = str(any_bags.as_recorded_by_rosbag2(tmp_path / "late", run, "file", skip=20))
    assert main(["laws", "--run", late, "--params", SCENE]) == 1
    assert "the recording begins after the reference" in capsys.readouterr().out
    assert main(["salvage", bag, "-o", str(tmp_path / "salvaged")]) == 2
    assert "is complete" in capsys.readouterr().err
    empty = any_bags.as_recorded_by_rosbag2(tmp_path / "empty", run, "message", outputs=False)
    assert main(["replay", str(empty), "--params", SCENE, "--compare"]) == 1
    assert "NOTHING COMPARED" in capsys.readouterr().out
    assert main(["info", str(empty)]) == 0
    assert "next: cylconn replay" in capsys.readouterr().out


@pytest.mark.parametrize("absent", [False, True])
def test_a_definition_in_idl_is_read_with_rosbags_or_says_so(
    absent: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if absent:
        for name in [name for name in sys.modules if name.partition(".")[0] == "rosbags"]:
            monkeypatch.delitem(sys.modules, name)
        monkeypatch.setattr(sys, "path", [])
        definitions._from_idl.cache_clear()
    text = ""
    for name, body in (
        ("Gap", "their_msgs::msg::Side left; double width;"),
        ("Side", '@verbatim (language="comment", text="of a gap") sequence<double> edge;'),
    ):
        idl = f"module their_msgs {{ module msg {{ struct {name} {{ {body} }}; }}; }};"
        text += f"{'=' * 80}\nIDL: their_msgs/msg/{name}\n{idl}\n"
    path = tmp_path / "idl.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema("their_msgs/msg/Gap", "ros2idl", text.encode())
        channel = writer.register_channel("/gap", "cdr", schema)
        writer.add_message(channel, 5, b"\0\1\0\0" + struct.pack("<IIdd", 1, 0, 0.5, 0.25), 5)
        writer.finish()
    assert main(["info", str(path)]) == 0
    line = (
        "not decoded /gap: its type their_msgs/msg/Gap is not installed here, and its definition in"
        " the recording (ros2idl) is read with: pip install rosbags"
    )
    assert (line in capsys.readouterr().out) == absent
    if not absent:
        table = read_run(path).table("/gap")
        assert table["width"].tolist() == [0.25]
        assert table["left.edge"].tolist() == [[0.5]]
