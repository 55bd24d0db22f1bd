"""Check of the selection: outputs are the solutions that the rules select, solved by brute force.

An output has to be the solution that the rule selects for the active bounds that it reports. If
that solution is consistent with no set of active bounds, the output has to be the solution nearest
to stick; if that is consistent with none either, the solution of least traction. SEVERAL_ROOTS has
to be set if the output slips although stick is admissible. The restitution coefficient of an impact
has to be the largest for which the work of its impulses on slide and spin is not positive.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws import rigid
from cylconn_ros.laws.bounds import Bounds, bounds, driven, stop_sides
from cylconn_ros.laws.impulses import impulses
from cylconn_ros.laws.normalised import Block
from cylconn_ros.laws.parameters import Bools, Parameters, Table
from cylconn_ros.laws.predicted_end import prepare_step
from cylconn_ros.laws.reduced import WORST_CONDITION, Problem, problem_of
from cylconn_ros.laws.roots import least_traction, nearest_to_stick, select_solution
from cylconn_ros.laws.sample_state import SampleState, state_of
from cylconn_ros.laws.step import Step
from cylconn_ros.laws.stops import bounds_of

Array = NDArray[np.float64]
CLOSE = 1e-3  # relative difference of phi within one solution; the laws check its precision
Solve = Callable[[Problem, Sequence[Table]], Array]  # phi (n, 2)
SLIGHT = 1e-7  # resolution of work and coefficient, that of the solver's own search


@dataclasses.dataclass
class SelectionCheck:
    """Check of a block, (n,) each."""

    checked: Bools
    wrong: Bools  # the output is another solution, or none
    ambiguous: Bools  # rounding decides between solutions
    several: Bools  # more than one solution
    flag: Bools  # SEVERAL_ROOTS is wrong
    impacts: Bools  # impacts whose coefficient was checked
    restitution: Bools  # the coefficient is not the largest without a gain of energy


@dataclasses.dataclass
class SelectionSummary:
    """Counts over blocks, and the locations of the first failures."""

    samples: int = 0
    checked: int = 0
    wrong: int = 0
    ambiguous: int = 0
    several: int = 0
    flag: int = 0
    impacts: int = 0
    restitution: int = 0
    locations: list[str] = dataclasses.field(default_factory=list)

    @property
    def failures(self) -> int:
        """Number of wrong solutions, flags and coefficients."""
        return self.wrong + self.flag + self.restitution

    def add(self, found: SelectionCheck, *columns: NDArray[np.intp]) -> None:
        """Add a block; columns: numbers that name its rows."""
        self.samples += len(found.checked)
        self.checked += int(found.checked.sum())
        self.wrong += int(found.wrong.sum())
        self.ambiguous += int(found.ambiguous.sum())
        self.several += int(found.several.sum())
        self.flag += int(found.flag.sum())
        self.impacts += int(found.impacts.sum())
        self.restitution += int(found.restitution.sum())
        for row in np.flatnonzero(found.wrong | found.flag | found.restitution)[
            : 5 - len(self.locations)
        ]:
            self.locations.append("/".join(str(int(column[row])) for column in columns))


def check(block: Block) -> SelectionCheck:
    """Compare friction and restitution of a block's outputs with those that the rules select."""
    p, out, tables = block.parameters, block.out, block.tables
    o = state_of(p, block.sample, block.past)
    s = prepare_step(p, o, block.sample)
    b = bounds_of(block, o, s)
    held, rests = np.asarray(b.held(out)), b.rests(out)
    upper = (stop_sides(out) > 0.0) & ~b.bilateral
    q = problem_of(p, o, s, held, np.where(upper, b.high, b.low), rests)
    unit = np.stack([np.ones_like(p.radius), p.radius], axis=1)
    moved = held & ~rests
    q.free_size += np.where(moved, unit * np.where(upper, b.high_size, b.low_size), 0.0)
    values = np.linalg.eigvalsh(q.s)
    rows = p.on & (q.condition < WORST_CONDITION) & ~b.ambiguous & ~driven(p, b).any(axis=1)
    even = values[:, 0] > values[:, 1] / (100.0 * WORST_CONDITION)
    rows &= even | held.any(axis=1)
    rows &= ~rests.all(axis=1)  # friction has no share there: the law of stops
    rows &= ~(b.followed & (b.impact != 0.0)).any(axis=1)  # that of the impact
    rows &= out[:, layout.FLAGS].astype(np.int64) & layout.NOT_CONVERGED == 0
    index = np.flatnonzero(rows)
    q = q.take(index)
    given = out[index][:, [layout.FORCE_FRICTION, layout.MOMENT_FRICTION]]
    given[:, 1] /= q.parameters.radius
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found = select_solution(q, tables)
        differs = _differs(given, found.phi)
        # another solution is right if those before it are consistent with no set of bounds
        others = np.flatnonzero(differs & ~found.ambiguous & p.bounded[index])
        before: list[Solve] = [_selected]
        for solve in (nearest_to_stick, least_traction):
            others = others[differs[others]]
            same = others[~_differs(given[others], solve(q.take(others), tables))]
            sub = index[same]
            bound = _all_bounds(block, o, s, sub)
            these = (p.take(sub), tables, o.take(sub), s.take(sub), bound)
            differs[same] = np.any([_is_consistent(*these, rule) for rule in before], axis=0)
            differs[same] &= ~bound.ambiguous
            before.append(solve)
    slips = out[index, layout.REGIME] == layout.SLIP
    flagged = out[index, layout.FLAGS].astype(np.int64) & layout.SEVERAL_ROOTS != 0
    free = ~np.asarray(held[index].any(axis=1))
    wrong_flag = free & (flagged != (slips & found.admissible))
    columns = np.zeros((6, len(p.h)), dtype=np.bool_)
    columns[0, index] = differs & ~found.ambiguous
    columns[1, index] = differs & found.ambiguous
    columns[2, index] = found.several
    columns[3, index] = wrong_flag & ~found.ambiguous & ~differs
    columns[4], columns[5] = _check_restitution(block, o, s, b)
    return SelectionCheck(rows, *columns)


def _all_bounds(block: Block, o: SampleState, s: Step, rows: NDArray[np.intp]) -> Bounds:
    """Bounds of the ``rows``, also of stops that only another solution than theirs reaches."""
    out = block.out[rows].copy()
    out[:, layout.STOP] = np.where(out[:, layout.STOP] == 0.0, 1.0, out[:, layout.STOP])
    these = (block.parameters.take(rows), block.tables, o.take(rows), s.take(rows))
    return bounds(*these, block.past.take(rows), out)


def _differs(given: Array, expected: Array) -> Bools:
    """(n,) whether two values of phi (n, 2) are different solutions."""
    off = rigid.norm(given - expected) > CLOSE * rigid.norm(expected)
    return np.asarray(off | ~np.isfinite(expected).all(axis=1))


def _selected(q: Problem, tables: Sequence[Table]) -> Array:
    """(n, 2) phi of the solution that the rule selects."""
    return select_solution(q, tables).phi


def _is_consistent(
    p: Parameters, tables: Sequence[Table], o: SampleState, s: Step, b: Bounds, solve: Solve
) -> Bools:
    """(n,) whether the solution of ``solve`` is consistent with some set of active bounds."""
    found = np.zeros(len(p.h), dtype=np.bool_)
    for choice in range(9):
        rows = np.flatnonzero(~found)
        if not len(rows):
            break
        these = (p.take(rows), tables, o.take(rows), s.take(rows), b.take(rows))
        found[rows] = _is_consistent_with(choice, *these, solve)
    return found


def _is_consistent_with(
    choice: int,
    p: Parameters,
    tables: Sequence[Table],
    o: SampleState,
    s: Step,
    b: Bounds,
    solve: Solve,
) -> Bools:
    """(n,) whether it is consistent with one of the nine sets of active bounds."""
    unit = np.stack([np.ones_like(p.radius), p.radius], axis=1)
    side = np.array([[0.0, -1.0, 1.0][choice % 3], [0.0, -1.0, 1.0][choice // 3]])
    rates = np.where(side > 0.0, b.high, b.low)
    held = np.asarray(b.bilateral | (side != 0.0))
    can = np.asarray(np.isfinite(np.where(held, rates, 0.0)).all(axis=1))
    rests = np.asarray(held & (b.rest != 0.0))
    q = problem_of(p, o, s, held, np.where(can[:, None], rates, 0.0), rests)
    phi = solve(q, tables)
    reaction = q.push + rigid.out_of(q.push_by, phi) - unit * phi
    end = (q.free + rigid.out_of(q.s, phi)) / unit - s.hold
    inside = b.low * (1.0 - 1e-9 * np.sign(b.low)) <= end
    inside &= end <= b.high * (1.0 + 1e-9 * np.sign(b.high))
    fits = np.where(side == 0.0, inside, reaction * side < 0.0) | b.bilateral
    return np.asarray(can & fits.all(axis=1))


def _check_restitution(block: Block, o: SampleState, s: Step, b: Bounds) -> tuple[Bools, Bools]:
    """(n,) checked impacts, and those whose coefficient is not the largest allowed."""
    p, given = block.parameters, block.out[:, layout.RESTITUTION]
    one = b.begins.any(axis=1) & ((b.impact != 0.0).sum(axis=1) == 1)
    acts = ((b.impact != 0.0) & (stop_sides(block.out) == b.impact)).any(axis=1)  # not: stick did
    checked = np.asarray(one & acts & ~b.ambiguous & ~b.bilateral.any(axis=1))
    index = np.flatnonzero(checked)
    wrong = np.zeros_like(checked)
    if not len(index):
        return checked, wrong
    eps = given[index]
    less = np.flatnonzero(eps < p.restitution[index] * (1.0 - SLIGHT))
    rows = np.concatenate([np.arange(len(eps)), less])  # the coefficient, and a slightly larger one
    more = np.concatenate([eps, eps[less] * (1.0 + SLIGHT)])
    at = index[rows]
    gain, certain = _gain(block.tables, p.take(at), o.take(at), s.take(at), b.take(at), more)
    bad = gain[: len(eps)] > SLIGHT
    bad[less] |= gain[len(eps) :] < -SLIGHT
    certain[less] &= certain[len(eps) :]
    certain = certain[: len(eps)]
    wrong[index] = bad & certain
    checked[index] = certain
    return checked, wrong


def _gain(
    tables: Sequence[Table], p: Parameters, o: SampleState, s: Step, b: Bounds, eps: Array
) -> tuple[Array, Bools]:
    """(n,) relative work of the impulses of an impact; whether it is unambiguous."""
    gain, certain = np.zeros(len(eps)), np.zeros(len(eps), dtype=np.bool_)
    for k in range(2):
        rows = np.flatnonzero(b.impact[:, k] != 0.0)
        if len(rows):
            there = (p.take(rows), tables, o.take(rows), s.take(rows))
            i = impulses(*there, b.rates[rows, k], k, eps[rows], b.bilateral[rows, 1 - k])
            gain[rows], certain[rows] = i.work, ~i.undecided
    return gain, certain
