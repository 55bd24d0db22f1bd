"""Sweeps into a dataset: right, complete, resumed, the same however they are computed."""

import multiprocessing
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import bundled

import cylconn_ros as cr
from cylconn_ros.errors import StudyError
from cylconn_ros.simulation.run import Run
from cylconn_ros.study.dataset import Dataset
from cylconn_ros.study.executors import Engine, Here, Processes
from cylconn_ros.study.rows import Rows, read_axis
from cylconn_ros.study.run import chunk_size, run
from cylconn_ros.study.sweep import Sweep, sweep_rows
from cylconn_ros.study.variants import Variants

VARY = {"friction.coefficient": np.linspace(0.1, 0.4, 8).tolist(), "body_b.mass": [1.0, 2.0, 3.0]}
OUTPUTS = ("displacement.end", "stop_time", "normal_force.max")


def small(output: Any, **options: Any) -> Sweep:
    return cr.sweep(
        bundled("coast"), VARY, 0.05,
        **{"output": output, "outputs": OUTPUTS, "workers": 1, "chunk": 5, **options},
    )  # fmt: skip


def files(folder: Path) -> dict[str, bytes]:
    return {one.name: one.read_bytes() for one in sorted((folder / "rows").iterdir())}


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study") / "one"
    small(folder)
    return folder


def test_a_row_holds_what_its_simulation_gives(done: Path) -> None:
    found = Sweep(Dataset.existing(done))
    table = found.to_dataframe()
    assert len(table) == 24
    assert table["row"].tolist() == list(range(24))
    for k in (0, 7, 23):
        row, again = table.iloc[k], found.run(k)
        assert isinstance(again, Run)
        assert row["friction.coefficient"] == again.scene.friction.coefficient
        assert row["displacement.end"] == again["displacement"][-1]
        assert row["normal_force.max"] == again["normal_force"].max()
        assert (row["status"], row["error"]) == ("ok", "")
    with pytest.raises(StudyError, match="row 24 is not written"):
        found.run(24)


def test_processes_give_the_same_files_bit_for_bit(done: Path, tmp_path: Path) -> None:
    small(tmp_path / "two", workers=2)
    assert files(tmp_path / "two") == files(done)


def test_an_interrupted_sweep_resumes_and_repeats_nothing(done: Path, tmp_path: Path) -> None:
    folder = tmp_path / "study"

    def interrupt(done: int, _: int) -> None:
        if done >= 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        small(folder, progress=interrupt)
    before = {one: one.stat().st_mtime_ns for one in (folder / "rows").iterdir()}
    assert 2 <= len(before) < 5
    outcome = small(folder).outcome
    assert (outcome.present, outcome.rows) == (5 * len(before), 24 - 5 * len(before))
    assert all(one.stat().st_mtime_ns == time for one, time in before.items())
    assert files(folder) == files(done)
    assert small(folder).outcome.rows == 0  # the same folder twice: nothing is left to do


def test_the_same_folder_for_another_sweep_is_refused(done: Path, tmp_path: Path) -> None:
    before = files(done)
    with pytest.raises(StudyError, match=r"holds another study; outputs was .* give another"):
        small(done, outputs=("jam",))
    with pytest.raises(StudyError, match="holds another study; values was"):
        cr.sweep(bundled("coast"), {**VARY, "body_b.mass": [1.0, 2.0, 4.0]}, 0.05, output=done,
                 outputs=OUTPUTS)  # fmt: skip
    assert files(done) == before
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(StudyError, match="exists and holds no study"):
        small(tmp_path)


def test_two_processes_at_the_same_folder_at_once(done: Path) -> None:
    with (
        Dataset(done).locked(),
        pytest.raises(StudyError, match="another process writes to it"),
    ):
        small(done)


def test_a_wrong_row_is_named_before_anything_runs(tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    values = ["0.2"] * 8000
    values[7341], values[1] = "-0.1", "0.3"
    table.write_text("friction.coefficient\n" + "\n".join(values))
    rows = sweep_rows([read_axis(f"@{table}")])
    from cylconn_ros.study.sweep import Simulation, into_dataset

    task = Simulation(Variants({"": bundled("coast")}), 0.01, ("jam",))
    with pytest.raises(
        StudyError, match=r"^row 7341: friction.coefficient = -0.1: must be .*; nothing was run$"
    ):
        into_dataset(task, rows, tmp_path / "out", Engine(Here(), 1))
    assert not (tmp_path / "out").exists()


def test_a_failed_run_is_a_row(tmp_path: Path) -> None:
    vary = {"plant.duration": [0.01, float("inf"), 0.02]}
    found = cr.sweep(bundled("coast"), vary, output=tmp_path / "out", outputs=["jam"], workers=1)
    rows = found.to_dataframe().to_dict("records")
    assert [row["status"] for row in rows] == ["ok", "failed", "ok"]
    assert rows[1]["error"].startswith("plant.duration = .inf: must be finite")
    assert rows[1]["jam"] is None
    assert (found.outcome.rows, found.outcome.failed) == (3, 1)


def test_a_dataset_on_another_file_system(done: Path) -> None:
    import fsspec

    small("memory://bucket/study")
    memory = fsspec.filesystem("memory")
    names = memory.ls("/bucket/study/rows", detail=False)
    assert {name.rpartition("/")[2]: memory.cat_file(name) for name in names} == files(done)
    assert small("memory://bucket/study").outcome.rows == 0
    with pytest.raises(StudyError, match="nowhere://x"):
        small("nowhere://x")


@pytest.fixture
def little_disk(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=20k", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("no right to mount a file system")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_keeps_what_is_written(done: Path, little_disk: Path) -> None:
    folder = little_disk / "study"
    with pytest.raises(StudyError, match=r"No space left on device; \d chunks are written") as e:
        small(folder)
    written = files(folder)
    assert str(folder) in str(e.value)
    assert 0 < len(written) < 5
    assert not [name for name in written if name.startswith(".")]
    assert written.items() <= files(done).items()  # no file is cut
    subprocess.run(["mount", "-o", "remount,size=4m", str(little_disk)], check=True)
    small(folder)
    assert files(folder) == files(done)


class Killer:
    """A task that ends its process at a row: the first time, or every time."""

    outputs = {"twice": "float64"}  # noqa: RUF012

    def __init__(self, mark: Path, row: float, always: bool) -> None:
        self.mark, self.row, self.always = mark, row, always

    def __call__(self, row: dict[str, Any]) -> dict[str, Any]:
        if row["x"] == self.row and (self.always or not self.mark.exists()):
            self.mark.write_text("")
            os.kill(os.getpid(), signal.SIGKILL)
        return {"twice": 2.0 * row["x"]}


def counted(folder: Path, task: Any, count: int = 40) -> Any:
    rows = Rows({"x": np.arange(count, dtype=np.float64)}, count)
    dataset = Dataset(folder)
    dataset.begin({"rows": count, "chunk": 2})
    engine = Processes(2)
    try:
        return run(task, rows, dataset, engine), dataset.table().to_pydict()
    finally:
        engine.close()


@pytest.mark.parametrize("always", [False, True])
def test_a_killed_process_loses_only_the_rows_that_kill(tmp_path: Path, always: bool) -> None:
    outcome, table = counted(tmp_path / "out", Killer(tmp_path / "mark", 20.0, always))
    assert table["row"] == list(range(40))
    lost = [20, 21] if always else []
    assert [k for k in range(40) if table["status"][k] == "failed"] == lost
    assert [k for k in range(40) if table["twice"][k] != 2.0 * k] == lost
    assert outcome.repeated >= 1
    assert len(lost) == 0 or "ended each time" in table["error"][20]


def test_chunks_follow_from_the_cost_of_a_row() -> None:
    assert chunk_size(5e-3, 10_000, 2) == 200  # a second of work
    assert chunk_size(5e-3, 100, 2) == 10  # at least four chunks a worker
    assert chunk_size(10.0, 100, 2) == 1
    assert chunk_size(5e-3, 10**8, 1000) == 2000  # ten seconds: 100 tasks a second
    assert chunk_size(1e-7, 10**9, 2) == 10_000


def test_memory_does_not_grow_with_the_rows(tmp_path: Path) -> None:
    rows = {"friction.coefficient": np.linspace(0.1, 0.4, 400).tolist()}
    outcome = cr.sweep(
        bundled("coast"), rows, 0.5, output=tmp_path / "out", workers=2, chunk=10
    ).outcome
    for first, last in outcome.memory.values():
        assert last - first < 20e6


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_no_process_stays_behind(tmp_path: Path) -> None:
    small(tmp_path / "out", workers=2)
    wait_for(lambda: not multiprocessing.active_children())
