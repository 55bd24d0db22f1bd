"""Small dense systems of any size, in place, for the solver of connectors that share bodies.

Matrices are rows of arrays that the caller owns: compiled code allocates nothing.
"""

from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function

SINGULAR = 1e-13  # pivots below this share of the greatest element of their row are no equations


@device_function
def solve_general(a: Array, n: int, columns: int) -> int:
    """Solve A X = B by elimination with scaled row pivoting; returns the sign of det A.

    a: (n, n + columns) A and B; X replaces B. An unknown without an equation gets zero; the sign is
    0 then.
    """
    sign = 1
    for k in range(n):  # rows are scaled by their greatest element
        greatest = 0.0
        for j in range(n):
            greatest = max(greatest, abs(a[k, j]))
        if greatest > 0.0:
            for j in range(n + columns):
                a[k, j] /= greatest
    for k in range(n):
        best, at = abs(a[k, k]), k
        for i in range(k + 1, n):
            if abs(a[i, k]) > best:
                best, at = abs(a[i, k]), i
        if at != k:
            sign = -sign
            for j in range(k, n + columns):
                a[k, j], a[at, j] = a[at, j], a[k, j]
        if not best > SINGULAR:
            sign = 0
            a[k, k] = 0.0
            continue
        if a[k, k] < 0.0:
            sign = -sign
        inverse = 1.0 / a[k, k]
        for i in range(k + 1, n):
            factor = a[i, k] * inverse
            if factor != 0.0:
                for j in range(k + 1, n + columns):
                    a[i, j] -= factor * a[k, j]
    for k in range(n - 1, -1, -1):
        for column in range(n, n + columns):
            if a[k, k] == 0.0:
                a[k, column] = 0.0
                continue
            total = a[k, column]
            for j in range(k + 1, n):
                total -= a[k, j] * a[j, column]
            a[k, column] = total / a[k, k]
    return sign


@device_function
def factor_positive(a: Array, n: int, order: Array) -> None:
    """L L^T of the rows and columns order[0:n] of a symmetric positive matrix, in place.

    The factor replaces the lower triangle in the order given: a[order[i], order[j]], j <= i.
    """
    for j in range(n):
        cj = int(order[j])
        total = a[cj, cj]
        for k in range(j):
            total -= a[cj, int(order[k])] ** 2
        root = max(total, 1e-300) ** 0.5
        a[cj, cj] = root
        for i in range(j + 1, n):
            ci = int(order[i])
            total = a[ci, cj]
            for k in range(j):
                ck = int(order[k])
                total -= a[ci, ck] * a[cj, ck]
            a[ci, cj] = total / root


@device_function
def solve_factored(a: Array, n: int, order: Array, x: Array) -> None:
    """Solve L L^T x = x for the components order[0:n] of ``x``, in place."""
    for i in range(n):
        ci = int(order[i])
        total = x[ci]
        for k in range(i):
            ck = int(order[k])
            total -= a[ci, ck] * x[ck]
        x[ci] = total / a[ci, ci]
    for i in range(n - 1, -1, -1):
        ci = int(order[i])
        total = x[ci]
        for k in range(i + 1, n):
            ck = int(order[k])
            total -= a[ck, ci] * x[ck]
        x[ci] = total / a[ci, ci]
