"""Stops, locks and imposed motion as bounds on the rates of slide and spin (see equations.md).

A bound at distance ``gap``, whose rate is w (negative: approaching), requires w+ >= t:

    contact           t = -gap/h - w/2
    impact, 1st step  t = w (T - 1/2 - eps' (3/2 - T)),  T = -gap/(h w); begins if
                      gap + 3/2 h w < 0
    impact, 2nd step  t = -eps' w of the first
    lock, position    w+ = vc - (x - xc)/h - (w - vc)/2, in both directions; see also drives.py
    velocity          w+ = vc

For a semi-implicit plant the halves vanish, and an impact is one step, t = -eps' w, which begins if
gap + h w < 0. -gap/h is limited by the pull-in speed. (x - xc)/h is limited by the greater of the
pull-in speed (of an imposed position: its approach speed) and 3/2 |w - vc|, which brings the
component to rest. If an output reports the coefficient 0, the step is a contact and no impact.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws.parameters import Bools, Parameters, Rows
from cylconn_ros.laws.sample_state import History, SampleState
from cylconn_ros.laws.step import FREE

Array = NDArray[np.float64]
ROUNDING = 1e-13  # relative margin below which a decision depends on rounding
STILL = 1e-9  # relative rate below which the direction of motion is undefined


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
    impact: Array  # (n, 2) side (-1, 1) of the stop at which an impact begins
    acting: Bools  # (n,) an impact begins or has its second step
    ambiguous: Bools  # (n,) rounding decides whether an impact begins, or began before
    newly_ambiguous: Bools  # (n,) the same, for this step alone
    locked_at: Array  # (n,)
    imposed_at: Array  # (n, 2)

    def held(self, out: Array) -> Bools:
        """(n, 2) which components the outputs hold at a bound; friction does not stick there."""
        return self.bilateral | (stop_sides(out) != 0.0)


def driven(p: Parameters, b: Bounds) -> Bools:
    """(n, 2) whether a stop or a greatest force can hold an imposed motion back."""
    held_back = np.isfinite(p.stops).any(axis=2) | np.isfinite(p.drive[:, :, 0])
    return np.asarray(b.imposed & ~b.locked & held_back)


def stop_sides(out: Array) -> Array:
    """(n, 2) reported stop: -1 lower, 1 upper, 0 none, NaN both."""
    bits = out[:, layout.STOP].astype(np.int64)
    sides = np.array([0.0, -1.0, 1.0, np.nan])
    return np.stack([sides[bits & 3], sides[bits >> 2 & 3]], axis=1)


def bounds(p: Parameters, o: SampleState, past: History, coefficient: Array) -> Bounds:
    """Bounds of a step. coefficient: (n,) the restitution eps' that the output reports."""
    x, w = o.position, o.w[:, FREE]
    w_size = o.w_size[:, FREE]
    h, keep = p.h[:, None], np.where(p.explicit, 0.0, 0.5)[:, None]
    pull = np.stack([p.pull_in_speed, p.pull_in_rate], axis=1)
    eps = coefficient[:, None]
    impact = np.zeros_like(w)
    newly_ambiguous, ties = np.zeros_like(past.ambiguous), np.zeros(w.shape, dtype=np.bool_)
    limits, sizes = [], []
    for side, number in ((-1.0, 0), (1.0, 1)):
        stop = p.stops[:, :, number]
        there = np.isfinite(stop)
        stop = np.where(there, stop, 0.0)
        gap, rate = -side * (x - stop), -side * w
        gap_size = o.position_size + np.abs(stop)
        target = np.minimum(-gap / h, pull) - keep * rate
        size = (
            np.where(_exceeds_pull_in(-gap, pull, gap_size, h), pull, gap_size / h) + keep * w_size
        )
        reach = np.where(p.explicit, 1.0, 1.5)[:, None] * h * rate
        near = np.abs(gap + reach) < ROUNDING * (gap_size + h * w_size)
        begins = there & (rate < 0.0) & (p.restitution[:, None] > 0.0) & (eps > 0.0)
        ties |= begins & near
        begins &= near | (gap + reach < 0.0)
        newly_ambiguous |= past.ambiguous & begins.any(axis=1)
        begins &= (past.pending == 0.0) & (impact == 0.0)
        still = there & (np.abs(rate) <= STILL * w_size) & (eps > 0.0)
        newly_ambiguous |= (still & (gap < ROUNDING * gap_size)).any(axis=1)
        time = np.maximum(-gap / np.where(begins, h * rate, -1.0), 0.5)
        first = rate * (time - 0.5 - eps * (1.5 - time))
        first_size = 2.0 * w_size + (1.0 + eps) * (w_size + gap_size / h)
        first = np.where(p.explicit[:, None], -eps * rate, first)
        second = past.pending == side
        target = np.where(begins, first, target)
        size = np.where(begins, first_size, size)
        target = np.where(second, -side * past.leaving_rate, target)
        size = np.where(second, past.leaving_size, size)
        impact = np.where(begins, side, impact)
        limits.append(np.where(there, -side * target, side * np.inf))
        sizes.append(np.where(there, size, 0.0))
    # an impact whose second step is due reports its coefficient again; another may begin then
    repeated = (past.pending != 0.0).any(axis=1) & (coefficient == past.pending_restitution)
    certain = ((impact != 0.0) & ~ties) | (past.pending != 0.0)
    newly_ambiguous |= ties.any(axis=1) & certain.any(axis=1)  # rounding decides which one
    newly_ambiguous |= repeated & (impact != 0.0).any(axis=1)
    low, high = limits
    low_size, high_size = sizes
    crossed = low > high
    with np.errstate(invalid="ignore"):  # the bounds leave no range except rounding
        newly_ambiguous |= (np.abs(high - low) <= 1e-12 * (low_size + high_size)).any(axis=1)
    middle = 0.5 * (np.where(crossed, low, 0.0) + np.where(crossed, high, 0.0))
    wide = 0.5 * (low_size + high_size)
    found = Bounds(
        low=np.where(crossed, middle, low),
        low_size=np.where(crossed, wide, low_size),
        high=np.where(crossed, middle, high),
        high_size=np.where(crossed, wide, high_size),
        bilateral=crossed,
        locked=np.zeros_like(crossed),
        imposed=p.imposed,
        impact=impact,
        acting=np.any((impact != 0.0) | (past.pending != 0.0), axis=1),
        ambiguous=newly_ambiguous | past.ambiguous,
        newly_ambiguous=newly_ambiguous,
        locked_at=past.locked_at,
        imposed_at=_imposed_at(p, o, past),
    )
    _lock(p, o, past, found)
    _hold(p, o, found)
    return found


def _exceeds_pull_in(distance: Array, pull: Array, size: Array, h: Array) -> Bools:
    """Whether a distance exceeds the pull-in distance of a step by more than rounding."""
    return np.asarray(distance - pull * h > ROUNDING * size)


def _imposed_at(p: Parameters, o: SampleState, past: History) -> Array:
    """(n, 2) position of imposed motions at this sample.

    They start at the position that their parameter gives, else at that of the first sample.
    """
    first = np.where(np.isnan(p.command[:, :, 0]), o.position, p.command[:, :, 0])
    return np.where(past.started[:, None], past.imposed_at, first)


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
    coefficient = out[:, layout.RESTITUTION]
    rows = p.lock >= 0
    last = np.where(p.lock == 1, o.position[:, 1], o.position[:, 0])
    velocity = np.where(np.isnan(p.command[:, :, 1]), 0.0, p.command[:, :, 1])
    pending = np.where(p.explicit[:, None] | (stop_sides(out) == 0.0), 0.0, b.impact)
    w, w_size, eps = o.w[:, FREE], o.w_size[:, FREE], coefficient[:, None]
    begins = (pending != 0.0).any(axis=1)
    return dataclasses.replace(
        past,
        pending=pending,
        leaving_rate=np.where(pending != 0.0, -eps * w, past.leaving_rate),
        leaving_size=np.where(pending != 0.0, eps * w_size, past.leaving_size),
        ambiguous=b.newly_ambiguous,
        pending_restitution=np.where(begins, coefficient, past.pending_restitution),
        locked=np.asarray(b.locked.any(axis=1)),
        locked_at=b.locked_at,
        lock_last=np.where(rows, last, past.lock_last),
        imposed_at=b.imposed_at + p.h[:, None] * velocity,
    )
