"""Minimum-norm reactions of redundant constraints.

K x = b with K = J M^-1 J^T, positive semi-definite, rows scaled to one unit (moments by an arm). If
rows of J depend linearly on others, x is determined up to the null space Z of J^T. The solution is
the x of least norm, and b is projected onto the range: x = P (P K P)^+ P b with P = I - Z Z^T.

The rank depends on geometry only: it follows from a Cholesky factorization, with pivoting, of J J^T
with equal masses for all bodies, scaled to a unit diagonal. With the independent rows I and the
dependent ones D = T I, the columns of Z are (-T^T, 1).
"""

import math
from typing import Final

from cylconn_ros.core.dense import factor_positive, solve_factored
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function

NEGLIGIBLE: Final = 1e-4  # smaller pivots are redundant: rows that agree within 10 mrad


@device_function
def null_space(like: Array, n: int, order: Array, scale: Array, z: Array) -> int:
    """Orthonormal null space of ``like`` (n, n), J J^T, in the rows of ``z``; returns the rank.

    ``order`` (n,) becomes the rows, independent ones first; ``scale`` (n,) is overwritten, and so
    is ``like``.
    """
    for i in range(n):
        order[i] = i
        scale[i] = math.sqrt(like[i, i]) if like[i, i] > 0.0 else 1.0
    for i in range(n):
        for j in range(n):
            like[i, j] /= scale[i] * scale[j]
    rank = 0
    while rank < n:
        best, at = 0.0, rank
        for i in range(rank, n):
            c = int(order[i])
            if like[c, c] > best:
                best, at = like[c, c], i
        if not best > NEGLIGIBLE:
            break
        order[rank], order[at] = order[at], order[rank]
        k = int(order[rank])
        root = math.sqrt(like[k, k])
        like[k, k] = root
        for i in range(rank + 1, n):
            ci = int(order[i])
            like[ci, k] /= root
            for j in range(rank + 1, i + 1):
                cj = int(order[j])
                like[ci, cj] -= like[ci, k] * like[cj, k]
                like[cj, ci] = like[ci, cj]
        rank += 1
    if rank < n:
        _null_vectors(like, n, rank, order, scale, z)
    return rank


@device_function
def _null_vectors(like: Array, n: int, rank: int, order: Array, scale: Array, z: Array) -> None:
    for d in range(n - rank):
        row = int(order[rank + d])
        for i in range(n):
            z[d, i] = 0.0
        z[d, row] = 1.0 / scale[row]
        for i in range(rank - 1, -1, -1):
            ci = int(order[i])
            total = like[row, ci]
            for k in range(i + 1, rank):
                ck = int(order[k])
                total += z[d, ck] * scale[ck] * like[ck, ci]
            z[d, ci] = -total / like[ci, ci] / scale[ci]
    for d in range(n - rank):
        for _ in range(2):  # Gram-Schmidt, twice
            for e in range(d):
                share = 0.0
                for i in range(n):
                    share += z[d, i] * z[e, i]
                for i in range(n):
                    z[d, i] -= share * z[e, i]
        size = 0.0
        for i in range(n):
            size += z[d, i] * z[d, i]
        size = math.sqrt(size)
        for i in range(n):
            z[d, i] /= size


@device_function
def project(z: Array, count: int, n: int, x: Array) -> float:
    """Remove the parts of x (n,) along ``count`` rows of z; returns the norm of what is removed."""
    removed = 0.0
    for d in range(count):
        share = 0.0
        for i in range(n):
            share += z[d, i] * x[i]
        removed += share * share
        for i in range(n):
            x[i] -= share * z[d, i]
    return math.sqrt(removed)


@device_function
def factor_projected(k: Array, n: int, rank: int, order: Array, z: Array) -> None:
    """Replace the symmetric k (n, n) by the factor of P k P."""
    count = n - rank
    for i in range(n if count > 0 else 0):
        project(z, count, n, k[i])
    for j in range(n if count > 0 else 0):
        for d in range(count):
            share = 0.0
            for i in range(n):
                share += z[d, i] * k[i, j]
            for i in range(n):
                k[i, j] -= share * z[d, i]
    factor_positive(k, rank, order)


@device_function
def solve_projected(k: Array, n: int, rank: int, order: Array, z: Array, x: Array) -> float:
    """Replace x (n,) by the least-norm solution; returns the norm of what is out of the range."""
    off = project(z, n - rank, n, x)
    for i in range(rank, n):
        x[int(order[i])] = 0.0
    solve_factored(k, rank, order, x)
    project(z, n - rank, n, x)
    return off
