"""Pairs of vectors from body axes to world axes: twists and external loads.

A pair is a twist (linear, angular velocity) or a load (force, torque). The same formula exists for
Python numbers (reference path) and for compiled code, with the operations in the same order, so
that both give the same numbers bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from cylconn_ros.core import layout
from cylconn_ros.core.jit import device_function

# Axes of a body's external load.
NO_LOAD: Final = 0
IN_WORLD: Final = 1
IN_BODY: Final = 2

Vector = Sequence[float]


def frame_name(name: str) -> str:
    """The name of a frame without a leading slash: ``/world`` is the same frame as ``world``."""
    return name.removeprefix("/")


def into_world(pose: Vector, pair: Vector) -> tuple[float, ...]:
    """Rotate a pair (6,) from body axes to world axes with a pose (7,): position, quaternion xyzw.

    The quaternion need not be normalised. A quaternion of length zero, or one that is not finite,
    gives NaN, because the axes are unknown.
    """
    x, y, z, w = pose[3:7]
    s = _scale(x, y, z, w)
    a, b, c, d, e, f = pair
    return (*_rotated(x, y, z, w, s, a, b, c), *_rotated(x, y, z, w, s, d, e, f))


@device_function
def write_load(body: int, loads: Any, axes: Any, sample: Any) -> None:
    """Write the load on a body to a sample (NSAMPLE,), in world axes; without a load, nothing.

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
            sample[at + k], sample[at + k + 1], sample[at + k + 2] = _rotated(
                x, y, z, w, s, loads[of], loads[of + 1], loads[of + 2]
            )


@device_function
def rotate_twist(body: int, sample: Any) -> None:
    """Rotate the twist of a body in a sample (NSAMPLE,) from body axes to world axes."""
    at = layout.A_TWIST if body == 0 else layout.B_TWIST
    turn = (layout.A_POSE if body == 0 else layout.B_POSE) + 3
    x, y, z, w = sample[turn], sample[turn + 1], sample[turn + 2], sample[turn + 3]
    s = _scale(x, y, z, w)
    for k in (at, at + 3):
        sample[k], sample[k + 1], sample[k + 2] = _rotated(
            x, y, z, w, s, sample[k], sample[k + 1], sample[k + 2]
        )


@device_function
def _scale(x: float, y: float, z: float, w: float) -> float:
    """Two over the squared length of a quaternion; NaN if its direction is undefined."""
    square = x * x + y * y + z * z + w * w
    return 2.0 / square if 0.0 < square < math.inf else math.nan


@device_function
def _rotated(
    x: Any, y: Any, z: Any, w: Any, s: Any, a: Any, b: Any, c: Any
) -> tuple[Any, Any, Any]:
    """The vector (a, b, c) rotated by the quaternion x y z w; ``s``: from :func:`_scale`."""
    xx, yy, zz, xy, xz, yz = s * x * x, s * y * y, s * z * z, s * x * y, s * x * z, s * y * z
    wx, wy, wz = s * w * x, s * w * y, s * w * z
    return (
        a * (1.0 - yy - zz) + b * (xy - wz) + c * (xz + wy),
        a * (xy + wz) + b * (1.0 - xx - zz) + c * (yz - wx),
        a * (xz - wy) + b * (yz + wx) + c * (1.0 - xx - yy),
    )
