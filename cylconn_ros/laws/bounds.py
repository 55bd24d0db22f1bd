"""Stops, locks and imposed motion as bounds on the rates of slide and spin, from docs/equations.md.

A bound at distance ``gap`` with the gap's rate w (negative: approaching) demands w+ >= t:

    contact           t = -gap/h - w/2
    impact, 1st step  t = w (T - 1/2 - eps' (3/2 - T)),  T = -gap/(h w); begins where
                      gap + 3/2 h w < 0
    impact, 2nd step  t = -eps' w of the first
    lock, position    w+ = vc - (x - xc)/h - (w - vc)/2, both ways
    velocity          w+ = vc

On a semi-implicit plant the halves drop out and an impact is one step, t = -eps' w, that begins
where gap + h w < 0. -gap/h is no more than the pull-in speed; (x - xc)/h no more than that or than
what brings the component to rest, 3/2 |w - vc|. Where the coefficient that an answer reports is 0
there is no impact but a contact.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws.parameters import Bools, Parameters, Rows
from cylconn_ros.laws.sample_state import History, Observed
from cylconn_ros.laws.step import AVAILABLE

Array = NDArray[np.float64]
TIE = 1e-13  # a decision that hangs on less than this is the answer's own
STILL = 1e-9  # whether a rate that is less moves towards a stop is not asked


@dataclasses.dataclass
class Bounds(Rows):
    """What bounds (v1, w1) at the end of the step; columns are slide and spin."""

    low: Array  # (n, 2)
    low_size: Array
    high: Array
    high_size: Array
    both: Bools  # (n, 2) held both ways: low is high
    locked: Bools  # (n, 2) by the lock
    driven: Bools  # (n, 2) by an imposed motion
    impact: Array  # (n, 2) -1 or 1 at the stop where an impact begins
    acting: Bools  # (n,) an impact begins or has its second step
    unsure: Bools  # (n,) whether one begins, or has begun, is not to be known from outside
    doubt: Bools  # (n,) and that it is so since this step
    locked_at: Array  # (n,)
    imposed_at: Array  # (n, 2)

    def held(self, out: Array) -> Bools:
        """(n, 2) which components the answers hold at a bound: there is no friction's stick."""
        return self.both | (stop_sides(out) != 0.0)


def stop_sides(out: Array) -> Array:
    """(n, 2) -1 at the lower stop, 1 at the upper, 0 at none, NaN at both."""
    bits = out[:, layout.STOP].astype(np.int64)
    sides = np.array([0.0, -1.0, 1.0, np.nan])
    return np.stack([sides[bits & 3], sides[bits >> 2 & 3]], axis=1)


def bounds(p: Parameters, o: Observed, past: History, coefficient: Array) -> Bounds:
    """Bounds of a step. coefficient: (n,) the restitution eps' that the answer reports."""
    x, w = o.place, o.w[:, AVAILABLE]
    w_size = o.w_size[:, AVAILABLE]
    h, keep = p.h[:, None], np.where(p.explicit, 0.0, 0.5)[:, None]
    pull = np.stack([p.pull_in_speed, p.pull_in_rate], axis=1)
    eps = coefficient[:, None]
    impact = np.zeros_like(w)
    doubt, ties = np.zeros_like(past.unsure), np.zeros(w.shape, dtype=np.bool_)
    limits, sizes = [], []
    for side, number in ((-1.0, 0), (1.0, 1)):
        stop = p.stops[:, :, number]
        there = np.isfinite(stop)
        stop = np.where(there, stop, 0.0)
        gap, rate = -side * (x - stop), -side * w
        gap_size = o.place_size + np.abs(stop)
        target = np.minimum(-gap / h, pull) - keep * rate
        size = np.where(_beyond(-gap, pull, gap_size, h), pull, gap_size / h) + keep * w_size
        reach = np.where(p.explicit, 1.0, 1.5)[:, None] * h * rate
        near = np.abs(gap + reach) < TIE * (gap_size + h * w_size)
        begins = there & (rate < 0.0) & (p.restitution[:, None] > 0.0) & (eps > 0.0)
        ties |= begins & near
        begins &= near | (gap + reach < 0.0)
        doubt |= past.unsure & begins.any(axis=1)
        begins &= (past.pending == 0.0) & (impact == 0.0)
        still = there & (np.abs(rate) <= STILL * w_size) & (eps > 0.0)
        doubt |= (still & (gap < TIE * gap_size)).any(axis=1)
        time = np.maximum(-gap / np.where(begins, h * rate, -1.0), 0.5)
        first = rate * (time - 0.5 - eps * (1.5 - time))
        first_size = 2.0 * w_size + (1.0 + eps) * (w_size + gap_size / h)
        first = np.where(p.explicit[:, None], -eps * rate, first)
        second = past.pending == side
        target = np.where(begins, first, target)
        size = np.where(begins, first_size, size)
        target = np.where(second, -side * past.leaving, target)
        size = np.where(second, past.leaving_size, size)
        impact = np.where(begins, side, impact)
        limits.append(np.where(there, -side * target, side * np.inf))
        sizes.append(np.where(there, size, 0.0))
    # while one impact has its second step to come, another may begin without a coefficient
    told = (past.pending != 0.0).any(axis=1) & (coefficient == past.bounce)
    surely = ((impact != 0.0) & ~ties) | (past.pending != 0.0)
    doubt |= ties.any(axis=1) & surely.any(axis=1)  # whose coefficient it is
    doubt |= told & (impact != 0.0).any(axis=1)
    low, high = limits
    low_size, high_size = sizes
    crossed = low > high
    with np.errstate(invalid="ignore"):  # no room, or just a little: rounding decides
        doubt |= (np.abs(high - low) <= 1e-12 * (low_size + high_size)).any(axis=1)
    middle = 0.5 * (np.where(crossed, low, 0.0) + np.where(crossed, high, 0.0))
    wide = 0.5 * (low_size + high_size)
    found = Bounds(
        low=np.where(crossed, middle, low),
        low_size=np.where(crossed, wide, low_size),
        high=np.where(crossed, middle, high),
        high_size=np.where(crossed, wide, high_size),
        both=crossed,
        locked=np.zeros_like(crossed),
        driven=p.imposed,
        impact=impact,
        acting=np.any((impact != 0.0) | (past.pending != 0.0), axis=1),
        unsure=doubt | past.unsure,
        doubt=doubt,
        locked_at=past.locked_at,
        imposed_at=_imposed_at(p, o, past),
    )
    _lock(p, o, past, found)
    _hold(p, o, found)
    return found


def _beyond(way: Array, pull: Array, size: Array, h: Array) -> Bools:
    """Whether a way is longer than the pull-in speed goes in a step, rounding aside."""
    return np.asarray(way - pull * h > TIE * size)


def _imposed_at(p: Parameters, o: Observed, past: History) -> Array:
    """(n, 2) where an imposed motion is at this sample: it starts from its position, or here."""
    first = np.where(np.isnan(p.command[:, :, 0]), o.place, p.command[:, :, 0])
    return np.where(past.started[:, None], past.imposed_at, first)


def _lock(p: Parameters, o: Observed, past: History, b: Bounds) -> None:
    """Whether the lock is closed, and where.

    By position: the component has passed it or will within a step and a half, and is locked there.
    By force: the last answer's force exceeded it, and it is locked where it can be brought to rest.
    """
    rows = np.flatnonzero(p.lock >= 0)
    k = p.lock[rows]
    x, w = o.place[rows, k], o.w[rows, np.array(AVAILABLE)[k]]
    away = x - p.lock_position[rows]
    passed = past.started[rows] & (away * (past.lock_last[rows] - p.lock_position[rows]) <= 0.0)
    passed |= (away * w < 0.0) & (np.abs(away) < 1.5 * p.h[rows] * np.abs(w))
    forced = np.abs(past.total[rows, k]) > p.lock_force[rows]
    rest = x + np.where(p.explicit[rows], 0.0, 0.5 * p.h[rows] * w)
    at = np.where(passed, p.lock_position[rows], rest)
    b.locked_at = b.locked_at.copy()
    b.locked_at[rows] = np.where(past.locked[rows], past.locked_at[rows], at)
    b.locked[rows, k] = past.locked[rows] | passed | forced


def _hold(p: Parameters, o: Observed, b: Bounds) -> None:
    """Locks and imposed motions hold both ways; a lock goes before a motion."""
    w, w_size = o.w[:, AVAILABLE], o.w_size[:, AVAILABLE]
    h, keep = p.h[:, None], np.where(p.explicit, 0.0, 0.5)[:, None]
    at = np.where(b.locked, b.locked_at[:, None], b.imposed_at)
    velocity = p.command[:, :, 1]
    only_velocity = ~b.locked & np.isnan(p.command[:, :, 0])
    rate = np.where(b.locked | np.isnan(velocity), 0.0, velocity)
    pull = np.stack([p.pull_in_speed, p.pull_in_rate], axis=1)
    pull = np.maximum(pull, 1.5 * np.abs(w - rate))
    back = np.clip((at - o.place) / h, -pull, pull)
    target = np.where(only_velocity, rate, rate + back - keep * (w - rate))
    way_size, rate_size = np.abs(at) + o.place_size, w_size + np.abs(rate)
    far = _beyond(np.abs(at - o.place), pull, way_size, h)
    size = np.abs(rate) + keep * rate_size
    size += np.where(far, np.maximum(pull, 1.5 * rate_size), way_size / h)
    size = np.where(only_velocity, np.abs(rate), size)
    rows = b.locked | b.driven
    b.both = b.both | rows
    b.low, b.high = np.where(rows, target, b.low), np.where(rows, target, b.high)
    b.low_size = np.where(rows, size, b.low_size)
    b.high_size = np.where(rows, size, b.high_size)
    b.impact = np.where(rows, 0.0, b.impact)


def after(p: Parameters, o: Observed, past: History, b: Bounds, out: Array) -> History:
    """``past`` with what bounds remember of this sample and its answer."""
    coefficient = out[:, layout.RESTITUTION]
    rows = p.lock >= 0
    last = np.where(p.lock == 1, o.place[:, 1], o.place[:, 0])
    velocity = np.where(np.isnan(p.command[:, :, 1]), 0.0, p.command[:, :, 1])
    pending = np.where(p.explicit[:, None] | (stop_sides(out) == 0.0), 0.0, b.impact)
    w, w_size, eps = o.w[:, AVAILABLE], o.w_size[:, AVAILABLE], coefficient[:, None]
    begins = (pending != 0.0).any(axis=1)
    return dataclasses.replace(
        past,
        pending=pending,
        leaving=np.where(pending != 0.0, -eps * w, past.leaving),
        leaving_size=np.where(pending != 0.0, eps * w_size, past.leaving_size),
        unsure=b.doubt,
        bounce=np.where(begins, coefficient, past.bounce),
        locked=np.asarray(b.locked.any(axis=1)),
        locked_at=b.locked_at,
        lock_last=np.where(rows, last, past.lock_last),
        imposed_at=b.imposed_at + p.h[:, None] * velocity,
    )
