"""Simulated joints with friction of every kind.

A sleeve on a level, fixed shaft is pushed and turned while loads across the slot change. The motion
is integrated here with substeps, independent of the connector.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.bench.identification import sensors
from cylconn_ros.bench.identification.sensors import INERTIA, MASS, PERIOD, WEIGHT
from cylconn_ros.core import layout
from cylconn_ros.identification.likelihood.law import FrictionLaw
from cylconn_ros.scene.behaviour import INPUTS
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

SAMPLES, SUBSTEPS = 4000, 10
TELESCOPE = "changing overlap"
CHANGES: dict[str, float | str] = {
    "overlap_change": "increasing",
    "overlap_at": 0.0,
}  # of TELESCOPE
_COULOMB = {"coefficient": 0.2, "preload": 3.0, "bending": 20.0, "radius": 0.02}
MODELS: dict[str, dict[str, float]] = {
    "Coulomb": {},
    "viscous": {"c1": 2.0, "cr1": 1e-3},
    "by direction": {"direction": 0.2},
    "Stribeck": {"stribeck": 0.5, "decay": 8.0},
    "load-dependent": {"preload": 8.0, "bending": 40.0},
    "with offset": {"offset": 1.0},
    TELESCOPE: {"bending": 4.0},
    "all": {"c1": 2.0, "direction": 0.15, "stribeck": 0.5, "decay": 8.0, "offset": 1.0},
}
"""Parameters beyond those of Coulomb friction, by name."""


def law_of(model: str) -> FrictionLaw:
    """Return the true law of a model."""
    values: Mapping[str, float] = {**_COULOMB, **MODELS[model]}
    return FrictionLaw(**values)


def scene(model: str = "Coulomb") -> Scene:
    """Return the scene that the identification starts from, with other values of friction."""
    if model == TELESCOPE:
        return sensors.scene(coefficient=0.1, radius=0.025, overlap=0.4, **CHANGES)
    return sensors.scene(coefficient=0.1, radius=0.025, overlap=0.08)


def motion(model: str, pressed: Array | None = None, inputs: Sequence[str] = INPUTS) -> Array:
    """Return the exact samples (SAMPLES, NSAMPLE) of a joint.

    ``pressed``: preload (SAMPLES,), N, instead of that of the law. ``inputs``: what presses.
    """
    law = law_of(model)
    rows = np.zeros((SAMPLES, layout.NSAMPLE))
    x = v = angle = spin = 0.0
    d = PERIOD / SUBSTEPS
    for k in range(SAMPLES):
        t = k * PERIOD
        push = 22.0 * np.sin(6.0 * t) + 6.0 * np.sin(2.3 * t)
        turn = 0.45 * np.sin(4.1 * t + 0.5)
        side, bend = 14.0 * np.sin(3.1 * t), 0.35 + 0.3 * np.sin(5.3 * t)
        row = rows[k]
        row[layout.B_POSE], row[layout.A_POSE + 6] = x, 1.0
        half = 0.5 * angle
        row[layout.B_POSE + 3], row[layout.B_POSE + 6] = np.sin(half), np.cos(half)
        row[layout.B_TWIST], row[layout.B_TWIST + 3] = v, spin
        loads = np.zeros(12)
        loads[6:] = push, side, 0.0, turn, bend, 0.0
        row[layout.LOADS] = loads
        bent = law.bending * bend
        if model == TELESCOPE:
            bent = _bent(law, x, side, bend)
        parts = {
            "radial": float(np.hypot(side, WEIGHT)),
            "bending": bent,
            "preload": law.preload if pressed is None else float(pressed[k]),
        }
        normal = sum(parts[name] for name in inputs)
        for _ in range(SUBSTEPS):
            size = max(float(np.hypot(v, law.radius * spin)), 2e-4)
            cos, sin = v / size, law.radius * spin / size
            ratio = law.coefficient * (1.0 + law.direction * cos)
            ratio *= 1.0 + law.stribeck * np.exp(-law.decay * size)
            v += d * (push - ratio * normal * cos - law.c1 * v - law.offset) / MASS
            moment = turn - ratio * normal * law.radius * sin - law.cr1 * spin
            spin += d * moment / INERTIA[0]
            x, angle = x + d * v, angle + d * spin
    return rows


def _bent(law: FrictionLaw, x: float, side: float, bend: float) -> float:
    """Return the normal force by bending, N, of an overlap that increases with the slide ``x``.

    The middle of the contact lags behind by half the slide: the reactions, which are the weight and
    the opposite of the load ``side``, have an arm.
    """
    arm = 0.5 * x
    moment = float(np.hypot(bend + arm * WEIGHT, arm * side))
    return 2.0 * moment / (2.0 / law.bending + x)
