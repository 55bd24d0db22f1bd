"""What the simulated joints have in common: a sleeve on a shaft, and its sensors at 1 kHz."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.recording.samples import SampleArrays
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

PERIOD = 1e-3  # s
MASS, INERTIA = 2.0, (0.0016, 0.0, 0.0, 0.0022, 0.0, 0.0022)
WEIGHT = MASS * 9.81
NOISES = (
    "white", "coloured", "quantised", "one sample late", "filtered twist", "uneven stamps",
    "poses only",
)  # fmt: skip
RATE, SPIN, PLACE, TURN = 1e-3, 5e-3, 1e-5, 1e-4  # m/s, rad/s, m, rad: standard deviations


def scene(**friction: float | str) -> Scene:
    """Return the scene that an identification starts from, with these friction parameters."""
    return Scene.from_parameters({
        "period": PERIOD,
        "body_a.frame": "shaft",
        "body_a.kind": "fixed",
        "body_b.frame": "sleeve",
        "body_b.kind": "free",
        "body_b.mass": MASS,
        "body_b.inertia": list(INERTIA),
        "node_a.orientation": [0.0, 0.0, 0.0, 1.0],
        **{f"friction.{name}": value for name, value in friction.items()},
    })  # fmt: skip


def measured(rows: Array, noise: str, seed: int) -> SampleArrays:
    """Return the samples that sensors and drivers with this noise give of exact ones."""
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
    if noise == "poses only":
        found[:, place + 4 : place + 6] += 0.5 * TURN * rng.standard_normal((n, 2))
        found[:, twist : twist + 6] = 0.0
    norm = np.linalg.norm(found[:, place + 3 : place + 7], axis=1, keepdims=True)
    found[:, place + 3 : place + 7] /= norm
    h = np.diff(times, prepend=times[0])
    stamps = np.round(times * 1e9).astype(np.int64)
    return SampleArrays(stamps, h, np.zeros(n, np.bool_), found)
