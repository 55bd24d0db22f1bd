"""Cost of a task: a run of a sweep, a recording of an archive; one process against two."""

from __future__ import annotations

import dataclasses
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cylconn_ros.bench.common.results import Findings, Measurement, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Spread, run_interleaved
from cylconn_ros.bench.nodes import replay_cost
from cylconn_ros.bench.step_cost.kernel import step_cases
from cylconn_ros.scene.multiple import ONE
from cylconn_ros.scene.resources import shipped
from cylconn_ros.scene.scene import load_all
from cylconn_ros.study.archive.bags import PATH
from cylconn_ros.study.archive.tasks import IdentifyTask, InfoTask, LawsTask, ReplayTask
from cylconn_ros.study.chunk import compute, resident
from cylconn_ros.study.executors import Engine, Here, Processes
from cylconn_ros.study.outputs import DEFAULT
from cylconn_ros.study.rows import Rows, axis_of, combine
from cylconn_ros.study.sweep import Simulation
from cylconn_ros.study.variants import Variants

TASK, ROW, MEMORY = "cost of a task", "CPU time", "memory"
PROCESSES = "one process against two"
RUN = "run of the demo, 1 s at 1 ms, {} outputs"
GROUP = "run of the drawer on two rails, 1 s at 1 ms"
SCENE = "of a run: its scene, made and checked"
SAMPLES = 1000  # of the recording: 1 s
LIMIT = 1.0 / 1.8  # of the time with two processes over that with one
_MEGABYTE = 1e-6


def measure(settings: Settings) -> Findings:
    """Cost of tasks, then the wall time of the same runs in one and in two processes."""
    found = Findings()
    rounds, repeats = (2, 2) if settings.quick else (9, 20)
    samples = 100 if settings.quick else SAMPLES
    with tempfile.TemporaryDirectory() as folder:
        works = _works(settings, Path(folder), samples)
        for work in works.values():
            work()  # compiles
        before = resident()
        turns = run_interleaved({name: _timed(one, repeats) for name, one in works.items()}, rounds)
        for name, values in turns.items():
            found.measurements.append(
                Measurement.of(TASK, name, ROW, Spread.of(values), "ms", scale=1e3)
            )
        for subject, value in (
            ("after the first task of each", before),
            ("at the end", resident()),
        ):
            found.measurements.append(Measurement(TASK, subject, MEMORY, value * _MEGABYTE, "MB"))
    found.add(_two_processes(settings))
    return found


def _timed(work: Callable[[], object], repeats: int) -> Callable[[], float]:
    """A function that returns the CPU time of one repetition, s."""

    def turn() -> float:
        begin = time.thread_time()
        for _ in range(repeats):
            work()
        return (time.thread_time() - begin) / repeats

    return turn


def _works(settings: Settings, folder: Path, samples: int) -> Mapping[str, Callable[[], object]]:
    """The tasks by name, as functions without arguments."""
    duration = 1e-3 * samples
    demo = Variants({ONE: settings.load("demo")})
    rails = Variants(load_all(shipped("drawer_on_two_rails")))
    row, own = {"friction.coefficient": 0.2}, {"left.friction.coefficient": 0.03}
    one, group = Simulation(demo, duration, DEFAULT), Simulation(rails, duration, DEFAULT)
    bag = {PATH: str(_recording(settings, folder / "run", samples))}
    return {
        RUN.format(len(one.outputs)): lambda: one(row),
        SCENE: lambda: demo.of(row),
        GROUP: lambda: group(own),
        "replay of a recording of 1 s, compared": lambda: _done(ReplayTask(), bag),
        "identification of it": lambda: _done(IdentifyTask(), bag),
        "its laws checked": lambda: _done(LawsTask(), bag),
        "its summary": lambda: _done(InfoTask(), bag),
    }


def _done(task: Any, row: Mapping[str, Any]) -> Any:
    return task(row)


def _recording(settings: Settings, path: Path, samples: int) -> Path:
    """Record the sleeve on a shaft, inputs and outputs; ``samples`` of it."""
    case = step_cases(dataclasses.replace(settings, quick=False))[0]
    return replay_cost.record(path, case, case.scene, 3 * samples, True)


def _two_processes(settings: Settings) -> Findings:
    """Wall time of the same runs in one process and in two, in turns, and their ratio."""
    rounds, count = (2, 4) if settings.quick else (7, 400)
    task = Simulation(Variants({ONE: settings.load("demo")}), 1.0, DEFAULT)
    rows = combine([axis_of("friction.coefficient", np.linspace(0.1, 0.5, count).tolist())])
    engines = {"one process": Engine(Here(), 1), "two processes": Processes(2)}
    try:
        for engine in engines.values():
            _all(engine, task, rows)  # the processes begin
        walls = run_interleaved(
            {name: _wall(one, task, rows) for name, one in engines.items()}, rounds
        )
    finally:
        for engine in engines.values():
            engine.close()
    found = Findings()
    for name, values in walls.items():
        found.measurements.append(
            Measurement.of(
                PROCESSES, name, "time of a run", Spread.of(values), "ms", scale=1e3 / count
            )
        )
    share = np.array(walls["two processes"]) / np.array(walls["one process"])
    found.targets.append(
        Target("wall time of two processes over that of one", float(np.median(share)), LIMIT, "1")
    )
    return found


def _wall(engine: Engine, task: Simulation, rows: Rows) -> Callable[[], float]:
    def turn() -> float:
        begin = time.perf_counter()
        _all(engine, task, rows)
        return time.perf_counter() - begin

    return turn


def _all(engine: Engine, task: Simulation, rows: Rows) -> None:
    """Compute all rows in eight chunks, as a sweep does."""
    size = max(len(rows) // 8, 1)
    firsts = range(0, len(rows), size)
    pending = [engine.submit(compute, task, k, rows.part(k, k + size)) for k in firsts]
    for future in pending:
        future.result()
