"""Tasks of zero work: how many a second the executors and the file system take."""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path

from cylconn_ros.bench.common.results import Findings, Measurement, NotMeasured
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Spread
from cylconn_ros.errors import StudyError
from cylconn_ros.study.dataset import Dataset
from cylconn_ros.study.executors import LOCAL, Engine, engine

ZERO = "tasks of zero work, two workers"
FILES = "files of a dataset, written, synchronized and renamed"
RATE, LEAST = "rate", "least work of a task for 1000 workers"
SHARE = 3.0  # a third of the rate is used: the chunking rule
DASK = "Dask scheduler, client and workers on one machine"
_SIZES = (5_000, 200_000)  # bytes


def measure(settings: Settings) -> Findings:
    """Rates of the engines of a study, and of its files."""
    found = Findings()
    seconds, rounds = (0.05, 2) if settings.quick else (1.0, 7)
    for name, scheduler in (("processes", ""), (DASK, LOCAL)):
        if settings.quick and scheduler:
            found.not_measured.append(NotMeasured(ZERO, name, "skipped", "the short form"))
            continue
        try:
            with _engine(scheduler) as used:
                values = [_rate(used, seconds) for _ in range(rounds + 1)][1:]
        except StudyError as error:
            found.not_measured.append(NotMeasured(ZERO, name, "not installed", str(error)))
            continue
        rate = Spread.of(values)
        found.measurements += [
            Measurement.of(ZERO, name, RATE, rate, "1/s"),
            Measurement(ZERO, name, LEAST, SHARE * 1000.0 / rate.median, "s"),
        ]
    with tempfile.TemporaryDirectory() as folder:
        for k, size in enumerate(_SIZES):
            values = [_files(Path(folder) / f"{k}_{n}", size, seconds) for n in range(rounds)]
            subject = f"{size / 1000:g} kB each"
            found.measurements.append(
                Measurement.of(FILES, subject, RATE, Spread.of(values), "1/s")
            )
    return found


@contextlib.contextmanager
def _engine(scheduler: str) -> Iterator[Engine]:
    """Two workers that have begun."""
    with engine(scheduler, 2) as used:
        for future in [used.submit(_nothing, 0) for _ in range(8)]:
            future.result()
        yield used


def _nothing(number: int) -> int:
    return number


def _rate(used: Engine, seconds: float) -> float:
    """Tasks a second, with as many under way as a study has."""
    most = used.workers * (1 + used.ahead)
    pending = deque(used.submit(_nothing, k) for k in range(most))
    begin, count = time.perf_counter(), 0
    while time.perf_counter() - begin < seconds:
        pending.popleft().result()
        pending.append(used.submit(_nothing, count))
        count += 1
    rate = count / (time.perf_counter() - begin)
    for future in pending:
        future.result()
    return rate


def _files(folder: Path, size: int, seconds: float) -> float:
    """Files a second."""
    dataset, data = Dataset(folder), bytes(size)
    dataset.begin({"rows": 0})
    begin, count = time.perf_counter(), 0
    while time.perf_counter() - begin < seconds:
        dataset.put(count, data)
        count += 1
    return count / (time.perf_counter() - begin)
