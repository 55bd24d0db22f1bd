"""Stops, locks and imposed motion as bounds on the rates of slide and spin (see equations.md).

A bound at distance ``gap``, whose rate is w (negative: approaching), requires w+ >= t:

    contact           t = -gap/h - w/2
    impact            two steps that lead to the ideal motion (ideal_motion.py) at their end:
                      t = (x2 - gap)/h - (w + w2)/2, then t = w2
    lock, position    w+ = vc - (x - xc)/h - (w - vc)/2, in both directions; see also drives.py
    velocity          w+ = vc

For a semi-implicit plant the halves vanish, and the first step of an impact has t = (x2 - gap)/h -
w2. -gap/h is limited by the pull-in speed. (x - xc)/h is limited by the greater of the pull-in
speed (of an imposed position: its approach speed) and 3/2 |w - vc|, which brings the component to
rest. A component has the bound of a contact where it rests at a stop, where it is beyond one, and
where the bounces of an impact end within the step; where no impact begins or goes on either, it has
none.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws.approach import Approach, Held, approach, gap_at, rests_at, unit_of
from cylconn_ros.laws.ideal_motion import end_of_two_steps, first_target, flight, latest
from cylconn_ros.laws.parameters import Bools, Parameters, Rows, Table
from cylconn_ros.laws.reduced import problem_of
from cylconn_ros.laws.sample_state import History, SampleState
from cylconn_ros.laws.step import FREE, Step

Array = NDArray[np.float64]
ROUNDING = 1e-13  # relative margin below which a decision depends on rounding
LOST = 1.2  # periods between two samples above which one was lost


@dataclasses.dataclass
class Bounds(Rows):
    """Bounds on (v1, w1) at the end of the step; columns are slide and spin."""

    low: Array  # (n, 2)
    low_size: Array
    high: Array
    high_size: Array
    bilateral: Bools  # (n, 2) rate prescribed: low equals high
    locked: Bools  # (n, 2) held by the lock
    imposed: Bools  # (n, 2) moved by an imposed motion
    rest: Array  # (n, 2) side (1: also of a prescribed rate) at which a component rests; 0: none
    impact: Array  # (n, 2) side (-1, 1) of the stop at which an impact begins or goes on
    begins: Bools  # (n, 2) an impact begins and is followed
    hit: Array  # (n, 2) rate of the gap at that impact
    goes_on: Bools  # (n, 2) the impact has another step
    rebound: Array  # (n, 2) rate of the gap after the impact, its size, and so on: for that step
    rebound_size: Array
    acceleration: Array
    time: Array
    restitution: Array
    rates: Array  # (n, 2, 2) of slide and spin at the impact of each component
    before: Array  # (n, 2, 2) friction until it, N, N.m
    after: Array  # (n, 2, 2) friction after it
    followed: Bools  # (n, 2) the step is one of the two that follow an impact
    ambiguous: Bools  # (n,) rounding decides whether an impact begins, or began before
    locked_at: Array  # (n,)
    imposed_at: Array  # (n, 2)

    def held(self, out: Array) -> Bools:
        """(n, 2) which components the outputs hold at a bound; friction does not stick there."""
        return self.bilateral | (stop_sides(out) != 0.0)

    def rests(self, out: Array) -> Bools:
        """(n, 2) which of them are at rest, so that friction does not slip there either."""
        return np.asarray(self.held(out) & (self.rest != 0.0))


def driven(p: Parameters, b: Bounds) -> Bools:
    """(n, 2) whether a stop or a greatest force can hold an imposed motion back."""
    held_back = np.isfinite(p.stops).any(axis=2) | np.isfinite(p.drive[:, :, 0])
    return np.asarray(b.imposed & ~b.locked & held_back)


def stop_sides(out: Array) -> Array:
    """(n, 2) reported stop: -1 lower, 1 upper, 0 none, NaN both."""
    bits = out[:, layout.STOP].astype(np.int64)
    sides = np.array([0.0, -1.0, 1.0, np.nan])
    return np.stack([sides[bits & 3], sides[bits >> 2 & 3]], axis=1)


def motion_bounds(p: Parameters, o: SampleState, past: History) -> Bounds:
    """Bounds of locks and imposed motions alone."""
    n = len(p.h)
    none, no = np.zeros((n, 2)), np.zeros((n, 2), dtype=np.bool_)
    found = Bounds(
        low=none - np.inf,
        low_size=none.copy(),
        high=none + np.inf,
        high_size=none.copy(),
        bilateral=no.copy(),
        locked=no.copy(),
        imposed=p.imposed,
        begins=no.copy(),
        goes_on=no.copy(),
        followed=no.copy(),
        **{name: none.copy() for name in ("rest", "impact", "hit", *SCALARS)},
        **{name: np.zeros((n, 2, 2)) for name in PAIRS},
        ambiguous=past.ambiguous.copy(),
        locked_at=past.locked_at,
        imposed_at=_imposed_at(p, o, past),
    )
    _lock(p, o, past, found)
    _hold(p, o, found)
    return found


SCALARS = ("rebound", "rebound_size", "acceleration", "time", "restitution")
PAIRS = ("rates", "before", "after")
CARRIED = (*SCALARS, *PAIRS)
"""Fields of an impact that its second step needs; the history has them too."""


def held_of(p: Parameters, o: SampleState, s: Step, b: Bounds) -> Held:
    """The components that locks and imposed motions hold, and which of them rest."""
    rests = np.zeros_like(b.bilateral)
    rows = np.flatnonzero(b.bilateral.any(axis=1))
    if len(rows):
        of, state, step = p.take(rows), o.take(rows), s.take(rows)
        w = state.w[:, FREE]
        change = problem_of(of, state, step).free / unit_of(of) - step.hold - w
        slow, tie = rests_at(of, w, state.w_size[:, FREE], change)
        still, near = rests_at(of, b.low[rows], b.low_size[rows], change)
        held = b.bilateral[rows]
        rests[rows] = held & slow & still
        b.ambiguous[rows] |= (held & (slow | tie) & (still | near) & (tie | near)).any(axis=1)
    b.rest = np.where(rests, 1.0, b.rest)
    return Held(b.bilateral.copy(), np.where(b.bilateral, b.low, 0.0), rests)


def bounds(
    p: Parameters,
    tables: Sequence[Table],
    o: SampleState,
    s: Step,
    past: History,
    out: Array,
    near: Approach | None = None,
) -> Bounds:
    """Bounds of steps, with the restitution coefficient that the outputs report.

    near: the :func:`approach` of the samples, if it is known.
    """
    found = motion_bounds(p, o, past)
    if np.isnan(p.gains[:, 0]).all():  # a penalty method's stops are springs
        if near is None:
            near = approach(p, tables, o, s, held_of(p, o, s, found), out)
        _set_stops(p, o, past, found, near)
        found.ambiguous |= _tied_drives(p, o, found).any(axis=1)
        # the second of two impacts that overlap is that of a motion which begins at the first
        meets = (near.side != 0.0) | (stop_sides(out) != 0.0)
        goes_on = found.followed & ~found.begins
        found.ambiguous |= p.on & (goes_on & meets[:, ::-1] & ~goes_on[:, ::-1]).any(axis=1)
    return found


def _tied_drives(p: Parameters, o: SampleState, b: Bounds) -> Bools:
    """(n, 2) driven components of which rounding decides whether and where a stop holds them.

    They rest at the stop at which they touch, or stops are closer than a step resolves.
    """
    pull = np.stack([p.pull_in_speed, p.pull_in_rate], axis=1)
    touches = np.zeros_like(b.bilateral)
    for side in (-1.0, 1.0):
        gap, size, there = gap_at(p, o, side)
        touches |= there & (np.abs(gap) <= 1e-12 * size)
    close = p.stops[:, :, 1] - p.stops[:, :, 0] <= pull * p.h[:, None]
    rests = np.abs(b.low) <= 1e-9 * pull
    return np.asarray(driven(p, b) & ((touches & rests) | close))


def _set_stops(p: Parameters, o: SampleState, past: History, b: Bounds, near: Approach) -> None:
    """Set the bounds by stops of components that nothing else holds."""
    open_ = ~b.bilateral & np.isfinite(p.stops).any(axis=2)
    lost = past.period[:, None] > LOST * p.h[:, None]
    second = open_ & (past.pending != 0.0) & ((np.abs(past.pending) == 1.0) | lost)
    first = open_ & ~second & (near.rest == 0.0) & (near.side != 0.0)
    rests = open_ & ~second & (near.rest != 0.0)
    b.rest = np.where(rests, near.rest, b.rest)
    b.ambiguous |= (open_ & ~second & near.undecided).any(axis=1)
    side = np.where(
        second, np.sign(past.pending), np.where(first, near.side, np.where(rests, near.rest, 0.0))
    )
    contact: dict[float, tuple[Array, Array]] = {}
    for at in (-1.0, 1.0):
        gap, gap_size, there = gap_at(p, o, at)
        contact[at] = _contact(p, o, at, np.where(there, gap, 1.0), gap_size)
        beyond = open_ & there & (gap < 0.0)
        _put(b, beyond, at, *contact[at])
    target = np.where(side < 0.0, contact[-1.0][0], contact[1.0][0])
    size = np.where(side < 0.0, contact[-1.0][1], contact[1.0][1])
    begun = _first_step(p, o, b, near, first & ~near.closes)
    later = _second_step(p, o, past, b, second)
    for rows, values in ((first & ~near.closes, begun), (second & ~later[2], later)):
        target, size = np.where(rows, values[0], target), np.where(rows, values[1], size)
    b.impact = np.where(first | second, side, 0.0)
    b.followed = (first & ~near.closes) | (second & ~later[2] & ~lost)
    b.goes_on |= first
    b.time = np.where(first & near.closes, near.time, b.time)
    for at in (-1.0, 1.0):
        _put(b, (side == at) & ~b.bilateral, at, target, size)
    crossed = open_ & (b.low > b.high)
    middle = 0.5 * (np.where(crossed, b.low, 0.0) + np.where(crossed, b.high, 0.0))
    wide = 0.5 * (b.low_size + b.high_size)
    with np.errstate(invalid="ignore"):  # the bounds leave no range except rounding
        tie = np.abs(b.high - b.low) <= 1e-12 * (b.low_size + b.high_size)
    b.ambiguous |= (open_ & ~b.bilateral & tie).any(axis=1)
    b.low, b.high = np.where(crossed, middle, b.low), np.where(crossed, middle, b.high)
    b.low_size = np.where(crossed, wide, b.low_size)
    b.high_size = np.where(crossed, wide, b.high_size)
    b.bilateral = b.bilateral | crossed


def _put(b: Bounds, rows: Bools, side: float, target: Array, size: Array) -> None:
    """Set the target of the gap's rate at the lower (-1) or upper (1) stop."""
    if side < 0.0:
        b.low, b.low_size = np.where(rows, target, b.low), np.where(rows, size, b.low_size)
    else:
        b.high, b.high_size = np.where(rows, -target, b.high), np.where(rows, size, b.high_size)


def _contact(
    p: Parameters, o: SampleState, side: float, gap: Array, gap_size: Array
) -> tuple[Array, Array]:
    """(n, 2) target of a contact, and its size."""
    h, keep = p.h[:, None], np.where(p.explicit, 0.0, 0.5)[:, None]
    pull = np.stack([p.pull_in_speed, p.pull_in_rate], axis=1)
    far = _exceeds_pull_in(-gap, pull, gap_size, h)
    size = np.where(far, pull, gap_size / h) + keep * o.w_size[:, FREE]
    return np.minimum(-gap / h, pull) + keep * side * o.w[:, FREE], size


def _gap(p: Parameters, o: SampleState, side: Array) -> tuple[Array, Array, Array]:
    """(n, 2) gap at the stop on each side (0: any), its size, and its rate."""
    both = [gap_at(p, o, at) for at in (-1.0, 1.0)]
    gap = np.where(side < 0.0, both[0][0], both[1][0])
    return gap, np.where(side < 0.0, both[0][1], both[1][1]), -side * o.w[:, FREE]


def _first_step(
    p: Parameters, o: SampleState, b: Bounds, near: Approach, rows: Bools
) -> tuple[Array, Array]:
    """Targets (n, 2) of impacts that begin, and their sizes; what their second step needs."""
    h, explicit = p.h[:, None], p.explicit[:, None]
    gap, gap_size, w = _gap(p, o, near.side)
    gap, a, eps = np.where(rows, gap, 0.0), near.before, near.restitution
    least = np.where(explicit, 0.0, 0.5 * h)
    early = rows & ((gap < 0.0) | (near.time < least))  # put off to when two wrenches can act
    time = np.where(early, np.maximum(near.time, least), near.time)
    time = np.where(rows, time, 0.0)
    parabola = w + np.where(explicit, 0.5 * h * a, 0.0)
    gap = np.where(early, -(parabola * time + 0.5 * a * time * time), gap)
    hit = np.where(early, parabola + a * time, near.hit)
    rebound = np.where(rows, np.maximum(-eps * hit, 0.0), 0.0)
    size = near.size + np.abs(hit) + np.abs(near.after) * h + gap_size / h
    end = end_of_two_steps(rebound, near.after, eps, 2.0 * h - time, h, explicit, size)
    b.ambiguous |= (rows & end.undecided).any(axis=1)
    b.begins, b.hit = rows, near.hit
    b.rebound, b.rebound_size = np.where(rows, rebound, 0.0), np.where(rows, size, 0.0)
    b.acceleration = np.where(rows, near.after, 0.0)
    b.time, b.restitution = np.where(rows, time, 0.0), np.where(rows, eps, 0.0)
    b.rates, b.before, b.after = near.rates, near.friction_before, near.friction_after
    return first_target(gap, w, end, h, explicit), 4.0 * (size + end.size)


def _second_step(
    p: Parameters, o: SampleState, past: History, b: Bounds, rows: Bools
) -> tuple[Array, Array, Bools]:
    """Targets (n, 2) of impacts that go on, their sizes, and whether they are contacts."""
    h, explicit, elapsed = p.h[:, None], p.explicit[:, None], past.period[:, None]
    rebound, a, eps = past.rebound, past.acceleration, past.restitution
    t = np.where(rows, elapsed + h - past.time, h)
    gap, gap_size, w = _gap(p, o, past.pending)
    gap = np.where(rows, gap, 0.0)
    size = past.rebound_size + gap_size / h + o.w_size[:, FREE] + np.abs(a) * h
    reach = t - 2.0 * h + latest(h, explicit)
    counts = [flight(rebound, a, eps, t, until, size, h) for until in (reach, reach + h)]
    again = rows & (counts[0].count != counts[1].count)
    lost = rows & (elapsed > LOST * h)
    end = end_of_two_steps(rebound, a, eps, np.where(again & ~lost, t + h, t), h, explicit, size)
    undecided = end.undecided | (~lost & (counts[0].undecided | counts[1].undecided))
    b.ambiguous |= (rows & undecided).any(axis=1)
    target = np.where(again & ~lost, first_target(gap, w, end, h, explicit), end.rate)
    b.bilateral = b.bilateral | lost
    back, wide = -np.sign(past.pending) * end.rate, 4.0 * (size + end.size)
    b.low, b.high = np.where(lost, back, b.low), np.where(lost, back, b.high)
    b.low_size, b.high_size = np.where(lost, wide, b.low_size), np.where(lost, wide, b.high_size)
    b.goes_on |= again & ~lost
    for name in CARRIED:
        value = getattr(past, name) - (elapsed if name == "time" else 0.0)
        of = rows if value.ndim == 2 else rows[:, :, None]
        setattr(b, name, np.where(of, value, getattr(b, name)))
    return target, wide, np.asarray((end.gap == 0.0) & (end.rate == 0.0) & ~lost)


def _exceeds_pull_in(distance: Array, pull: Array, size: Array, h: Array) -> Bools:
    """Whether a distance exceeds the pull-in distance of a step by more than rounding."""
    return np.asarray(distance - pull * h > ROUNDING * size)


def _imposed_at(p: Parameters, o: SampleState, past: History) -> Array:
    """(n, 2) position of imposed motions at this sample.

    They start at the position that their parameter or message gives, else at that of the sample.
    """
    first = np.where(np.isnan(p.command[:, :, 0]), o.position, p.command[:, :, 0])
    return np.where(past.started[:, None] & ~p.begins, past.imposed_at, first)


def _lock(p: Parameters, o: SampleState, past: History, b: Bounds) -> None:
    """Set whether the lock is closed, and its position.

    By position: the component passed it, or will pass it within a step and a half; it is locked
    there. By force: the previous output's force exceeded the limit; the component is locked at the
    position at which it can come to rest.
    """
    rows = np.flatnonzero(p.lock >= 0)
    k = p.lock[rows]
    x, w = o.position[rows, k], o.w[rows, np.array(FREE)[k]]
    away = x - p.lock_position[rows]
    passed = past.started[rows] & (away * (past.lock_last[rows] - p.lock_position[rows]) <= 0.0)
    passed |= (away * w < 0.0) & (np.abs(away) < 1.5 * p.h[rows] * np.abs(w))
    forced = np.abs(past.total[rows, k]) > p.lock_force[rows]
    rest = x + np.where(p.explicit[rows], 0.0, 0.5 * p.h[rows] * w)
    at = np.where(passed, p.lock_position[rows], rest)
    b.locked_at = b.locked_at.copy()
    b.locked_at[rows] = np.where(past.locked[rows], past.locked_at[rows], at)
    b.locked[rows, k] = past.locked[rows] | passed | forced


def _hold(p: Parameters, o: SampleState, b: Bounds) -> None:
    """Set the prescribed rates of locks and imposed motions; a lock has priority."""
    w, w_size = o.w[:, FREE], o.w_size[:, FREE]
    h, keep = p.h[:, None], np.where(p.explicit, 0.0, 0.5)[:, None]
    at = np.where(b.locked, b.locked_at[:, None], b.imposed_at)
    velocity = p.command[:, :, 1]
    only_velocity = ~b.locked & np.isnan(p.command[:, :, 0])
    rate = np.where(b.locked | np.isnan(velocity), 0.0, velocity)
    pull = np.stack([p.pull_in_speed, p.pull_in_rate], axis=1)
    pull = np.where(b.locked, pull, p.drive[:, :, 1])
    pull = np.maximum(pull, 1.5 * np.abs(w - rate))
    back = np.clip((at - o.position) / h, -pull, pull)
    target = np.where(only_velocity, rate, rate + back - keep * (w - rate))
    way_size, rate_size = np.abs(at) + o.position_size, w_size + np.abs(rate)
    far = _exceeds_pull_in(np.abs(at - o.position), pull, way_size, h)
    size = np.abs(rate) + keep * rate_size
    size += np.where(far, np.maximum(pull, 1.5 * rate_size), way_size / h)
    size = np.where(only_velocity, np.abs(rate), size)
    rows = b.locked | b.imposed
    b.bilateral = b.bilateral | rows
    b.low, b.high = np.where(rows, target, b.low), np.where(rows, target, b.high)
    b.low_size = np.where(rows, size, b.low_size)
    b.high_size = np.where(rows, size, b.high_size)
    b.impact = np.where(rows, 0.0, b.impact)


def next_bounds_history(
    p: Parameters, o: SampleState, past: History, b: Bounds, out: Array
) -> History:
    """``past`` with the history of the bounds after this sample and its output."""
    rows = p.lock >= 0
    last = np.where(p.lock == 1, o.position[:, 1], o.position[:, 0])
    velocity = np.where(np.isnan(p.command[:, :, 1]), 0.0, p.command[:, :, 1])
    acts = stop_sides(out) != 0.0
    between = b.bilateral & ~b.locked & ~b.imposed
    acts |= between
    # between stops closer than a step resolves, rounding decides which impact goes on
    close = between & (b.impact != 0.0) & (past.period <= LOST * p.h)[:, None]
    undecided = (b.ambiguous & acts.any(axis=1)) | close.any(axis=1)
    return dataclasses.replace(
        past,
        pending=np.where(acts, np.where(b.goes_on, 1.0, 2.0) * b.impact, 0.0),
        # where no stop acts, no impact goes on
        ambiguous=np.asarray(undecided),
        **{name: getattr(b, name) for name in CARRIED},
        locked=np.asarray(b.locked.any(axis=1)),
        locked_at=b.locked_at,
        lock_last=np.where(rows, last, past.lock_last),
        imposed_at=b.imposed_at + p.h[:, None] * velocity,
    )
