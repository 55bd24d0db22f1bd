"""Run the grid: every condition's grades, every contestant."""

from __future__ import annotations

import multiprocessing
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass

from cylconn_ros.bench.common.errors import AbsentError, LeftOutError
from cylconn_ros.bench.common.results import Findings, Gap, Measurement
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.stability.conditions import Case, conditions
from cylconn_ros.bench.stability.criteria import Laws, Verdict, judge
from cylconn_ros.bench.stability.solvers import Contestant, contestants

SURVIVED = "survived"
QUICK = ("impulse", "baumgarte", "penalty")
PROCESSES = 2

Progress = Callable[[int, int], None]
Task = tuple[str, str]
"""Names of a condition and a contestant."""


@dataclass(frozen=True)
class Cell:
    """What became of one contestant under one condition.

    ``verdicts`` by grade, in order; empty where there is nothing to judge, with ``status`` "absent"
    or "left out" and ``reason``.
    """

    condition: str
    contestant: str
    verdicts: dict[str, Verdict]
    status: str = ""
    reason: str = ""


def measure(
    settings: Settings, progress: Progress | None = None, laws: Laws | None = None
) -> Findings:
    """The whole map; the quick form: the easiest and the hardest grade, few contestants.

    ``laws``: what else is asked of our methods' answers; a function of a module, for it travels.
    """
    found = Findings()
    for cell in run(settings.quick, progress, laws):
        found.measurements += _measurements(cell)
        if cell.status == "absent":
            found.gaps.append(Gap(cell.condition, cell.contestant, "absent", cell.reason))
        elif cell.status:
            found.gaps.append(Gap(cell.condition, cell.contestant, "left out", cell.reason))
    found.gaps = _joined(found.gaps)
    return found


def run(quick: bool, progress: Progress | None = None, laws: Laws | None = None) -> list[Cell]:
    """Every cell, in the order of rows and columns."""
    names = [c.name for c in contestants() if not quick or c.name in QUICK]
    tasks = [(row.name, name) for row in conditions() for name in names]
    done: dict[tuple[str, str], Cell] = {}
    for cell in _here(tasks, laws) if quick else _spread(tasks, laws):
        done[cell.condition, cell.contestant] = cell
        if progress is not None:
            progress(len(done), len(tasks))
    return [done[task] for task in tasks]


def _here(tasks: Sequence[Task], laws: Laws | None) -> Iterator[Cell]:
    for condition, contestant in tasks:
        yield tried(condition, contestant, laws, ends_only=True)


def _spread(tasks: Sequence[Task], laws: Laws | None) -> Iterator[Cell]:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(PROCESSES, context) as pool:
        for future in as_completed([pool.submit(tried, *task, laws) for task in tasks]):
            yield future.result()


def tried(
    condition: str, contestant: str, laws: Laws | None = None, ends_only: bool = False
) -> Cell:
    """One cell; ``ends_only``: the easiest and the hardest grade."""
    row = next(c for c in conditions() if c.name == condition)
    who = next(c for c in contestants() if c.name == contestant)
    cases = row.cases()
    if ends_only and row.series:
        cases = [cases[0], cases[-1]]
    verdicts = {}
    try:
        for case in cases:
            verdicts[case.grade] = outcome(who, case, laws)
    except AbsentError as reason:
        return Cell(condition, contestant, {}, "absent", str(reason))
    except LeftOutError as reason:
        return Cell(condition, contestant, {}, "left out", str(reason))
    return Cell(condition, contestant, verdicts)


def outcome(who: Contestant, case: Case, laws: Laws | None = None) -> Verdict:
    """The verdict on one run, or on the best of several set-ups."""
    found: list[Verdict] = []
    for move in who.moves:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # states of 1e200 are judged as such
            try:
                trace = move(case.scene, case.faults)
                found.append(judge(case.scene, trace, case.end, laws))
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
                cell.condition, cell.contestant, quantity, value, unit,
                settings={"grade": grade}, note=v.reason if quantity == SURVIVED else "",
            )  # fmt: skip


def _joined(gaps: Sequence[Gap]) -> list[Gap]:
    """One line for all conditions with the same reason."""
    rows: dict[tuple[str, str, str], list[str]] = {}
    for gap in gaps:
        rows.setdefault((gap.contestant, gap.status, gap.reason), []).append(gap.problem)
    return [
        Gap("; ".join(names), contestant, "absent" if status == "absent" else "left out", reason)
        for (contestant, status, reason), names in rows.items()
    ]
