"""Inertias of URDF links: those that no body can have, and what is put in their place.

MuJoCo refuses a whole model for one such link. A link that is no part of the connector's bodies
needs not be exact, so that the nearest possible inertia is put in its place, and said; for a body
of the connector it is an error.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import ModelError

Array = NDArray[np.float64]

_ELEMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_LEAST = 1e-9  # kg m^2 of a principal moment that is put in place
_SLACK = 1e-9  # relative violation of the triangle inequality that MuJoCo may not accept


def repair(root: ElementTree.Element) -> dict[str, str]:
    """Change impossible inertias in place; names of the links and what was wrong.

    Raises ModelError for a mass without inertia, or for what is not a number.
    """
    found = {}
    for link in root.findall("link"):
        inertial, name = link.find("inertial"), link.get("name", "")
        if inertial is None:
            continue
        mass = _number(inertial.find("mass"), "value", name)
        inertia = inertial.find("inertia")
        if inertia is None:
            raise ModelError(
                f"link {name}: has a mass ({mass:g} kg) and no inertia; add an inertia element"
            )
        values = [_number(inertia, key, name) for key in _ELEMENTS]
        wrong = _repaired(values, mass)
        if wrong is not None:
            text, tensor = wrong
            found[name] = text
            for key, (i, j) in zip(_ELEMENTS, ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)),
                                   strict=True):  # fmt: skip
                inertia.set(key, repr(float(tensor[i, j])))
    return found


def _repaired(values: list[float], mass: float) -> tuple[str, Array] | None:
    xx, xy, xz, yy, yz, zz = values
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    moments, axes = np.linalg.eigh(tensor)
    if mass <= 0.0 and not tensor.any():
        return None  # a link without mass: MuJoCo says if it may have none
    shown = ", ".join(f"{x:.6g}" for x in moments)
    if moments[0] <= 0.0:
        text = f"principal moments {shown} kg m^2: all must be > 0"
    elif moments[0] + moments[1] < moments[2] * (1.0 - _SLACK):
        text = f"principal moments {shown} kg m^2: the sum of two must not be below the third"
    else:
        return None
    moments = np.maximum(moments, _LEAST)
    short = moments[2] - moments[0] - moments[1]
    if short > 0.0:
        moments = moments + np.array([0.5 * short, 0.5 * short, 0.0]) * (1.0 + 1e-6)
    return text, axes @ np.diag(moments) @ axes.T


def _number(element: ElementTree.Element | None, key: str, name: str) -> float:
    text = "0" if element is None else element.get(key, "0")
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise ModelError(f"link {name}: {key} = {text}: must be a finite number")
    return value
