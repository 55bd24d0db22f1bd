"""Energy stored in springs, tables and compliant stops, from the states and the parameters.

    V = k u^2/2 + integral of the table from 0 to u + k_s d^2/2

of slide and spin, u the elongation from the constitutive reference, d the depth beyond a compliant
stop. Zero without elongation and off the stops.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import CylconnError
from cylconn_ros.scene.elements import Table, compliant_stops, has_elements, spring_tables
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]
Stored = Callable[[Mapping[str, Array]], Array]

FIELDS = ("material_displacement", "material_rotation", "length", "angle")
"""Fields of ConnectorState that the energy needs."""


def stored_energy(parameters: Mapping[str, Any]) -> Stored | None:
    """Return the function from the FIELDS, (n,) each, to the energy (n,), J.

    None without springs and compliant stops, and if the parameters are not those of a scene.
    """
    try:
        scene = Scene.from_parameters(parameters)
    except CylconnError:
        return None
    linear = (scene.elasticity.k1, scene.elasticity.kr1)
    if not any(linear) and not has_elements(scene):
        return None
    tables, stops = spring_tables(scene), [compliant_stops(scene.stops, k) for k in (0, 1)]

    def stored(fields: Mapping[str, Array]) -> Array:
        found = np.zeros(len(fields["length"]))
        for k, (of, at) in enumerate(zip(FIELDS[:2], FIELDS[2:], strict=True)):
            u, x = np.asarray(fields[of], float), np.asarray(fields[at], float)
            depth = np.maximum(np.maximum(stops[k].low - x, x - stops[k].high), 0.0)
            found += 0.5 * linear[k] * u * u + 0.5 * stops[k].stiffness * depth * depth
            if tables[k].points:
                found += _integral(tables[k], u) - _integral(tables[k], np.zeros(1))
        return found

    return stored


def _integral(table: Table, u: Array) -> Array:
    """Integral of a table from its first point to u."""
    x, y, slopes = np.array(table.points), np.array(table.values), np.array(table.slopes)
    until = np.concatenate(([0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(x))))
    left = np.clip(np.searchsorted(x, u) - 1, 0, len(x) - 2)
    inside = np.clip(u, x[0], x[-1])
    d = inside - x[left]
    found = until[left] + (y[left] + 0.5 * slopes[left] * d) * d
    for end, slope, beyond in (
        (0, slopes[0], np.minimum(u - x[0], 0.0)), (-1, slopes[-1], np.maximum(u - x[-1], 0.0)),
    ):  # fmt: skip
        found += (y[end] + 0.5 * (0.0 if table.constant else slope) * beyond) * beyond
    return np.asarray(found)
