"""Rotations as arrays: quaternions (n, 4) x y z w, vectors (n, 3), matrices (n, 3, 3).

Independent of the vector functions of the solver. The columns of a rotation matrix are the axes of
the turned frame.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def multiply(p: Array, q: Array) -> Array:
    """(n, 4) product p q: the rotation q, then p."""
    u, s = p[:, :3], p[:, 3:]
    v, t = q[:, :3], q[:, 3:]
    vector = s * v + t * u + np.cross(u, v)
    return np.concatenate([vector, s * t - dot(u, v)[:, None]], axis=1)


def conjugate(q: Array) -> Array:
    """(n, 4) inverse rotations."""
    return q * np.array([-1.0, -1.0, -1.0, 1.0])


def normalised(q: Array) -> Array:
    """(n, 4) quaternions of unit length."""
    return q / np.sqrt(np.sum(q * q, axis=1, keepdims=True))


def exp(u: Array) -> Array:
    """(n, 4) quaternions of the rotation vectors u (n, 3)."""
    half = 0.5 * np.sqrt(np.sum(u * u, axis=1, keepdims=True))
    return np.concatenate([0.5 * u * np.sinc(half / np.pi), np.cos(half)], axis=1)


def turned(q: Array, u: Array) -> Array:
    """(n, 4) orientations q after a further rotation by the rotation vectors u, world axes."""
    return normalised(multiply(exp(u), q))


def matrix(q: Array) -> Array:
    """(n, 3, 3) rotation matrices: 1 + 2 s [v] + 2 [v]^2."""
    v, s = q[:, :3], q[:, 3, None, None]
    outer = v[:, :, None] * v[:, None, :]
    squared = outer - np.sum(v * v, axis=1)[:, None, None] * np.eye(3)
    return np.asarray(np.eye(3) + 2.0 * s * skew(v) + 2.0 * squared)


def skew(v: Array) -> Array:
    """(n, 3, 3) matrices of the vector product v x."""
    m = np.zeros((len(v), 3, 3))
    m[:, 0, 1], m[:, 0, 2], m[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return m - m.transpose(0, 2, 1)


def out_of(m: Array, a: Array) -> Array:
    """(..., n, 3) m a: components in the turned frame to components in the outer frame."""
    return np.asarray(np.einsum("nij,...nj->...ni", m, a))


def into(m: Array, a: Array) -> Array:
    """(n, 3) m^T a: components in the outer frame to components in the turned frame."""
    return np.asarray(np.einsum("nji,nj->ni", m, a))


def dot(a: Array, b: Array) -> Array:
    """(n,) scalar products."""
    return np.asarray(np.sum(a * b, axis=1))


def cross_size(a: Array, b: Array) -> Array:
    """(n, 3) sums of the absolute values of the products in the vector product a x b."""
    a, b = np.abs(a), np.abs(b)
    one, two = [1, 2, 0], [2, 0, 1]
    return np.asarray(a[:, one] * b[:, two] + a[:, two] * b[:, one])


def norm(a: Array) -> Array:
    """(...,) lengths, safe from overflow and underflow."""
    greatest = np.max(np.abs(a), axis=-1)
    unit = np.where(greatest > 0.0, greatest, 1.0)
    return np.asarray(greatest * np.sqrt(np.sum((a / unit[..., None]) ** 2, axis=-1)))


def twist_angle(q: Array) -> Array:
    """(n,) angle about x of the orientation q, in [-pi, pi]: the twist of swing times twist."""
    angle = 2.0 * np.arctan2(q[:, 0], q[:, 3])
    return np.asarray(angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi)))


def swing(q: Array) -> Array:
    """(n, 2) the y and z of the rotation vector that takes the turned x axis back to x.

    The turned axis is b = (1 - 2(y^2 + z^2), 2(xy + wz), 2(xz - wy)); the vector is along b x e1 =
    (0, b3, -b2) and as long as the angle between them. At exactly a half turn it is along -y.
    """
    x, y, z, w = q.T
    across = np.stack([2.0 * (x * z - w * y), -2.0 * (x * y + w * z)], axis=1)
    sine = np.hypot(across[:, 0], across[:, 1])
    half = np.arctan2(np.hypot(y, z), np.hypot(x, w))  # half the angle, without cancellation
    scale = np.where(sine > 0.0, 2.0 * half / np.where(sine > 0.0, sine, 1.0), 1.0)
    vector = across * scale[:, None]
    vector[np.hypot(x, w) == 0.0] = (-np.pi, 0.0)
    return vector
