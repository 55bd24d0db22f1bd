"""Nonlinear springs and dampers by table, and compliant stops, on slide (k = 0) and spin (k = 1).

A table is piecewise linear. The force on B along the component is -F(u) of a spring, u the
elongation from the constitutive reference, and -D(w) of a damper. A compliant stop that is passed
by a depth d > 0, at the rate d', pushes back with

    p = max(k d + c min(d / d0, 1) d', 0)

so that it starts at zero and never pulls (the ramp of the damping as in the impact functions of
multibody programs).

One held force acts over a step, in which the component moves from x- to x+. The springs act with
their mean over that path,

    F = (V(x+) - V(x-)) / (x+ - x-)       V: stored energy, the integral of the table

the discrete gradient of V (Gonzalez, J. Nonlinear Sci. 6, 1996): what the force does is what V
loses, exactly, for any stiffness and across kinks; -k (u- + u+)/2 where the table is linear. The
dampers act with the mean rate. A semi-implicit plant has its rates between its positions: there the
path goes from the last position, x - h w-, to the next one, x + h w+, which conserves
m w^2/2 + (V(x) + V(x + h w))/2 (Greenspan, J. Comput. Phys. 56, 1984).

A solved step takes this force as push - E w+ about a rate w+ (methods/free_axes/elements.py). That
is exact where the path lies on one piece; else the step is repeated about the rate that it found,
Newton's method.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.layout import MOST_POINTS

Array = NDArray[np.float64]

# --- numbers of both components (SIZE,), from model.ELEMENTS ---
_TABLE: Final = 2 + 2 * MOST_POINTS  # number of points, whether constant beyond, points, values
_COMPONENT: Final = 7 + 2 * _TABLE
SIZE: Final = 2 + 2 * _COMPONENT  # the first two: whether slide, spin has any element

# --- of one component ---
LOW: Final = 0  # compliant stops, infinite: none
HIGH: Final = 1
STIFFNESS: Final = 2
DAMPING: Final = 3
DEPTH: Final = 4  # over which the damping rises to its value
STEEPEST: Final = 5  # greatest stiffness of table and stops, and greatest damping
SPRING: Final = 7  # table of the spring
DAMPER: Final = SPRING + _TABLE


class ElementForces(NamedTuple):
    """Forces of the elements of one component on B, N or N.m; and which stop is passed."""

    spring: float
    damper: float
    stop: float
    side: int  # -1, 1: in contact with the lower, upper compliant stop; 0: with none
    slope: float  # -d(sum)/d(w+)


def pack_table(points: tuple[float, ...], values: tuple[float, ...], constant: bool) -> Array:
    """The numbers of one table, (2 + 2 MOST_POINTS,)."""
    table = np.zeros(_TABLE)
    n = len(points)
    table[0], table[1] = n, constant
    table[2 : 2 + n] = points
    table[2 + MOST_POINTS : 2 + MOST_POINTS + n] = values
    return table


@inline_function
def first_of(k: int) -> int:
    """Index of the numbers of a component in those of both."""
    return 2 + k * _COMPONENT


@inline_function
def _piece(par: Array, at: int, x: float) -> int:
    """The number of points of a table that x has passed."""
    n = int(par[at])
    j = 0
    while j < n and x > par[at + 2 + j]:
        j += 1
    return j


@device_function
def _on_piece(par: Array, at: int, j: int, x: float) -> tuple[float, float]:
    """Value and slope at x of the line on which piece j of a table lies."""
    n, first = int(par[at]), at + 2
    if (j == 0 or j == n) and par[at + 1] != 0.0:
        return par[first + MOST_POINTS + (0 if j == 0 else n - 1)], 0.0
    left = min(max(j, 1), n - 1) - 1
    x0, y0 = par[first + left], par[first + MOST_POINTS + left]
    x1, y1 = par[first + left + 1], par[first + MOST_POINTS + left + 1]
    slope = (y1 - y0) / (x1 - x0)
    if abs(x - x0) < abs(x - x1):  # from the nearer end: no digits are lost next to a zero
        return y0 + slope * (x - x0), slope
    return y1 + slope * (x - x1), slope


@device_function
def table_value(par: Array, at: int, x: float) -> float:
    """The value of a table at x; 0 without a table."""
    if par[at] == 0.0:
        return 0.0
    value, _ = _on_piece(par, at, _piece(par, at, x), x)
    return value


@device_function
def table_mean(par: Array, at: int, a: float, b: float) -> tuple[float, float]:
    """Mean of a table from a to b, and its derivative with respect to b."""
    if par[at] == 0.0:
        return 0.0, 0.0
    low, high = min(a, b), max(a, b)
    first, last = _piece(par, at, low), _piece(par, at, high)
    if first == last:
        value, slope = _on_piece(par, at, first, 0.5 * (a + b))
        return value, 0.5 * slope
    mean, left = 0.0, low
    for j in range(first, last + 1):
        right = high if j == last else par[at + 2 + j]
        value, _ = _on_piece(par, at, j, 0.5 * (left + right))
        mean += value * (right - left)
        left = right
    mean /= high - low
    return mean, (table_value(par, at, b) - mean) / (b - a)


@inline_function
def _mean_depth(a: float, b: float) -> float:
    """Mean of max(d, 0) from a to b."""
    if a >= 0.0 and b >= 0.0:
        return 0.5 * (a + b)
    if a <= 0.0 and b <= 0.0:
        return 0.0
    deepest = max(a, b)
    return 0.5 * deepest * deepest / (deepest - min(a, b))


@inline_function
def _mean_and_slope(a: float, b: float) -> tuple[float, float]:
    """Mean of max(d, 0) from a to b, and its derivative with respect to b."""
    mean = _mean_depth(a, b)
    if a == b:
        return mean, 0.5 if a > 0.0 else 0.0
    return mean, (max(b, 0.0) - mean) / (b - a)


@inline_function
def _mean_share(a: float, b: float, over: float) -> tuple[float, float]:
    """Mean of min(d / over, 1), 0 for d < 0, from a to b, and its derivative with respect to b."""
    low, high = min(a, b), max(a, b)
    if low >= over:
        return 1.0, 0.0
    if a == b:
        return a / over, 0.5 / over
    rises, full = max(low, 0.0), min(high, over)
    mean = 0.5 * (full - rises) * (full + rises) / over + max(high - over, 0.0)
    mean /= high - low
    return mean, (min(max(b / over, 0.0), 1.0) - mean) / (b - a)


@device_function
def _stop_force(
    par: Array, at: int, a: float, b: float, rate: float, by_b: float, by_rate: float
) -> tuple[float, float]:
    """Force of a compliant stop for depths from a to b at a mean rate, and its derivative.

    by_b, by_rate: derivatives of b and of the rate.
    """
    if a <= 0.0 and b <= 0.0:
        return 0.0, 0.0
    depth, slope = _mean_and_slope(a, b)
    k, c, over = par[at + STIFFNESS], par[at + DAMPING], par[at + DEPTH]
    force, by = k * depth, k * slope * by_b
    if c > 0.0:
        share, share_by = _mean_share(a, b, over)
        force += c * share * rate
        by += c * (share * by_rate + share_by * by_b * rate)
    return (force, by) if force > 0.0 else (0.0, 0.0)


@device_function
def elements_over_step(
    par: Array, base: int, k: int, u: float, x: float, w: float, end: float, h: float,
    semi_implicit: bool,
) -> ElementForces:  # fmt: skip
    """Forces of the elements held over a step that ends at the rate ``end``.

    u: elongation (m, rad); x, w: position and rate of the component at the start.
    """
    at = base + first_of(k)
    mean = 0.5 * (w + end)
    start, last, by = 0.0, h * mean, 0.5 * h
    if semi_implicit:
        start, last, by = -h * w, h * end, h
    spring, slope = table_mean(par, at + SPRING, u + start, u + last)
    damper, damper_slope = table_mean(par, at + DAMPER, mean, mean)
    total = by * slope + damper_slope
    low, high = par[at + LOW], par[at + HIGH]
    below, below_by = _stop_force(par, at, low - x - start, low - x - last, -mean, -by, -0.5)
    above, above_by = _stop_force(par, at, x + start - high, x + last - high, mean, by, 0.5)
    side = (1 if above > 0.0 else 0) - (1 if below > 0.0 else 0)
    return ElementForces(-spring, -damper, below - above, side, total - below_by + above_by)


@device_function
def elements_at(par: Array, base: int, k: int, u: float, x: float, w: float) -> ElementForces:
    """Forces of the elements at one instant; the slope is not given."""
    at = base + first_of(k)
    spring, damper = table_value(par, at + SPRING, u), table_value(par, at + DAMPER, w)
    low, high = par[at + LOW] - x, x - par[at + HIGH]
    below, _ = _stop_force(par, at, low, low, -w, 0.0, 0.0)
    above, _ = _stop_force(par, at, high, high, w, 0.0, 0.0)
    side = (1 if above > 0.0 else 0) - (1 if below > 0.0 else 0)
    return ElementForces(-spring, -damper, below - above, side, 0.0)


@device_function
def element_energy(par: Array, base: int, k: int, u: float, x: float) -> float:
    """Energy stored in table and compliant stops, J; zero without elongation and off the stops."""
    at = base + first_of(k)
    mean, _ = table_mean(par, at + SPRING, 0.0, u)
    low, high = max(par[at + LOW] - x, 0.0), max(x - par[at + HIGH], 0.0)
    return mean * u + 0.5 * par[at + STIFFNESS] * (low * low + high * high)
