"""Minimum-norm reactions of redundant constraints.

G x = b with G = J M^-1 J^T, positive semi-definite. If rows of J depend linearly on others, x is
determined up to the null space Z of J^T. The solution is the x of least norm in the metric

    |x|^2 = sum (x_i / a_i)^2         a_i: 1 for a force, an arm for a moment

and b is projected onto the range. The rank depends on geometry only: it follows from the
eigenvalues of J J^T with equal masses for all bodies, scaled to a unit diagonal.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEGLIGIBLE = 1e-4  # smaller eigenvalues are redundant: rows that agree within 10 mrad


def range_and_null_space(like: Array) -> tuple[Array, Array]:
    """Bases of the range (n, m) and of the null space (n, k) of the rows, from J J^T (n, n)."""
    scale = np.sqrt(np.diag(like))
    scale[~(scale > 0.0)] = 1.0
    values, vectors = np.linalg.eigh(like / np.outer(scale, scale))
    kept = values > NEGLIGIBLE
    return vectors[:, kept] / scale[:, None], vectors[:, ~kept] / scale[:, None]


def minimum_norm(x: Array, z: Array, arms: Array) -> Array:
    """The x + z c of least norm in the metric of ``arms`` (n,); x (n,) or (n, m), z (n, k)."""
    if not z.shape[1]:
        return x
    inverse = 1.0 / arms
    weighted = inverse[:, None] * z
    q, _ = np.linalg.qr(weighted)
    part: Array = (q.T * inverse) @ x
    found: Array = x - (arms * (q @ part).T).T
    return found


def minimum_norm_operator(g: Array, like: Array, arms: Array) -> Array:
    """(n, n) operator P: P b is the x with G x = b of least norm in the metric of ``arms``.

    ``like``: J J^T (n, n) for bodies of equal mass.
    """
    y, z = range_and_null_space(like)
    return minimum_norm(y @ np.linalg.solve(y.T @ g @ y, y.T), z, arms)
