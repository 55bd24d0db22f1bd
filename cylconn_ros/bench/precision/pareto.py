"""Fronts of work and precision, and whether another's point dominates ours.

A point is (cost, error). Errors below ``floor`` are rounding, and equal; costs within ``SAME`` of
each other are equal.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from cylconn_ros.bench.common.results import Findings, Target
from cylconn_ros.bench.peers.registry import CONTESTANTS
from cylconn_ros.bench.precision.cases import CASES, PLACE
from cylconn_ros.bench.precision.trials import COST

FLOORS = {"closed form": 1e-13}
REFERENCE_FLOOR = 2e-11  # m, of what DOP853 at 1e-12 leaves
SAME = 1.1  # of a cost: no more than the clock's own spread
HUNDREDTH = 1e-2


@dataclass(frozen=True)
class Point:
    """One set-up on one scene; ``failed`` says why its answer is worth nothing.

    ``low``, ``high``: quartiles of the cost, NaN where it was taken once.
    """

    contestant: str
    value: float
    cost: float
    error: float
    failed: str = ""
    low: float = math.nan
    high: float = math.nan


def floor(problem: str) -> float:
    """Below which errors on a scene mean nothing, m."""
    return FLOORS.get(CASES[problem].source, REFERENCE_FLOOR)


def points(found: Findings, problem: str) -> list[Point]:
    """All set-ups measured on a scene, failed ones with them."""
    keyed: dict[tuple[str, float], dict[str, float | str]] = {}
    for m in found.measurements:
        if m.problem == problem and m.quantity in (PLACE, COST):
            value = float(next(iter(m.settings.values())))
            row = keyed.setdefault((m.contestant, value), {"failed": m.note})
            row[m.quantity] = m.value
            if m.quantity == COST:
                row["low"], row["high"] = m.low, m.high
    return [
        Point(
            name,
            value,
            float(row[COST]),
            float(row[PLACE]),
            str(row["failed"]),
            float(row["low"]),
            float(row["high"]),
        )
        for (name, value), row in keyed.items()
        if COST in row and PLACE in row
    ]


def usable(found: Iterable[Point]) -> list[Point]:
    """Those with an answer and a time."""
    return [p for p in found if not p.failed and math.isfinite(p.cost) and math.isfinite(p.error)]


def front(found: Iterable[Point], rounding: float = 0.0) -> list[Point]:
    """Those that nobody else here beats in both, by cost; errors up to ``rounding`` are equal."""
    best, least = [], math.inf
    for p in sorted(usable(found), key=lambda p: (p.cost, p.error)):
        error = max(p.error, rounding)
        if error < least:
            best.append(p)
            least = error
    return best


def kind(point: Point) -> str:
    """Ours, simulator or hand."""
    return CONTESTANTS[point.contestant].kind


def at_equal_cost(ours: Sequence[Point], theirs: Point, least: float) -> float:
    """Our least error at no more than the cost of one of theirs, over its error.

    NaN where nothing of ours is as cheap.
    """
    errors = [max(p.error, least) for p in ours if p.cost <= SAME * theirs.cost]
    if not errors:
        return math.nan
    return min(errors) / max(theirs.error, least)


def dominating(ours: Sequence[Point], theirs: Iterable[Point], least: float) -> list[Point]:
    """Theirs that are cheaper and nearer than a point of our front, beyond doubt in one of both."""
    found = []
    for q in theirs:
        for p in ours:
            cost, error = p.cost / q.cost, max(p.error, least) / max(q.error, least)
            if cost >= 1.0 and error >= 1.0 and (cost > SAME or error > SAME):
                found.append(q)
                break
    return found


def _nearest(
    ours: Sequence[Point], theirs: Sequence[Point], least: float
) -> tuple[float, Point | None, int]:
    """The worst ratio at equal cost over their front, whose it is, and how many cost too little."""
    ratios = [(at_equal_cost(ours, q, least), q) for q in front(theirs)]
    compared = [pair for pair in ratios if not math.isnan(pair[0])]
    worst, who = max(compared, key=lambda pair: pair[0], default=(math.nan, None))
    return worst, who, len(ratios) - len(compared)


def targets(found: Findings) -> list[Target]:
    """Scene by scene: our error at equal cost over the best simulator's, and who dominates us."""
    aims = []
    for problem in dict.fromkeys(m.problem for m in found.measurements):
        every = points(found, problem)
        least, limit = floor(problem), HUNDREDTH if CASES[problem].reactive else 1.0
        ours = front((p for p in every if kind(p) == "ours"), least)
        simulators = [p for p in every if kind(p) == "simulator"]
        worst, who, cheaper = _nearest(ours, simulators, least)
        note = f"against {who.contestant} at {who.value:g}" if who else "no simulator's answer"
        if who and worst > limit and max(who.error, least) <= least / limit:
            note += f"; both near rounding ({least:g} m)"
        if cheaper:
            note += f"; {cheaper} of theirs are cheaper than any of ours"
        if who and worst > limit and not who.contestant.endswith("loop"):
            loops = [p for p in simulators if p.contestant.endswith("loop")]
            note += f"; over loops alone {_nearest(ours, loops, least)[0]:.2e}"
        aims.append(
            Target(
                f"{problem}: our error at equal CPU, over the best simulator's", worst, limit, "",
                note,
            )
        )  # fmt: skip
        others = front(p for p in every if kind(p) != "ours")
        above = dominating(ours, others, least)
        note = ", ".join(f"{p.contestant} at {p.value:g}" for p in above)
        aims.append(Target(f"{problem}: others' points that dominate ours", len(above), 0.0, "",
                           note))  # fmt: skip
    return aims
