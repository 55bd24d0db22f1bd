"""Least-squares cubics in time over windows of measurements; their residuals estimate the noise.

A window of w intervals has w + 1 measurements, at arbitrary times. A cubic has four parameters. Its
slope at the middle has the variance 75 V / (w^3 h^2) for measurements with white noise of variance
V and period h, for large w.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]

TERMS = 4
SHORT_WINDOW = 6  # intervals over which a cubic represents any motion


class CubicFits(NamedTuple):
    """Linear operators from the values in n windows to the cubics fitted to them."""

    middle: Array  # (n,) times, s
    value: Array  # (n, w + 1) rows that yield the value at the middle
    slope: Array  # (n, w + 1) rows that yield the slope at the middle, 1/s
    design: Array  # (n, w + 1, 4) design matrices
    solve: Array  # (n, 4, w + 1) least-squares inverses

    def residuals(self, values: Array) -> Array:
        """Return ``values`` (n, w + 1, k) minus the cubics fitted to them."""
        return np.asarray(values - self.design @ (self.solve @ values))


def fit_cubics(times: Array) -> CubicFits:
    """Return the operators for windows with ascending times (n, w + 1)."""
    middle: Array = 0.5 * (times[:, 0] + times[:, -1])
    half: Array = 0.5 * (times[:, -1] - times[:, 0])
    x = (times - middle[:, None]) / half[:, None]
    design = np.stack([np.ones_like(x), x, x * x, x**3], axis=2).astype(np.float64)
    transposed = design.transpose(0, 2, 1)
    solve = np.asarray(np.linalg.solve(transposed @ design, transposed), dtype=np.float64)
    return CubicFits(middle, solve[:, 0], solve[:, 1] / half[:, None], design, solve)


def window_rows(samples: int, w: int) -> Index:
    """Return the rows (n, w + 1) of disjoint windows, centred within ``samples`` rows."""
    count = samples // (w + 1)
    begin = (samples - count * (w + 1)) // 2
    return np.asarray(begin + np.arange(count * (w + 1)).reshape(count, w + 1), dtype=np.intp)


def noise_covariance(time: Array, values: Array) -> Array:
    """Return the covariance (k, k) of white noise in ``values`` (n, k), n > SHORT_WINDOW.

    The motion itself is removed by cubics over the shortest windows.
    """
    rows = window_rows(len(time), SHORT_WINDOW)
    rest = fit_cubics(time[rows]).residuals(values[rows]).reshape(-1, values.shape[1])
    return np.asarray(rest.T @ rest / (len(rows) * (SHORT_WINDOW + 1 - TERMS)))
