"""U: stops with restitution, locks and imposed motion, by the bounds that they set to the rates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws.bounds import Bounds, bounds, stop_sides
from cylconn_ros.laws.normalised import Block, ratio, worst
from cylconn_ros.laws.parameters import Parameters
from cylconn_ros.laws.reduced import problem_of
from cylconn_ros.laws.sample_state import Observed
from cylconn_ros.laws.step import AVAILABLE, Step

Array = NDArray[np.float64]
REACTIONS = [layout.FORCE_REACTION, layout.MOMENT_REACTION]


def bounds_of(block: Block, o: Observed) -> Bounds:
    """The bounds of a block's steps, with the coefficients that its answers report."""
    return bounds(block.parameters, o, block.past, block.out[:, layout.RESTITUTION])


def stops(block: Block, o: Observed, s: Step, b: Bounds, end: Array, end_size: Array) -> Array:
    """U: 0 <= p _|_ w+ - t >= 0 at each bound, and what the answer says of it; NaN: no bounds.

    end: (n, 6) J~ v+, and its size.
    """
    p, out = block.parameters, block.out
    rate = end[:, AVAILABLE] + s.bracket[:, AVAILABLE]
    size = end_size[:, AVAILABLE] + s.bracket_size[:, AVAILABLE]
    given, side = out[:, REACTIONS], stop_sides(out)
    with np.errstate(invalid="ignore"):
        below = ratio(np.maximum(b.low - rate, 0.0), size + b.low_size)
        above = ratio(np.maximum(rate - b.high, 0.0), size + b.high_size)
        low, high = ratio(rate - b.low, size + b.low_size), ratio(rate - b.high, size + b.high_size)
    free = np.maximum(below, above)
    pushing = _pulls(block, o, s, given, side, size)
    at_low, at_high = np.maximum(low, pushing), np.maximum(high, pushing)
    found = np.where(side < 0.0, at_low, np.where(side > 0.0, at_high, free))
    found = np.where(b.both, low, found)
    carried = (given != 0.0) & ~b.both & (side == 0.0)
    told = (b.locked | b.driven) & (side != 0.0)  # a lock or a motion is no stop
    found = np.where(carried | told | np.isnan(side), np.inf, found)
    found = np.maximum(worst(found), _said(p, out, b))
    return np.where(p.bounded & ~b.unsure, found, np.nan)


def _said(p: Parameters, out: Array, b: Bounds) -> Array:
    """Whether lock and restitution are those that are, 0 or infinite."""
    locks = np.array([1.0, 2.0])
    wrong = out[:, layout.LOCK] != (b.locked * locks).sum(axis=1)
    coefficient = out[:, layout.RESTITUTION]
    wrong |= (coefficient > 0.0) & ~b.acting
    wrong |= (coefficient < 0.0) | (coefficient > p.restitution)
    return np.where(wrong, np.inf, 0.0)


def _pulls(block: Block, o: Observed, s: Step, given: Array, side: Array, size: Array) -> Array:
    """(n, 2) by how much a stop pulls, as what it does to the rate."""
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
