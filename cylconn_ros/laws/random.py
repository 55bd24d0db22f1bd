"""Seeded random generators, one per scene and block, common distributions, what scenes can be."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.laws import rigid
from cylconn_ros.methods.traits import TRAITS
from cylconn_ros.scene.elements import FROM_THE_SAMPLE, SEMI_IMPLICIT

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


def soften(values: dict[str, Any]) -> None:
    """Keep linear springs and dampers within what the period carries (scene/elements.py).

    With a method whose elements act with the force of the sample, a fifth is left to them.
    """
    free = [values[body] for body in ("body_a", "body_b") if values[body]["kind"] == "free"]
    sampled = TRAITS[values["method"]].samples_elements
    if not free or not (sampled or values["plant_integration"] == "semi_implicit"):
        return
    moved = (
        1.0 / sum(1.0 / body["mass"] for body in free),
        1.0 / sum(1.0 / max(body["inertia"][0], body["inertia"][3]) for body in free),
    )
    h = values["period"]
    stiff = 0.1 * FROM_THE_SAMPLE if sampled else 0.9 * SEMI_IMPLICIT
    limits = [("elasticity", ("k1", "kr1"), stiff / h**2)]
    limits += [("damping", ("c1", "cr1"), 0.05 * FROM_THE_SAMPLE / h)] if sampled else []
    for group, names, share in limits:
        given = values.get(group, {})
        for name, most in zip(names, moved, strict=True):
            if name in given:
                given[name] = min(given[name], share * most)
