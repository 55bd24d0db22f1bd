"""Residuals: what a law leaves over, by the size of the terms that enter it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.laws.parameters import Parameters, Table
from cylconn_ros.laws.sample_state import History

Array = NDArray[np.float64]

TOLERANCE = 1e-12
"""What is attainable in double precision over extreme scales, and allowed."""


@dataclasses.dataclass
class Block:
    """Samples and their answers: row k of every array belongs together."""

    parameters: Parameters
    tables: Sequence[Table]
    sample: Array  # (n, NSAMPLE)
    out: Array  # (n, NOUT)
    past: History  # before the sample


def ratio(value: Array, size: Array) -> Array:
    """|value| / size, 0 where both vanish, infinite for what is not finite."""
    value = np.abs(value)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        found = np.where(value > 0.0, value / size, 0.0)
    return np.where(np.isfinite(value) & ~np.isnan(found), found, np.inf)


def worst(rows: Array) -> Array:
    """(n,) the greatest of (n, k) rows."""
    return np.asarray(np.max(rows, axis=1))
