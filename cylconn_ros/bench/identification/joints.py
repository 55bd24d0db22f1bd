"""Simulated joints with friction of every kind, and the noise of sensors.

A sleeve on a level, fixed shaft is pushed and turned while loads across the slot change. The motion
is integrated here with substeps, independent of the connector.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.identification.likelihood.law import FrictionLaw
from cylconn_ros.recording.samples import SampleArrays
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

PERIOD, SAMPLES, SUBSTEPS = 1e-3, 4000, 10
MASS, INERTIA = 2.0, (0.0016, 0.0, 0.0, 0.0022, 0.0, 0.0022)
_COULOMB = {"coefficient": 0.2, "preload": 3.0, "bending": 20.0, "radius": 0.02}
MODELS: dict[str, dict[str, float]] = {
    "Coulomb": {},
    "viscous": {"c1": 2.0, "cr1": 1e-3},
    "by direction": {"direction": 0.2},
    "Stribeck": {"stribeck": 0.5, "decay": 8.0},
    "load-dependent": {"preload": 8.0, "bending": 40.0},
    "with offset": {"offset": 1.0},
    "all": {"c1": 2.0, "direction": 0.15, "stribeck": 0.5, "decay": 8.0, "offset": 1.0},
}
"""Parameters beyond those of Coulomb friction, by name."""
NOISES = ("white", "coloured", "quantised", "one sample late", "filtered twist", "uneven stamps")
RATE, SPIN, PLACE, TURN = 1e-3, 5e-3, 1e-5, 1e-4  # m/s, rad/s, m, rad: standard deviations


def law_of(model: str) -> FrictionLaw:
    """Return the true law of a model."""
    values: Mapping[str, float] = {**_COULOMB, **MODELS[model]}
    return FrictionLaw(**values)


def scene() -> Scene:
    """Return the scene that the identification starts from, with other values of friction."""
    return Scene.from_parameters({
        "period": PERIOD,
        "body_a.frame": "shaft",
        "body_a.kind": "fixed",
        "body_b.frame": "sleeve",
        "body_b.kind": "free",
        "body_b.mass": MASS,
        "body_b.inertia": list(INERTIA),
        "node_a.orientation": [0.0, 0.0, 0.0, 1.0],
        "friction.coefficient": 0.1,
        "friction.radius": 0.025,
        "friction.overlap": 0.08,
    })  # fmt: skip


def motion(law: FrictionLaw) -> Array:
    """Return the exact samples (SAMPLES, NSAMPLE) of a joint with this law."""
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
        normal = float(np.hypot(side, MASS * 9.81)) + law.bending * bend + law.preload
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


def measured(rows: Array, noise: str, seed: int) -> SampleArrays:
    """Return samples as sensors and drivers with this noise give them."""
    rng = np.random.default_rng(seed)
    times = np.arange(len(rows)) * PERIOD
    if noise == "uneven stamps":
        kept = np.sort(rng.choice(len(rows), int(0.7 * len(rows)), replace=False))
        rows, times = rows[kept], times[kept]
    found, n = rows.copy(), len(rows)
    place, twist = layout.B_POSE, layout.B_TWIST
    white = rng.standard_normal((n, 6)) * ([RATE] * 3 + [SPIN] * 3)
    if noise == "coloured":
        for k in range(1, n):
            white[k] = 0.5 * white[k - 1] + np.sqrt(0.75) * white[k]
    found[:, twist : twist + 6] += white
    if noise == "filtered twist":
        for k in range(1, n):
            before = found[k - 1, twist : twist + 6]
            found[k, twist : twist + 6] = 0.7 * before + 0.3 * found[k, twist : twist + 6]
    if noise == "one sample late":
        found[1:, twist : twist + 6] = found[:-1, twist : twist + 6].copy()
    if noise == "quantised":
        found[:, place] = np.round(found[:, place] / 5e-6) * 5e-6
        found[:, twist : twist + 3] = np.round(found[:, twist : twist + 3] / 2e-3) * 2e-3
        found[:, twist + 3 : twist + 6] = np.round(found[:, twist + 3 : twist + 6] / 1e-2) * 1e-2
    else:
        found[:, place : place + 3] += PLACE * rng.standard_normal((n, 3))
        found[:, place + 3] += 0.5 * TURN * rng.standard_normal(n)
    norm = np.linalg.norm(found[:, place + 3 : place + 7], axis=1, keepdims=True)
    found[:, place + 3 : place + 7] /= norm
    h = np.diff(times, prepend=times[0])
    stamps = np.round(times * 1e9).astype(np.int64)
    return SampleArrays(stamps, h, np.zeros(n, np.bool_), found)
