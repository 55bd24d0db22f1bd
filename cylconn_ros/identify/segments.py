"""Stretches of a recording in which the joint slips, or rests."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.identify.cubics import SHORT, cut, fits
from cylconn_ros.identify.intervals import Measured

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CHI_MEDIAN = 2.3659738843753377  # of three degrees of freedom
SLIPS_ABOVE = 5.0  # standard deviations of the slip rate
SHORTEST = 16  # intervals
TURNING = 2  # intervals at the ends of slip, in which it turns or begins
CHUNK = 512  # intervals over which the noise is taken as constant


class Stretch(NamedTuple):
    """Intervals first … last - 1, all usable, of one regime."""

    first: int
    last: int
    slips: bool

    @property
    def size(self) -> int:
        """How many intervals."""
        return self.last - self.first


def slip_rate(measured: Measured, radius: float) -> tuple[Array, float]:
    """(n,) |s| at the ends of the intervals and the standard deviation of one component."""
    s = measured.rates * [1.0, radius]
    if len(s) <= SHORT:
        return np.hypot(s[:, 0], s[:, 1]), 0.0
    rows = cut(len(s), SHORT)
    left = np.square(fits(measured.time[rows]).rest(s[rows])).sum(axis=1)
    # The median, of a chi square with three degrees of freedom: jerks do not count.
    deviation = np.sqrt(np.median(left, axis=0) / CHI_MEDIAN)
    return np.hypot(s[:, 0], s[:, 1]), float(deviation.max())


def threshold(measured: Measured, deviation: float) -> float:
    """The slip rate above which the joint slips, m/s."""
    return max(measured.scene.friction.rest_rate, SLIPS_ABOVE * deviation)


def stretches(measured: Measured, radius: float) -> list[Stretch]:
    """The stretches of slip and of rest, in their order; what is too short for either is left out.

    An interval counts as slip where both its ends do, and as rest where neither does.
    """
    rate, deviation = slip_rate(measured, radius)
    fast = rate > threshold(measured, deviation)
    before = np.r_[fast[:1], fast[:-1]]
    found = []
    for slips, rows in ((True, fast & before), (False, ~fast & ~before)):
        inside = np.r_[False, rows & measured.usable, False].astype(np.int8)
        edges = np.flatnonzero(np.diff(inside))
        trim = TURNING if slips else 0
        found += [
            Stretch(int(a) + trim, int(b) - trim, slips)
            for a, b in zip(edges[::2], edges[1::2], strict=True)
            if b - a - 2 * trim >= SHORTEST
        ]
    return sorted(found)


def chunks(stretch: Stretch) -> list[Stretch]:
    """A stretch in pieces of about CHUNK intervals, none shorter than half of it if it can be."""
    parts = max(1, round(stretch.size / CHUNK))
    edges = np.linspace(stretch.first, stretch.last, parts + 1).astype(int)
    return [Stretch(int(a), int(b), stretch.slips) for a, b in pairwise(edges)]
