"""Law of drives: imposed motion with a greatest force, and against stops.

A drive with the target rate t and the greatest force F, whose reaction p is d alone, has

    w+ = t, |d| <= F     or     w+ <= t, d = F     or     w+ >= t, d = -F

and where an upper stop also acts, p = d - n with n >= 0: w+ <= t, p <= F, or w+ >= t, p <= -F; a
lower stop alike. The target of an imposed position with a finite F depends on the braking
distance and is not judged, only its force is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.laws.bounds import Bounds, driven, stop_sides
from cylconn_ros.laws.normalised import TOLERANCE, ratio
from cylconn_ros.laws.parameters import Bools, Parameters

Array = NDArray[np.float64]
REACTIONS = [layout.FORCE_REACTION, layout.MOMENT_REACTION]


def drive_residual(p: Parameters, out: Array, b: Bounds, rate: Array, size: Array) -> Array:
    """(n, 2) residual of the drives' conditions; 0 for components that are not driven.

    rate: (n, 2) w+ and ``size`` its size. Infinite where DRIVE_BLOCKED is set without a stop or a
    lock.
    """
    force, side = out[:, REACTIONS], stop_sides(out)
    most, target = p.drive[:, :, 0], b.low
    size = size + b.low_size
    unknown = np.isfinite(most) & ~np.isnan(p.command[:, :, 0])
    ahead = np.where(unknown, 0.0, ratio(np.maximum(target - rate, 0.0), size))
    beyond = np.where(unknown, 0.0, ratio(np.maximum(rate - target, 0.0), size))
    above, below = excess(force, most), excess(-force, most)
    at_most, at_least = _distance(force, most), _distance(-force, most)
    holds = np.maximum(np.maximum(ahead, beyond), np.maximum(above, below))
    gives_way = np.minimum(np.maximum(at_most, beyond), np.maximum(at_least, ahead))
    upper = np.minimum(np.maximum(beyond, above), np.maximum(ahead, excess(force, -most)))
    lower = np.minimum(np.maximum(ahead, below), np.maximum(beyond, excess(-force, -most)))
    free = np.minimum(holds, gives_way)
    found = np.where(side > 0.0, upper, np.where(side < 0.0, lower, free))
    found = np.where(driven(p, b), found, 0.0)
    flagged = (out[:, layout.FLAGS].astype(np.int64) & layout.DRIVE_BLOCKED) != 0
    wrong = flagged & ~((side != 0.0) & b.imposed | b.locked).any(axis=1)
    return np.asarray(np.where(wrong[:, None], np.inf, found))


def gives_way(p: Parameters, out: Array, b: Bounds) -> Bools:
    """(n, 2) whether a drive acts with its greatest force, away from stops: its component moves."""
    at_most = _distance(np.abs(out[:, REACTIONS]), p.drive[:, :, 0]) <= TOLERANCE
    return np.asarray(driven(p, b) & (stop_sides(out) == 0.0) & at_most)


def excess(force: Array, most: Array) -> Array:
    """By how much a force exceeds ``most``, relative; ``most`` may be infinite."""
    finite = np.isfinite(most)
    limit = np.where(finite, most, 1.0)
    excess = np.maximum(force - limit, 0.0) / np.abs(limit)
    return np.where(finite, excess, np.where(most < 0.0, np.inf, 0.0))


def _distance(force: Array, most: Array) -> Array:
    """Distance of a force from ``most``, relative; infinite if that is infinite."""
    finite = np.isfinite(most)
    limit = np.where(finite, most, 1.0)
    return np.where(finite, np.abs(force - limit) / limit, np.inf)
