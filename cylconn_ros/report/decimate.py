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
