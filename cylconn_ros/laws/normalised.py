"""Normalised residuals: the error of a law divided by the size of the terms that enter it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.laws.parameters import Parameters, Table
from cylconn_ros.laws.sample_state import History

Array = NDArray[np.float64]

TOLERANCE = 1e-12
"""Largest residual that counts as rounding: attainable in double precision over extreme scales."""


@dataclasses.dataclass
class Block:
    """Samples and their outputs; row k of every array belongs to sample k."""

    parameters: Parameters
    tables: Sequence[Table]
    sample: Array  # (n, NSAMPLE)
    out: Array  # (n, NOUT)
    past: History  # before each sample
    others: Array | None = None  # (n, 12) wrenches of connectors on the same bodies (together.py)
    near: Any = None  # Approach of the samples to their stops (approach.py), if it is known
    elements: Any = None  # Substitution of tables and compliant stops (elements.py), if it is known


def ratio(value: Array, size: Array) -> Array:
    """|value| / size; 0 if both are 0, infinite if the value is not finite."""
    value = np.abs(value)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        found = np.where(value > 0.0, value / size, 0.0)
    return np.where(np.isfinite(value) & ~np.isnan(found), found, np.inf)


def worst(rows: Array) -> Array:
    """(n,) maximum over the columns of (n, k) rows."""
    return np.asarray(np.max(rows, axis=1))
