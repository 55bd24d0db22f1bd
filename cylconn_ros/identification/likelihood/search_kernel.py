"""The search of a fit, compiled: iteratively reweighted Gauss-Newton steps, bounded and halved.

The same as the loop of ``fit_law`` in kinetic.py, which says what a step is. The least-squares
problem of a step is reduced to a triangle by Householder reflections, and the triangle solved by
its singular values (one-sided Jacobi rotations), as ``numpy.linalg.lstsq`` does with a relative
least singular value.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core.jit import device_function, kernel
from cylconn_ros.identification.likelihood.windows_kernel import (
    BENDING,
    C1,
    CR1,
    DECAY,
    FR,
    MU,
    OFFSET,
    PLACE,
    PRELOAD,
    M,
    R,
    V,
    W,
    evaluate,
    limits,
    squares,
)

Array = NDArray[np.float64]

SIGMA, AT, LEAST, MOST = 0, 1, 2, 3  # of a contact
RADIAL, MOMENT, RATE, SPIN = 0, 1, 2, 3  # of the sizes of Calibrated
FLOOR, CONVERGED, LARGEST, NORMAL, CUT = 0, 1, 2, 3, 4  # of the limits of a search
SWEEPS = 30
HALVINGS = 8
LOGARITHMS = 40.0  # greatest absolute value of ln mu, ln R, ln dc


@device_function
def _bend(table: Array, contact: Array, first: float, bending: Array, slope: Array) -> float:
    """Write 2/L and its derivatives by 2/L0 = ``first``; return the mean of 2/L."""
    total = 0.0
    for i in range(len(bending)):
        bending[i], slope[i] = first, 1.0
        if contact[SIGMA] != 0.0 and first != 0.0:
            moved = 2.0 / first + contact[SIGMA] * (table[i, PLACE] - contact[AT])
            overlap = min(max(moved, contact[LEAST]), contact[MOST])
            bending[i], slope[i] = 2.0 / overlap, 0.0
            if contact[LEAST] <= moved <= contact[MOST]:
                slope[i] = (2.0 / (first * overlap)) ** 2
        total += bending[i]
    return total / len(bending)


@device_function
def _scale(law: Array, sizes: Array, bending: float, scale: Array) -> None:
    """Write the scales (10,) of the fitted vector: ``parameter_scales`` of kinetic.py."""
    force = max(sizes[RADIAL] + bending * sizes[MOMENT] + max(law[PRELOAD], 0.0), 1e-12)
    limit = force * law[MU]
    scale[:] = 1.0
    scale[PRELOAD] = force
    scale[BENDING] = force / max(sizes[MOMENT], 1e-12 * force)
    scale[C1] = limit / max(sizes[RATE], 1e-12)
    scale[CR1] = limit * law[R] / max(sizes[SPIN], 1e-12)
    scale[OFFSET] = limit


@device_function
def _ranked(values: Array, rank: int) -> float:
    """Return the value of a rank (0: the least); ``values`` are rearranged."""
    low, high = 0, len(values) - 1
    while low < high:
        pivot, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if rank <= j:
            high = j
        elif rank >= i:
            low = i
        else:
            break
    return float(values[rank])


@device_function
def _triangle(rows: Array, right: Array) -> None:
    """Reduce ``rows`` (n, k) to a triangle by reflections, which are applied to ``right`` too."""
    n, k = rows.shape
    for c in range(min(n, k)):
        square = 0.0
        for i in range(c, n):
            square += rows[i, c] * rows[i, c]
        if square == 0.0:
            continue
        alpha = -math.copysign(math.sqrt(square), rows[c, c])
        rows[c, c] -= alpha
        factor = -1.0 / (alpha * rows[c, c])  # 2/|v|^2
        for j in range(c + 1, k):
            share = 0.0
            for i in range(c, n):
                share += rows[i, c] * rows[i, j]
            share *= factor
            for i in range(c, n):
                rows[i, j] -= share * rows[i, c]
        share = 0.0
        for i in range(c, n):
            share += rows[i, c] * right[i]
        share *= factor
        for i in range(c, n):
            right[i] -= share * rows[i, c]
        rows[c, c] = alpha
        for i in range(c + 1, n):
            rows[i, c] = 0.0


@device_function
def _rotate(u: Array, turned: Array) -> bool:
    """Turn all pairs of columns of ``u`` (k, k) to right angles once; return whether any was not.

    ``turned`` (k, k) collects the rotations.
    """
    k, changed = len(u), False
    for p in range(k - 1):
        for q in range(p + 1, k):
            a = b = c = 0.0
            for i in range(k):
                a += u[i, p] * u[i, p]
                b += u[i, q] * u[i, q]
                c += u[i, p] * u[i, q]
            if abs(c) <= 1e-15 * math.sqrt(a * b):
                continue
            changed = True
            zeta = (b - a) / (2.0 * c)
            t = math.copysign(1.0 / (abs(zeta) + math.hypot(1.0, zeta)), zeta)
            cos = 1.0 / math.sqrt(1.0 + t * t)
            sin = cos * t
            for i in range(k):
                x, y = u[i, p], u[i, q]
                u[i, p], u[i, q] = cos * x - sin * y, sin * x + cos * y
                x, y = turned[i, p], turned[i, q]
                turned[i, p], turned[i, q] = cos * x - sin * y, sin * x + cos * y
    return changed


@device_function
def _step(rows: Array, right: Array, cut: float, u: Array, turned: Array, step: Array) -> None:
    """Write the least-squares solution (k,) of ``rows step = -right``, of least length.

    Singular values below ``cut`` of the largest count as zero. ``rows`` and ``right`` are changed;
    ``u`` and ``turned`` (k, k) are for work.
    """
    n, k = rows.shape
    _triangle(rows, right)
    for i in range(k):
        step[i] = 0.0
        for j in range(k):
            u[i, j] = rows[i, j] if i < n else 0.0
            turned[i, j] = 1.0 if i == j else 0.0
    for _ in range(SWEEPS):
        if not _rotate(u, turned):
            break
    largest = 0.0
    for j in range(k):
        square = 0.0
        for i in range(k):
            square += u[i, j] * u[i, j]
        largest = max(largest, square)
    for j in range(k):
        square = share = 0.0
        for i in range(k):
            square += u[i, j] * u[i, j]
            if i < n:
                share -= u[i, j] * right[i]
        if square > cut * cut * largest:
            for i in range(k):
                step[i] += turned[i, j] * share / square


@device_function
def _bound(table: Array, bending: Array, law: Array, least: float, fits: Array) -> None:
    """Bound preload and decay as ``_bounded`` of kinetic.py.

    ``fits`` (10,): 1 for the parameters that are fitted.
    """
    if fits[PRELOAD] != 0.0:
        size, low = 0.0, np.inf
        for i in range(len(bending)):
            normal = table[i, FR] + bending[i] * table[i, M]
            size += abs(normal)
            low = min(low, normal)
        law[PRELOAD] = max(law[PRELOAD], least * size / len(bending) - low)
    if fits[DECAY] != 0.0:
        slow, fast = np.inf, 0.0
        for i in range(len(bending)):
            rate = max(math.hypot(table[i, V], law[R] * table[i, W]), 1e-300)
            slow, fast = min(slow, rate), max(fast, rate)
        law[DECAY] = min(max(law[DECAY], 2.0 / fast), 10.0 / slow)


@device_function
def _moved(law: Array, step: Array, scale: Array, free: NDArray[np.int64], tried: Array) -> None:
    """Write the law ``tried`` that is a step of the fitted vector away."""
    for i in range(len(law)):  # a copy of a whole array would allocate
        tried[i] = law[i]
    for column in range(len(free)):
        k = free[column]
        change = step[column] * scale[k]
        if k in (MU, R, DECAY):
            tried[k] = math.exp(min(max(math.log(law[k]) + change, -LOGARITHMS), LOGARITHMS))
        else:
            tried[k] += change


@kernel
def search(
    table: Array,
    contact: Array,
    sizes: Array,
    bounds: Array,
    free: NDArray[np.int64],
    law: Array,
    iterations: int,
    windows: Array,
    weights: Array,
    pairs: Array,
    jacobian: Array,
    small: Array,
) -> int:
    """Fit the parameters ``free`` (k,) of ``law`` (10,), which is changed; return the iterations.

    ``contact``, ``sizes`` and ``bounds``: see the constants. For work: ``windows`` (4, n),
    ``weights`` (n, 4), ``pairs`` (2 n,), ``jacobian`` (2 n, k), ``small`` (5 + 2 k, max(k, 10)).
    """
    n, k = len(table), len(free)
    bending, slope, limit, spare = windows[0], windows[1], windows[2], windows[3]
    tried, scale, fits = small[0, :10], small[1, :10], small[2, :10]
    chosen, step = small[3, :k], small[4, :k]
    u, turned = small[5 : 5 + k, :k], small[5 + k : 5 + 2 * k, :k]
    fits[:] = 0.0
    for column in range(k):
        fits[free[column]] = 1.0
    for iteration in range(iterations):
        _scale(law, sizes, _bend(table, contact, law[BENDING], bending, slope), scale)
        limits(table, bending, law, limit)
        floor = (bounds[FLOOR] * _ranked(limit, n // 2)) ** 2 + 1e-300
        for column in range(k):
            chosen[column] = scale[free[column]]
        evaluate(table, bending, slope, law, floor, free, chosen, weights, pairs, jacobian)
        before = 0.0
        for i in range(2 * n):
            before += pairs[i] * pairs[i]
        _step(jacobian, pairs, bounds[CUT], u, turned, step)
        greatest = 1e-300
        for column in range(k):
            greatest = max(greatest, abs(step[column]))
        for column in range(k):
            step[column] *= min(1.0, bounds[LARGEST] / greatest)
        for _ in range(HALVINGS):
            _moved(law, step, scale, free, tried)
            _bend(table, contact, tried[BENDING], bending, spare)
            _bound(table, bending, tried, bounds[NORMAL], fits)
            if squares(table, bending, tried, weights) <= before:
                break
            for column in range(k):
                step[column] *= 0.5
        moved = 0.0
        for column in range(k):
            at = free[column]
            change = tried[at] - law[at]
            if at in (MU, R, DECAY):
                change = math.log(tried[at]) - math.log(law[at])
            moved = max(moved, abs(change / scale[at]))
        for i in range(len(law)):
            law[i] = tried[i]
        if moved < bounds[CONVERGED]:
            return iteration + 1
    return iterations
