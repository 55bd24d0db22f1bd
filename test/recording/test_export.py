"""Tables of recorded topics: pandas, CSV and Parquet have the values and names of the messages."""

from __future__ import annotations

import builtins
import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from pyarrow import parquet
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from cylconn_ros.cli.main import main
from cylconn_ros.errors import RecordingError
from cylconn_ros.recording import export
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.recording.run import Run, read_run
from cylconn_ros.recording.writer import RunWriter

POSITIONS: tuple[list[float], ...] = ([0.1], [0.2, 1.0 / 3.0], [], [0.4, np.nan])


@pytest.fixture(scope="module")
def joints(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Joint states whose arrays differ in length, one of them too long for a table."""
    path = tmp_path_factory.mktemp("export") / "joints"
    with RunWriter(path, [TopicInfo("/joints", "sensor_msgs/msg/JointState")], {}) as writer:
        for k, position in enumerate(POSITIONS):
            message = JointState(
                header=Header(stamp=Time(sec=5, nanosec=1_000_000 * k), frame_id="arm, left"),
                name=["a", "b"][: len(position)],
                position=position,
                effort=[0.0] * (export.LONGEST + 1),
            )
            writer.write("/joints", serialize_message(message), k, k)
    return read_run(path)


def test_a_dataframe_has_the_fields_of_the_message(demo_recording: Path) -> None:
    run = read_run(demo_recording)
    frame = run.to_dataframe()
    assert frame.index.name == "time"
    assert frame.index.to_numpy().tolist() == run.state.time.tolist()
    assert frame["normal_force"].tolist() == run.state["normal_force"].tolist()
    assert frame["force[1]"].tolist() == run.state["force"][:, 1].tolist()
    assert set(frame["method"]) == {"impulse"}
    pose = run.to_dataframe(run.topic("body_b/pose"))
    assert pose["pose.position.x"].tolist() == run.table("/body_b/pose")["pose.position.x"].tolist()


def test_arrays_of_different_lengths_have_empty_cells(joints: Run) -> None:
    frame = joints.to_dataframe("/joints")
    assert frame.index.tolist() == pytest.approx([0.0, 1e-3, 2e-3, 3e-3])
    np.testing.assert_array_equal(frame["position[0]"], [0.1, 0.2, np.nan, 0.4])
    assert frame["name[1]"].isna().tolist() == [True, False, True, False]
    assert not [name for name in frame if "effort" in name]
    assert export.layout_of(joints.read_blocks("/joints")).left_out == ["effort"]


def test_csv_and_parquet_hold_every_digit(
    demo_recording: Path, joints: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = {"--csv": tmp_path / "s.csv", "--parquet": tmp_path / "s.parquet"}
    arguments = [text for option, path in files.items() for text in (option, str(path))]
    assert main(["info", str(demo_recording), *arguments]) == 0
    printed = capsys.readouterr().out
    assert f"written     {files['--csv']}  (4001 rows, " in printed
    state = read_run(demo_recording).state
    expected = export.layout_of([state]).cells(state)
    head, *rows = csv.reader(files["--csv"].read_text().splitlines())
    table = parquet.read_table(files["--parquet"])
    assert head == list(expected) == table.column_names
    for (name, values), texts in zip(expected.items(), zip(*rows, strict=True), strict=True):
        written = table[name].to_numpy()
        assert written.dtype == values.dtype
        np.testing.assert_array_equal(written, values, name)
        as_text = [str(value) for value in values.tolist()]
        assert list(texts) == as_text  # a float's text is the shortest that gives its bits

    for file in files.values():
        file.unlink()
    arguments = ["--topic", "joints", *arguments]
    assert main(["info", str(joints.path.parent), *arguments]) == 0
    assert "left out    effort: more than 64 values" in capsys.readouterr().out
    head, *rows = csv.reader(files["--csv"].read_text().splitlines())
    cells = [dict(zip(head, row, strict=True)) for row in rows]
    assert [cell["position[1]"] for cell in cells] == ["nan", "0.3333333333333333", "nan", "nan"]
    assert [cell["name[0]"] for cell in cells] == ["a", "a", "", "a"]
    assert cells[0]["header.frame_id"] == "arm, left"
    names = parquet.read_table(files["--parquet"])["name[1]"].to_pylist()
    assert names == [None, "b", None, "b"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--topic", "joints"], "--topic names the topic to write"),
        (["--csv", "no/such/folder.csv", "--topic", "joints"], "no/such/folder.csv: No such file"),
        (["--parquet", "no/such/folder.pq", "--topic", "joints"], "no/such/folder.pq: "),
        (["--csv", __file__, "--topic", "joints"], f"{__file__}: File exists"),
        (["--csv", "x.csv", "--topic", "nowhere"], "no single topic nowhere"),
        (["--csv", "x.csv"], "expected one topic of cylconn_ros/msg/ConnectorState"),
    ],
)
def test_what_cannot_be_written_is_one_sentence(
    joints: Run, arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(joints.path.parent), *arguments]) == 2
    assert sentence in capsys.readouterr().err


def test_a_missing_library_is_named_with_the_remedy(
    joints: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    genuine = builtins.__import__

    def absent(name: str, *rest: Any, **more: Any) -> Any:
        if name in ("pandas", "pyarrow"):
            raise ImportError(name)
        return genuine(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", absent)
    with pytest.raises(RecordingError, match="pip install pandas"):
        joints.to_dataframe("/joints")
    with pytest.raises(RecordingError, match="pip install pyarrow"):
        export.write_parquet(lambda: joints.read_blocks("/joints"), tmp_path / "x.parquet")


def test_accelerations_are_written_on_request(
    demo_recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The columns are those of the state table, across the blocks of the file."""
    target = tmp_path / "s.csv"
    assert main(["info", str(demo_recording), "--acceleration", "--csv", str(target)]) == 0
    capsys.readouterr()
    head, *rows = csv.reader(target.read_text().splitlines())
    state = read_run(demo_recording).state
    speed, step = state["velocity"][:, 0], np.diff(state.stamp) * 1e-9
    written = np.array([float(row[head.index("acceleration")]) for row in rows])
    np.testing.assert_allclose(written[:-1], np.diff(speed) / step, rtol=1e-12, atol=1e-12)
    assert np.isnan(written[-1])
    np.testing.assert_array_equal(written, state["acceleration"])
    assert "angular_acceleration" in head
    assert "acceleration" not in export.layout_of([state]).kinds()
    assert main(["info", str(demo_recording), "--acceleration"]) == 2
    assert "needs --csv or --parquet" in capsys.readouterr().err
