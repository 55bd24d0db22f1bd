"""Fewer points with the same extremes: buckets of samples, with their smallest and largest value.

A bucket is a stretch of consecutive samples. What is drawn from it covers every sample in it, so a
peak of one sample in a million is as high on the page as in the recording.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


def starts(count: int, buckets: int) -> npt.NDArray[np.intp]:
    """First row of each bucket: at most ``buckets`` of nearly the same size, none empty."""
    number = min(count, buckets)
    return np.arange(number, dtype=np.intp) * count // max(number, 1)


def extremes(values: Array, first: Array) -> tuple[Array, Array]:
    """Smallest and largest finite value of each bucket; NaN where a bucket has none.

    Parameters
    ----------
    values
        (n,) floats.
    first
        (m,) first rows, from :func:`starts`.

    """
    finite = np.where(np.isfinite(values), values, np.nan)
    return np.fmin.reduceat(finite, first), np.fmax.reduceat(finite, first)


def union(bits: Array, first: Array) -> Array:
    """Every bit that is up somewhere in a bucket; ``bits`` (n,) whole numbers."""
    return np.bitwise_or.reduceat(bits, first)


class Extremes:
    """:func:`extremes` of values that come piece by piece.

    Attributes
    ----------
        low, high: (m,) so far; NaN where a bucket has no finite value.
    """

    def __init__(self, first: Array) -> None:
        """``first``: (m,) first rows of the buckets."""
        self._first, self._at = first, 0
        self.low, self.high = np.full((2, len(first)), np.nan)

    def add(self, values: Array) -> None:
        """Take the next (n,) values."""
        which, first = _touched(self._first, self._at, len(values))
        low, high = extremes(values, first)
        self.low[which] = np.fmin(self.low[which], low)
        self.high[which] = np.fmax(self.high[which], high)
        self._at += len(values)


class Union:
    """:func:`union` of bits that come piece by piece; ``bits`` (m,) so far."""

    def __init__(self, first: Array) -> None:
        """``first``: (m,) first rows of the buckets."""
        self._first, self._at = first, 0
        self.bits = np.zeros(len(first), np.int64)

    def add(self, bits: Array) -> None:
        """Take the next (n,) bits."""
        which, first = _touched(self._first, self._at, len(bits))
        self.bits[which] |= union(bits, first)
        self._at += len(bits)


def _touched(first: Array, start: int, count: int) -> tuple[slice, Array]:
    """The buckets that rows from ``start`` on belong to, and their first rows among these."""
    begin = int(np.searchsorted(first, start, "right")) - 1
    end = int(np.searchsorted(first, start + count, "left"))
    return slice(begin, end), np.maximum(first[begin:end] - start, 0)


def telling_rows(columns: Iterable[Array], first: Array, count: int) -> npt.NDArray[np.intp]:
    """Rows that stand for their buckets where whole samples are needed, as for a path in a plane.

    The first row of each bucket, and those with the smallest and the largest finite value of each
    column; in order, each once.
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
