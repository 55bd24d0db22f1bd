"""Orders of convergence and cost per step of every method.

Each method runs in the closed loop with the exact plant; only its wrench acts on the bodies. The
order is the slope of log(error) over log(period), fitted over all periods at which the method is
stable.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cylconn_ros.bench.common import report
from cylconn_ros.bench.common.errors import NotApplicableError
from cylconn_ros.bench.common.methods import METHODS, with_method, with_period
from cylconn_ros.bench.common.results import STEP, Errors, Findings, Measurement, NotMeasured
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Spread, time_interleaved, timed
from cylconn_ros.bench.convergence.cases import (
    ConvergenceCase,
    convergence_case,
    convergence_cases,
)
from cylconn_ros.bench.step_cost.kernel import Batch
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.simulation.simulate import simulate

PERIODS = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4)
SHOWN_PERIOD = 1e-3  # s; the table shows the errors at this period
ROUNDING = 1e-12  # errors below this are rounding errors and have no order
DIVERGED = 10.0  # m, s or rad; a method with a larger error has failed
FIT_POINTS = 5  # smallest number of periods in a fit
ORDER, ERROR = "order", "error"


def measure(settings: Settings) -> Findings:
    """All cases with all methods; the quick form has one case."""
    found = Findings()
    periods = PERIODS[:FIT_POINTS] if settings.quick else PERIODS
    quick = [convergence_case(settings.load, "slide_and_spin")] if settings.quick else None
    for case in quick or convergence_cases(settings.load):
        connectors = {}
        for method in METHODS:
            try:
                found.add(convergence(case, method, periods))
                scene = with_method(with_period(case.scene, SHOWN_PERIOD), method)
                connectors[method] = Connector(scene)
            except NotApplicableError as reason:
                found.not_measured.append(
                    NotMeasured(case.name, method, "not applicable", str(reason))
                )
        found.add(_step_costs(case, connectors, settings))
    return found


def convergence(case: ConvergenceCase, method: str, periods: Sequence[float]) -> Findings:
    """Errors over the periods, and the fitted orders. Raises NotApplicableError."""
    found = Findings()
    errors: dict[float, Errors] = {}
    for h in periods:
        scene = with_method(with_period(case.scene, h), method)
        with np.errstate(all="ignore"):  # an unstable method overflows; its errors show it
            errors[h] = case.errors(simulate(scene, samples=round(case.duration / h) + 1))
    for quantity, (_, unit) in errors[periods[0]].items():
        sizes = [errors[h][quantity][0] for h in periods]
        if all(math.isnan(size) for size in sizes):
            continue
        for h, size in zip(periods, sizes, strict=True):
            note = "" if is_stable(size) else "failed"
            found.measurements.append(
                Measurement(
                    case.name, method, f"{ERROR}: {quantity}", size, unit,
                    settings={"period": h}, note=note,
                )
            )  # fmt: skip
        order, note = fit_order(periods, sizes)
        found.measurements.append(
            Measurement(case.name, method, f"{ORDER}: {quantity}", order, "1", note=note)
        )
    return found


def is_stable(error: float) -> bool:
    """Whether an error is finite and below DIVERGED."""
    return math.isfinite(error) and error < DIVERGED


def fit_order(periods: Sequence[float], errors: Sequence[float]) -> tuple[float, str]:
    """The order and a note; NaN if no order can be fitted."""
    pairs = [(h, e) for h, e in zip(periods, errors, strict=True) if is_stable(e)]
    failed = len(periods) - len(pairs)
    note = f"failed at {failed} of {len(periods)} periods" if failed else ""
    if pairs and max(e for _, e in pairs) <= ROUNDING:
        return math.nan, "; ".join(filter(None, ("exact", note)))
    pairs = [(h, e) for h, e in pairs if e > ROUNDING]
    if len(pairs) < FIT_POINTS:
        return math.nan, note or "too few errors above rounding"
    h, e = np.log(np.array(pairs)).T
    return float(np.polyfit(h, e, 1)[0]), note


def _step_costs(
    case: ConvergenceCase, connectors: dict[str, Connector], settings: Settings
) -> Findings:
    """CPU time of a step in a batch; all methods process the same samples, in turns."""
    scene = with_period(case.scene, SHOWN_PERIOD)
    run = simulate(scene, samples=min(1000, round(case.duration / SHOWN_PERIOD)))
    samples = np.zeros((len(run.time), layout.NSAMPLE))
    samples[:, layout.MOTION] = run.states
    blocks = {name: timed(Batch(one, samples)) for name, one in connectors.items()}
    times = time_interleaved(blocks, settings.rounds, settings.block)
    return Findings(
        measurements=[
            Measurement.of(case.name, name, STEP, Spread.of(values), "µs", scale=1e6)
            for name, values in times.items()
        ]
    )


def text(found: Findings) -> str:
    """Table of orders, errors at SHOWN_PERIOD, and costs: one column per method."""
    methods = list(dict.fromkeys(m.subject for m in found.measurements))
    rows: dict[tuple[str, str], dict[str, str]] = {}
    errors = {
        (m.case, m.quantity.removeprefix(f"{ERROR}: "), m.subject): m
        for m in found.measurements
        if m.settings.get("period") == SHOWN_PERIOD
    }
    for m in found.measurements:
        if m.quantity == STEP:
            rows.setdefault((m.case, STEP), {})[m.subject] = report.number(m.value, m.unit)
        elif m.quantity.startswith(f"{ORDER}: "):
            quantity = m.quantity.removeprefix(f"{ORDER}: ")
            error = errors[m.case, quantity, m.subject]
            order = "" if math.isnan(m.value) else f"order {m.value:.1f}"
            size = f"{error.value:.0e} {error.unit}"
            cell = "; ".join(filter(None, (order, m.note, size)))
            rows.setdefault((m.case, quantity), {})[m.subject] = cell
    body = [
        (case, quantity, *(row.get(method, "") for method in methods))
        for (case, quantity), row in rows.items()
    ]
    return report.table(("scene", "quantity", *methods), body)
