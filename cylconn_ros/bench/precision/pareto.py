"""Pareto fronts of error and CPU time, and the targets of the precision benchmark.

A point is (cost, error). Errors below the rounding error of the reference count as equal, and so do
costs within the factor SAME_COST.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from cylconn_ros.bench.common.results import Findings, Target
from cylconn_ros.bench.peers.registry import SOLVERS
from cylconn_ros.bench.precision.cases import CASES, CLOSED_FORM, ERROR, WITH_KINKS
from cylconn_ros.bench.precision.trials import COST

ROUNDING_CLOSED_FORM = 1e-13  # m
ROUNDING_INTEGRATED = 2e-11  # m, error of a reference computed by DOP853 with 1e-12
ROUNDING_WITH_KINKS = 1e-7  # m
SAME_COST = 1.1  # spread of the clock
LIMIT_REACTION_DEPENDENT = 1e-2  # of the error ratio if friction depends on changing reactions
SMALL_ERROR = 1e-10  # m
COST_LIMIT_SCIPY = 0.05  # minimal's CPU time over SciPy's
IMPULSE = "impulse"
MINIMAL, SCIPY, MUJOCO = "minimal", "SciPy DOP853", "MuJoCo RK4, constant"


@dataclass(frozen=True)
class Point:
    """One trial: cost in ms per simulated second, error in m.

    ``failed``: why its solution is not usable. ``low``, ``high``: quartiles of the cost, NaN if it
    was measured once.
    """

    solver: str
    value: float
    cost: float
    error: float
    failed: str = ""
    low: float = math.nan
    high: float = math.nan


def rounding(case: str) -> float:
    """The rounding error of the reference of a case, m."""
    sizes = {CLOSED_FORM: ROUNDING_CLOSED_FORM, WITH_KINKS: ROUNDING_WITH_KINKS}
    return sizes.get(CASES[case].source, ROUNDING_INTEGRATED)


def points(found: Findings, case: str) -> list[Point]:
    """All trials measured on a case, failed ones included."""
    trials: dict[tuple[str, float], dict[str, float | str]] = {}
    for m in found.measurements:
        if m.case == case and m.quantity in (ERROR, COST):
            value = float(next(iter(m.settings.values())))
            row = trials.setdefault((m.subject, value), {"failed": m.note})
            row[m.quantity] = m.value
            if m.quantity == COST:
                row["low"], row["high"] = m.low, m.high
    return [
        Point(
            name,
            value,
            float(row[COST]),
            float(row[ERROR]),
            str(row["failed"]),
            float(row["low"]),
            float(row["high"]),
        )
        for (name, value), row in trials.items()
        if COST in row and ERROR in row
    ]


def usable(found: Iterable[Point]) -> list[Point]:
    """The points with a solution and a time."""
    return [p for p in found if not p.failed and math.isfinite(p.cost) and math.isfinite(p.error)]


def front(found: Iterable[Point], least: float = 0.0) -> list[Point]:
    """Pareto front by increasing cost; errors up to ``least`` (m) count as equal."""
    best, lowest = [], math.inf
    for p in sorted(usable(found), key=lambda p: (p.cost, p.error)):
        error = max(p.error, least)
        if error < lowest:
            best.append(p)
            lowest = error
    return best


def kind(point: Point) -> str:
    """Kind of the solver: own, simulator or reduced."""
    return SOLVERS[point.solver].kind


def ratio_at_equal_cost(own: Sequence[Point], peer: Point, least: float) -> float:
    """Smallest own error at no more than the cost of a peer's point, over the peer's error.

    NaN if no own point is as cheap.
    """
    errors = [max(p.error, least) for p in own if p.cost <= SAME_COST * peer.cost]
    if not errors:
        return math.nan
    return min(errors) / max(peer.error, least)


def dominating(own: Sequence[Point], peers: Iterable[Point], least: float) -> list[Point]:
    """Peers' points that dominate an own point, by more than SAME_COST in cost or in error."""
    found = []
    for q in peers:
        for p in own:
            cost, error = p.cost / q.cost, max(p.error, least) / max(q.error, least)
            if cost >= 1.0 and error >= 1.0 and (cost > SAME_COST or error > SAME_COST):
                found.append(q)
                break
    return found


def worst_ratio(
    own: Sequence[Point], peers: Sequence[Point], least: float
) -> tuple[float, Point | None, int]:
    """Largest ratio at equal cost over the peers' front, its point, and how many were too cheap."""
    ratios = [(ratio_at_equal_cost(own, q, least), q) for q in front(peers)]
    compared = [pair for pair in ratios if not math.isnan(pair[0])]
    worst, point = max(compared, key=lambda pair: pair[0], default=(math.nan, None))
    return worst, point, len(ratios) - len(compared)


def cost_ratio(own: Sequence[Point], peers: Sequence[Point], error: float) -> float:
    """Least own cost to reach an error (m) over the peers' least cost; NaN if one does not."""

    def least(found: Sequence[Point]) -> float:
        costs = (p.cost for p in usable(found) if p.error <= error)
        return min(costs, default=math.nan)

    return least(own) / least(peers)


def targets(found: Findings) -> list[Target]:
    """The targets of every measured case."""
    aims = []
    for case in dict.fromkeys(m.case for m in found.measurements):
        aims += _front_targets(case, points(found, case))
    for case in dict.fromkeys(m.case for m in found.measurements):
        if CASES[case].events:
            aims.append(_fixed_step_target(case, points(found, case)))
    return aims + _minimal_targets(found)


def _front_targets(case: str, every: Sequence[Point]) -> list[Target]:
    """The own error at equal cost over the best simulator's, and the peers' dominating points."""
    limit = LIMIT_REACTION_DEPENDENT if CASES[case].reaction_dependent else 1.0
    least = rounding(case)
    own = front((p for p in every if kind(p) == "own"), least)
    simulators = [p for p in every if kind(p) == "simulator"]
    worst, point, cheaper = worst_ratio(own, simulators, least)
    note = f"against {point.solver} at {point.value:g}" if point else "no simulator has a solution"
    if point and worst > limit and max(point.error, least) <= least / limit:
        note += f"; both near rounding ({least:g} m)"
    if cheaper:
        note += f"; {cheaper} of the simulators' points are cheaper than all own points"
    if point and worst > limit and not point.solver.endswith("loop"):
        loops = [p for p in simulators if p.solver.endswith("loop")]
        note += f"; over loops alone {worst_ratio(own, loops, least)[0]:.2e}"
    peers = front(p for p in every if kind(p) != "own")
    above = dominating(own, peers, least)
    names = ", ".join(f"{p.solver} at {p.value:g}" for p in above)
    return [
        Target(f"{case}: own error over the best simulator's at equal CPU time", worst, limit, "",
               note),
        Target(f"{case}: peers' points that dominate own points", len(above), 0.0, "", names),
    ]  # fmt: skip


def _fixed_step_target(case: str, every: Sequence[Point]) -> Target:
    """``impulse`` alone among all solvers with fixed steps: points that dominate its front."""
    least = rounding(case)
    own = front((p for p in every if p.solver == IMPULSE), least)
    others = [p for p in every if kind(p) != "own" and SOLVERS[p.solver].parameter == "step"]
    above = dominating(own, front(others, least), least)
    names = ", ".join(f"{p.solver} at {p.value:g}" for p in above)
    name = f"{case}: points with fixed steps that dominate points of {IMPULSE}"
    return Target(name, len(above) if own and others else math.nan, 0.0, "", names)


def _minimal_targets(found: Findings) -> list[Target]:
    """``minimal`` beside SciPy on a coast, and beside MuJoCo's RK4 on two free bodies."""

    def of(case: str, solver: str) -> list[Point]:
        return [p for p in points(found, case) if p.solver == solver]

    measured = {m.case for m in found.measurements}
    aims = []
    if "slide_and_spin" in measured:
        own, peer = of("slide_and_spin", MINIMAL), of("slide_and_spin", SCIPY)
        name = f"slide_and_spin: CPU time of {MINIMAL} over that of {SCIPY}, to {SMALL_ERROR:g} m"
        value = cost_ratio(own, peer, SMALL_ERROR)
        aims.append(Target(name, value, COST_LIMIT_SCIPY, ""))
    if "free_flight" in measured:
        own, peer = of("free_flight", MINIMAL), of("free_flight", MUJOCO)
        name = f"free_flight: error of {MINIMAL} over that of {MUJOCO}, at equal CPU time"
        worst, point, _ = worst_ratio(own, peer, rounding("free_flight"))
        note = f"at a step of {point.value:g} s" if point else ""
        aims.append(Target(name, worst, 1.0, "", note))
    return aims
