"""Tables of a precision benchmark: cases, least errors within a CPU time, failures."""

from __future__ import annotations

from collections.abc import Sequence

from cylconn_ros.bench.common import report
from cylconn_ros.bench.common.results import Findings
from cylconn_ros.bench.peers.registry import SOLVERS
from cylconn_ros.bench.precision import pareto
from cylconn_ros.bench.precision.cases import CASES
from cylconn_ros.bench.precision.pareto import Point

BUDGETS = (1.0, 10.0)  # ms of CPU time per simulated second
FAILED, TOO_SLOW, NO_RESULT = "✗", "–", ""


def tables(found: Findings) -> str:
    """The cases, and the least error of every solver within each budget of CPU time."""
    names = list(dict.fromkeys(m.case for m in found.measurements))
    parts = [case_table(names)]
    for budget in BUDGETS:
        parts.append(
            f"**Least error (m) within {budget:g} ms of CPU time per simulated second**\n\n"
            + within(found, names, budget)
        )
    return "\n\n".join(parts)


def case_table(names: Sequence[str]) -> str:
    """The cases; ◆ marks friction that depends on changing reactions."""
    rows = []
    for k, name in enumerate(names):
        case = CASES[name]
        title = case.title + (" ◆" if case.reaction_dependent else "")
        duration = f"{case.duration:g} s"
        published = f"{case.published[0]}: {case.published[1]:.1e} m" if case.published else ""
        row = str(k + 1), f"`{name}`", title, case.error_of, duration, case.source, published
        rows.append(row)
    head = ("", "scene", "motion", "error of", "duration", "reference", "published result")
    return report.table(head, rows)


def within(found: Findings, names: Sequence[str], budget: float) -> str:
    """Least errors within a budget: one row per solver, one column per case."""
    points = {case: pareto.points(found, case) for case in names}
    measured = {p.solver for every in points.values() for p in every}
    rows = []
    for name in SOLVERS:
        if name in measured:
            own = [[p for p in points[case] if p.solver == name] for case in names]
            rows.append((name, *(cell(each, budget) for each in own)))
    return report.table(("", *(str(k + 1) for k in range(len(names)))), rows)


def cell(own: Sequence[Point], budget: float) -> str:
    """Least error within the budget; a cross if all points failed, a dash if all are too slow."""
    if not own:
        return NO_RESULT
    cheap = [p for p in own if p.cost <= budget]
    good = pareto.usable(cheap)
    if good:
        error = min(p.error for p in good)
        return "exact" if error <= 1e-14 else f"{error:.0e}"
    if any(p.failed for p in cheap) or all(p.failed for p in own):
        return FAILED
    return TOO_SLOW


def failed(found: Findings) -> str:
    """Failures: one row per solver and case, with the number of failed points and the reasons."""
    rows = []
    for case in dict.fromkeys(m.case for m in found.measurements):
        every = pareto.points(found, case)
        for name in dict.fromkeys(p.solver for p in every if p.failed):
            own = [p for p in every if p.solver == name]
            failures = [p for p in own if p.failed]
            reasons = "; ".join(dict.fromkeys(p.failed for p in failures))
            rows.append((case, name, f"{len(failures)} of {len(own)}", reasons))
    head = ("scene", "solver", "failed points", "reasons")
    return report.table(head, rows) if rows else ""


def body(found: Findings) -> str:
    """All tables except the targets."""
    return "\n\n".join(filter(None, [tables(found), failed(found)]))
