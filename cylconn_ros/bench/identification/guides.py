"""A level guide pushed to and fro, and a carriage that coasts to rest.

Friction is viscous or differs by direction, which a scene with one coefficient does not tell. The
motion is integrated here, independent of the connector; a push within friction holds the guide
exactly.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.bench.identification import sensors
from cylconn_ros.bench.identification.sensors import MASS, PERIOD, WEIGHT
from cylconn_ros.core import layout
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

SUBSTEPS = 20
PUSH, FREQUENCY = 14.0, 1.0  # N, Hz


class Guide(NamedTuple):
    """Friction and motion of a guide."""

    forward: float  # coefficient of a positive slide
    backward: float
    viscous: float  # N.s/m
    rate: float = 0.0  # m/s, at the begin
    push: float = PUSH  # N, amplitude
    samples: int = 4000


GUIDES = {
    "guide, 0.20 both ways": Guide(0.2, 0.2, 0.0),
    "guide, 0.25 out and 0.15 back": Guide(0.25, 0.15, 0.0),
    "guide, 0.20 and 2 N.s/m": Guide(0.2, 0.2, 2.0),
    "coasting, 0.20 and 2 N.s/m": Guide(0.2, 0.2, 2.0, 1.5, 0.0, 1000),
}


def scene() -> Scene:
    """Return what is assumed of the guide: a coefficient, and no damping."""
    return sensors.scene(coefficient=0.2, radius=0.02)


def motion(guide: Guide) -> Array:
    """Return the exact samples (n, NSAMPLE)."""
    rows = np.zeros((guide.samples, layout.NSAMPLE))
    x, v, d = 0.0, guide.rate, PERIOD / SUBSTEPS
    for k, row in enumerate(rows):
        push = guide.push * math.sin(2.0 * math.pi * FREQUENCY * k * PERIOD)
        row[layout.A_POSE + 6] = row[layout.B_POSE + 6] = 1.0
        row[layout.B_POSE], row[layout.B_TWIST] = x, v
        row[layout.LOADS] = [0.0] * 6 + [push] + [0.0] * 5
        for _ in range(SUBSTEPS):
            if v == 0.0 and -guide.backward * WEIGHT <= push <= guide.forward * WEIGHT:
                continue
            outwards = v > 0.0 or (v == 0.0 and push > 0.0)
            friction = -guide.forward * WEIGHT if outwards else guide.backward * WEIGHT
            after = v + d * (push + friction - guide.viscous * v) / MASS
            if v * after < 0.0:
                after = 0.0
            x, v = x + 0.5 * d * (v + after), after
    return rows
