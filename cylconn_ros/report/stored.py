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

from cylconn_ros.core import model
from cylconn_ros.core.elements import element_energy
from cylconn_ros.core.jit import kernel
from cylconn_ros.errors import CylconnError
from cylconn_ros.scene.elements import has_elements
from cylconn_ros.scene.packing import pack
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
        par = pack(scene)
    except CylconnError:
        return None
    if not (scene.elasticity.k1 or scene.elasticity.kr1 or has_elements(scene)):
        return None

    def stored(fields: Mapping[str, Array]) -> Array:
        columns = [np.ascontiguousarray(fields[name], np.float64) for name in FIELDS]
        found = np.zeros(len(columns[0]))
        for k, (elongation, position) in enumerate(zip(columns[:2], columns[2:], strict=True)):
            _add_energy(par, k, elongation, position, found)
        return found

    return stored


@kernel
def _add_energy(par: Array, k: int, u: Array, x: Array, found: Array) -> None:
    """Add the energy stored in slide (k = 0) or spin (1); all (n,)."""
    for row in range(len(u)):
        found[row] += 0.5 * par[model.ELASTICITY + k] * u[row] * u[row]
        if par[model.ELEMENTS + k] != 0.0:
            found[row] += element_energy(par, model.ELEMENTS, k, u[row], x[row])
