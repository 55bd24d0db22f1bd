"""Results of a precision benchmark for people: who comes how near for how much."""

from __future__ import annotations

from collections.abc import Sequence

from cylconn_ros.bench.common import report
from cylconn_ros.bench.common.results import Findings
from cylconn_ros.bench.peers.registry import CONTESTANTS
from cylconn_ros.bench.precision import pareto
from cylconn_ros.bench.precision.cases import CASES
from cylconn_ros.bench.precision.pareto import Point

BUDGETS = (1.0, 10.0)  # ms of CPU per simulated second
FAILED, DEARER, NONE = "✗", "–", ""


def tables(found: Findings) -> str:
    """The scenes, and the least error of everybody within budgets of CPU time."""
    problems = list(dict.fromkeys(m.problem for m in found.measurements))
    parts = [scenes(problems)]
    for budget in BUDGETS:
        parts.append(
            f"**Least error (m) within {budget:g} ms of CPU time per simulated second**\n\n"
            + within(found, problems, budget)
        )
    return "\n\n".join(parts)


def scenes(problems: Sequence[str]) -> str:
    """What is solved; ◆ where friction depends on reactions that change."""
    rows = []
    for k, name in enumerate(problems):
        case = CASES[name]
        rows.append(
            (
                str(k + 1), f"`{name}`", case.title + (" ◆" if case.reactive else ""), case.matters,
                f"{case.duration:g} s", case.source,
            )
        )  # fmt: skip
    return report.table(("", "scene", "what happens", "error of", "for", "answer"), rows)


def within(found: Findings, problems: Sequence[str], budget: float) -> str:
    """A row a contestant, a column a scene."""
    points = {name: pareto.points(found, name) for name in problems}
    taking_part = {p.contestant for every in points.values() for p in every}
    rows = []
    for name in CONTESTANTS:
        if name in taking_part:
            own = [[p for p in points[problem] if p.contestant == name] for problem in problems]
            rows.append((name, *(cell(each, budget) for each in own)))
    return report.table(("", *(str(k + 1) for k in range(len(problems)))), rows)


def cell(own: Sequence[Point], budget: float) -> str:
    """Least error within the budget; a cross where all failed, a dash where all are dearer."""
    if not own:
        return NONE
    cheap = [p for p in own if p.cost <= budget]
    good = pareto.usable(cheap)
    if good:
        error = min(p.error for p in good)
        return "exact" if error <= 1e-14 else f"{error:.0e}"
    if any(p.failed for p in cheap) or all(p.failed for p in own):
        return FAILED
    return DEARER


def failed(found: Findings) -> str:
    """What failed, a row a set-up on a scene: how many of its points, and how."""
    rows = []
    for problem in dict.fromkeys(m.problem for m in found.measurements):
        every = pareto.points(found, problem)
        for name in dict.fromkeys(p.contestant for p in every if p.failed):
            own = [p for p in every if p.contestant == name]
            lost = [p for p in own if p.failed]
            reasons = "; ".join(dict.fromkeys(p.failed for p in lost))
            rows.append((problem, name, f"{len(lost)} of {len(own)}", reasons))
    head = ("scene", "set-up", "points that failed", "how")
    return report.table(head, rows) if rows else ""


def body(found: Findings) -> str:
    """All tables but the targets."""
    return "\n\n".join(filter(None, [tables(found), failed(found)]))
