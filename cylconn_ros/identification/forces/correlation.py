"""Correlation of noise from sample to sample: its test, and intervals taken together until it ends.

Over seven measurements a cubic represents any motion. What is left of noise are its coefficients of
the orthonormal polynomials of degree 4 to 6, in the order of rising frequency; over 13 measurements
those of degree 6 to 12. White noise has the same variance in all of them; noise that is smoothed
has more of it in the low degrees, noise of differences has more in the high ones. The ratio of both
is expressed as the correlation of neighbouring samples of an autoregressive process of first order
that has the same ratio.

Correlated noise looks smaller than it is over a window, so its effect on forces, and the bias by
it, are underestimated. The impulse over k intervals contains the noise of the samples at its ends
only; with k so large that these are not correlated, the noise is white again.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.identification.forces.cubics import SHORT_WINDOW, TERMS, window_rows
from cylconn_ros.identification.forces.intervals import Intervals
from cylconn_ros.identification.forces.segments import find_segments
from cylconn_ros.identification.forces.windows import impulses

Array = NDArray[np.float64]

SIGNIFICANT = 4.0  # standard deviations of a correlation that counts
UNSEEN = 2.0  # standard deviations of a correlation that is left in intervals taken together
ALLOWED = 0.1  # correlation that does not count
REMAINING = 0.015  # correlation over the intervals taken together, at most
MATERIAL = 0.01  # of the force: noise of the shortest windows that does not count
LARGEST = 0.9  # correlation that increases the noise of longer windows
MIN_WINDOWS = 20  # of the test
LONG_WINDOW = 12  # intervals
LOWEST_DEGREE = 6  # over LONG_WINDOW; lower ones contain motion
TOGETHER = (2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24)  # intervals taken together
MOST_TOGETHER = TOGETHER[-1]


class Correlation(NamedTuple):
    """Correlation of the noise of neighbouring samples."""

    value: float  # that of an autoregressive process of first order; 0 for white noise
    deviations: float  # standard deviations by which it differs from zero
    material: bool  # the noise is large enough to change the forces
    windows: int  # of the test

    def describe(self) -> str:
        """Say what was seen and what white noise has."""
        deviation = abs(self.value / self.deviations) if self.deviations else 0.0
        return (
            f"noise of neighbouring samples is correlated: {self.value:.2f} ± "
            f"{1.96 * deviation:.2f} (white noise: 0)"
        )

    @property
    def white(self) -> bool:
        """Whether the noise may be taken as white."""
        small = abs(self.value) < ALLOWED or abs(self.deviations) < SIGNIFICANT
        return small or not self.material


def noise_correlation(measured: Intervals, radius: float, size: int = SHORT_WINDOW) -> Correlation:
    """Estimate the correlation of noise in the segments of slip and rest.

    ``size`` is the number of intervals of a window; longer windows tell more, if a cubic still
    represents the motion.
    """
    lowest = TERMS if size == SHORT_WINDOW else LOWEST_DEGREE
    parts: list[Array] = [np.zeros((0, size + 1 - lowest, 6))]
    means: list[Array] = [np.zeros((0, 6))]
    for segment in find_segments(measured, radius):
        time, p, _ = impulses(measured, segment)
        rows = window_rows(len(p), size)
        inside, span = p[rows], time[rows[:, -1]] - time[rows[:, 0]]
        parts.append(_high_degrees(time[rows], inside, lowest))
        means.append((inside[:, -1] - inside[:, 0]) / span[:, None])
    squares, force = np.square(np.concatenate(parts)), np.concatenate(means)
    if len(squares) < MIN_WINDOWS:
        return Correlation(0.0, 0.0, False, len(squares))
    variance = squares.mean(axis=(0, 1))
    shares = squares / np.maximum(variance, 1e-300)
    half = (size + 1 - lowest) // 2
    low, high = shares[:, :half].sum(axis=(1, 2)), shares[:, -half:].sum(axis=(1, 2))
    difference = low - high
    spread = max(float(difference.std()), 1e-300) / np.sqrt(len(difference))
    ratio = float(low.mean() / max(float(high.mean()), 1e-300))
    correlations = np.linspace(-0.95, 0.99, 195, dtype=np.float64)
    value = float(np.interp(ratio, _ratios(correlations, size, lowest), correlations))
    # Of the slope of a cubic over W intervals: 75 V / (W^3 h^2). Smoothed noise is larger over
    # longer windows than it looks over the shortest ones.
    unit = np.array([1.0, 1.0, 1.0, radius, radius, radius])
    smooth = min(max(value, 0.0), LARGEST)
    variance = variance * (1.0 + smooth) / (1.0 - smooth)
    noise = np.sqrt(75.0 * variance / SHORT_WINDOW**3) / measured.step / unit
    usual = float(np.median(np.linalg.norm(force / unit, axis=1)))
    material = bool((noise > MATERIAL * usual).any())
    return Correlation(value, float(difference.mean() / spread), material, len(squares))


def _high_degrees(times: Array, values: Array, lowest: int) -> Array:
    """Return the coefficients (n, :, k) of degrees ``lowest`` to w of ``values`` (n, w + 1, k)."""
    middle = 0.5 * (times[:, :1] + times[:, -1:])
    half = 0.5 * (times[:, -1:] - times[:, :1])
    x = (times - middle) / half
    q = np.linalg.qr(np.stack([x**k for k in range(times.shape[1])], axis=2)).Q
    return np.asarray(q[:, :, lowest:].transpose(0, 2, 1) @ values)


def _ratios(correlations: Array, size: int, lowest: int) -> Array:
    """Return the expected ratios of low to high degrees; they increase with the correlation."""
    points = size + 1
    lag = np.abs(np.subtract.outer(np.arange(points), np.arange(points)))
    q = _high_degrees(np.arange(points, dtype=np.float64)[None], np.eye(points)[None], lowest)[0]
    covariances = correlations[:, None, None] ** lag
    variances = np.einsum("ki,nij,kj->nk", q, covariances, q)
    half = len(q) // 2
    return np.asarray(variances[:, :half].sum(axis=1) / variances[:, -half:].sum(axis=1))


def independent_noise(measured: Intervals, radius: float) -> tuple[Intervals, int, Correlation]:
    """Take intervals together until the noise of their ends is white.

    Returns
    -------
        The intervals, how many were taken together (1: none, 0: no number makes the noise white;
        then the intervals are as given), and the correlation of neighbouring samples.
    """
    seen = noise_correlation(measured, radius, LONG_WINDOW)
    if seen.white and (seen := noise_correlation(measured, radius)).white:
        return measured, 1, seen
    for k in TOGETHER:
        if seen.value > 0.0 and seen.value**k > REMAINING:
            continue
        merged = together(measured, k)
        left = noise_correlation(merged, radius, LONG_WINDOW)
        if left.windows < MIN_WINDOWS:
            break
        if abs(left.deviations) < UNSEEN:
            return merged, k, seen
    return measured, 0, seen


def together(measured: Intervals, k: int) -> Intervals:
    """Take every ``k`` successive intervals together, after the first one."""
    n = (len(measured.time) - 1) // k
    if k == 1 or n < 1:
        return measured
    last = np.arange(1, n + 1) * k
    rows = last[:, None] - np.arange(k)[::-1]
    dt = measured.dt[rows]
    wrench = np.einsum("nk,nkc->nc", dt, measured.wrench[rows]) / dt.sum(axis=1)[:, None]
    first = measured.usable[:1]
    return dataclasses.replace(
        measured,
        time=np.r_[measured.time[:1], measured.time[last]],
        dt=np.r_[measured.dt[:1], dt.sum(axis=1)],
        wrench=np.vstack([measured.wrench[:1], wrench]),
        rates=measured.rates[np.r_[0, last]],
        places=measured.places[np.r_[0, last]],
        pressed=np.r_[
            measured.pressed[:1],
            (dt * measured.pressed[rows]).sum(axis=1) / dt.sum(axis=1),
        ],
        usable=np.r_[first, measured.usable[rows].all(axis=1)],
    )
