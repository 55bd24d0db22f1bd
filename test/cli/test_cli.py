"""The command line: arguments, output and errors."""

from __future__ import annotations

import importlib.util
import io
import math
from pathlib import Path

import numpy as np
import pytest
from cylconn_ros.msg import ConnectorState
from PIL import Image
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

import cylconn_ros
from cylconn_ros.cli import checks, info, main, progress, scenes, simulate
from cylconn_ros.connector import summary
from cylconn_ros.core.layout import STATE_FIELDS
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.recording.run import read_run
from cylconn_ros.recording.writer import RunWriter
from cylconn_ros.report.picture import ReferenceCurves, draw_run, save_run

STATE = TopicInfo("/connector/state", "cylconn_ros/msg/ConnectorState")
SAMPLES = 1000
STOP = 0.6004  # s


def states() -> dict[str, np.ndarray]:
    """Synthetic states at 1 kHz: slip until STOP, then stick."""
    time = np.arange(SAMPLES) * 1e-3
    moving = time < STOP
    left = np.maximum(STOP - time, 0.0)
    found: dict[str, np.ndarray] = {
        name: np.zeros(SAMPLES) if width == 1 else np.zeros((SAMPLES, width))
        for name, width in STATE_FIELDS
    }
    found["displacement"] = STOP**2 - left**2
    found["rotation"] = 2.0 * math.pi * 3.0 * (STOP - left) / STOP
    found["slip_velocity"] = np.stack([2.0 * left, left], axis=1)
    found["normal_force"] = 30.0 + np.sin(60.0 * time)
    found["friction_limit"] = 0.2 * found["normal_force"]
    found["traction"] = np.where(moving, found["friction_limit"], 3.0)
    found["stop_time"] = np.full(SAMPLES, -1.0)
    found["stop_time"][600] = 0.0004
    found["offset_violation"] = np.full(SAMPLES, 1e-9)
    found["offset_violation"][7] = -3e-7
    found["angular_violation"] = np.full(SAMPLES, 2e-8)
    found["regime"] = np.where(time < 0.6, 2, 1)
    found["status"] = np.zeros(SAMPLES, dtype=int)
    found["flags"] = np.where(time < 0.6, 0, 128)
    found["flags"][:5] = 1
    found["time"] = time
    return found


def record(directory: Path, count: int = SAMPLES) -> Path:
    """Record the synthetic states."""
    table = states()
    with RunWriter(directory, [STATE], {"version": "9.8.7", "model": "everything"}) as writer:
        for k in range(count):
            message = ConnectorState(header=Header(frame_id="shaft"), method="impulse")
            message.header.stamp.nanosec = k * 1_000_000
            for name, width in STATE_FIELDS:
                value = table[name][k]
                setattr(message, name, float(value) if width == 1 else value)
            message.regime = int(table["regime"][k])
            message.flags = int(table["flags"][k])
            writer.write(STATE.name, serialize_message(message), 10**18 + k, 10**18 + k)
    return directory


def call(*arguments: str) -> int:
    return main.main([str(a) for a in arguments])


@pytest.mark.parametrize("command", list(main.COMMANDS))
def test_help_explains_a_command(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        call(command, "--help")
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert text.startswith(f"usage: cylconn {command}")
    assert f"For example: cylconn {command}" in text or f"For example:\n  cylconn {command}" in text
    assert "\nNext: " in text[text.index("options:") :]


def test_version_and_no_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        call("--version")
    assert ended.value.code == 0
    with pytest.raises(SystemExit) as ended:
        call()
    assert ended.value.code == 2
    assert "COMMAND" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["simulate", "nowhere"], "nowhere is neither a file nor a bundled scene"),
        (["info", "nowhere"], "nowhere: No such file or directory"),
        (["info", __file__], "test_cli.py: is not a recording (a directory with metadata.yaml"),
        (["info", "/dev/null"], "/dev/null: is not a regular file"),
        (["simulate", "demo", "--output", "run.txt.gz"], "run.txt.gz"),
        (["demo", "--output", "/proc/nope/here"], "/proc/nope/here"),
    ],
)
def test_errors_are_one_sentence(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(*arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_missing_plot_package_is_reported_before_the_simulation(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(simulate, "simulate", lambda *_: pytest.fail("the simulation started"))
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert call("simulate", "coast", "--plot", "a.png") == 2
    assert "--plot needs matplotlib: pip install '.[demo]'" in capsys.readouterr().err


@pytest.mark.parametrize("value", ["0", "-1", "inf", "nan", "soon"])
def test_durations_are_positive_numbers(value: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        call("simulate", "demo", f"--duration={value}")
    assert ended.value.code == 2
    assert value in capsys.readouterr().err


def test_scenes_are_bundled() -> None:
    names = {"demo", "coast", "slide_and_spin", "incline", "free_flight", "twenty_turns"}
    assert names <= set(scenes.bundled())
    for name in names:
        options = main.parser().parse_args(["simulate", name, "--period", "0.01"])
        scene = scenes.load_with_overrides(scenes.find(name), options)
        assert scene.period == 0.01
        assert scenes.steps(scene) == round(scene.plant.duration / 0.01)


def test_scenes_are_found_in_an_installation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = tmp_path / "share" / "cylconn_ros" / "config"
    config.mkdir(parents=True)
    (config / "only.yaml").touch()
    elsewhere = tmp_path / "lib" / "cylconn_ros" / "__init__.py"
    monkeypatch.setattr(cylconn_ros, "__file__", str(elsewhere))
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    assert scenes.bundled() == {"only": config / "only.yaml"}


def test_a_scene_without_an_end_needs_a_duration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    endless = tmp_path / "endless.yaml"
    text = scenes.find("coast").read_text()
    endless.write_text(text.replace("      duration: 1.0                       # s\n", ""))
    assert call("simulate", str(endless)) == 2
    assert "has no plant.duration: give --duration S" in capsys.readouterr().err


def test_states_are_summarised() -> None:
    table = states()
    found = summary.summarise(table["time"], table)
    assert found.samples == SAMPLES
    assert found.duration == pytest.approx(0.999)
    assert found.distance == pytest.approx(STOP**2)
    assert found.turns == pytest.approx(3.0)
    assert found.stop_time == pytest.approx(STOP)
    assert found.worst_offset == 3e-7
    assert found.worst_misalignment == 2e-8
    assert found.regimes == {"stick": pytest.approx(0.4), "slip": pytest.approx(0.6)}
    assert found.flags == {"undersampled": 5}
    assert found.refused == 0


def test_no_stop_and_values_that_are_not_finite_fail_checks() -> None:
    table = states()
    table["regime"][-1] = 2
    table["offset_violation"][3] = np.nan
    table["status"][3] = 1
    found = summary.summarise(table["time"], table)
    assert math.isnan(found.stop_time)
    assert math.isnan(found.worst_offset)
    assert found.refused == 1
    assert checks.below("offset", found.worst_offset, 1.0, "m").ok is False
    assert checks.against("stop", found.stop_time, 1.0, 1.0, "s").ok is False


def test_a_summary_passes_only_if_every_check_passes(capsys: pytest.CaptureFixture[str]) -> None:
    good = [checks.below("size", 0.5, 1.0, "m"), checks.Check("method", "impulse")]
    assert checks.show(good)
    assert not checks.show([*good, checks.equal("lost", 1, 0)])
    out = capsys.readouterr().out
    assert "✓ size    0.5 m" in out
    assert "✗ lost    1" in out
    assert "exactly 0" in out


def test_simulate_keeps_arrays_and_recordings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arrays, recording, picture = (tmp_path / name for name in ("run.npz", "run", "run.png"))
    assert call("simulate", "coast", "-o", str(arrays)) == 0
    assert call("simulate", "coast", "-o", str(recording), "--plot", str(picture)) == 0
    out = capsys.readouterr().out
    assert "at rest     from 0.4061" in out
    assert "slide 0.20308" in out
    assert picture.stat().st_size > 10_000
    run = read_run(recording)
    assert set(run.counts.values()) == {SAMPLES + 1}
    with np.load(arrays) as kept:
        for name, _ in STATE_FIELDS:
            np.testing.assert_array_equal(run.state[name], kept[name], err_msg=name)
        pose = run.table("/body_b/pose")
        np.testing.assert_array_equal(pose["pose.position.x"], kept["motion"][:, 13])
        np.testing.assert_array_equal(pose.stamp, np.round(kept["time"] * 1e9))
        assert str(kept["parameters"]) == run.metadata["parameters"]
    for path in (arrays, recording):
        assert call("simulate", "coast", "-o", str(path)) == 2
        assert "never overwritten" in capsys.readouterr().err


def test_info_shows_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("info", str(record(tmp_path / "run"))) == 0
    out = capsys.readouterr().out
    for words in (
        "recorded by cylconn_ros 9.8.7",
        "/connector/state      1000  cylconn_ros/msg/ConnectorState",
        "method      impulse\nmodel       everything",
        "stick 40.0%, slip 60.0%",
        "slide 0.360480 m, spin 3.000000 turns",
        "from 0.600400 s on",
        "at most 3.00e-04 mm",
        "undersampled 5",
    ):
        assert words in out


def test_info_reports_an_incomplete_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = record(tmp_path / "run", count=20) / "metadata.yaml"
    path.write_text(path.read_text().replace("message_count: 20\n", "message_count: 21\n"))
    assert call("info", str(path.parent)) == 1
    out = capsys.readouterr().out
    assert "INCOMPLETE" in out
    assert "next: cylconn salvage" in out


def test_info_reports_empty_and_undecodable_topics(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("info", str(record(tmp_path / "empty", count=0))) == 1  # nothing usable
    assert "NO MESSAGE" in capsys.readouterr().out
    with RunWriter(tmp_path / "damaged", [STATE], {}) as writer:
        writer.write(STATE.name, b"\x00\x01\x00\x00garbage", 1, 1)
    assert call("info", str(tmp_path / "damaged")) == 1
    assert "UNDECODABLE: 1 messages of /connector/state" in capsys.readouterr().out


def test_the_picture_of_a_run(tmp_path: Path) -> None:
    table = states()
    time = table["time"]
    reference = ReferenceCurves(
        time, table["displacement"], table["rotation"], table["normal_force"]
    )
    figure = draw_run(time, table, "A title", "a subtitle", reference, STOP)
    texts = [text.get_text() for axes in figure.axes for text in (axes.title, *axes.texts)]
    texts.append(figure.axes[0].get_title(loc="left"))
    assert {"A title", "a subtitle", "slip", "stick: at rest from 0.600 s"} <= set(texts)
    assert len(figure.axes) == 6
    for name in ("run.png", "run.svg"):
        save_run(figure, tmp_path / name)
        assert 10_000 < (tmp_path / name).stat().st_size < 400_000
    with Image.open(tmp_path / "run.png") as image:
        assert image.width == 1800


def test_progress_without_a_terminal_is_a_line_every_tenth() -> None:
    stream = io.StringIO()
    with progress.Progress("demo", stream) as bar:
        bar.note("starting")
        for done in range(0, 1001, 10):
            bar(done, 1000)
    lines = stream.getvalue().splitlines()
    assert lines == ["demo: starting", *(f"demo: {k}0%" for k in range(1, 11))]


def test_progress_on_a_terminal_is_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr(stream, "isatty", lambda: True)
    with progress.Progress("demo", stream) as bar:
        bar(500, 1000)
        bar(1000, 1000)
    assert "50%" in stream.getvalue()
    assert "[" + "#" * 36 + "] 100%" in stream.getvalue()
    assert stream.getvalue().endswith("\n")


def test_a_simulation_includes_its_end(tmp_path: Path) -> None:
    for name, length in (("time", "--duration=0.01"), ("steps", "--steps=10")):
        output = tmp_path / f"{name}.npz"
        assert call("simulate", "coast", length, "-o", str(output)) == 0
        with np.load(output) as kept:
            np.testing.assert_allclose(kept["time"], 1e-3 * np.arange(11), atol=1e-15)


def test_duration_and_steps_exclude_each_other(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        call("simulate", "coast", "--duration=1", "--steps=10")
    assert ended.value.code == 2
    assert "not allowed with argument" in capsys.readouterr().err


def test_results_are_described_in_words() -> None:
    table = states()
    lines = info.describe(summary.summarise(table["time"], table))
    assert any(line.startswith("at rest") for line in lines)


def test_a_start_beyond_a_stop_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = tmp_path / "beyond.yaml"
    scene.write_text("""/**:
  ros__parameters:
    body_b: {kind: free, mass: 1.0, inertia: [0.001, 0.0, 0.0, 0.001, 0.0, 0.001],
             pose: [0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]}
    node_a: {orientation: [0.0, 0.0, 0.0, 1.0]}
    stops: {l_min: 0.0, l_max: 0.08}
""")
    assert main.main(["simulate", str(scene), "--duration", "0.01"]) == 0
    out = capsys.readouterr().out
    assert "warning     slide starts at 0.2 m, beyond stops.l_max (0.08 m)" in out


def test_a_run_that_leaves_its_joint_is_exit_code_1(capsys):
    """A declared latency that the plant does not have: the body falls off, no sample is refused."""
    wrong = ["--set", "latency=1", "--set", "plant.latency=3", "--duration", "0.3"]
    assert main.main(["simulate", "demo", *wrong]) == 1
    assert "NOT USABLE" in capsys.readouterr().out


def test_what_changed_is_shown_for_a_scene_without_duration(tmp_path, capsys):
    scene = tmp_path / "endless.yaml"
    scene.write_text(
        "/**:\n  ros__parameters:\n    period: 0.001\n"
        "    node_a: {orientation: [0.0, 0.0, 0.0, 1.0]}\n"
        "    body_b: {kind: free, mass: 2.0, inertia: [0.01, 0.0, 0.0, 0.02, 0.0, 0.02]}\n"
    )
    assert main.main(["simulate", str(scene), "--set", "plant.duration=0.05"]) == 0
    assert "with --set" in capsys.readouterr().out
