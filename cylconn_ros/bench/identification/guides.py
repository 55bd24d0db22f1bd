"""A level guide pushed to and fro, and a carriage that coasts to rest, with white noise.

Friction is viscous or differs by direction, which a scene with one coefficient does not tell. The
motion is integrated here, independent of the connector; a push within friction holds the guide
exactly.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.recording.samples import SampleArrays
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

PERIOD, SUBSTEPS = 1e-3, 20
MASS, WEIGHT = 2.0, 2.0 * 9.81
PUSH, FREQUENCY = 14.0, 1.0  # N, Hz
RATE, SPIN, PLACE, TURN = 1e-3, 5e-3, 1e-5, 1e-4  # m/s, rad/s, m, rad: standard deviations


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
    return Scene.from_parameters({
        "period": PERIOD,
        "body_a.frame": "shaft",
        "body_a.kind": "fixed",
        "body_b.frame": "sleeve",
        "body_b.kind": "free",
        "body_b.mass": MASS,
        "body_b.inertia": [0.0016, 0.0, 0.0, 0.0022, 0.0, 0.0022],
        "node_a.orientation": [0.0, 0.0, 0.0, 1.0],
        "friction.coefficient": 0.2,
        "friction.radius": 0.02,
    })  # fmt: skip


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


def measured(rows: Array, seed: int) -> SampleArrays:
    """Return samples with white noise on pose and twist."""
    rng, found, n = np.random.default_rng(seed), rows.copy(), len(rows)
    place, twist = layout.B_POSE, layout.B_TWIST
    found[:, place : place + 3] += PLACE * rng.standard_normal((n, 3))
    found[:, place + 3 : place + 6] += 0.5 * TURN * rng.standard_normal((n, 3))
    found[:, twist : twist + 3] += RATE * rng.standard_normal((n, 3))
    found[:, twist + 3 : twist + 6] += SPIN * rng.standard_normal((n, 3))
    h = np.full(n, PERIOD)
    h[0] = 0.0
    stamps = np.round(np.arange(n) * PERIOD * 1e9).astype(np.int64)
    return SampleArrays(stamps, h, np.zeros(n, np.bool_), found)
