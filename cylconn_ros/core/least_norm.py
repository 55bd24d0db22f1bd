"""Reactions where there are more constraints than motions to prevent: the least of all that do.

G x = b with G = J M^-1 J^T, positive semi-definite. Rows of J that follow from others leave x open
by the null space Z of J^T. Taken is the x of least norm in a stated metric,

    |x|^2 = sum (x_i / a_i)^2         a_i: 1 for a force, an arm for a moment

and of b what the other directions can have. Which rows follow is a question of geometry: it is
judged by the eigenvalues of J J^T with all bodies of the same mass, scaled to a unit diagonal.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEGLIGIBLE = 1e-4  # eigenvalues below it are redundant: rows that agree within 10 mrad


def directions(like: Array) -> tuple[Array, Array]:
    """(n, m) basis of what J^T tells apart, and (n, k) of what it does not, from J J^T (n, n)."""
    scale = np.sqrt(np.diag(like))
    scale[~(scale > 0.0)] = 1.0
    values, vectors = np.linalg.eigh(like / np.outer(scale, scale))
    kept = values > NEGLIGIBLE
    return vectors[:, kept] / scale[:, None], vectors[:, ~kept] / scale[:, None]


def least(x: Array, z: Array, arms: Array) -> Array:
    """Of all x + z c the least in the metric of ``arms`` (n,); x (n,) or (n, m)."""
    if not z.shape[1]:
        return x
    inverse = 1.0 / arms
    weighted = inverse[:, None] * z
    q, _ = np.linalg.qr(weighted)
    part: Array = (q.T * inverse) @ x
    found: Array = x - (arms * (q @ part).T).T
    return found


def least_norm(g: Array, like: Array, arms: Array) -> Array:
    """(n, n) operator P: P b is the x with G x = b that is least in the metric of ``arms``.

    ``like``: J J^T, as of bodies of the same mass.
    """
    y, z = directions(like)
    return least(y @ np.linalg.solve(y.T @ g @ y, y.T), z, arms)
