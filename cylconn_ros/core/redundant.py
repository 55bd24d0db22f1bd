"""Reactions where there are more constraints than motions to prevent: the least of all that do.

G x = b with G = J M^-1 J^T, positive semi-definite. Rows of J that follow from others leave x open
by the null space of G. Taken is the x of least norm in a stated metric,

    |x|^2 = sum (x_i / a_i)^2         a_i: 1 for a force, an arm for a moment

and of b what can be had. Which rows follow is judged by the eigenvalues of G scaled to a unit
diagonal, so that neither units nor masses matter.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEGLIGIBLE = 1e-9  # eigenvalues below it belong to redundant directions: misfits of 3e-5 rad do


def null_space(g: Array) -> tuple[Array, Array]:
    """(n, n) solution operator and (n, k) null space of G, the first in no stated metric."""
    scale = np.sqrt(np.diag(g))
    scale[~(scale > 0.0)] = 1.0
    values, vectors = np.linalg.eigh(g / np.outer(scale, scale))
    kept = values > NEGLIGIBLE
    whole = vectors[:, kept] / scale[:, None]
    return (whole / values[kept]) @ whole.T, vectors[:, ~kept] / scale[:, None]


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


def least_norm(g: Array, arms: Array) -> Array:
    """(n, n) operator P: P b is the x with G x = b that is least in the metric of ``arms``."""
    solution, z = null_space(g)
    return least(solution, z, arms)
