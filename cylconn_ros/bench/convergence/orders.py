"""Orders of convergence, and costs, of every method on a handful of problems.

In the closed loop with the exact plant, only the wrench going out. The order is the slope of
log(error) over log(period), fitted over all periods at which the method survives.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cylconn_ros.bench.common.errors import LeftOutError
from cylconn_ros.bench.common.methods import METHODS, available, served_by, with_period
from cylconn_ros.bench.common.results import STEP, Findings, Gap, Measurement
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Contestant, Spread, take_turns, timed
from cylconn_ros.bench.convergence.problems import Problem, handful, problem
from cylconn_ros.bench.precision.trials import Errors
from cylconn_ros.bench.step_cost.kernel import Batch
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.simulation.simulate import simulate

PERIODS = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4)
SHOWN = 1e-3  # s, the period whose errors stand in the table
EXACT = 1e-12  # errors below are rounding, and have no order
LOST = 10.0  # m, s or rad: a method that is this far off has failed
FEWEST = 5  # periods in a fit
ORDER, ERROR = "order", "error"


def measure(settings: Settings) -> Findings:
    """All problems with all methods."""
    found = Findings()
    for method in METHODS:
        if method not in available():
            found.gaps.append(Gap("every problem", method, "absent", "is not written yet"))
    periods = PERIODS[:FEWEST] if settings.quick else PERIODS
    chosen = [problem(settings.load, "slide_and_spin")] if settings.quick else None
    for each in chosen or handful(settings.load):
        connectors = {}
        for method in available():
            try:
                found.add(convergence(each, method, periods))
                connectors[method] = Connector(served_by(with_period(each.scene, SHOWN), method))
            except LeftOutError as reason:
                found.gaps.append(Gap(each.name, method, "left out", str(reason)))
        found.add(_costs(each, connectors, settings))
    return found


def convergence(case: Problem, method: str, periods: Sequence[float]) -> Findings:
    """Errors over the periods, and the fitted orders. Raises LeftOutError."""
    found = Findings()
    errors: dict[float, Errors] = {}
    for h in periods:
        scene = served_by(with_period(case.scene, h), method)
        with np.errstate(all="ignore"):  # a method may blow up here; its errors say so
            errors[h] = case.errors(simulate(scene, round(case.duration / h) + 1))
    for quantity, (_, unit) in errors[periods[0]].items():
        sizes = [errors[h][quantity][0] for h in periods]
        if all(math.isnan(size) for size in sizes):
            continue
        for h, size in zip(periods, sizes, strict=True):
            note = "" if survived(size) else "failed"
            found.measurements.append(
                Measurement(
                    case.name, method, f"{ERROR}: {quantity}", size, unit,
                    settings={"period": h}, note=note,
                )
            )  # fmt: skip
        slope, note = fitted(periods, sizes)
        found.measurements.append(
            Measurement(case.name, method, f"{ORDER}: {quantity}", slope, "1", note=note)
        )
    return found


def survived(error: float) -> bool:
    """Whether an error is one; beyond LOST, or not finite, the method has failed."""
    return math.isfinite(error) and error < LOST


def fitted(periods: Sequence[float], errors: Sequence[float]) -> tuple[float, str]:
    """The order and what is to be said about it; NaN where there is none to be fitted."""
    pairs = [(h, e) for h, e in zip(periods, errors, strict=True) if survived(e)]
    lost = len(periods) - len(pairs)
    note = f"failed at {lost} of {len(periods)} periods" if lost else ""
    if pairs and max(e for _, e in pairs) <= EXACT:
        return math.nan, "; ".join(filter(None, ("exact", note)))
    pairs = [(h, e) for h, e in pairs if e > EXACT]
    if len(pairs) < FEWEST:
        return math.nan, note or "too few errors above rounding"
    h, e = np.log(np.array(pairs)).T
    return float(np.polyfit(h, e, 1)[0]), note


def _costs(case: Problem, connectors: dict[str, Connector], settings: Settings) -> Findings:
    """CPU time of an answer in a batch, all methods on the same samples, in turns."""
    scene = with_period(case.scene, SHOWN)
    run = simulate(scene, min(1000, round(case.duration / SHOWN)))
    samples = np.zeros((len(run.time), layout.NSAMPLE))
    samples[:, layout.MOTION] = run.states
    contestants = [Contestant(n, timed(Batch(c, samples))) for n, c in connectors.items()]
    times = take_turns(contestants, settings.rounds, settings.block)
    return Findings(
        measurements=[
            Measurement.of(case.name, name, STEP, Spread.of(values), "µs", scale=1e6)
            for name, values in times.items()
        ]
    )
