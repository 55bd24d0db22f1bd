"""Poses, energy and momentum in NumPy, independent of the code that the benchmarks measure.

Quaternions are x, y, z, w; a pose is (7,) position and quaternion, a twist (6,) linear and angular
velocity, both in world axes. A state is (26,): pose and twist of body A, then of body B.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.scene.scene import Body, Scene

Array = NDArray[np.float64]


def rotation(q: Sequence[float] | Array) -> Array:
    """(3, 3) rotation matrix of a quaternion, which need not have unit length."""
    x, y, z, w = np.asarray(q, dtype=float) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion(axes: Array) -> Array:
    """(4,) quaternion of a rotation matrix: the dominant eigenvector of a symmetric 4x4 matrix."""
    (a, b, c), (d, e, f), (g, h, i) = axes
    symmetric = np.array(
        [
            [a - e - i, d + b, g + c, h - f],
            [d + b, e - a - i, h + f, c - g],
            [g + c, h + f, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    q: Array = np.linalg.eigh(symmetric)[1][:, -1]
    return q


def product(p: Sequence[float] | Array, q: Sequence[float] | Array) -> Array:
    """The quaternion product p q."""
    a, b = np.asarray(p, dtype=float), np.asarray(q, dtype=float)
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.array([*vector, a[3] * b[3] - a[:3] @ b[:3]])


def inverse(q: Sequence[float] | Array) -> Array:
    """The inverse of a unit quaternion."""
    return np.asarray(q, dtype=float) * (-1.0, -1.0, -1.0, 1.0)


def to_world(pose: Sequence[float] | Array, point: Sequence[float] | Array) -> Array:
    """World coordinates of a point given in the frame of a body with this pose (7,)."""
    return np.asarray(pose[:3]) + rotation(pose[3:]) @ np.asarray(point)


def to_body(pose: Sequence[float] | Array, point: Sequence[float] | Array) -> Array:
    """Body coordinates of a point given in the world."""
    return rotation(pose[3:]).T @ (np.asarray(point) - np.asarray(pose[:3]))


def com(body: Body, state: Array) -> tuple[Array, Array]:
    """Position and velocity of the centre of mass of a body with pose and twist (13,)."""
    arm = rotation(state[3:7]) @ np.array(body.com)
    return state[:3] + arm, state[7:10] + np.cross(state[10:13], arm)


def energy(scene: Scene, state: Array) -> float:
    """Kinetic and gravitational energy (J) of the moving bodies in a state (26,)."""
    total = 0.0
    for body, own in ((scene.body_a, state[:13]), (scene.body_b, state[13:])):
        if body.kind in ("free", "unknown"):
            position, velocity = com(body, own)
            axes = rotation(own[3:7])
            angular_velocity = axes.T @ own[10:13]
            total += 0.5 * body.mass * float(velocity @ velocity)
            total += 0.5 * float(angular_velocity @ inertia_tensor(body) @ angular_velocity)
            total -= body.mass * float(np.array(scene.gravity) @ position)
    return total


def momentum(scene: Scene, state: Array) -> Array:
    """(6,) linear momentum, and angular momentum about the origin of the world."""
    total = np.zeros(6)
    for body, own in ((scene.body_a, state[:13]), (scene.body_b, state[13:])):
        if body.kind in ("free", "unknown"):
            position, velocity = com(body, own)
            axes = rotation(own[3:7])
            total[:3] += body.mass * velocity
            total[3:] += axes @ inertia_tensor(body) @ axes.T @ own[10:13]
            total[3:] += body.mass * np.cross(position, velocity)
    return total


def inertia_tensor(body: Body) -> Array:
    """(3, 3) inertia about the centre of mass, body axes, kg.m^2."""
    ixx, ixy, ixz, iyy, iyz, izz = body.inertia
    return np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
