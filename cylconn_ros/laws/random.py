"""Seeded random generators, one per scene and block, and common distributions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.laws import rigid

Array = NDArray[np.float64]
Random = np.random.Generator


def generator(*seed: int) -> Random:
    """Generator of a scene or block. seed: seed of the check, number, and part of the scene."""
    return np.random.default_rng(seed)


def decades(rng: Random, low: float, high: float, size: int | None = None) -> Any:
    """10 to a power that is uniform between ``low`` and ``high``."""
    return 10.0 ** rng.uniform(low, high, size)


def direction(rng: Random, n: int) -> Array:
    """(n, 3) uniform unit vectors."""
    v = rng.normal(size=(n, 3))
    return v / rigid.norm(v)[:, None]


def orientation(rng: Random, n: int) -> Array:
    """(n, 4) uniform unit quaternions."""
    return rigid.normalised(rng.normal(size=(n, 4)))
