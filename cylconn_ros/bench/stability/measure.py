"""Measurement of the stability map: every grade of every condition with every solver."""

from __future__ import annotations

import multiprocessing
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass

from cylconn_ros.bench.common.errors import NotApplicableError, NotInstalledError
from cylconn_ros.bench.common.results import Findings, Measurement, NotMeasured, merge_cases
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.stability.conditions import Case, conditions
from cylconn_ros.bench.stability.criteria import Laws, Verdict, evaluate
from cylconn_ros.bench.stability.solvers import Solver, solvers

SURVIVED = "survived"
QUICK = ("impulse", "baumgarte", "penalty")
PROCESSES = 2

Progress = Callable[[int, int], None]
Task = tuple[str, str]
"""Names of a condition and a solver."""


@dataclass(frozen=True)
class Cell:
    """Results of one solver under one condition.

    Attributes
    ----------
        verdicts: by grade, in order; empty if the condition was not measured.
        not_measured: the reason for that.
    """

    condition: str
    solver: str
    verdicts: dict[str, Verdict]
    not_measured: NotMeasured | None = None


def measure(
    settings: Settings, progress: Progress | None = None, laws: Laws | None = None
) -> Findings:
    """Measure the map; the quick form has the easiest and the hardest grade and three solvers.

    ``laws``: check of the methods' outputs; a module's function, since it is sent to processes.
    """
    found = Findings()
    for cell in run(settings.quick, progress, laws):
        found.measurements += _measurements(cell)
        if cell.not_measured is not None:
            found.not_measured.append(cell.not_measured)
    found.not_measured = merge_cases(found.not_measured, "; ")
    return found


def run(quick: bool, progress: Progress | None = None, laws: Laws | None = None) -> list[Cell]:
    """Run every cell; return them in the order of rows and columns."""
    names = [solver.name for solver in solvers() if not quick or solver.name in QUICK]
    tasks = [(condition.name, name) for condition in conditions() for name in names]
    done: dict[tuple[str, str], Cell] = {}
    for cell in _in_sequence(tasks, laws) if quick else _in_parallel(tasks, laws):
        done[cell.condition, cell.solver] = cell
        if progress is not None:
            progress(len(done), len(tasks))
    return [done[task] for task in tasks]


def _in_sequence(tasks: Sequence[Task], laws: Laws | None) -> Iterator[Cell]:
    for task in tasks:
        yield run_cell(*task, laws, ends_only=True)


def _in_parallel(tasks: Sequence[Task], laws: Laws | None) -> Iterator[Cell]:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(PROCESSES, context) as pool:
        for future in as_completed([pool.submit(run_cell, *task, laws) for task in tasks]):
            yield future.result()


def run_cell(
    condition: str, solver: str, laws: Laws | None = None, ends_only: bool = False
) -> Cell:
    """Run one cell; ``ends_only``: only the easiest and the hardest grade."""
    row = next(one for one in conditions() if one.name == condition)
    column = next(one for one in solvers() if one.name == solver)
    cases = row.cases()
    if ends_only and row.series:
        cases = [cases[0], cases[-1]]
    try:
        verdicts = {case.grade: verdict(column, case, laws) for case in cases}
    except NotInstalledError as reason:
        missing = NotMeasured(condition, solver, "not installed", str(reason))
    except NotApplicableError as reason:
        missing = NotMeasured(condition, solver, "not applicable", str(reason))
    else:
        return Cell(condition, solver, verdicts)
    return Cell(condition, solver, {}, missing)


def verdict(solver: Solver, case: Case, laws: Laws | None = None) -> Verdict:
    """The verdict on a run, or the best one of several set-ups."""
    found: list[Verdict] = []
    for simulate in solver.setups:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # overflow fails the criteria
            try:
                trace = simulate(case.scene, case.faults)
                found.append(evaluate(case.scene, trace, case.end, laws))
            except RuntimeError as error:
                found.append(Verdict(str(error)))
        if found[-1].survived:
            return found[-1]
    return found[0]


def _measurements(cell: Cell) -> Iterator[Measurement]:
    for grade, v in cell.verdicts.items():
        numbers = (
            (SURVIVED, float(v.survived), "1"),
            ("worst offset", v.offset, "m"),
            ("worst angle", v.angle, "rad"),
            ("energy gained", v.energy, "1"),
            ("slip at the end", v.slip, "m/s"),
        )
        for quantity, value, unit in numbers:
            yield Measurement(
                cell.condition, cell.solver, quantity, value, unit,
                settings={"grade": grade}, note=v.failure if quantity == SURVIVED else "",
            )  # fmt: skip
