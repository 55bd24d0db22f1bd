"""Friction and stops of connectors that share bodies: one problem for the slide and spin of all.

With the constraints of all connectors eliminated, two unknowns of each connector remain, scaled as
in core/friction_disc.py: phi = (f1f, m1f/R) on a disc, and p, the reaction of a stop, a lock or a
drive. For n = 2 N components

    s+  = free + S (phi + p)                     S symmetric, >= 0
    c_c = base_c + By_c (phi + p)                constraint reactions of connector c, hence FN_c
    phi_c in the disc of radius limit(|s~|, FN_c), against s~; inside the disc s+ = -back
    0 <= p _|_ s+ - low >= 0                     and likewise for the greatest rate
    |p| <= F of a drive, which gives way beyond  (where a stop acts as well: on the other side)

The radii depend on the unknowns: a quasi-variational inequality. As a fixed point of projections
(natural map), with s^ = s+ + back + (1/theta - 1) s- in the direction of s~ and g_c a mobility:

    H_c = phi_c - P_disc(phi_c - s^_c / g_c) = 0        H_k = p_k - P(p_k - (s+_k - t) / g_k) = 0

Where several connectors stick, the friction of each can be undetermined. A term EPSILON m (phi -
phi_0) is added to s^, m the mobility of the connector's bodies in translation: with phi_0 = 0 it
selects the friction of least norm that the discs admit; then phi_0 is the solution itself, so that
nothing of the term remains (proximal point method). With such a term on p, several stops share
their load equally. Friction takes no share of what is at rest at a stop or a lock: there ``slips``
is 0, also for components of other connectors that cannot move without it.
"""

import math
from typing import Final, NamedTuple

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array, at_middle, coefficient, contact, limit, share_of
from cylconn_ros.core.jit import device_function, inline_function

STOPS: Final = 10.0  # ratio of the terms of reactions and friction
_AT_REST: Final = 1e-12  # excess over the limit that is still stick, relative
_DIFFERENCE: Final = 1e-6  # relative, for the slopes of a limit that is not constant


class GroupProblem(NamedTuple):
    """The problem of N connectors and its state; arrays are the caller's."""

    number: int  # N
    par: Array  # (N, size) parameters of each
    on: Array  # (N,) whether friction is on
    s: Array  # (2 N, 2 N)
    free: Array  # (2 N,)
    terms: Array  # (2 N,) sum of the absolute values of the terms of free
    base: Array  # (4 N,)
    by: Array  # (4 N, 2 N)
    low: Array  # (2 N,) bounds of s+, infinite: none
    high: Array
    least: Array  # (2 N,) bounds of p: of a drive with a greatest force
    most: Array
    back: Array  # (2 N,)
    before: Array  # (2 N,) s-
    moves: Array  # (2 N,) 0 for a component that other connectors hold
    slips: Array  # (2 N,) 0 for one without slip: held as above, or at rest at a stop or lock
    mobility: Array  # (N,) m
    theta: Array  # (N,) 1/2 or 1
    gain: Array  # (N,) g_c
    epsilon: Array  # (1,) factor of the proximal term
    sharp: Array  # (1,) not 0: its mobility takes the place of g_c
    phi: Array  # (2 N,) the solution
    p: Array  # (2 N,)
    anchor: Array  # (4 N,) phi_0, p_0
    end: Array  # (2 N,) s+
    size: Array  # (2 N,) sum of the absolute values of the terms of s+
    away: Array  # (2 N,) the point that is projected on the disc
    radius: Array  # (N,)
    fixed: Array  # (N,) the radii, where they do not follow the reactions
    forced: Array  # (N,) 1: sticks, -1: slips, whatever its limit
    share: Array  # (1,) factor on the limits
    limits: Array  # (N,) without it
    residual: Array  # (4 N,) H of phi, of p
    listed: Array  # (4 N,) unknowns: j for phi_j, 2 N + j for p_j
    matrix: Array  # (4 N + 1, 4 N + 2)
    tried: Array  # (4 N,) the unknowns before a Newton step
    start: Array  # (4 N,) the same before Newton's method
    best: Array  # (4 N,) of the least residual
    settled: Array  # (4 N,) before the proximal term is moved
    slope: Array  # (2 N,) of a limit
    tangent: Array  # (4 N + 1,) of the path (core/group_path.py)
    origin: Array  # (4 N + 1,) the point from which it is followed


@inline_function
def shift(g: GroupProblem, j: int) -> float:
    """s^ - s+ of component j, without the proximal term."""
    return float(g.back[j] + (1.0 / g.theta[j // 2] - 1.0) * g.before[j])


@inline_function
def _slip(g: GroupProblem, j: int) -> float:
    """s^ of component j, without the proximal term."""
    return float(g.end[j] + shift(g, j)) if g.slips[j] != 0.0 else 0.0


@device_function
def evaluate(g: GroupProblem, follow: bool) -> float:
    """Update s+, the radii (``follow``; else the fixed ones) and H; returns the relative |H|."""
    n = 2 * g.number
    for j in range(n):
        total, size = g.free[j], g.terms[j]
        for k in range(n):
            term = g.s[j, k] * (g.phi[k] + g.p[k])
            total += term
            size += abs(term)
        g.end[j], g.size[j] = total, size
    worst = 0.0
    for c in range(g.number):
        for j in (2 * c, 2 * c + 1):
            g.residual[n + j] = 0.0
            if g.moves[j] != 0.0 and (g.low[j] > -math.inf or g.high[j] < math.inf):
                worst = max(worst, _bound_residual(g, j))
        if g.on[c] != 0.0:
            worst = max(worst, _disc_residual(g, c, follow))
    return worst


@inline_function
def _softness(g: GroupProblem, j: int) -> float:
    """Factor of the proximal term of the reaction p_j."""
    return float(STOPS * g.epsilon[0] * g.mobility[j // 2])


@inline_function
def reaction_at(g: GroupProblem, j: int, p: float, rate: float) -> float:
    """P(p_j - (s+_j - t)/g_j): p_j itself where bounds and limit of the drive are satisfied."""
    gain = g.s[j, j]
    found = max(0.0, p - (rate - g.low[j]) / gain) + min(0.0, p - (rate - g.high[j]) / gain)
    return float(min(max(found, g.least[j]), g.most[j]))


@inline_function
def _bound_residual(g: GroupProblem, j: int) -> float:
    n, gain = 2 * g.number, g.s[j, j]
    p, rate = g.p[j], g.end[j] + _softness(g, j) * (g.p[j] - g.anchor[n + j])
    taken = reaction_at(g, j, p, rate)
    g.residual[n + j] = p - taken
    size = g.size[j]
    if taken > 0.0 or p > 0.0:
        size += abs(g.low[j])
    elif taken < 0.0 or p < 0.0:
        size += abs(g.high[j])
    return abs(p - taken) * gain / size if size > 0.0 else 0.0


@inline_function
def is_within(g: GroupProblem, c: int, out: float) -> bool:
    """Whether the point that is projected, at a distance ``out``, is taken as within the disc."""
    if g.forced[c] != 0.0:
        return g.forced[c] > 0.0 or out == 0.0
    return bool(out <= g.radius[c])


@inline_function
def _disc_residual(g: GroupProblem, c: int, follow: bool) -> float:
    i, j = 2 * c, 2 * c + 1
    m = g.epsilon[0] * g.mobility[c]
    gain = m if g.sharp[0] != 0.0 else g.gain[c]
    x, y = _slip(g, i), _slip(g, j)
    a = g.phi[i] - (x + m * (g.phi[i] - g.anchor[i])) / gain
    b = g.phi[j] - (y + m * (g.phi[j] - g.anchor[j])) / gain
    if g.slips[i] == 0.0:
        a = 0.0
    if g.slips[j] == 0.0:
        b = 0.0
    g.away[i], g.away[j] = a, b
    out = math.sqrt(a * a + b * b)
    radius = g.fixed[c]
    if follow:
        law = model.law(g.par[c])
        rate = g.theta[c] * math.sqrt(x * x + y * y)
        along = -a / out if law.direction != 0.0 and out > 0.0 else 0.0
        g.limits[c] = limit(law, g.par[c], rate, contact(law, _reaction(g, c)).normal, along)
        radius = g.share[0] * g.limits[c]
    g.radius[c] = radius
    share = 1.0 if is_within(g, c, out) else radius / out
    g.residual[i], g.residual[j] = g.phi[i] - share * a, g.phi[j] - share * b
    size = (g.size[i] + g.size[j]) / g.gain[c] + (radius if radius < math.inf else 0.0)
    off = math.sqrt(g.residual[i] ** 2 + g.residual[j] ** 2)
    return off / size if size > 0.0 else 0.0


@inline_function
def _reaction(g: GroupProblem, c: int) -> tuple[float, float, float, float]:
    """The constraint reactions (f2, f3, m2, m3) of connector c."""
    n, r = 2 * g.number, 4 * c
    f2, f3, m2, m3 = g.base[r], g.base[r + 1], g.base[r + 2], g.base[r + 3]
    for k in range(n):
        u = g.phi[k] + g.p[k]
        f2 += g.by[r, k] * u
        f3 += g.by[r + 1, k] * u
        m2 += g.by[r + 2, k] * u
        m3 += g.by[r + 3, k] * u
    return (f2, f3, m2, m3)


@device_function
def _limit_slope(g: GroupProblem, c: int, along: float) -> float:
    """Write the slope of the limit of connector c over all components to ``slope``.

    Without the part by the slip direction, whose cosine is ``along``; returns the limit's slope
    over that cosine.
    """
    n, i, j, r = 2 * g.number, 2 * c, 2 * c + 1, 4 * c
    par = g.par[c]
    law = model.law(par)
    pressed = contact(law, _reaction(g, c))
    f2, f3, m2, m3 = at_middle(law, _reaction(g, c))
    x, y = _slip(g, i), _slip(g, j)
    total = math.sqrt(x * x + y * y)
    rate = g.theta[c] * total
    radius = limit(law, par, rate, pressed.normal, along)
    mean = coefficient(law, par, rate, pressed.normal)
    over_normal, over_cosine = mean * share_of(law, along), law.direction * mean * pressed.normal
    over_rate = 0.0
    if law.force_slope > 0.0 and pressed.normal > 0.0:
        d = _DIFFERENCE * pressed.normal
        over_normal = (limit(law, par, rate, pressed.normal + d, along) - radius) / d
    if law.rate_slope > 0.0 and rate > 0.0:
        d = _DIFFERENCE * rate
        over_rate = (limit(law, par, rate + d, pressed.normal, along) - radius) / d
    if radius >= law.cap:
        over_normal = over_rate = over_cosine = 0.0
    if pressed.radial + pressed.bending + law.preload < 0.0:
        over_normal = -over_normal
    radial = law.radial * over_normal / pressed.radial if pressed.radial > 0.0 else 0.0
    bending = over_normal * law.bending / pressed.moment if pressed.moment > 0.0 else 0.0
    across = over_rate * g.theta[c] / total if total > 0.0 else 0.0
    for k in range(n):
        by = (g.by[r, k], g.by[r + 1, k], g.by[r + 2, k], g.by[r + 3, k])
        by2, by3, turn2, turn3 = at_middle(law, by)
        g.slope[k] = g.share[0] * (
            radial * (f2 * by2 + f3 * by3)
            + bending * (m2 * turn2 + m3 * turn3)
            + across * (x * g.s[i, k] + y * g.s[j, k])
        )
    return float(g.share[0] * over_cosine)


@device_function
def list_unknowns(g: GroupProblem) -> int:
    """List the unknowns; returns their number."""
    n, count = 2 * g.number, 0
    for j in range(n):
        if g.on[j // 2] != 0.0 and g.slips[j] != 0.0:
            g.listed[count] = j
            count += 1
    for j in range(n):
        if g.moves[j] != 0.0 and (g.low[j] > -math.inf or g.high[j] < math.inf):
            g.listed[count] = n + j
            count += 1
    return count


@device_function
def linearise(g: GroupProblem, unknowns: int, follow: bool) -> None:
    """Write the generalised Jacobian of H and -H to ``matrix``."""
    n = 2 * g.number
    row = 0
    while row < unknowns:
        j = int(g.listed[row])
        if j >= n:
            _linearise_bound(g, row, j - n, unknowns)
            row += 1
            continue
        both = g.slips[2 * (j // 2)] != 0.0 and g.slips[2 * (j // 2) + 1] != 0.0
        _linearise_disc(g, row, j // 2, both, unknowns, follow)
        row += 2 if both else 1


@inline_function
def _linearise_bound(g: GroupProblem, row: int, j: int, unknowns: int) -> None:
    n, gain, p = 2 * g.number, g.s[j, j], g.p[j]
    soft = _softness(g, j)
    rate = g.end[j] + soft * (p - g.anchor[n + j])
    found = reaction_at(g, j, p, rate)
    taken = found != 0.0 and g.least[j] < found < g.most[j]
    for column in range(unknowns):
        k = int(g.listed[column])
        if taken:
            g.matrix[row, column] = g.s[j, k % n] / gain + (soft / gain if k == n + j else 0.0)
        else:
            g.matrix[row, column] = 1.0 if k == n + j else 0.0
    g.matrix[row, unknowns] = -g.residual[n + j]


@device_function
def _linearise_disc(
    g: GroupProblem, row: int, c: int, both: bool, unknowns: int, follow: bool
) -> None:
    n, i, j = 2 * g.number, 2 * c, 2 * c + 1
    m = g.epsilon[0] * g.mobility[c]
    gain = m if g.sharp[0] != 0.0 else g.gain[c]
    a, b = g.away[i], g.away[j]
    out = math.sqrt(a * a + b * b)
    slips = not is_within(g, c, out)
    share, d11, d12, d22, n1, n2 = 1.0, 1.0, 0.0, 1.0, 0.0, 0.0
    turn = 0.0  # slope of the limit over n1 times that of n1 over the projected point
    if slips:
        share, n1, n2 = g.radius[c] / out, a / out, b / out
        d11, d12, d22 = share * n2 * n2, -share * n1 * n2, share * n1 * n1
        if follow:
            turn = _limit_slope(g, c, -n1) * n2 / out
    first = g.slips[i] != 0.0
    second_row = row + 1 if first else row
    for column in range(unknowns):
        k = int(g.listed[column])
        at = k % n
        q1, q2 = -g.s[i, at] / gain, -g.s[j, at] / gain
        e1 = e2 = 0.0
        if k == i:
            q1 += 1.0 - m / gain
            e1 = 1.0
        elif k == j:
            q2 += 1.0 - m / gain
            e2 = 1.0
        if not first:
            q1 = 0.0
        elif not both:
            q2 = 0.0
        grown = g.slope[at] if slips and follow else 0.0
        grown -= turn * (n2 * q1 - n1 * q2)
        if first:
            g.matrix[row, column] = e1 - d11 * q1 - d12 * q2 - n1 * grown
        if both or not first:
            g.matrix[second_row, column] = e2 - d12 * q1 - d22 * q2 - n2 * grown
    if first:
        g.matrix[row, unknowns] = -g.residual[i]
    if both or not first:
        g.matrix[second_row, unknowns] = -g.residual[j]


@inline_function
def sticks(g: GroupProblem, c: int) -> bool:
    """Whether friction of connector c is within its disc, s+ = -back."""
    i, j = 2 * c, 2 * c + 1
    out = math.sqrt(g.away[i] ** 2 + g.away[j] ** 2)
    return out <= g.radius[c] * (1.0 + _AT_REST)


@inline_function
def contradiction(g: GroupProblem) -> float:
    """The part of a rate, relative, by which the proximal term reconciles bounds of s+."""
    n, worst = 2 * g.number, 0.0
    for j in range(n):
        if g.p[j] != 0.0:
            # what enters the rate: that of no force, its bound, and friction of all connectors
            size = abs(g.free[j]) + abs(g.low[j] if g.p[j] > 0.0 else g.high[j])
            for k in range(n):
                size += abs(g.s[j, k] * g.phi[k])
            left = _softness(g, j) * abs(g.p[j] - g.anchor[n + j])
            worst = max(worst, left / size if size > 0.0 else 0.0)
    return worst


@inline_function
def kept_share(g: GroupProblem, c: int) -> float:
    """s-.s+ / |s-|^2: slip goes on in its direction if it is above 1/4."""
    if sticks(g, c):
        return 0.0
    i, j = 2 * c, 2 * c + 1
    x, y = g.before[i], g.before[j]
    return float((x * (g.end[i] + g.back[i]) + y * (g.end[j] + g.back[j])) / (x * x + y * y))
