"""Segments of a recording in which the joint slips or is at rest."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.identification.forces.cubics import SHORT_WINDOW, fit_cubics, window_rows
from cylconn_ros.identification.forces.intervals import Intervals

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CHI_SQUARE_MEDIAN = 2.3659738843753377  # three degrees of freedom
SLIP_SIGNIFICANCE = 5.0  # standard deviations of the slip rate
MIN_SEGMENT = 16  # intervals
TRIMMED = 2  # intervals at either end of a slip segment, in which slip begins or reverses
LONGEST = 5.0  # times the usual length of a window; a longer one has a gap
NOISE_SPAN = 512  # intervals over which the noise is assumed constant


class Segment(NamedTuple):
    """Intervals first to last - 1, all usable, of one regime."""

    first: int
    last: int
    slips: bool

    @property
    def size(self) -> int:
        """Number of intervals."""
        return self.last - self.first


def slip_rate(measured: Intervals, radius: float) -> tuple[Array, float]:
    """Return |s| (n,) at the ends of the intervals, and the standard deviation of a component."""
    s = measured.rates * [1.0, radius]
    if len(s) <= SHORT_WINDOW:
        return np.hypot(s[:, 0], s[:, 1]), 0.0
    rows = window_rows(len(s), SHORT_WINDOW)
    span = measured.time[rows[:, -1]] - measured.time[rows[:, 0]]
    rows = rows[span <= LONGEST * np.median(span)]  # not across a gap of the recording
    squares = np.square(fit_cubics(measured.time[rows]).residuals(s[rows])).sum(axis=1)
    # From the median of a chi-square variable with three degrees of freedom, which is insensitive
    # to outliers, such as sudden changes of velocity.
    deviation = np.sqrt(np.median(squares, axis=0) / CHI_SQUARE_MEDIAN)
    return np.hypot(s[:, 0], s[:, 1]), float(deviation.max())


def slip_threshold(measured: Intervals, deviation: float) -> float:
    """Return the slip rate above which the joint slips, m/s."""
    return max(measured.scene.friction.rest_rate, SLIP_SIGNIFICANCE * deviation)


def find_segments(measured: Intervals, radius: float) -> list[Segment]:
    """Return the slip and rest segments in order of time, without those that are too short.

    An interval belongs to slip if the slip rate exceeds the threshold at both of its ends, and to
    rest if it does so at neither.
    """
    rate, deviation = slip_rate(measured, radius)
    fast = rate > slip_threshold(measured, deviation)
    before = np.r_[fast[:1], fast[:-1]]
    found = []
    for slips, rows in ((True, fast & before), (False, ~fast & ~before)):
        inside = np.r_[False, rows & measured.usable, False].astype(np.int8)
        edges = np.flatnonzero(np.diff(inside))
        trim = TRIMMED if slips else 0
        found += [
            Segment(int(a) + trim, int(b) - trim, slips)
            for a, b in zip(edges[::2], edges[1::2], strict=True)
            if b - a - 2 * trim >= MIN_SEGMENT
        ]
    return sorted(found)


def split_segment(segment: Segment) -> list[Segment]:
    """Split a segment into equal parts of about NOISE_SPAN intervals."""
    parts = max(1, round(segment.size / NOISE_SPAN))
    edges = np.linspace(segment.first, segment.last, parts + 1).astype(int)
    return [Segment(int(a), int(b), segment.slips) for a, b in pairwise(edges)]
