"""Whether answers are the ones that the rules name, by solving their friction again.

The solution that the rule names for the sides that the answer chose; where that fits no choice of
sides, the one nearest to stick; where that fits none either, the one of least traction.
SEVERAL_ROOTS where it slips although stick is admissible. The coefficient of an impact is the
greatest with which the work of its impulses on slide and spin is not positive.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws import rigid
from cylconn_ros.laws.bounds import Bounds, stop_sides
from cylconn_ros.laws.normalised import Block
from cylconn_ros.laws.parameters import Bools, Parameters, Table
from cylconn_ros.laws.predicted_end import begin
from cylconn_ros.laws.reduced import WORST_CONDITION, Problem, problem_of
from cylconn_ros.laws.roots import least_traction, named, nearest_to_stick
from cylconn_ros.laws.sample_state import Observed, observe
from cylconn_ros.laws.step import AVAILABLE, Step
from cylconn_ros.laws.stops import bounds_of

Array = NDArray[np.float64]
CLOSE = 1e-3  # of phi: the same solution; that it is one to rounding is the matter of S and D
Solve = Callable[[Problem, Sequence[Table]], Array]  # phi (n, 2)
SLIGHT = 1e-7  # of energy and of a coefficient: as near as the search for one goes


@dataclasses.dataclass
class Found:
    """The verdict on a block: rows that were judged, and those judged wrong or undecided."""

    judged: Bools
    wrong: Bools
    unsure: Bools
    several: Bools  # more than one solution
    flag: Bools  # SEVERAL_ROOTS is not as it should be
    impacts: Bools  # whose coefficient was judged
    restitution: Bools  # and is not the greatest without a gain of energy


@dataclasses.dataclass
class Verdict:
    """Counts over many blocks, and where the first wrong answers are."""

    samples: int = 0
    judged: int = 0
    wrong: int = 0
    unsure: int = 0
    several: int = 0
    flag: int = 0
    impacts: int = 0
    restitution: int = 0
    where: list[str] = dataclasses.field(default_factory=list)

    @property
    def faults(self) -> int:
        """How many answers are not what they should be."""
        return self.wrong + self.flag + self.restitution

    def add(self, found: Found, *columns: NDArray[np.intp]) -> None:
        """Count a block; columns name its rows."""
        self.samples += len(found.judged)
        self.judged += int(found.judged.sum())
        self.wrong += int(found.wrong.sum())
        self.unsure += int(found.unsure.sum())
        self.several += int(found.several.sum())
        self.flag += int(found.flag.sum())
        self.impacts += int(found.impacts.sum())
        self.restitution += int(found.restitution.sum())
        for row in np.flatnonzero(found.wrong | found.flag | found.restitution)[
            : 5 - len(self.where)
        ]:
            self.where.append("/".join(str(int(column[row])) for column in columns))


def judge(block: Block) -> Found:
    """Whether the answers of a block are the solutions that the rule names."""
    p, out, tables = block.parameters, block.out, block.tables
    o = observe(p, block.sample, block.past)
    b = bounds_of(block, o)
    held: Bools = np.asarray(b.held(out))
    s = begin(p, o, block.sample)
    upper = (stop_sides(out) > 0.0) & ~b.both
    q = problem_of(p, o, s, held, np.where(upper, b.high, b.low))
    unit = np.stack([np.ones_like(p.radius), p.radius], axis=1)
    q.free_size += np.where(held, unit * np.where(upper, b.high_size, b.low_size), 0.0)
    values = np.linalg.eigvalsh(q.s)
    rows = p.on & (q.condition < WORST_CONDITION) & ~b.unsure
    even = values[:, 0] > values[:, 1] / (100.0 * WORST_CONDITION)
    rows &= even | held.any(axis=1)
    index = np.flatnonzero(rows)
    q = q.take(index)
    given = out[index][:, [layout.FORCE_FRICTION, layout.MOMENT_FRICTION]]
    given[:, 1] /= q.parameters.radius
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found = named(q, tables)
        apart = _apart(given, found.phi)
        # another one where those before it fit no choice of sides
        others = np.flatnonzero(apart & ~found.unsure & p.bounded[index])
        before: list[Solve] = [_named]
        for solve in (nearest_to_stick, least_traction):
            others = others[apart[others]]
            same = others[~_apart(given[others], solve(q.take(others), tables))]
            sub = index[same]
            these = (p.take(sub), tables, o.take(sub), s.take(sub), b.take(sub))
            apart[same] = np.any([fit_at_all(*these, rule) for rule in before], axis=0)
            before.append(solve)
    slips = out[index, layout.REGIME] == layout.SLIP
    flagged = out[index, layout.FLAGS].astype(np.int64) & layout.SEVERAL_ROOTS != 0
    free = ~np.asarray(held[index].any(axis=1))
    wrongly = free & (flagged != (slips & found.admissible))
    everything = np.zeros((6, len(p.h)), dtype=np.bool_)
    everything[0, index] = apart & ~found.unsure
    everything[1, index] = apart & found.unsure
    everything[2, index] = found.several
    everything[3, index] = wrongly & ~found.unsure & ~apart
    everything[4], everything[5] = bounced(block, o, s, b)
    return Found(rows, *everything)


def _apart(given: Array, expected: Array) -> Bools:
    off = rigid.norm(given - expected) > CLOSE * rigid.norm(expected)
    return np.asarray(off | ~np.isfinite(expected).all(axis=1))


def _named(q: Problem, tables: Sequence[Table]) -> Array:
    return named(q, tables).phi


def fit_at_all(
    p: Parameters, tables: Sequence[Table], o: Observed, s: Step, b: Bounds, solve: Solve
) -> Bools:
    """(n,) whether the solution that ``solve`` gives fits some choice of sides."""
    found = np.zeros(len(p.h), dtype=np.bool_)
    for choice in range(9):
        rows = np.flatnonzero(~found)
        if not len(rows):
            break
        these = (p.take(rows), tables, o.take(rows), s.take(rows), b.take(rows))
        found[rows] = _fits(choice, *these, solve)
    return found


def _fits(
    choice: int,
    p: Parameters,
    tables: Sequence[Table],
    o: Observed,
    s: Step,
    b: Bounds,
    solve: Solve,
) -> Bools:
    """(n,) whether it fits one of the nine choices of sides."""
    unit = np.stack([np.ones_like(p.radius), p.radius], axis=1)
    side = np.array([[0.0, -1.0, 1.0][choice % 3], [0.0, -1.0, 1.0][choice // 3]])
    rates = np.where(side > 0.0, b.high, b.low)
    held = np.asarray(b.both | (side != 0.0))
    can = np.asarray(np.isfinite(np.where(held, rates, 0.0)).all(axis=1))
    q = problem_of(p, o, s, held, np.where(can[:, None], rates, 0.0))
    phi = solve(q, tables)
    reaction = q.push + rigid.out_of(q.push_by, phi) - unit * phi
    end = (q.free + rigid.out_of(q.s, phi)) / unit - s.hold
    inside = b.low * (1.0 - 1e-9 * np.sign(b.low)) <= end
    inside &= end <= b.high * (1.0 + 1e-9 * np.sign(b.high))
    fits = np.where(side == 0.0, inside, reaction * side < 0.0) | b.both
    return np.asarray(can & fits.all(axis=1))


def bounced(block: Block, o: Observed, s: Step, b: Bounds) -> tuple[Bools, Bools]:
    """(n,) impacts that were judged, and those whose coefficient is not the greatest it may be."""
    p, given = block.parameters, block.out[:, layout.RESTITUTION]
    judged = np.asarray((b.impact != 0.0).any(axis=1) & ~b.unsure & ~b.both.any(axis=1))
    index = np.flatnonzero(judged)
    wrong = np.zeros_like(judged)
    if not len(index):
        return judged, wrong
    eps = given[index]
    less = np.flatnonzero(eps < p.restitution[index] * (1.0 - SLIGHT))
    both = np.concatenate([np.arange(len(eps)), less])  # with it, and with hardly more
    more = np.concatenate([eps, eps[less] * (1.0 + SLIGHT)])
    at = index[both]
    gain, sure = _gain(block.tables, p.take(at), o.take(at), s.take(at), b.impact[at], more)
    bad = gain[: len(eps)] > SLIGHT
    bad[less] |= gain[len(eps) :] < -SLIGHT
    sure[less] &= sure[len(eps) :]
    sure = sure[: len(eps)]
    wrong[index] = bad & sure
    judged[index] = sure
    return judged, wrong


def _gain(
    tables: Sequence[Table], p: Parameters, o: Observed, s: Step, impact: Array, eps: Array
) -> tuple[Array, Bools]:
    """(n,) the work of an instant impact's impulses by the sum of its terms; whether it is sure."""
    w = o.w[:, AVAILABLE]
    held = impact != 0.0
    q = problem_of(p, o, s, held, -eps[:, None] * w)
    unit = np.stack([np.ones_like(p.radius), p.radius], axis=1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found = named(q, tables)
        phi = np.where(p.on[:, None], found.phi, 0.0)
    push = q.push + rigid.out_of(q.push_by, phi)
    rates = w + (q.free + rigid.out_of(q.s, phi)) / unit - s.hold
    work = rigid.dot(push, rates)
    size = np.abs(push) * (np.abs(w) + np.abs(rates - w))
    sure = (~found.unsure | ~p.on) & (q.condition < WORST_CONDITION)
    return work / np.maximum(size.sum(axis=1), 1e-300), sure
