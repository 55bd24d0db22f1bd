"""Where the tasks of a study run: this process, processes of this machine, or a Dask scheduler.

Each is a :class:`concurrent.futures.Executor`; an :class:`Engine` adds what an executor does not
tell: how many tasks it runs at a time, whether it can still answer, and how to replace it after a
worker's death.
"""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

from cylconn_ros.errors import StudyError

LOCAL = "local"
PATIENCE = 15.0
"""Seconds without a connection after which a scheduler counts as gone."""


class Here(Executor):
    """Runs a task in this process, at once."""

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run a task; its exception becomes that of the future."""
        future: Future[Any] = Future()
        try:
            future.set_result(function(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class Engine:
    """Tasks in this process, one at a time.

    Attributes
    ----------
        executor: runs the tasks. workers: tasks that run at a time. name: for the terminal.
        ahead: tasks that are submitted beyond those.
    """

    name = "this process"
    ahead = 0

    def __init__(self, executor: Executor, workers: int) -> None:
        self.executor, self.workers = executor, workers

    def submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        """Submit a task."""
        return self.executor.submit(function, *args)

    def problem(self) -> str:
        """Return why no task will ever end any more; '' if it may."""
        return ""

    def usable(self) -> bool:
        """Whether tasks can be submitted."""
        return True

    def renew(self) -> None:
        """Replace the workers after one has died."""

    def close(self) -> None:
        """End the workers; running tasks are not waited for."""


class Processes(Engine):
    """Processes of this machine. They begin as copies of this one, with its compiled code."""

    ahead = 2

    def __init__(self, workers: int) -> None:
        super().__init__(self._pool(workers), workers)
        self.name = f"{workers} processes"

    @staticmethod
    def _pool(workers: int) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(workers, get_context("fork"), _ignore_interrupt)

    def renew(self) -> None:
        """Begin with new processes."""
        self.executor.shutdown(wait=False, cancel_futures=True)
        self.executor = self._pool(self.workers)

    def close(self) -> None:
        """End the processes after their present task."""
        self.executor.shutdown(wait=True, cancel_futures=True)


def _ignore_interrupt() -> None:
    """In a worker: Ctrl-C ends the study, which ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


class DaskEngine(Engine):
    """The workers of a Dask scheduler, which repeats the tasks of a worker that dies."""

    ahead = 2

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address, self._lost = client, address, 0.0
        super().__init__(client.get_executor(pure=False), self._count())
        self.name = f"{self.workers} threads of workers of {address}"

    def _count(self) -> int:
        return max(sum(self._client.ncores().values()), 1)

    def submit(self, function: Callable[..., Any], *args: Any) -> Future[Any]:
        """Submit a task. Raises StudyError if the scheduler is gone."""
        try:
            return super().submit(function, *args)
        except Exception as error:
            raise StudyError(self._gone(str(error))) from None

    def usable(self) -> bool:
        """Whether there is a connection to the scheduler."""
        return bool(self._client.status == "running")

    def problem(self) -> str:
        """Return that the scheduler is gone, once it has not been seen for PATIENCE."""
        status = self._client.status
        if self.usable():
            self._lost = 0.0
            return ""
        now = time.monotonic()
        self._lost = self._lost or now
        lost = status in ("closed", "closing") or now - self._lost > PATIENCE
        return self._gone(f"connection {status}") if lost else ""

    def _gone(self, why: str) -> str:
        return f"the scheduler {self._address} is gone ({why})"

    def close(self) -> None:
        """Take back what has not run, and part from the scheduler."""
        with contextlib.suppress(Exception):  # the scheduler may be gone
            self._client.close(timeout=2)


@contextlib.contextmanager
def engine(scheduler: str = "", workers: int | None = None) -> Iterator[Engine]:
    """Open where tasks run.

    Args:
        scheduler: address of a Dask scheduler (``tcp://host:8786``), or ``local``: one that is
            started here with its workers. Default: processes of this machine.
        workers: number of processes, by default one a core; 1: this process itself. It belongs to
            processes that are started here.

    Raises StudyError if Dask is not installed or the scheduler does not answer.
    """
    count = workers or len(os.sched_getaffinity(0))
    if not scheduler:
        used: Engine = Engine(Here(), 1) if count == 1 else Processes(count)
        try:
            yield used
        finally:
            used.close()
        return
    with contextlib.ExitStack() as stack:
        used = _dask(scheduler, count, stack)
        stack.callback(used.close)
        yield used


def _dask(scheduler: str, count: int, stack: contextlib.ExitStack) -> DaskEngine:
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise StudyError("--scheduler needs Dask: pip install '.[scale]'") from None
    stack.enter_context(_silent())
    address: Any = scheduler
    if scheduler == LOCAL:
        address = LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=None)
        stack.enter_context(address)
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise StudyError(f"the scheduler {scheduler} does not answer: {error}") from None
    if not client.ncores():
        with contextlib.suppress(Exception):
            client.wait_for_workers(1, timeout=PATIENCE)
        if not client.ncores():
            client.close()
            raise StudyError(f"the scheduler {scheduler} has no worker")
    return DaskEngine(client, scheduler if scheduler != LOCAL else client.scheduler.address)


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Silence Dask's log: a death of a worker or of the scheduler is a page of tracebacks in it.

    What it means for a study is a result or the text of an error.
    """
    loggers = [logging.getLogger(name) for name in ("distributed", "tornado.application")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
