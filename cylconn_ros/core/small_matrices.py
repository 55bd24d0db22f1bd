"""Unrolled small dense systems: the 4x4 of the constraint, the 2x2 of slide and spin."""

import math

from cylconn_ros.core.jit import inline_function

Four = tuple[float, float, float, float]
Lower = tuple[float, float, float, float, float, float, float, float, float, float]


@inline_function
def factor(
    a00: float, a10: float, a11: float, a20: float, a21: float, a22: float,
    a30: float, a31: float, a32: float, a33: float,
) -> Lower:  # fmt: skip
    """L D L^T of a positive definite 4x4: (l10, l20, l21, l30, l31, l32, 1/d0 .. 1/d3)."""
    i0 = 1.0 / a00
    l10, l20, l30 = a10 * i0, a20 * i0, a30 * i0
    i1 = 1.0 / (a11 - l10 * a10)
    b21, b31 = a21 - l20 * a10, a31 - l30 * a10
    l21, l31 = b21 * i1, b31 * i1
    i2 = 1.0 / (a22 - l20 * a20 - l21 * b21)
    b32 = a32 - l30 * a20 - l31 * b21
    l32 = b32 * i2
    i3 = 1.0 / (a33 - l30 * a30 - l31 * b31 - l32 * b32)
    return (l10, l20, l21, l30, l31, l32, i0, i1, i2, i3)


@inline_function
def solve(f: Lower, b0: float, b1: float, b2: float, b3: float) -> Four:
    """The solution x of L D L^T x = b."""
    l10, l20, l21, l30, l31, l32, i0, i1, i2, i3 = f
    y1 = b1 - l10 * b0
    y2 = b2 - l20 * b0 - l21 * y1
    y3 = b3 - l30 * b0 - l31 * y1 - l32 * y2
    x3 = y3 * i3
    x2 = y2 * i2 - l32 * x3
    x1 = y1 * i1 - l21 * x2 - l31 * x3
    x0 = b0 * i0 - l10 * x1 - l20 * x2 - l30 * x3
    return (x0, x1, x2, x3)


@inline_function
def eigen2(a: float, b: float, c: float) -> tuple[float, float, float, float]:
    """Eigenvalues of [[a, b], [b, c]] and the eigenvector (cos, sin) of the greater one.

    Returns (greater, lesser, cos, sin). The lesser is the determinant over the greater, which
    avoids cancellation if they differ by orders of magnitude.
    """
    mean, half = 0.5 * (a + c), 0.5 * (a - c)
    radius = math.sqrt(half * half + b * b)
    greater = mean + radius
    lesser = (a * c - b * b) / greater if greater > 0.0 else 0.0
    if radius == 0.0:
        return (greater, lesser, 1.0, 0.0)
    if half >= 0.0:
        x, y = half + radius, b
    else:
        x, y = b, radius - half
    n = math.sqrt(x * x + y * y)
    return (greater, lesser, x / n, y / n)
