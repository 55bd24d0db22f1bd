"""Pairs of vectors given in a body's axes, turned into the world's; loads among them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from cylconn_ros.core import layout
from cylconn_ros.core.jit import device_function

NO_LOAD: Final = 0
IN_WORLD: Final = 1
IN_BODY: Final = 2

Vector = Sequence[float]


def into_world(pose: Vector, pair: Vector) -> tuple[float, ...]:
    """Turn two stacked vectors (6) from body axes into the world's, with a pose (7).

    A quaternion without direction turns them into NaN: nobody knows where they point.
    """
    x, y, z, w = pose[3:7]
    s = _scale(x, y, z, w)
    a, b, c, d, e, f = pair
    return (*_turned(x, y, z, w, s, a, b, c), *_turned(x, y, z, w, s, d, e, f))


def into_world_all(poses: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """(n, 6) what :func:`into_world` gives for each of (n, 7) poses and (n, 6) pairs."""
    with np.errstate(all="ignore"):
        x, y, z, w = poses[:, 3:7].T
        square = x * x + y * y + z * z + w * w
        s = np.where((square > 0.0) & (square < math.inf), 2.0 / square, math.nan)
        a, b, c, d, e, f = pairs.T
        return np.stack(
            (*_turned(x, y, z, w, s, a, b, c), *_turned(x, y, z, w, s, d, e, f)), axis=1
        )


@device_function
def hold_load(body: int, loads: Any, axes: Any, sample: Any) -> None:
    """Write a body's load in force to a sample (NSAMPLE,).

    ``loads``, ``axes``: (12,) of both bodies, and (2,) NO_LOAD, IN_WORLD or IN_BODY.
    """
    at = layout.A_LOAD if body == 0 else layout.B_LOAD
    turn = (layout.A_POSE if body == 0 else layout.B_POSE) + 3
    if axes[body] == IN_WORLD:
        for k in range(6):
            sample[at + k] = loads[6 * body + k]
    elif axes[body] == IN_BODY:
        x, y, z, w = sample[turn], sample[turn + 1], sample[turn + 2], sample[turn + 3]
        s = _scale(x, y, z, w)
        for k in (0, 3):
            of = 6 * body + k
            sample[at + k], sample[at + k + 1], sample[at + k + 2] = _turned(
                x, y, z, w, s, loads[of], loads[of + 1], loads[of + 2]
            )


@device_function
def turn_twist(body: int, sample: Any) -> None:
    """Turn a body's twist in a sample (NSAMPLE,) from its axes into the world's."""
    at = layout.A_TWIST if body == 0 else layout.B_TWIST
    turn = (layout.A_POSE if body == 0 else layout.B_POSE) + 3
    x, y, z, w = sample[turn], sample[turn + 1], sample[turn + 2], sample[turn + 3]
    s = _scale(x, y, z, w)
    for k in (at, at + 3):
        sample[k], sample[k + 1], sample[k + 2] = _turned(
            x, y, z, w, s, sample[k], sample[k + 1], sample[k + 2]
        )


@device_function
def _scale(x: float, y: float, z: float, w: float) -> float:
    """Two over the square of a quaternion; NaN where it has no direction."""
    square = x * x + y * y + z * z + w * w
    return 2.0 / square if 0.0 < square < math.inf else math.nan


@device_function
def _turned(x: Any, y: Any, z: Any, w: Any, s: Any, a: Any, b: Any, c: Any) -> tuple[Any, Any, Any]:
    """Turn (a, b, c) with numbers or arrays alike; ``s``: two over the quaternion's square."""
    xx, yy, zz, xy, xz, yz = s * x * x, s * y * y, s * z * z, s * x * y, s * x * z, s * y * z
    wx, wy, wz = s * w * x, s * w * y, s * w * z
    return (
        a * (1.0 - yy - zz) + b * (xy - wz) + c * (xz + wy),
        a * (xy + wz) + b * (1.0 - xx - zz) + c * (yz - wx),
        a * (xz - wy) + b * (yz + wx) + c * (1.0 - xx - yy),
    )
