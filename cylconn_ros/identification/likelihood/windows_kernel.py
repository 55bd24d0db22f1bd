"""The innermost loop of a fit: weights, residuals and their slopes in all windows.

The same as ``factors``, ``weighted_residuals`` and ``slopes_of`` of kinetic.py, window by window
instead of operation by operation; compiled into the search (search_kernel.py).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core.jit import device_function, inline_function

Array = NDArray[np.float64]

# Columns of a table of windows.
V, W, FR, M, F1, M1, OWN, REST, SHARED, NOISE, PLACE = 0, 1, 2, 3, 4, 5, 6, 9, 12, 16, 18
COLUMNS: Final = 19

# The law, in the order of law.NAMES.
MU, PRELOAD, BENDING, R, C1, CR1, DIRECTION, OFFSET, STRIBECK, DECAY = range(10)


@inline_function
def _ratio(law: Array, size: float, cos: float) -> float:
    """P/FN."""
    decayed = math.exp(-law[DECAY] * size)
    return law[MU] * (1.0 + law[DIRECTION] * cos) * (1.0 + law[STRIBECK] * decayed)


@device_function
def limits(table: Array, bending: Array, law: Array, found: Array) -> None:
    """Write the friction limits (n,), N."""
    for i in range(len(bending)):
        x, y = table[i, V], law[R] * table[i, W]
        size = max(math.hypot(x, y), 1e-300)
        normal = table[i, FR] + bending[i] * table[i, M] + law[PRELOAD]
        found[i] = abs(_ratio(law, size, x / size) * normal)


@device_function
def squares(table: Array, bending: Array, law: Array, weights: Array) -> float:
    """Return the sum of the squared residuals with weights (n, 4)."""
    total = 0.0
    for i in range(len(bending)):
        x, y = table[i, V], law[R] * table[i, W]
        size = max(math.hypot(x, y), 1e-300)
        cos, sin = x / size, y / size
        normal = table[i, FR] + bending[i] * table[i, M] + law[PRELOAD]
        limit = _ratio(law, size, cos) * normal
        e0 = table[i, F1] + limit * cos + law[C1] * table[i, V] + law[OFFSET]
        e1 = table[i, M1] + limit * law[R] * sin + law[CR1] * table[i, W]
        r0 = weights[i, 0] * e0 + weights[i, 1] * e1
        r1 = weights[i, 2] * e0 + weights[i, 3] * e1
        total += r0 * r0 + r1 * r1
    return total


@device_function
def evaluate(
    table: Array,
    bending: Array,
    slope: Array,
    law: Array,
    floor: float,
    free: NDArray[np.int64],
    scale: Array,
    weights: Array,
    residuals: Array,
    jacobian: Array,
) -> None:
    """Write weights (n, 4), residuals (2 n,) and their derivatives (2 n, k) by scaled parameters.

    ``floor``: least variance of a residual, N^2. ``free``: the k parameters; ``slope``: derivatives
    of ``bending`` by that of the law.
    """
    mu, radius, d, b, dc = law[MU], law[R], law[DIRECTION], law[STRIBECK], law[DECAY]
    for i in range(len(bending)):
        v, w = table[i, V], table[i, W]
        size = max(math.hypot(v, radius * w), 1e-300)
        cos, sin = v / size, radius * w / size
        decayed, way = math.exp(-dc * size), 1.0 + d * cos
        steep = 1.0 + b * decayed
        ratio, beta = mu * way * steep, bending[i]
        normal = table[i, FR] + beta * table[i, M] + law[PRELOAD]
        limit = ratio * normal
        c1, s1, c2, s2 = cos, sin / radius, cos / radius, sin
        v00, v01, v11 = table[i, OWN], table[i, OWN + 1], table[i, OWN + 2]
        slide = ratio * (table[i, SHARED] + beta * table[i, SHARED + 2])
        spin = ratio * (table[i, SHARED + 1] + beta * table[i, SHARED + 3])
        load = table[i, REST] + beta * (2.0 * table[i, REST + 1] + beta * table[i, REST + 2])
        along = c1 * c1 * v00 + s1 * (2.0 * c1 * v01 + s1 * v11)
        along += ratio * ratio * load + 2.0 * (c1 * slide + s1 * spin)
        both = -c1 * s2 * v00 + (c1 * c2 - s1 * s2) * v01 + s1 * c2 * v11
        both += c2 * spin - s2 * slide
        across = s2 * s2 * v00 + c2 * (-2.0 * s2 * v01 + c2 * v11)
        turn, push = sin * table[i, NOISE], cos * radius * table[i, NOISE + 1]
        across += (limit / size) ** 2 * (turn * turn + push * push)
        across = max(across, 0.0) + floor
        a = math.sqrt(max(along, 0.0) + floor)
        back = both / a
        c = math.sqrt(max(across - back * back, 1e-6 * across))
        back /= a
        w0, w1 = c1 / a, s1 / a
        w2, w3 = (-s2 - back * c1) / c, (c2 - back * s1) / c
        weights[i, 0], weights[i, 1], weights[i, 2], weights[i, 3] = w0, w1, w2, w3
        e0 = table[i, F1] + limit * cos + law[C1] * v + law[OFFSET]
        e1 = table[i, M1] + limit * radius * sin + law[CR1] * w
        residuals[2 * i], residuals[2 * i + 1] = w0 * e0 + w1 * e1, w2 * e0 + w3 * e1
        for column in range(len(free)):
            k, share, f0, f1 = free[column], 0.0, 0.0, 0.0  # f0, f1: derivatives of -friction
            if k == R:
                square = sin * sin
                turned = -d * cos * square * steep - way * b * dc * size * square * decayed
                change = mu * normal * turned
                f0 = -cos * (limit * square - change)
                f1 = radius * sin * (change + limit * (1.0 + cos * cos))
            elif k == C1:
                f0 = v
            elif k == CR1:
                f1 = w
            elif k == OFFSET:
                f0 = 1.0
            else:
                if k == MU:
                    share = limit
                elif k == PRELOAD:
                    share = ratio
                elif k == BENDING:
                    share = ratio * slope[i] * table[i, M]
                elif k == DIRECTION:
                    share = mu * normal * cos * steep
                elif k == STRIBECK:
                    share = mu * normal * way * decayed
                else:
                    share = -mu * normal * way * b * dc * size * decayed
                f0, f1 = share * cos, share * radius * sin
            jacobian[2 * i, column] = (w0 * f0 + w1 * f1) * scale[column]
            jacobian[2 * i + 1, column] = (w2 * f0 + w3 * f1) * scale[column]
