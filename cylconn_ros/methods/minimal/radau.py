"""Radau IIA of order 5 for slow slip, in which friction makes the equations stiff.

Friction changes the direction of slip at the rate P G/|s|, G the inverse inertia normal to it. The
rate is unbounded for |s| towards zero, and exceeds all others if friction is large compared with
the accelerating forces. An explicit step is limited to a few times its inverse.

Three stages Y_i = y + z_i, z = h (A x I) f(Y), by simplified Newton iterations. Only the two rates
are stiff, and only with respect to themselves: the Jacobian is their 2x2 block by finite
differences, and the other components use fixed-point iteration (Hairer, Wanner, Solving Ordinary
Differential Equations II, 1996, IV.8).
"""

import math
from typing import Final

from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import allocating_function
from cylconn_ros.methods.minimal import coordinates
from cylconn_ros.methods.minimal.derivatives import derivatives_at
from cylconn_ros.methods.minimal.forces import Sides

S6 = math.sqrt(6.0)
NODES: Final = ((4.0 - S6) / 10.0, (4.0 + S6) / 10.0, 1.0)
WEIGHTS: Final = (
    ((88.0 - 7.0 * S6) / 360.0, (296.0 - 169.0 * S6) / 1800.0, (-2.0 + 3.0 * S6) / 225.0),
    ((296.0 + 169.0 * S6) / 1800.0, (88.0 + 7.0 * S6) / 360.0, (-2.0 - 3.0 * S6) / 225.0),
    ((16.0 - S6) / 36.0, (16.0 + S6) / 36.0, 1.0 / 9.0),
)
REAL = 3.0 + 3.0 ** (2.0 / 3.0) - 3.0 ** (1.0 / 3.0)  # real eigenvalue of the inverse weights
ERROR: Final = ((-13.0 - 7.0 * S6) / 3.0, (-13.0 + 7.0 * S6) / 3.0, -1.0 / 3.0)

# rows of the workspace k, of which row 0 holds the rates at the start
Z: Final = 1  # 3
F: Final = 4  # 3
ESTIMATE: Final = 7  # the error of the step

ITERATIONS = 15
Jacobian = tuple[float, float, float, float]


@allocating_function
def jacobian(
    par: Array, joint: Array, t: float, y: Array, sides: Sides, slip: float, radius: float,
    k: Array,
) -> Jacobian:  # fmt: skip
    """d(l'', alpha'')/d(v1, w1) by forward differences: 11, 12, 21, 22."""
    for c in range(2):
        step = 1e-7 * (slip if c == 0 else slip / radius)
        kept = y[coordinates.SLIDE + c]
        y[coordinates.SLIDE + c] = kept + step
        derivatives_at(par, joint, t, y, False, sides, k[F + c])
        y[coordinates.SLIDE + c] = kept
        for r in range(2):
            k[F + c, coordinates.SLIDE + r] = (
                k[F + c, coordinates.SLIDE + r] - k[0, coordinates.SLIDE + r]
            ) / step
    return (
        k[F, coordinates.SLIDE],
        k[F + 1, coordinates.SLIDE],
        k[F, coordinates.SPIN],
        k[F + 1, coordinates.SPIN],
    )


@allocating_function
def stiffness(
    par: Array, joint: Array, t: float, y: Array, sides: Sides, slip: float, radius: float,
    k: Array,
) -> float:  # fmt: skip
    """Stiffness of friction on the slip direction, 1/s; k[0]: the derivatives at y."""
    j = jacobian(par, joint, t, y, sides, slip, radius, k)
    across = (j[1] / radius) ** 2 + (j[2] * radius) ** 2
    return math.sqrt(j[0] * j[0] + across + j[3] * j[3])


@allocating_function
def _solve6(m: Array) -> None:
    """Solve the 6x6 system of m (6, 7) in place; the last column becomes the solution."""
    for p in range(6):
        best = p
        for r in range(p + 1, 6):
            if abs(m[r, p]) > abs(m[best, p]):
                best = r
        for c in range(p, 7):
            m[p, c], m[best, c] = m[best, c], m[p, c]
        for r in range(6):
            if r != p:
                share = m[r, p] / m[p, p]
                for c in range(p, 7):
                    m[r, c] -= share * m[p, c]
    for p in range(6):
        m[p, 6] /= m[p, p]


@allocating_function
def _newton_iteration(
    y: Array, h: float, j: Jacobian, slip: float, radius: float, k: Array, size: int, system: Array
) -> float:
    """One Newton iteration on z; returns the greatest change of a rate.

    The Jacobian is inversely proportional to the slip rate, which can grow by orders of magnitude
    within a step, so that each stage has its own.
    """
    for i in range(3):
        for c in range(size):
            residual = -k[Z + i, c]
            for s in range(3):
                residual += h * WEIGHTS[i][s] * k[F + s, c]
            if c == coordinates.SLIDE or c == coordinates.SPIN:
                system[2 * i + c - coordinates.SLIDE, 6] = residual
            else:
                k[Z + i, c] += residual
    for i in range(6):
        for c in range(6):
            v = y[coordinates.SLIDE] + k[Z + c // 2, coordinates.SLIDE]
            w = radius * (y[coordinates.SPIN] + k[Z + c // 2, coordinates.SPIN])
            share = slip / math.sqrt(v * v + w * w) * j[2 * (i % 2) + c % 2]
            system[i, c] = -h * WEIGHTS[i // 2][c // 2] * share + (1.0 if i == c else 0.0)
    _solve6(system)
    change = 0.0
    for i in range(6):
        k[Z + i // 2, coordinates.SLIDE + i % 2] += system[i, 6]
    for c in range(2):
        for i in range(3):
            change = max(change, abs(system[2 * i + c, 6]))
    return change


@allocating_function
def stiff_step(
    par: Array, joint: Array, t: float, y: Array, h: float, sides: Sides, slip: float,
    radius: float, k: Array, new: Array, system: Array,
) -> bool:  # fmt: skip
    """One step into ``new`` (k[0]: derivatives at its start); whether it converged."""
    size = y.shape[0]
    j = jacobian(par, joint, t, y, sides, slip, radius, k)
    for i in range(3):
        for c in range(size):
            k[Z + i, c] = NODES[i] * h * k[0, c]
    last, done = math.inf, False
    for _ in range(ITERATIONS):
        for i in range(3):
            for c in range(size):
                new[c] = y[c] + k[Z + i, c]
            if derivatives_at(par, joint, t + NODES[i] * h, new, False, sides, k[F + i]).jammed:
                return False
        change = _newton_iteration(y, h, j, slip, radius, k, size, system)
        if not change < 4.0 * last:
            return False
        if done:
            break
        done = change <= 1e-9 * slip  # one more iteration for the other components
        last = change
    if not done:
        return False
    for c in range(size):
        new[c] = y[c] + k[Z + 2, c]
        total = k[0, c]
        for i in range(3):
            total += ERROR[i] * k[Z + i, c] / h
        k[ESTIMATE, c] = h / REAL * total
    a, d = REAL / h - j[0], REAL / h - j[3]
    det = a * d - j[1] * j[2]
    u, v = k[ESTIMATE, coordinates.SLIDE] * REAL / h, k[ESTIMATE, coordinates.SPIN] * REAL / h
    k[ESTIMATE, coordinates.SLIDE] = (d * u + j[1] * v) / det
    k[ESTIMATE, coordinates.SPIN] = (a * v + j[2] * u) / det
    return True


@allocating_function
def stiff_error(
    y: Array, new: Array, k: Array, n: int, tolerance: float, rate_tolerance: tuple[float, float]
) -> float:
    """Estimated error over the allowed one of a stiff step (order 3)."""
    total = 0.0
    for i in range(n):
        allowed = tolerance * (0.1 + max(abs(y[i]), abs(new[i])))
        if i == coordinates.SLIDE or i == coordinates.SPIN:
            allowed = min(allowed, rate_tolerance[i - coordinates.SLIDE])
        total += (k[ESTIMATE, i] / allowed) ** 2
    return math.sqrt(total / n)
