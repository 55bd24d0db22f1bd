"""Chance: a generator for each scene and block, and what is drawn everywhere."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.laws import rigid

Array = NDArray[np.float64]
Random = np.random.Generator


def generator(*seed: int) -> Random:
    """The generator of a scene or block: the draw's seed, its number, and which part of it."""
    return np.random.default_rng(seed)


def decades(rng: Random, low: float, high: float, size: int | None = None) -> Any:
    """10 to a power uniform between ``low`` and ``high``."""
    return 10.0 ** rng.uniform(low, high, size)


def direction(rng: Random, n: int) -> Array:
    """(n, 3) unit vectors, uniform."""
    v = rng.normal(size=(n, 3))
    return v / rigid.norm(v)[:, None]


def orientation(rng: Random, n: int) -> Array:
    """(n, 4) quaternions, uniform."""
    return rigid.normalised(rng.normal(size=(n, 4)))
