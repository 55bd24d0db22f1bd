"""Poses, energy and momentum with NumPy: nothing here comes from what is measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.scene.scene import Body, Scene

Array = NDArray[np.float64]


def rotation(q: Sequence[float] | Array) -> Array:
    """The matrix of a quaternion x, y, z, w of any length."""
    x, y, z, w = np.asarray(q, dtype=float) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion(axes: Array) -> Array:
    """Of a rotation's matrix, x y z w, by the eigenvector of its symmetric form."""
    (a, b, c), (d, e, f), (g, h, i) = axes
    form = np.array(
        [
            [a - e - i, d + b, g + c, h - f],
            [d + b, e - a - i, h + f, c - g],
            [g + c, h + f, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    q: Array = np.linalg.eigh(form)[1][:, -1]
    return q


def product(p: Sequence[float] | Array, q: Sequence[float] | Array) -> Array:
    """The quaternion p q, x y z w."""
    a, b = np.asarray(p, dtype=float), np.asarray(q, dtype=float)
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.array([*vector, a[3] * b[3] - a[:3] @ b[:3]])


def inverse(q: Sequence[float] | Array) -> Array:
    """The inverse of a unit quaternion."""
    return np.asarray(q, dtype=float) * (-1.0, -1.0, -1.0, 1.0)


def outside(pose: Sequence[float] | Array, point: Sequence[float] | Array) -> Array:
    """A point of the body with this pose (7,), in the world."""
    return np.asarray(pose[:3]) + rotation(pose[3:]) @ np.asarray(point)


def inside(pose: Sequence[float] | Array, point: Sequence[float] | Array) -> Array:
    """A point of the world, in the frame of this pose."""
    return rotation(pose[3:]).T @ (np.asarray(point) - np.asarray(pose[:3]))


def com(body: Body, state: Array) -> tuple[Array, Array]:
    """Place and velocity of the mass centre of a body with pose and twist (13,)."""
    arm = rotation(state[3:7]) @ np.array(body.com)
    return state[:3] + arm, state[7:10] + np.cross(state[10:13], arm)


def energy(scene: Scene, state: Array) -> float:
    """Kinetic and gravitational energy (J) of both bodies, ``state`` (26,) as in a sample."""
    total = 0.0
    for body, own in ((scene.body_a, state[:13]), (scene.body_b, state[13:])):
        if body.kind in ("free", "unknown"):
            place, velocity = com(body, own)
            turn = rotation(own[3:7])
            spin = turn.T @ own[10:13]
            total += 0.5 * body.mass * float(velocity @ velocity)
            total += 0.5 * float(spin @ tensor(body) @ spin)
            total -= body.mass * float(np.array(scene.gravity) @ place)
    return total


def momentum(scene: Scene, state: Array) -> Array:
    """(6,) linear momentum, and angular momentum about the world's origin."""
    total = np.zeros(6)
    for body, own in ((scene.body_a, state[:13]), (scene.body_b, state[13:])):
        if body.kind in ("free", "unknown"):
            place, velocity = com(body, own)
            turn = rotation(own[3:7])
            total[:3] += body.mass * velocity
            total[3:] += turn @ tensor(body) @ turn.T @ own[10:13]
            total[3:] += body.mass * np.cross(place, velocity)
    return total


def tensor(body: Body) -> Array:
    """Inertia about the mass centre, body axes."""
    ixx, ixy, ixz, iyy, iyz, izz = body.inertia
    return np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
