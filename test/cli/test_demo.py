"""The demo command: two processes, a recording that other tools can read, and its checks."""

from __future__ import annotations

import dataclasses
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from cylconn_ros.cli import demo_checks, main, scenes
from cylconn_ros.core import layout
from cylconn_ros.process import child
from cylconn_ros.recording.run import Run, read_run
from cylconn_ros.reference import Reference
from cylconn_ros.scene.scene import Scene, load
from cylconn_ros.simulation.simulate import simulate

DURATION, STEPS = 0.5, 500


@pytest.fixture(autouse=True)
def _installed_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Under pytest, argv[0] is pytest: search the programs in this prefix."""
    monkeypatch.setattr(sys, "argv", [str(Path(sys.executable).parent / "cylconn")])


def call(*arguments: str) -> int:
    return main.main(["demo", f"--duration={DURATION}", *arguments])


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[int, str, Path]:
    """Run the demo for half a second; exit code, output, output directory."""
    output = tmp_path_factory.mktemp("demo") / "run"
    cylconn = child.executable("cylconn")
    done = subprocess.run(
        [cylconn, "demo", f"--duration={DURATION}", f"--output={output}"],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr, output


def recording(output: Path) -> Path:
    (found,) = (path.parent for path in output.glob("*/metadata.yaml"))
    return found


def scene_of(output: Path) -> Scene:
    return load(output / "scene.yaml")


def test_the_demo_passes_and_prints_its_checks(demo: tuple[int, str, Path]) -> None:
    code, text, output = demo
    assert code == 0, text
    assert "✗" not in text
    for line in ("distance", "turns", "samples processed", "samples lost", "recorded run"):
        assert line in text
    assert "demo: 100%" in text
    assert str(recording(output)) in text
    assert (output / "demo.png").stat().st_size > 10_000


def test_every_sample_is_in_the_recording(demo: tuple[int, str, Path]) -> None:
    directory = recording(demo[2])
    per_sample = {
        "/body_a/wrench",
        "/body_b/pose",
        "/body_b/twist",
        "/body_b/wrench",
        "/connector/state",
        "/connector/joint_state",
    }
    stamps = np.arange(STEPS) * 1_000_000
    with AnyReader([directory]) as reader:
        found: dict[str, list[int]] = {topic: [] for topic in per_sample}
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            if connection.topic in found:
                stamp = message.header.stamp
                found[connection.topic].append(stamp.sec * 10**9 + stamp.nanosec)
    for topic, times in found.items():
        np.testing.assert_array_equal(times[:STEPS], stamps, err_msg=topic)
        # At shutdown, the connector sends a zero wrench, stamped just after the last sample.
        assert all(stamp > stamps[-1] for stamp in times[STEPS:])
        assert topic.endswith("/wrench") or len(times) == STEPS


def test_two_processes_give_the_results_of_one(demo: tuple[int, str, Path]) -> None:
    state = read_run(recording(demo[2])).state
    run = simulate(scene_of(demo[2]), samples=STEPS)
    for name, _ in layout.STATE_FIELDS:
        if name != "computing_time":
            np.testing.assert_array_equal(state[name], run[name], err_msg=name)
    np.testing.assert_array_equal(state["regime"], run.outs[:, layout.REGIME])


def test_the_recorded_parameters_are_those_in_use(
    demo: tuple[int, str, Path], tmp_path: Path
) -> None:
    run = read_run(recording(demo[2]))
    stored = tmp_path / "stored.yaml"
    stored.write_text(run.metadata["parameters"])
    wanted, found = scene_of(demo[2]).parameters(), load(stored).parameters()
    assert {name for name in wanted if repr(wanted[name]) != repr(found[name])} == set()
    assert run.metadata["method"] == "impulse"
    assert run.version


@pytest.fixture(scope="module")
def reference(demo: tuple[int, str, Path]) -> Reference:
    return demo_checks.reference(scene_of(demo[2]))


@pytest.fixture
def checked(demo: tuple[int, str, Path], reference: Reference) -> tuple[Run, Scene, Reference]:
    return read_run(recording(demo[2])), scene_of(demo[2]), reference


def passes(run: Run, scene: Scene, expected: Reference, name: str) -> bool | None:
    (line,) = (line for line in demo_checks.check_run(run, scene, expected) if line.name == name)
    return line.ok


def test_a_lost_sample_is_detected(checked: tuple[Run, Scene, Reference]) -> None:
    run = checked[0]
    wrench = run.table("/body_b/wrench")
    fewer = {name: np.delete(column, 7, axis=0) for name, column in wrench.columns.items()}
    run._tables["/body_b/wrench"] = dataclasses.replace(
        wrench, columns=fewer, log_time=np.delete(wrench.log_time, 7)
    )
    assert passes(*checked, "samples lost") is False
    assert passes(*checked, "samples processed") is False


@pytest.mark.parametrize(
    ("name", "field", "size"),
    [
        ("distance", "displacement", 2e-4),
        ("turns", "rotation", 2e-3),
        ("constraint, offset", "offset_violation", 2e-6),
        ("constraint, angle", "angular_violation", math.nan),
        ("residual of the laws", "residual", 2e-12),
        ("samples refused", "status", 1),
    ],
)
def test_an_error_of_each_quantity_is_detected(
    checked: tuple[Run, Scene, Reference], name: str, field: str, size: float
) -> None:
    run = checked[0]
    assert passes(*checked, name) is True
    state = run.state
    changed = state[field].copy()
    changed[-1] += np.asarray(size).astype(changed.dtype)
    run._tables[state.topic] = dataclasses.replace(state, columns={**state.columns, field: changed})
    assert passes(*checked, name) is False


def test_a_wrong_stop_time_is_detected(tmp_path: Path) -> None:
    assert main.main(["simulate", "slide_and_spin", f"--output={tmp_path / 'run'}"]) == 0
    run, scene = read_run(tmp_path / "run"), load(scenes.find("slide_and_spin"))
    expected = demo_checks.reference(scene)
    assert passes(run, scene, expected, "stop time") is True
    state = run.state
    later = np.where(state["stop_time"] >= 0.0, state["stop_time"] + 2e-4, state["stop_time"])
    run._tables[state.topic] = dataclasses.replace(
        state, columns={**state.columns, "stop_time": later}
    )
    assert passes(run, scene, expected, "stop time") is False


def programs(directory: Path, plant: str, connector: str) -> str:
    """Substitutes for the two programs; returns a path of cylconn in the same directory."""
    for name, code in (("plant", plant), ("connector", connector)):
        path = directory / name
        path.write_text(f"#!{sys.executable} -u\nimport sys, time\n{code}\n")
        path.chmod(0o755)
    return str(directory / "cylconn")


@pytest.mark.parametrize(
    ("plant", "connector", "words"),
    [
        ("time.sleep(60)", "print('no such parameter'); sys.exit(2)", "no such parameter"),
        ("print('no wrench'); sys.exit(1)", "time.sleep(60)", "plant ended with exit code 1"),
        ("time.sleep(0.2)", "import os; os.kill(os.getpid(), 11)", "connector ended early"),
    ],
)
def test_a_process_that_dies_is_reported_with_its_output(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    plant: str,
    connector: str,
    words: str,
) -> None:
    monkeypatch.setattr(sys, "argv", [programs(tmp_path, plant, connector)])
    start = time.monotonic()
    assert call(f"--output={tmp_path / 'out'}") == 1
    assert time.monotonic() - start < 30.0
    out = capsys.readouterr().out
    assert out.startswith("✗")
    assert words in out


def test_an_existing_output_is_rejected(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(f"--output={tmp_path}") == 2
    assert "never overwritten" in capsys.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_both_processes(tmp_path: Path, number: signal.Signals) -> None:
    mark = f"import os; open(r'{tmp_path}/' + os.path.basename(sys.argv[0]) + '.pid', 'w').write"
    code = f"{mark}(str(os.getpid())); time.sleep(60)"
    cylconn = programs(tmp_path, code, code)
    Path(cylconn).write_text(
        f"#!{sys.executable}\nimport sys\nfrom cylconn_ros.cli.main import main\nsys.exit(main())\n"
    )
    Path(cylconn).chmod(0o755)
    command = [cylconn, "demo", f"--output={tmp_path / 'out'}"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        children = [tmp_path / f"{name}.pid" for name in ("plant", "connector")]
        deadline = time.monotonic() + 120.0
        while not all(path.exists() and path.read_text() for path in children):
            assert time.monotonic() < deadline
            time.sleep(0.02)
        process.send_signal(number)
        _, error = process.communicate(timeout=120.0)
    assert process.returncode == 130
    assert "interrupted" in error
    for path in children:
        with pytest.raises(ProcessLookupError):
            os.kill(int(path.read_text()), 0)
