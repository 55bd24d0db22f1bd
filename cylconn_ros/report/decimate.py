"""Decimation of long runs to buckets of consecutive samples, with the extremes of each bucket.

The drawn range of a bucket contains all of its samples, so that a peak of a single sample has its
full height on the page.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


def bucket_starts(count: int, buckets: int) -> npt.NDArray[np.intp]:
    """Return the first row of each bucket: at most ``buckets`` of nearly equal size, none empty."""
    number = min(count, buckets)
    return np.arange(number, dtype=np.intp) * count // max(number, 1)


def extremes(values: Array, first: Array) -> tuple[Array, Array]:
    """Return smallest and largest finite value of each bucket; NaN if a bucket has none.

    Parameters
    ----------
    values
        (n,) floats.
    first
        (m,) first rows, from :func:`starts`.

    """
    finite = np.where(np.isfinite(values), values, np.nan)
    return np.fmin.reduceat(finite, first), np.fmax.reduceat(finite, first)


def bitwise_or(bits: Array, first: Array) -> Array:
    """Return the bitwise or of the samples of each bucket; ``bits`` (n,) integers."""
    return np.bitwise_or.reduceat(bits, first)


class RunningExtremes:
    """:func:`extremes` of values that are added block by block.

    Attributes
    ----------
        low, high: (m,) of the values added so far; NaN if a bucket has no finite value.
    """

    def __init__(self, first: Array) -> None:
        """Start with no values; ``first`` (m,) are the first rows of the buckets."""
        self._first, self._at = first, 0
        self.low, self.high = np.full((2, len(first)), np.nan)

    def add(self, values: Array) -> None:
        """Add the next (n,) values."""
        which, first = _touched(self._first, self._at, len(values))
        low, high = extremes(values, first)
        self.low[which] = np.fmin(self.low[which], low)
        self.high[which] = np.fmax(self.high[which], high)
        self._at += len(values)


class RunningBitwiseOr:
    """:func:`union` of integers that are added block by block; the result is ``bits`` (m,)."""

    def __init__(self, first: Array) -> None:
        """Start with no values; ``first`` (m,) are the first rows of the buckets."""
        self._first, self._at = first, 0
        self.bits = np.zeros(len(first), np.int64)

    def add(self, bits: Array) -> None:
        """Add the next (n,) integers."""
        which, first = _touched(self._first, self._at, len(bits))
        self.bits[which] |= bitwise_or(bits, first)
        self._at += len(bits)


def _touched(first: Array, start: int, count: int) -> tuple[slice, Array]:
    """Return the buckets of ``count`` rows from ``start`` on, and their first rows in the block."""
    begin = int(np.searchsorted(first, start, "right")) - 1
    end = int(np.searchsorted(first, start + count, "left"))
    return slice(begin, end), np.maximum(first[begin:end] - start, 0)


def extreme_rows(columns: Iterable[Array], first: Array, count: int) -> npt.NDArray[np.intp]:
    """Return rows that represent their buckets, for plots that need whole samples (trajectories).

    These are the first row of each bucket, the rows with the smallest and the largest finite value
    of each column, and the last row; in order, each once.
    """
    kept = [np.asarray(first, dtype=np.intp), np.array([count - 1], dtype=np.intp)]
    ends = np.append(first[1:], count)
    for column in columns:
        finite = np.isfinite(column)
        low, high = np.where(finite, column, np.inf), np.where(finite, column, -np.inf)
        for start, end in zip(first, ends, strict=True):
            rows = (start + low[start:end].argmin(), start + high[start:end].argmax())
            kept.append(np.array(rows, dtype=np.intp))
    return np.unique(np.concatenate(kept))
