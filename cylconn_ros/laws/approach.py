"""Motion towards stops within a step: rest at a stop, and the impacts that begin.

Everything here follows from the step without stops, solved anew by elimination and brute force
(reduced.py, roots.py): its end gives the acceleration a1 before an impact, and the end of the same
step begun with the rates after the rebound the acceleration a2 after it. It does not depend on the
impacts of earlier samples.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws import rigid
from cylconn_ros.laws.ideal_motion import UNDECIDED, ends_within_a_step, fall, latest
from cylconn_ros.laws.impulses import impulses
from cylconn_ros.laws.parameters import Bools, Parameters, Rows, Table
from cylconn_ros.laws.reduced import WORST_CONDITION, Problem, problem_of
from cylconn_ros.laws.roots import select_solution
from cylconn_ros.laws.sample_state import SampleState
from cylconn_ros.laws.step import FREE, Step, rates_from_wrench

Array = NDArray[np.float64]
REST_SHARE = 1e-6  # of the change of rate in a step, below which a held component rests
REST_ROUNDING = 1e-13  # of the pull-in speed
MARGIN = 1e-3  # relative, of these thresholds
NEAR = 1.01  # times the latest impact that begins: further ones are not solved again


@dataclasses.dataclass
class Held(Rows):
    """Components whose rate is prescribed without stops, (n, 2) each."""

    rows: Bools
    rate: Array
    rests: Bools


@dataclasses.dataclass
class Approach(Rows):
    """What slide and spin do at their stops if no earlier impact goes on, (n, 2) each."""

    rest: Array  # side (-1, 1) of the stop at which the component rests; 0: none
    side: Array  # side of the stop at which an impact begins; 0: none
    time: Array  # T
    hit: Array  # w_T, rate of the gap
    before: Array  # a1, of the gap
    after: Array  # a2, of the gap
    restitution: Array  # eps' with which the impact is followed
    closes: Bools  # the bounces end within a step
    size: Array  # of the rates that follow
    undecided: Bools  # rounding decides, or the coefficient is not known
    rates: Array  # (n, 2, 2) of slide and spin at the impact of each component
    friction_before: Array  # (n, 2, 2) N, N.m, until that impact
    friction_after: Array  # (n, 2, 2) after it


@dataclasses.dataclass
class Ends(Rows):
    """Rates (n, 2) at the end of steps without stops."""

    rate: Array
    size: Array
    undecided: Bools  # (n,)
    friction: Array  # (n, 2) N, N.m


def gap_at(p: Parameters, o: SampleState, side: float) -> tuple[Array, Array, Bools]:
    """(n, 2) distance from the lower (-1) or upper (1) stop, its size, and whether it exists."""
    stop = p.stops[:, :, 0 if side < 0.0 else 1]
    there = np.isfinite(stop)
    stop = np.where(there, stop, 0.0)
    return (
        np.where(there, side * (stop - o.position), np.inf),
        o.position_size + np.abs(stop),
        there,
    )


def begun_at(p: Parameters, o: SampleState, s: Step, jump: Array) -> tuple[SampleState, Step]:
    """Sample and step with rates of slide and spin that differ by ``jump`` (n, 2)."""
    w, free = o.w.copy(), s.free.copy()
    w[:, FREE] += jump
    free[:, FREE] += jump
    kept = np.where(p.explicit, 0.0, 0.5)[:, None] * jump
    hold = s.hold + np.where(o.holding[:, None], kept, 0.0)
    return dataclasses.replace(o, w=w), dataclasses.replace(s, free=free, hold=hold)


def unit_of(p: Parameters) -> Array:
    """(n, 2) slip rates of unit rates of slide and spin."""
    return np.stack([np.ones_like(p.radius), p.radius], axis=1)


def ends_of(q: Problem, tables: Sequence[Table], hold: Array) -> Ends:
    """Rates at the end of a reduced step, with friction by the rule of selection."""
    p, unit = q.parameters, unit_of(q.parameters)
    phi = np.zeros_like(q.free)
    undecided = np.asarray(q.condition >= WORST_CONDITION)
    rows = np.flatnonzero(p.on & ~undecided)
    if len(rows):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            found = select_solution(q.take(rows), tables)
        phi[rows] = found.phi
        undecided[rows] |= found.ambiguous
    rate = (q.free + rigid.out_of(q.s, phi)) / unit - hold
    size = (q.free_size + rigid.out_of(np.abs(q.s), np.abs(phi))) / unit
    size = size * (1.0 + 1e-3 * q.condition)[:, None]
    return Ends(rate, size, undecided | ~np.isfinite(rate).all(axis=1), unit * phi)


def rests_at(p: Parameters, w: Array, w_size: Array, change: Array) -> tuple[Bools, Bools]:
    """(n, 2) whether the rate w is rounding; whether that is undecided."""
    pull = np.stack([p.pull_in_speed, p.pull_in_rate], axis=1)
    least = REST_SHARE * np.abs(change) + REST_ROUNDING * pull
    margin = MARGIN * least + 1e-15 * w_size
    return np.abs(w) <= least, np.abs(np.abs(w) - least) <= margin


def nothing(n: int) -> Approach:
    """No rest and no impacts, for n samples."""
    rest, side, time, hit, before, after, restitution, size = np.zeros((8, n, 2))
    closes, undecided = np.zeros((2, n, 2), dtype=np.bool_)
    pairs = np.zeros((3, n, 2, 2))
    return Approach(
        rest, side, time, hit, before, after, restitution, closes, size, undecided, *pairs
    )


def approach(
    p: Parameters,
    tables: Sequence[Table],
    o: SampleState,
    s: Step,
    held: Held,
    out: Array,
) -> Approach:
    """What slide and spin do at their stops, with the restitution that the outputs report."""
    found = nothing(len(p.h))
    index = np.flatnonzero((np.isfinite(p.stops).any(axis=2) & ~held.rows).any(axis=1))
    if not len(index):
        return found
    sub = (p.take(index), o.take(index), s.take(index), held.take(index))
    part = _of_rows(sub[0], tables, sub[1], sub[2], sub[3], out[index])
    for field in dataclasses.fields(found):
        getattr(found, field.name)[index] = getattr(part, field.name)
    return found


def _of_rows(
    p: Parameters, tables: Sequence[Table], o: SampleState, s: Step, held: Held, out: Array
) -> Approach:
    """:func:`approach` of rows that have stops."""
    h, w, w_size = p.h[:, None], o.w[:, FREE], o.w_size[:, FREE]
    found = nothing(len(p.h))
    bare, unit = problem_of(p, o, s), unit_of(p)
    loaded = bare.free / unit - s.hold  # without friction and reactions
    loaded_size = bare.free_size / unit * (1.0 + 1e-3 * bare.condition)[:, None]
    pull = np.stack([p.pull_in_speed, p.pull_in_rate], axis=1)
    slow, tie = rests_at(p, w, w_size, loaded - w)
    for side in (-1.0, 1.0):
        gap, gap_size, there = gap_at(p, o, side)
        change = -side * (loaded - w)
        reach = (REST_SHARE * np.abs(change) + REST_ROUNDING * pull) * h
        within = np.abs(gap) <= reach
        near = np.abs(np.abs(gap) - reach) <= MARGIN * reach + 1e-15 * gap_size
        pressed = change < 0.0
        light = np.abs(change) <= 1e-12 * (loaded_size + w_size)
        free = there & ~held.rows & (found.rest == 0.0)
        found.undecided |= free & (within | near) & (slow | tie) & (near | tie | light)
        touches = np.abs(gap) <= 4e-15 * gap_size  # and leaves: whether it hits first is rounding
        found.undecided |= free & touches & slow & ~pressed
        found.rest = np.where(free & pressed & within & slow, side, found.rest)
    open_ = ~held.rows & (found.rest == 0.0) & np.isfinite(p.stops).any(axis=2)
    # where no stop acts, the output is the step without stops: far ones need no solution
    kept = out[:, layout.STOP] == 0.0
    ends = _recorded_ends(p, s, out)
    far = kept[:, None] & ~_may_hit(p, o, ends, NEAR)
    index = np.flatnonzero((open_ & ~far).any(axis=1))
    if len(index):
        part = found.take(index)
        part = _impacts(
            p.take(index), tables, o.take(index), s.take(index), held.take(index),
            out[index, layout.RESTITUTION], part, open_[index], slow[index], tie[index],
        )  # fmt: skip
        for field in dataclasses.fields(found):
            getattr(found, field.name)[index] = getattr(part, field.name)
    return found


def _recorded_ends(p: Parameters, s: Step, out: Array) -> Array:
    """(n, 2) rates of slide and spin at the end of the step under the reported wrench."""
    wrench = out[:, layout.FORCE : layout.FORCE + 6]
    added, _ = rates_from_wrench(p, s, wrench, np.abs(wrench))
    return np.asarray((s.free + added + s.bracket)[:, FREE])


def _may_hit(p: Parameters, o: SampleState, ends: Array, share: float) -> Bools:
    """(n, 2) whether a stop is reached within ``share`` of the latest time of an impact."""
    w, found = o.w[:, FREE], np.zeros((len(p.h), 2), dtype=np.bool_)
    for side in (-1.0, 1.0):
        gap, size, there = gap_at(p, o, side)
        for k in range(2):
            sizes = [size[:, k], o.w_size[:, FREE[k]], np.abs(ends[:, k] - w[:, k])]
            rate, a = -side * w[:, k], -side * (ends[:, k] - w[:, k]) / p.h
            c = fall(np.where(there[:, k], gap[:, k], 1.0), rate, a, p.h, p.explicit, sizes)
            soon = (c.time < share * latest(p.h, p.explicit)) | c.undecided
            found[:, k] |= there[:, k] & soon
    return found


def _impacts(
    p: Parameters,
    tables: Sequence[Table],
    o: SampleState,
    s: Step,
    held: Held,
    coefficient: Array,
    found: Approach,
    open_: Bools,
    slow: Bools,
    tie: Bools,
) -> Approach:
    """``found`` with the impacts of the components ``open_`` (n, 2).

    slow: whether their rate is rounding, so that beyond a stop no impact begins; tie: whether that
    is undecided.
    """
    w = o.w[:, FREE]
    q = problem_of(p, o, s, held.rows, held.rate, held.rests)
    ends = ends_of(q, tables, s.hold)
    for k in range(2):
        first: Array = np.full(len(p.h), np.inf)
        size = ends.size[:, k] + o.w_size[:, FREE[k]]
        for side in (-1.0, 1.0):
            gap, gap_size, there = gap_at(p, o, side)
            gap = np.where(there, gap, 1.0)
            rate, change = -side * w[:, k], -side * (ends.rate[:, k] - w[:, k])
            sizes = [gap_size[:, k], o.w_size[:, FREE[k]], size]
            c = fall(gap[:, k], rate, change / p.h, p.h, p.explicit, sizes)
            last, free = latest(p.h, p.explicit), there[:, k] & open_[:, k]
            beyond = gap[:, k] < 0.0
            hits = free & (c.time < last) & (c.time < first) & ~(beyond & slow[:, k])
            close = free & (np.abs(c.time - last) <= UNDECIDED * p.h)
            other = np.where(np.isfinite(first), first, -np.inf)
            close |= free & (np.abs(c.time - other) <= UNDECIDED * p.h)
            close |= free & beyond & tie[:, k]
            soon = free & _may_hit(p, o, ends.rate, NEAR)[:, k]
            found.undecided[:, k] |= close | (free & c.undecided) | (soon & ends.undecided)
            first = np.where(hits, c.time, first)
            for name, value in (
                ("side", side), ("time", c.time), ("hit", c.rate), ("before", change / p.h),
                ("size", size + c.rate_size + gap_size[:, k] / p.h),
            ):  # fmt: skip
                getattr(found, name)[:, k] = np.where(hits, value, getattr(found, name)[:, k])
        rows = np.flatnonzero(found.side[:, k] != 0.0)
        if len(rows):
            these = (p.take(rows), tables, o.take(rows), s.take(rows), held.take(rows))
            part = _rebound(*these, coefficient[rows], found.take(rows), k, ends.take(rows))
            for field in dataclasses.fields(found):
                getattr(found, field.name)[rows, k] = getattr(part, field.name)[:, k]
    both = (found.side != 0.0).all(axis=1) & (p.restitution > 0.0)
    found.undecided |= both[:, None]  # one coefficient is reported for two impacts
    return found


def _rebound(
    p: Parameters,
    tables: Sequence[Table],
    o: SampleState,
    s: Step,
    held: Held,
    coefficient: Array,
    found: Approach,
    k: int,
    free: Ends,
) -> Approach:
    """``found`` with the motion of component k after its impact.

    free: the step without its stops. A coefficient that is reported as 0 is that of a series of
    bounces that ends within the step, if it does.
    """
    side, hit = found.side[:, k], found.hit[:, k]
    given = np.where(coefficient > 0.0, coefficient, p.restitution)
    rebound = -given * hit
    w = o.w[:, FREE]
    rates = w + (found.time[:, k] / p.h)[:, None] * (free.rate - w)
    rates[:, k] = -side * hit
    i = impulses(p, tables, o, s, rates, k, given, held.rows[:, 1 - k])
    jump = i.after - w
    moved, step = begun_at(p, o, s, jump)
    q = problem_of(p, moved, step, held.rows, held.rate, held.rests)
    ends = ends_of(q, tables, step.hold)
    after = (-side * ends.rate[:, k] - rebound) / p.h
    closes, near = ends_within_a_step(rebound, after, given, p.h)
    size = ends.size[:, k] + np.abs(rebound)
    slight = (rebound <= 1e-10 * size) & (np.abs(after) * p.h <= 1e-10 * size)
    # reported as 0 though the series goes on: the energy may have reduced the coefficient
    unknown = (coefficient == 0.0) & (p.restitution > 0.0) & ~closes
    found.closes[:, k], found.restitution[:, k], found.after[:, k] = closes, given, after
    found.undecided[:, k] |= near | slight | ends.undecided | unknown | i.undecided
    found.rates[:, k], found.friction_before[:, k] = rates, free.friction
    found.friction_after[:, k] = ends.friction
    found.size[:, k] += size
    return found
