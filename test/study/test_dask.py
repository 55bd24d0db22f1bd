"""A real Dask scheduler with two worker processes on loopback: deaths of a worker, of all."""

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import bundled

import cylconn_ros as cr
from cylconn_ros.cli.main import main
from cylconn_ros.errors import StudyError
from cylconn_ros.study.dataset import Dataset
from cylconn_ros.study.sweep import Sweep

VARY = {"friction.coefficient": np.linspace(0.1, 0.4, 120).tolist()}


@dataclass
class Cluster:
    address: str
    scheduler: subprocess.Popen[bytes]
    workers: list[subprocess.Popen[bytes]]


def start(*arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "dask", *arguments, "--no-dashboard"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    """One for both tests, in their order: a worker is killed, then the scheduler."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    scheduler = start("scheduler", "--host", "127.0.0.1", "--port", str(port))
    options = ("--nthreads", "1", "--no-nanny", "--host", "127.0.0.1")
    workers = [start("worker", address, *options) for _ in range(2)]
    found = Cluster(address, scheduler, workers)
    try:
        wait_for_workers(address)
        yield found
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()


def wait_for_workers(address: str) -> None:
    from distributed import Client

    with Client(address, timeout=60, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)


def sweep(output: Path, **options: Any) -> Sweep:
    return cr.sweep(
        bundled("coast"), VARY, 1.0, output=output, outputs=("displacement.end", "stop_time"),
        chunk=2, **options,
    )  # fmt: skip


def files(folder: Path) -> dict[str, bytes]:
    return {one.name: one.read_bytes() for one in sorted((folder / "rows").iterdir())}


@pytest.fixture(scope="module")
def one_process(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dask") / "one"
    sweep(folder, workers=1)
    return folder


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Numbers of the chunks as they are written."""
    found: list[int] = []
    put = Dataset.put

    def counted(dataset: Dataset, chunk: int, data: bytes) -> None:
        found.append(chunk)
        put(dataset, chunk, data)

    monkeypatch.setattr(Dataset, "put", counted)
    return found


def test_a_killed_worker_loses_and_repeats_nothing(
    cluster: Cluster, one_process: Path, tmp_path: Path, written: list[int]
) -> None:
    def kill(done: int, _: int) -> None:
        if done >= 20 and cluster.workers[0].poll() is None:
            cluster.workers[0].send_signal(signal.SIGKILL)
            cluster.workers[0].wait()

    found = sweep(tmp_path / "out", scheduler=cluster.address, progress=kill)
    assert cluster.workers[0].returncode == -signal.SIGKILL
    assert sorted(written) == list(range(60))
    assert (found.outcome.rows, found.outcome.failed) == (120, 0)
    assert files(tmp_path / "out") == files(one_process)


def test_a_scheduler_that_goes_away_leaves_a_dataset_that_resumes(
    cluster: Cluster, one_process: Path, tmp_path: Path, monkeypatch, written: list[int]
) -> None:
    monkeypatch.setattr("cylconn_ros.study.executors.PATIENCE", 3.0)

    def kill(done: int, _: int) -> None:
        if done >= 20:
            cluster.scheduler.kill()
            cluster.scheduler.wait()

    begin = time.monotonic()
    with pytest.raises(
        StudyError,
        match=rf"the scheduler {cluster.address} is gone .*; \d+ of 60 chunks are in .*resumes",
    ):
        sweep(tmp_path / "out", scheduler=cluster.address, progress=kill)
    assert time.monotonic() - begin < 30.0
    assert 10 <= len(written) < 60
    with pytest.raises(StudyError, match="does not answer"):
        sweep(tmp_path / "out", scheduler=cluster.address)
    sweep(tmp_path / "out", workers=1)
    assert sorted(written) == list(range(60))
    assert files(tmp_path / "out") == files(one_process)


def test_a_scheduler_started_here(tmp_path: Path, capsys) -> None:
    output = tmp_path / "out"
    command = ["sweep", "coast", "--vary", "friction.coefficient=0.1:0.3:6", "--duration", "0.1"]
    options = ["-o", str(output), "--scheduler", "local", "--workers", "2", "--chunk", "1"]
    assert main([*command, *options]) == 0
    printed = capsys.readouterr().out
    assert "2 threads of workers of tcp://127.0.0.1:" in printed
    assert len(Dataset.existing(output).table()) == 6
    assert (output / "page.html").is_file()
