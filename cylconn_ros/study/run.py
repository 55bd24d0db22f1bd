"""Work through the rows of a study: chunks to an engine, results to the dataset, in any order.

Chunks that are written are not computed again. Only a few chunks more than there are workers are
under way, so that memory does not grow with the number of rows. What a dying worker did not return
is computed again; a chunk during which workers died three times is then alone, and becomes failed
rows.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from dataclasses import dataclass, field

from cylconn_ros.errors import StudyError
from cylconn_ros.study.chunk import Chunk, Task, compute, lost
from cylconn_ros.study.dataset import Dataset
from cylconn_ros.study.executors import Engine
from cylconn_ros.study.rows import Rows

Progress = Callable[[int, int], None]

TASK_SECONDS = 1.0
"""Least work of a chunk, s, as far as there are rows enough."""
TASKS_A_SECOND = 100.0
"""Tasks that a scheduler takes, a third of what was measured (docs/scale): more workers need longer
tasks."""
MOST_ROWS_A_CHUNK = 10_000
_LEAST_CHUNKS_A_WORKER = 4
_MOST_DEATHS = 3
_WAIT = 0.5  # s between two looks at the engine


@dataclass
class Outcome:
    """What a run did.

    Attributes
    ----------
        rows, failed: rows computed and those among them that failed. present: rows that had been
            written before. repeated: chunks that were computed again after a worker's death.
        seconds: elapsed; cpu: of the tasks, s.
        memory: first and last memory of each worker process, bytes.
    """

    rows: int = 0
    failed: int = 0
    present: int = 0
    repeated: int = 0
    seconds: float = 0.0
    cpu: float = 0.0
    memory: dict[str, tuple[int, int]] = field(default_factory=dict)

    def add(self, chunk: Chunk) -> None:
        """Count a chunk that is written."""
        self.rows += chunk.rows
        self.failed += chunk.failed
        self.cpu += chunk.cpu
        if chunk.worker:
            process = chunk.worker.rpartition("/")[0]
            begin = self.memory.get(process, (chunk.memory, 0))[0]
            self.memory[process] = begin, chunk.memory


def chunk_size(seconds: float, rows: int, workers: int) -> int:
    """Rows of a chunk, 1, 2 or 5 times a power of ten.

    TASK_SECONDS of work, more for more than 100 workers, which a scheduler could not keep busy; but
    at least four chunks a worker, so that all end together.

    Args:
        seconds: of one row. rows: of the study. workers: tasks at a time.
    """
    work = max(TASK_SECONDS, workers / TASKS_A_SECOND)
    most = min(work / max(seconds, 1e-9), rows / (_LEAST_CHUNKS_A_WORKER * workers))
    size = 1
    for step in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, MOST_ROWS_A_CHUNK):
        size = step if step <= most else size
    return size


class _Work:
    """The chunks that are to be computed and those under way."""

    def __init__(self, task: Task, rows: Rows, dataset: Dataset, engine: Engine) -> None:
        self.task, self.rows, self.dataset, self.engine = task, rows, dataset, engine
        self.size = int(dataset.description["chunk"])
        done = dataset.done()
        self.count = -(-len(rows) // self.size)
        self.present = sum(self._length(k) for k in done)
        self.fresh = iter(k for k in range(self.count) if k not in done)
        self.again: deque[int] = deque()
        self.suspects: deque[int] = deque()
        self.deaths: dict[int, int] = {}
        self.under_way: dict[Future[Chunk], int] = {}

    def _length(self, chunk: int) -> int:
        return min(self.size, len(self.rows) - chunk * self.size)

    def arguments(self, chunk: int) -> tuple[Task, int, Rows]:
        """Return what :func:`compute` is called with."""
        first = chunk * self.size
        return self.task, first, self.rows.part(first, first + self.size)

    def _next(self) -> int | None:
        if self.again:
            return self.again.popleft()
        return next(self.fresh, None)

    def fill(self) -> None:
        """Submit chunks until enough are under way; a suspect only alone."""
        most = self.engine.workers * (1 + self.engine.ahead)
        while len(self.under_way) < most:
            chunk = self._next()
            if chunk is None:
                break
            self._submit(chunk)
        if self.suspects and not self.under_way:
            self._submit(self.suspects.popleft())

    def _submit(self, chunk: int) -> None:
        try:
            future = self.engine.submit(compute, *self.arguments(chunk))
        except BrokenExecutor:  # a worker died since the last look
            self.again.append(chunk)
            self.engine.renew()
            return
        self.under_way[future] = chunk

    def died(self, chunks: list[int]) -> Iterator[int]:
        """Take up chunks whose worker died again; yield those that are given up."""
        for chunk in chunks:
            self.deaths[chunk] = self.deaths.get(chunk, 0) + 1
            if self.deaths[chunk] >= _MOST_DEATHS:
                yield chunk
            elif self.deaths[chunk] == _MOST_DEATHS - 1:
                self.suspects.append(chunk)
            else:
                self.again.append(chunk)


def run(
    task: Task, rows: Rows, dataset: Dataset, engine: Engine, progress: Progress | None = None
) -> Outcome:
    """Compute the rows that ``dataset`` does not hold yet and write them.

    ``progress`` is called with (done, total) rows. Raises StudyError if the results cannot be
    written or the scheduler is gone; what is written stays, and another call resumes.
    """
    begin, outcome = time.monotonic(), Outcome()
    with dataset.locked():
        work = _Work(task, rows, dataset, engine)
        outcome.present = work.present
        if progress is not None:
            progress(outcome.present, len(rows))
        try:
            work.fill()
            while work.under_way:
                ended, _ = wait(work.under_way, _WAIT, FIRST_COMPLETED)
                _collect(work, ended, outcome)
                if progress is not None:
                    progress(outcome.present + outcome.rows, len(rows))
                if not ended and (problem := engine.problem()):
                    raise _gone(work, problem)
                work.fill()
        finally:
            for future in work.under_way:
                future.cancel()
    outcome.seconds = time.monotonic() - begin
    return outcome


def _collect(work: _Work, ended: set[Future[Chunk]], outcome: Outcome) -> None:
    """Write the chunks that are computed, and take up those that were lost with a worker."""
    dead: list[int] = []
    broken = False
    for future in ended:
        chunk = work.under_way.pop(future)
        error = CancelledError() if future.cancelled() else future.exception()
        if error is None:
            _write(work, chunk, future.result(), outcome)
        elif isinstance(error, BrokenExecutor | CancelledError):
            dead.append(chunk)
            broken |= isinstance(error, BrokenExecutor)
        elif type(error).__name__ == "KilledWorker":  # Dask has repeated it four times
            _write(work, chunk, lost(*work.arguments(chunk)), outcome)
        else:
            raise StudyError(
                f"{work.dataset.address}: a worker cannot compute a chunk: "
                f"{type(error).__name__}: {error}"
            ) from error
    if broken:
        dead += _abandoned(work, outcome)
        work.engine.renew()
    while dead and not work.engine.usable():  # all was cancelled as the connection ended
        if problem := work.engine.problem():
            raise _gone(work, problem)
        time.sleep(_WAIT)
    outcome.repeated += len(dead)
    for chunk in work.died(dead):
        _write(work, chunk, lost(*work.arguments(chunk)), outcome)


def _abandoned(work: _Work, outcome: Outcome) -> list[int]:
    """Chunks under way in a broken pool; those that were computed before are written."""
    left = []
    for future, chunk in list(work.under_way.items()):
        if future.done() and not future.cancelled() and future.exception() is None:
            _write(work, chunk, future.result(), outcome)
        else:
            left.append(chunk)
    work.under_way.clear()
    return left


def _write(work: _Work, chunk: int, result: Chunk, outcome: Outcome) -> None:
    work.dataset.put(chunk, result.data)
    outcome.add(result)


def _gone(work: _Work, problem: str) -> StudyError:
    return StudyError(
        f"{problem}; {len(work.dataset.done())} of {work.count} chunks are in "
        f"{work.dataset.address}; the same command resumes, with another --scheduler or without"
    )
