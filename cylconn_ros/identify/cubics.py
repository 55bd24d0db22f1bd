"""Cubics in time, fitted to measurements over windows; what they leave is noise.

A window of w intervals has w + 1 measurements, at whatever times. A cubic takes four of their
degrees of freedom. Its slope at the middle has the variance 75 V / (w^3 h^2) for measurements with
white noise of variance V, a period h apart, and many of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]

TERMS = 4
SHORT = 6  # intervals over which any motion is a cubic


class Fits(NamedTuple):
    """Rows by which values in windows make a cubic's value and slope at the middle of each."""

    middle: Array  # (n,) times, s
    value: Array  # (n, w + 1)
    slope: Array  # (n, w + 1), 1/s
    design: Array  # (n, w + 1, 4)
    solve: Array  # (n, 4, w + 1)

    def rest(self, inside: Array) -> Array:
        """(n, w + 1, k) what the cubics leave of values (n, w + 1, k)."""
        return np.asarray(inside - self.design @ (self.solve @ inside))


def fits(times: Array) -> Fits:
    """Of windows with the ascending times (n, w + 1)."""
    middle: Array = 0.5 * (times[:, 0] + times[:, -1])
    half: Array = 0.5 * (times[:, -1] - times[:, 0])
    x = (times - middle[:, None]) / half[:, None]
    design = np.stack([np.ones_like(x), x, x * x, x**3], axis=2).astype(np.float64)
    turned = design.transpose(0, 2, 1)
    solve = np.asarray(np.linalg.solve(turned @ design, turned), dtype=np.float64)
    return Fits(middle, solve[:, 0], solve[:, 1] / half[:, None], design, solve)


def cut(samples: int, w: int) -> Index:
    """(n, w + 1) rows of windows without a common sample, in the middle of ``samples`` of them."""
    count = samples // (w + 1)
    begin = (samples - count * (w + 1)) // 2
    return np.asarray(begin + np.arange(count * (w + 1)).reshape(count, w + 1), dtype=np.intp)


def noise(time: Array, values: Array) -> Array:
    """(k, k) covariance of the white noise in ``values`` (n, k), n > SHORT, beside a motion."""
    rows = cut(len(time), SHORT)
    rest = fits(time[rows]).rest(values[rows]).reshape(-1, values.shape[1])
    return np.asarray(rest.T @ rest / (len(rows) * (SHORT + 1 - TERMS)))
