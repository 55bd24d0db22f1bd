"""Law of stops with restitution, locks and imposed motion, by their bounds on the rates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws.bounds import Bounds, bounds, driven, stop_sides
from cylconn_ros.laws.drives import drive_residual
from cylconn_ros.laws.normalised import Block, ratio, worst
from cylconn_ros.laws.parameters import Parameters
from cylconn_ros.laws.reduced import problem_of
from cylconn_ros.laws.sample_state import SampleState
from cylconn_ros.laws.step import FREE, Step

Array = NDArray[np.float64]
REACTIONS = [layout.FORCE_REACTION, layout.MOMENT_REACTION]


def bounds_of(block: Block, o: SampleState, s: Step) -> Bounds:
    """Bounds of a block's steps, with the restitution coefficients that its outputs report."""
    return bounds(block.parameters, block.tables, o, s, block.past, block.out, block.near)


def stops(block: Block, o: SampleState, s: Step, b: Bounds, end: Array, end_size: Array) -> Array:
    """Residual (n,) of 0 <= p _|_ w+ - t >= 0 at each bound, and of the reported states.

    end: (n, 6) J~ v+, and its size. NaN: no bounds, or rounding decides on an impact.
    """
    p, out = block.parameters, block.out
    rate = end[:, FREE] + s.bracket[:, FREE]
    size = end_size[:, FREE] + s.bracket_size[:, FREE]
    given, side = out[:, REACTIONS], stop_sides(out)
    with np.errstate(invalid="ignore"):
        below = ratio(np.maximum(b.low - rate, 0.0), size + b.low_size)
        above = ratio(np.maximum(rate - b.high, 0.0), size + b.high_size)
        low, high = ratio(rate - b.low, size + b.low_size), ratio(rate - b.high, size + b.high_size)
    free = np.maximum(below, above)
    pulling = _pull_residual(block, o, s, given, side, size)
    at_low, at_high = np.maximum(low, pulling), np.maximum(high, pulling)
    found = np.where(side < 0.0, at_low, np.where(side > 0.0, at_high, free))
    drives = driven(p, b)
    found = np.where(b.bilateral & ~drives, low, found)
    # nor is a stop beside a drive, whose rate at the end of the step is not known beforehand
    found = np.where(drives.any(axis=1, keepdims=True), 0.0, found)
    found = np.maximum(found, drive_residual(p, out, b, rate, size))
    unreported = (given != 0.0) & ~b.bilateral & (side == 0.0)
    misreported = (b.locked | b.imposed) & ~drives & (side != 0.0)  # a lock or motion is no stop
    found = np.where(unreported | misreported | np.isnan(side), np.inf, found)
    found = np.maximum(found, _rest_residual(p, out, b))
    found = np.maximum(worst(found), _status_residual(p, out, b))
    judged = p.bounded & ~b.ambiguous
    if block.others is not None:  # an impact changes the forces of the others
        judged &= (b.impact == 0.0).all(axis=1)
    return np.where(judged, found, np.nan)


def _rest_residual(p: Parameters, out: Array, b: Bounds) -> Array:
    """(n, 2) share of the load of a component at rest at a bound that friction takes: none."""
    friction = np.abs(out[:, [layout.FORCE_FRICTION, layout.MOMENT_FRICTION]])
    load = friction + np.abs(out[:, REACTIONS])
    rests = b.rests(out) & ~driven(p, b).any(axis=1, keepdims=True)
    return np.where(rests, ratio(friction, load), 0.0)


def _status_residual(p: Parameters, out: Array, b: Bounds) -> Array:
    """(n,) infinite if the reported lock or restitution coefficient is wrong, else 0."""
    locks = np.array([1.0, 2.0])
    wrong = out[:, layout.LOCK] != (b.locked * locks).sum(axis=1)
    coefficient = out[:, layout.RESTITUTION]
    judged = ~driven(p, b).any(axis=1)
    wrong |= judged & (coefficient > 0.0) & (b.impact == 0.0).all(axis=1)
    wrong |= (coefficient < 0.0) | (coefficient > p.restitution)
    return np.where(wrong, np.inf, 0.0)


def _pull_residual(
    block: Block, o: SampleState, s: Step, given: Array, side: Array, size: Array
) -> Array:
    """(n, 2) residual of stops that pull: the pull's effect on the rate."""
    wrong = given * side > 0.0
    found = np.zeros_like(given)
    rows = np.flatnonzero(wrong.any(axis=1))
    if not len(rows):
        return found
    q = problem_of(block.parameters.take(rows), o.take(rows), s.take(rows))
    unit = np.stack([np.ones(len(rows)), block.parameters.radius[rows]], axis=1)
    yields = np.stack([q.s[:, 0, 0], q.s[:, 1, 1]], axis=1) / unit**2
    found[rows] = np.where(wrong[rows], ratio(yields * given[rows], size[rows]), 0.0)
    return found
