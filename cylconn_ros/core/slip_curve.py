"""Slip candidates: the one-parameter family of friction on the disc, and its bracketed root search.

After elimination of the constrained components two unknowns remain, phi = (f1f, m1f/R), with

    s+      = s_free + S phi               slip velocity at the end; S symmetric, >= 0
    s~      = (1 - theta) s- + theta s+    the one that friction opposes; theta = 1/2 or 1
    (f, m)c = base + c1 phi1 + c2 phi2     the constraint reactions, hence FN

    stick:   s+ = 0           and  |phi| <= limit(0, FN(phi))
    slip:    phi = -s~ / r    and  |phi|  = limit(|s~|, FN(phi)),    r = |s~| / |phi| > 0

so that all candidates lie on one curve, phi(r) = -(theta S + r I)^-1 s~free, from phi = 0 at r =
inf to stick at r = 0. |phi| grows along the curve: the solution of least traction, which for a
constant coefficient is that of least normal force, has the greatest r. The search starts at r =
inf, excludes intervals of r by rigorous bounds and never steps over a root.
"""

import math
from typing import NamedTuple

from cylconn_ros.core.friction import (
    Array,
    Law,
    at_middle,
    coefficient,
    contact,
    greatest_coefficient,
    last_force,
    least_coefficient,
    limit,
    share_of,
)
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.small_matrices import Four, eigen2

Two = tuple[float, float]

MAX_INTERVALS = 500
MAX_GRID_STEPS = 5000  # steps of 2 %: 44 decades
TOUCHING = 1e-9  # excess that counts as a root if the bounds are inconclusive
ROUNDING = 4e-16  # relative
NEGLIGIBLE_FORCE = 1e-100  # N: squares of smaller forces underflow


class DiscProblem(NamedTuple):
    """The reduced equations for phi; S by its eigenvalues and eigenvector (cos, sin)."""

    s_minus: Two
    s_free: Two
    greater: float
    lesser: float
    cos: float
    sin: float
    base: Four
    c1: Four
    c2: Four


class SlipCandidates(NamedTuple):
    """phi(r) in the eigenvectors of S: -a / (l1 + r), -b / (l2 + r)."""

    a: float
    b: float
    l1: float
    l2: float
    size: float  # |s~free|


@inline_function
def make_disc_problem(
    s_minus: Two, s_free: Two, s11: float, s12: float, s22: float, base: Four, c1: Four, c2: Four
) -> DiscProblem:
    """The problem with S given by its elements s11, s12, s22."""
    greater, lesser, cos, sin = eigen2(s11, s12, s22)
    if s11 > 0.0 and s22 > 0.0:  # no active limit: an eigenvalue <= 0 is rounding
        lesser = max(lesser, ROUNDING * min(s11, s22))
    return DiscProblem(s_minus, s_free, greater, lesser, cos, sin, base, c1, c2)


@inline_function
def reaction(d: DiscProblem, phi: Two) -> Four:
    """The constraint reactions (f2, f3, m2, m3) for phi."""
    p, q = phi
    return (
        d.base[0] + d.c1[0] * p + d.c2[0] * q,
        d.base[1] + d.c1[1] * p + d.c2[1] * q,
        d.base[2] + d.c1[2] * p + d.c2[2] * q,
        d.base[3] + d.c1[3] * p + d.c2[3] * q,
    )


@inline_function
def slip_candidates(d: DiscProblem, theta: float) -> SlipCandidates:
    """The candidates for one theta."""
    x = (1.0 - theta) * d.s_minus[0] + theta * d.s_free[0]
    y = (1.0 - theta) * d.s_minus[1] + theta * d.s_free[1]
    a, b = d.cos * x + d.sin * y, d.cos * y - d.sin * x
    l1, l2 = theta * d.greater, theta * d.lesser
    if b == 0.0:  # a component at rest at a limit does not contribute
        l2 = l1
    if a == 0.0:
        l1 = l2
    return SlipCandidates(a, b, l1, l2, math.sqrt(x * x + y * y))


@inline_function
def phi_at(d: DiscProblem, c: SlipCandidates, r: float) -> Two:
    """phi(r)."""
    p, q = -c.a / (c.l1 + r), -c.b / (c.l2 + r)
    return (d.cos * p - d.sin * q, d.sin * p + d.cos * q)


@inline_function
def _excess(law: Law, par: Array, d: DiscProblem, c: SlipCandidates, r: float) -> float:
    """limit/|phi| - 1 at r: >= 0 if stick is admissible (r = 0), or beyond the root for slip."""
    phi = phi_at(d, c, r)
    size = math.sqrt(phi[0] * phi[0] + phi[1] * phi[1])
    if size == 0.0:
        return math.inf
    normal = contact(law, reaction(d, phi)).normal
    along = -phi[0] / size if law.direction != 0.0 else 0.0
    return limit(law, par, r * size, normal, along) / size - 1.0


@device_function
def _slip_direction(d: DiscProblem, c: SlipCandidates, r: float) -> Two:
    """The unit vector of slip at r, -phi/|phi|. As r falls it turns one way, less than pi/2."""
    p = c.a
    q = c.b * ((c.l1 + r) / (c.l2 + r)) if r < math.inf else c.b
    size = math.sqrt(p * p + q * q)
    return ((d.cos * p - d.sin * q) / size, (d.sin * p + d.cos * q) / size)


@device_function
def _least_share(law: Law, here: Two, there: Two) -> float:
    """A lower bound of the share of direction between two slip directions of the curve.

    Between them no direction is farther from ``here`` than ``there`` is, and neither is its cosine.
    """
    x, y = there[0] - here[0], there[1] - here[1]
    least = share_of(law, here[0]) - abs(law.direction) * math.sqrt(x * x + y * y)
    return max(least, 1.0 - abs(law.direction))


@inline_function
def _has_end(c: SlipCandidates) -> bool:
    """Whether the curve ends at r = 0: it does not if a limited component moves."""
    return c.l1 > 0.0 and c.l2 > 0.0


@inline_function
def stick_excess(law: Law, par: Array, d: DiscProblem, c: SlipCandidates) -> float:
    """The excess of stick, r = 0; -1 if the curve does not end there."""
    return _excess(law, par, d, c, 0.0) if _has_end(c) else -1.0


@inline_function
def _normal_force_slope(law: Law, d: DiscProblem) -> float:
    """A Lipschitz constant of FN over |phi|."""
    c1, c2 = at_middle(law, d.c1), at_middle(law, d.c2)
    f = c1[0] ** 2 + c1[1] ** 2 + c2[0] ** 2 + c2[1] ** 2
    m = c1[2] ** 2 + c1[3] ** 2 + c2[2] ** 2 + c2[3] ** 2
    return law.radial * math.sqrt(f) + law.bending * math.sqrt(m)


@device_function
def _find_root(
    law: Law,
    par: Array,
    d: DiscProblem,
    c: SlipCandidates,
    low: float,
    g_low: float,
    high: float,
    g_high: float,
) -> float:
    """The root between ``low``, with negative excess ``g_low``, and ``high``.

    The excess is linear in r for constant FN and direction, so that regula falsi (Anderson and
    Bjorck) takes a few evaluations. Iterates keep a rounding error's distance from both ends: if
    one end has converged, the first point beyond the root closes the bracket. After eight
    evaluations every fourth one bisects the bracket.
    """
    for k in range(200):
        least = ROUNDING * high
        if high - low <= 2.0 * least or g_high == 0.0:
            break
        r = 0.5 * (low + high)
        falsi = low - g_low * (high - low) / (g_high - g_low)
        if low <= falsi <= high and (k < 8 or k % 4 != 3):
            r = min(max(falsi, low + least), high - least)
        g = _excess(law, par, d, c, r)
        if abs(g) <= ROUNDING:
            return r
        if g < 0.0:
            m = 1.0 - g / g_low
            g_high *= m if m > 0.0 else 0.5
            low, g_low = r, g
        else:
            m = 1.0 - g / g_high
            g_low *= m if m > 0.0 else 0.5
            high, g_high = r, g
    return high


@inline_function
def _component_bound(part: float, other: float, step: float) -> float:
    """A lower bound at the far end of ``step`` of c/(l + r), linear in r and exact at the near end.

    ``part`` is its value at the near end, ``other`` at the far end. For c > 0 it is convex and the
    tangent bounds it, for c < 0 it is concave and the chord does; ``step`` is the interval's length
    over l + r.
    """
    return part * (1.0 + step) if part > 0.0 else other


@device_function
def _is_free_of_roots(
    law: Law, par: Array, d: DiscProblem, c: SlipCandidates, growth: float, low: float, high: float
) -> bool:
    """Whether |phi| < limit is certain on the whole of [low, high]; it holds at high.

    |phi| is convex in r, so its chord bounds it from above. Fr + Fbend is convex in phi, so its
    tangent plane at high bounds it from below, and there the components of phi are convex or
    concave in r (`_component_bound`). From above it is bounded by its chord plus growth times the
    bow of phi(r). All bounds are linear in r, so that it suffices to compare them at both ends.
    Their error is of second order in the length of the interval.
    """
    x, y = -c.a / (c.l1 + high), -c.b / (c.l2 + high)
    u, v = -c.a / (c.l1 + low), -c.b / (c.l2 + low)
    size_high, size = math.sqrt(x * x + y * y), math.sqrt(u * u + v * v)
    if size >= law.cap:
        return False
    f = reaction(d, phi_at(d, c, high))
    here = contact(law, f)
    there = contact(law, reaction(d, phi_at(d, c, low)))
    # gradient of Fr + Fbend at high, in the eigenvectors
    g1 = g2 = 0.0
    f, c1, c2 = at_middle(law, f), at_middle(law, d.c1), at_middle(law, d.c2)
    if here.radial > 0.0:
        g1 += (f[0] * c1[0] + f[1] * c1[1]) / here.radial
        g2 += (f[0] * c2[0] + f[1] * c2[1]) / here.radial
    if here.moment > 0.0:
        g1 += law.bending * (f[2] * c1[2] + f[3] * c1[3]) / here.moment
        g2 += law.bending * (f[2] * c2[2] + f[3] * c2[3]) / here.moment
    p, q = d.cos * g1 + d.sin * g2, d.cos * g2 - d.sin * g1
    pressed = here.radial + here.bending + law.preload
    step = high - low
    least = pressed - p * x - q * y
    least += _component_bound(p * x, p * u, step / (c.l1 + high))
    least += _component_bound(q * y, q * v, step / (c.l2 + high))
    if pressed > 0.0 and least > 0.0:
        normal_high, normal_low = pressed, least
    else:  # FN = -(Fr + Fbend + FCint), or FN may vanish on the interval
        bow = 0.25 * step * step * (abs(u) / (c.l1 + low) ** 2 + abs(v) / (c.l2 + low) ** 2)
        normal_high = -pressed - growth * bow
        normal_low = -(there.radial + there.bending + law.preload) - growth * bow
        if normal_high <= 0.0 or normal_low <= 0.0:
            return False
    mu = coefficient(law, par, high * size_high, here.normal)
    mu -= law.rate_slope * abs(high * size_high - low * size)
    if law.force_slope > 0.0 and min(normal_high, normal_low) < last_force(law, par):
        mu -= law.force_slope * growth * math.sqrt((x - u) * (x - u) + (y - v) * (y - v))
    mu = max(mu, least_coefficient(law))
    if law.direction != 0.0:
        mu *= _least_share(law, _slip_direction(d, c, high), _slip_direction(d, c, low))
    return mu * normal_high > size_high and mu * normal_low > size


@device_function
def first_root(law: Law, par: Array, d: DiscProblem, c: SlipCandidates, g_end: float) -> float:
    """The greatest r of a root, given the excess at the end r = 0.

    0.0: there is none (stick), inf: phi = 0 solves.
    """
    growth = _normal_force_slope(law, d)
    only_one = False
    varies = law.rate_slope != 0.0 or law.force_slope != 0.0 or law.direction != 0.0
    if not varies and _has_end(c):
        spread = (c.l1 + c.l2) / (2.0 * math.sqrt(c.l1 * c.l2))  # |d phi| / d|phi|, Kantorovich
        only_one = greatest_coefficient(law) * growth * spread < 1.0
    if only_one and g_end >= 0.0:
        return 0.0
    first = (0.0, 0.0)
    if law.direction != 0.0:
        first = _slip_direction(d, c, math.inf)
    resting = limit(law, par, c.size, contact(law, d.base).normal, first[0])
    if resting <= NEGLIGIBLE_FORCE:
        return math.inf
    high = c.size / resting
    if only_one:  # |phi| <= |s~free| / r, so one of these is beyond the root
        for _ in range(200):
            g_high = _excess(law, par, d, c, high)
            if g_high >= 0.0:
                return _find_root(law, par, d, c, 0.0, g_end, high, g_high)
            high *= 4.0
        return math.inf
    # The upper end of the first interval: up to it FN differs from FN(0) by at most growth |phi|.
    certain = False
    while not certain and high < 1e300:
        high *= 4.0
        size = c.size / (c.l2 + high)
        normal = max(contact(law, d.base).normal - growth * size, 0.0)
        mu = coefficient(law, par, c.size, contact(law, d.base).normal)
        mu -= law.rate_slope * c.size * c.l1 / (c.l1 + high) + law.force_slope * growth * size
        mu = max(mu, least_coefficient(law))
        if law.direction != 0.0:
            mu *= _least_share(law, first, _slip_direction(d, c, high))
        certain = size < min(law.cap, mu * normal)
    if not certain:
        return math.inf
    g_high = _excess(law, par, d, c, high)
    step = 0.5  # length of the interval as a share of r
    for _ in range(MAX_INTERVALS):
        low = high * (1.0 - step) if high > 1e-13 * c.l2 else 0.0
        g_low = _excess(law, par, d, c, low)
        if g_low >= 0.0 and _is_free_of_roots(law, par, d, c, growth, low, high):
            if low == 0.0:
                return 0.0
            high, g_high = low, g_low
            step = min(2.0 * step, 0.9)
            continue
        if step < 1e-6 and g_low < 0.0:
            return _find_root(law, par, d, c, low, g_low, high, g_high)
        if step < 1e-15:  # a double root, or a curvature too high for the bounds
            return high if g_high <= TOUCHING else _grid_search(law, par, d, c, high, g_high, g_end)
        step *= 0.25
    return _grid_search(law, par, d, c, high, g_high, g_end)


@device_function
def _grid_search(
    law: Law,
    par: Array,
    d: DiscProblem,
    c: SlipCandidates,
    high: float,
    g_high: float,
    g_end: float,
) -> float:
    """The first change of sign below ``high`` on a geometric grid, if the bounds were inconclusive.

    This happens if limit and traction nearly coincide over a long interval, with a coefficient that
    varies.
    """
    for _ in range(MAX_GRID_STEPS):
        low, g_low = 0.98 * high, 0.0
        if low > 1e-13 * c.l2 + 1e-290:
            g_low = _excess(law, par, d, c, low)
        elif _has_end(c):
            low, g_low = 0.0, g_end
        else:
            break
        if g_low < 0.0:
            return _find_root(law, par, d, c, low, g_low, high, g_high)
        high, g_high = low, g_low
    return high


@device_function
def last_root(law: Law, par: Array, d: DiscProblem, c: SlipCandidates) -> float:
    """The root nearest to r = 0 by a search upwards; inf: there is none."""
    most = math.copysign(1.0, law.direction)
    greatest = limit(law, par, c.size, contact(law, d.base).normal, most)
    low = 1e-13 * c.l2
    if not _has_end(c):
        limited = abs(c.b) if c.l2 <= 0.0 and c.b != 0.0 else abs(c.a)  # the moving component
        low = ROUNDING * limited / max(greatest, NEGLIGIBLE_FORCE)
    g_low = _excess(law, par, d, c, low)
    for _ in range(MAX_GRID_STEPS):
        high = 1.05 * low
        g_high = _excess(law, par, d, c, high)
        if g_low < 0.0 <= g_high:
            return _find_root(law, par, d, c, low, g_low, high, g_high)
        low, g_low = high, g_high
    return math.inf
