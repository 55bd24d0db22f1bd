"""From the start of a fresh process to its first answer, with a cold and a warm compile cache."""

from __future__ import annotations

import tempfile
from pathlib import Path

from cylconn_ros.bench.common.results import Findings, Gap, Measurement, Target
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Spread
from cylconn_ros.bench.step_cost import kernel
from cylconn_ros.bench.step_cost.worker import Worker
from cylconn_ros.core.jit import COMPILED

PROBLEM = "start to first answer"
WALL, CPU = "wall time", "CPU time"
LIMIT = 2.0  # s


def measure(settings: Settings) -> Findings:
    """Cold once, as compiling takes long; warm several times. Plain Python for comparison."""
    found = Findings()
    stretch = kernel.stretches(settings)[0]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = kernel.write(stretch.scene, stretch.samples[:1], folder)

        def start(**environment: str) -> tuple[float, float]:
            with Worker(*files, environment) as worker:
                if worker.first["status"]:
                    raise RuntimeError("the first answer is not an answer")
                return worker.wall, float(worker.first["cpu"])

        def keep(contestant: str, starts: list[tuple[float, float]]) -> None:
            for quantity, seconds in zip((WALL, CPU), zip(*starts, strict=True), strict=True):
                spread = Spread.of(seconds)
                found.measurements.append(
                    Measurement.of(PROBLEM, contestant, quantity, spread, "s")
                )

        cache: dict[str, str] = {}
        if not COMPILED:
            found.gaps.append(Gap(PROBLEM, "compiled", "absent", "the compiler is not installed"))
        elif settings.quick:
            found.gaps.append(
                Gap(PROBLEM, "cold compile cache", "left out", "compiling is too long for --quick")
            )
            start()  # whatever the user's cache was, it is warm now
        else:
            cache = {"CYLCONN_CACHE_DIR": str(folder / "cache")}
            keep("cold compile cache", [start(**cache)])
        if COMPILED:
            keep("warm compile cache", [start(**cache) for _ in range(settings.starts)])
        plain = [start(CYLCONN_NO_COMPILER="1") for _ in range(settings.starts)]
        keep("plain Python", plain)
    warm = found.value(PROBLEM, "warm compile cache", WALL)
    found.targets.append(Target(f"{PROBLEM}, warm compile cache", warm, LIMIT, "s"))
    return found
