"""Time from process start to the first step, with a cold and a warm compile cache."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from cylconn_ros.bench.common.results import Findings, Measurement, NotMeasured, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Spread, run_interleaved
from cylconn_ros.bench.step_cost import kernel
from cylconn_ros.bench.step_cost.worker import Worker
from cylconn_ros.core.jit import COMPILED

CASE = "start to first step"
COLD, WARM, NOT_COMPILED = "cold compile cache", "warm compile cache", "plain Python"
WALL, CPU = "wall time", "CPU time"
LIMIT = 2.0  # s


def measure(settings: Settings) -> Findings:
    """One cold start, because compiling is slow; several warm starts and starts of plain Python."""
    found = Findings()
    case = kernel.step_cases(settings)[0]
    starts: dict[str, list[tuple[float, float]]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        start = partial(_start, *kernel.write(case.scene, case.samples[:1], folder))
        turns: dict[str, Callable[[], tuple[float, float]]] = {}
        if not COMPILED:
            reason = "the compiler is not installed"
            found.not_measured.append(NotMeasured(CASE, WARM, "not installed", reason))
        elif settings.quick:
            reason = "compiling takes too long for --quick"
            found.not_measured.append(NotMeasured(CASE, COLD, "skipped", reason))
            start()  # compiles if the user's cache is cold
            turns[WARM] = start
        else:
            cached = partial(start, CYLCONN_CACHE_DIR=str(folder / "cache"))
            starts[COLD] = [cached()]
            turns[WARM] = cached
        turns[NOT_COMPILED] = partial(start, CYLCONN_NO_COMPILER="1")
        starts.update(run_interleaved(turns, settings.starts))
    for subject, times in starts.items():
        for quantity, seconds in zip((WALL, CPU), zip(*times, strict=True), strict=True):
            spread = Spread.of(seconds)
            found.measurements.append(Measurement.of(CASE, subject, quantity, spread, "s"))
    value = found.value(CASE, WARM, WALL)
    found.targets.append(Target(f"{CASE}, {WARM}", value, LIMIT, "s"))
    return found


def _start(scene: Path, samples: Path, **environment: str) -> tuple[float, float]:
    """Wall time and CPU time (s) of one start."""
    with Worker(scene, samples, environment) as worker:
        if worker.first["status"]:
            raise RuntimeError(f"the first step has status {worker.first['status']}")
        return worker.wall, float(worker.first["cpu"])
