"""Friction and stops of connectors that share bodies: one problem for the slide and spin of all.

With the constraints of all connectors eliminated, two unknowns of each connector remain, scaled as
in core/friction_disc.py: phi = (f1f, m1f/R) on a disc, and p, the reaction of a stop, a lock or a
drive. For n = 2 N components

    s+  = free + S (phi + p)                     S symmetric, >= 0
    c_c = base_c + By_c (phi + p)                constraint reactions of connector c, hence FN_c
    phi_c in the disc of radius limit(|s~|, FN_c), against s~; inside the disc s+ = -back
    0 <= p _|_ s+ - low >= 0                     and likewise for the greatest rate

The radii depend on the unknowns: a quasi-variational inequality. As a fixed point of projections
(natural map), with s^ = s+ + back + (1/theta - 1) s- in the direction of s~ and g_c a mobility:

    H_c = phi_c - P_disc(phi_c - s^_c / g_c) = 0        H_k = p_k - P(p_k - (s+_k - t) / g_k) = 0

A semismooth Newton method solves H = 0, with step lengths that decrease |H|. Where it stalls, the
problem with fixed radii, which is convex, is solved in turns with an update of the radii, and
Newton's method starts again from there (Facchinei and Pang, Finite-Dimensional Variational
Inequalities and Complementarity Problems, 2003, chapters 8 and 12).

Where several connectors stick, the friction of each can be undetermined. A term EPSILON m (phi -
phi_0) is added to s^, m the mobility of the connector's bodies in translation: with phi_0 = 0 it
selects the friction of least norm that the discs admit; then phi_0 is the solution itself, so that
nothing of the term remains (proximal point method). Stops are without it: they take what they can.
"""

import math
from typing import Final, NamedTuple

from cylconn_ros.core import model
from cylconn_ros.core.dense import solve_general
from cylconn_ros.core.friction import Array, coefficient, contact, limit
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.small_matrices import eigen2

EPSILON: Final = 1e-7
SOLVED: Final = 1e-14  # residual that cannot be improved
ACCEPTED: Final = 1e-10  # residual of a solution
_FULL_STEPS: Final = 8
_DAMPED_STEPS: Final = 12
_HALVINGS: Final = 8
_SWEEPS: Final = 8
_LAST_SWEEPS: Final = 100
_WAYS: Final = 5
_DECREASE: Final = 0.03  # of the proximal term
_MOST_ENUMERATED: Final = 4  # connectors whose regimes are enumerated
_DIFFERENCE: Final = 1e-6  # relative, for the slopes of a limit that is not constant
_AT_REST: Final = 1e-12  # excess over the limit that is still stick, relative


class GroupProblem(NamedTuple):
    """The problem of N connectors and its state; arrays are the caller's."""

    count: int  # N
    par: Array  # (N, size) parameters of each
    on: Array  # (N,) whether friction is on
    s: Array  # (2 N, 2 N)
    free: Array  # (2 N,)
    base: Array  # (4 N,)
    by: Array  # (4 N, 2 N)
    low: Array  # (2 N,) bounds of s+, infinite: none
    high: Array
    back: Array  # (2 N,)
    before: Array  # (2 N,) s-
    moves: Array  # (2 N,) 0 for a component that other connectors hold
    mobility: Array  # (N,) m
    theta: Array  # (N,) 1/2 or 1
    gain: Array  # (N,) g_c
    epsilon: Array  # (1,) factor of the proximal term
    sharp: Array  # (1,) not 0: its mobility takes the place of g_c
    phi: Array  # (2 N,) the solution
    p: Array  # (2 N,)
    anchor: Array  # (2 N,) phi_0
    end: Array  # (2 N,) s+
    size: Array  # (2 N,) sum of the absolute values of the terms of s+
    away: Array  # (2 N,) the point that is projected on the disc
    radius: Array  # (N,)
    fixed: Array  # (N,) the radii, where they do not follow the reactions
    forced: Array  # (N,) not 0: sticks whatever its limit
    residual: Array  # (4 N,) H of phi, of p
    index: Array  # (4 N,) unknowns: j for phi_j, 2 N + j for p_j
    matrix: Array  # (4 N, 4 N + 1)
    tried: Array  # (4 N,) the unknowns before a Newton step
    start: Array  # (4 N,) the same before Newton's method
    slope: Array  # (2 N,) of a limit


@inline_function
def _shift(g: GroupProblem, j: int) -> float:
    """s^ - s+ of component j, without the proximal term."""
    return float(g.back[j] + (1.0 / g.theta[j // 2] - 1.0) * g.before[j])


@device_function
def _evaluate(g: GroupProblem, follow: bool) -> float:
    """Update s+, the radii (``follow``; else the fixed ones) and H; returns the relative |H|."""
    n = 2 * g.count
    for j in range(n):
        total, size = g.free[j], abs(g.free[j])
        for k in range(n):
            term = g.s[j, k] * (g.phi[k] + g.p[k])
            total += term
            size += abs(term)
        g.end[j], g.size[j] = total, size
    worst = 0.0
    for c in range(g.count):
        for j in (2 * c, 2 * c + 1):
            g.residual[n + j] = 0.0
            if g.moves[j] != 0.0 and (g.low[j] > -math.inf or g.high[j] < math.inf):
                worst = max(worst, _bound_residual(g, j))
        if g.on[c] != 0.0:
            worst = max(worst, _disc_residual(g, c, follow))
    return worst


@inline_function
def _bound_residual(g: GroupProblem, j: int) -> float:
    n, gain = 2 * g.count, g.s[j, j]
    p, rate = g.p[j], g.end[j]
    taken = max(0.0, p - (rate - g.low[j]) / gain) + min(0.0, p - (rate - g.high[j]) / gain)
    g.residual[n + j] = p - taken
    size = g.size[j]
    if taken > 0.0 or p > 0.0:
        size += abs(g.low[j])
    elif taken < 0.0 or p < 0.0:
        size += abs(g.high[j])
    return abs(p - taken) * gain / size if size > 0.0 else 0.0


@inline_function
def _disc_residual(g: GroupProblem, c: int, follow: bool) -> float:
    i, j = 2 * c, 2 * c + 1
    m = g.epsilon[0] * g.mobility[c]
    gain = m if g.sharp[0] != 0.0 else g.gain[c]
    x, y = g.end[i] + _shift(g, i), g.end[j] + _shift(g, j)
    radius = g.fixed[c]
    if g.forced[c] != 0.0:
        radius = math.inf
    elif follow:
        law = model.law(g.par[c])
        rate = g.theta[c] * math.sqrt(x * x + y * y)
        radius = limit(law, g.par[c], rate, contact(law, _reaction(g, c)).normal)
    g.radius[c] = radius
    a = g.phi[i] - (x + m * (g.phi[i] - g.anchor[i])) / gain
    b = g.phi[j] - (y + m * (g.phi[j] - g.anchor[j])) / gain
    if g.moves[i] == 0.0:
        a = 0.0
    if g.moves[j] == 0.0:
        b = 0.0
    g.away[i], g.away[j] = a, b
    out = math.sqrt(a * a + b * b)
    share = 1.0 if out <= radius else radius / out
    g.residual[i], g.residual[j] = g.phi[i] - share * a, g.phi[j] - share * b
    size = (g.size[i] + g.size[j]) / g.gain[c] + (radius if radius < math.inf else 0.0)
    off = math.sqrt(g.residual[i] ** 2 + g.residual[j] ** 2)
    return off / size if size > 0.0 else 0.0


@inline_function
def _reaction(g: GroupProblem, c: int) -> tuple[float, float, float, float]:
    """The constraint reactions (f2, f3, m2, m3) of connector c."""
    n, r = 2 * g.count, 4 * c
    f2, f3, m2, m3 = g.base[r], g.base[r + 1], g.base[r + 2], g.base[r + 3]
    for k in range(n):
        u = g.phi[k] + g.p[k]
        f2 += g.by[r, k] * u
        f3 += g.by[r + 1, k] * u
        m2 += g.by[r + 2, k] * u
        m3 += g.by[r + 3, k] * u
    return (f2, f3, m2, m3)


@device_function
def _limit_slope(g: GroupProblem, c: int) -> None:
    """Write the slope of the limit of connector c over all components to ``slope``."""
    n, i, j, r = 2 * g.count, 2 * c, 2 * c + 1, 4 * c
    par = g.par[c]
    law = model.law(par)
    f2, f3, m2, m3 = _reaction(g, c)
    pressed = contact(law, (f2, f3, m2, m3))
    x, y = g.end[i] + _shift(g, i), g.end[j] + _shift(g, j)
    total = math.sqrt(x * x + y * y)
    rate = g.theta[c] * total
    radius = limit(law, par, rate, pressed.normal)
    over_normal = coefficient(law, par, rate, pressed.normal)
    over_rate = 0.0
    if law.force_slope > 0.0 and pressed.normal > 0.0:
        d = _DIFFERENCE * pressed.normal
        over_normal = (limit(law, par, rate, pressed.normal + d) - radius) / d
    if law.rate_slope > 0.0 and rate > 0.0:
        d = _DIFFERENCE * rate
        over_rate = (limit(law, par, rate + d, pressed.normal) - radius) / d
    if radius >= law.cap:
        over_normal = over_rate = 0.0
    if pressed.radial + pressed.bending + law.preload < 0.0:
        over_normal = -over_normal
    radial = over_normal / pressed.radial if pressed.radial > 0.0 else 0.0
    bending = over_normal * law.bending / pressed.moment if pressed.moment > 0.0 else 0.0
    across = over_rate * g.theta[c] / total if total > 0.0 else 0.0
    for k in range(n):
        g.slope[k] = (
            radial * (f2 * g.by[r, k] + f3 * g.by[r + 1, k])
            + bending * (m2 * g.by[r + 2, k] + m3 * g.by[r + 3, k])
            + across * (x * g.s[i, k] + y * g.s[j, k])
        )


@device_function
def _index(g: GroupProblem) -> int:
    """List the unknowns; returns their number."""
    n, count = 2 * g.count, 0
    for j in range(n):
        if g.on[j // 2] != 0.0 and g.moves[j] != 0.0:
            g.index[count] = j
            count += 1
    for j in range(n):
        if g.moves[j] != 0.0 and (g.low[j] > -math.inf or g.high[j] < math.inf):
            g.index[count] = n + j
            count += 1
    return count


@device_function
def _linearise(g: GroupProblem, unknowns: int, follow: bool) -> None:
    """Write the generalised Jacobian of H and -H to ``matrix``."""
    n = 2 * g.count
    row = 0
    while row < unknowns:
        j = int(g.index[row])
        if j >= n:
            _linearise_bound(g, row, j - n, unknowns)
            row += 1
            continue
        both = g.moves[2 * (j // 2)] != 0.0 and g.moves[2 * (j // 2) + 1] != 0.0
        _linearise_disc(g, row, j // 2, both, unknowns, follow)
        row += 2 if both else 1


@inline_function
def _linearise_bound(g: GroupProblem, row: int, j: int, unknowns: int) -> None:
    n, gain, p = 2 * g.count, g.s[j, j], g.p[j]
    taken = p - (g.end[j] - g.low[j]) / gain > 0.0 or p - (g.end[j] - g.high[j]) / gain < 0.0
    for column in range(unknowns):
        k = int(g.index[column])
        if taken:
            g.matrix[row, column] = g.s[j, k % n] / gain
        else:
            g.matrix[row, column] = 1.0 if k == n + j else 0.0
    g.matrix[row, unknowns] = -g.residual[n + j]


@device_function
def _linearise_disc(
    g: GroupProblem, row: int, c: int, both: bool, unknowns: int, follow: bool
) -> None:
    n, i, j = 2 * g.count, 2 * c, 2 * c + 1
    m = g.epsilon[0] * g.mobility[c]
    gain = m if g.sharp[0] != 0.0 else g.gain[c]
    a, b = g.away[i], g.away[j]
    out = math.sqrt(a * a + b * b)
    slips = out > g.radius[c]
    share, d11, d12, d22, n1, n2 = 1.0, 1.0, 0.0, 1.0, 0.0, 0.0
    if slips:
        share, n1, n2 = g.radius[c] / out, a / out, b / out
        d11, d12, d22 = share * n2 * n2, -share * n1 * n2, share * n1 * n1
        if follow:
            _limit_slope(g, c)
    first = g.moves[i] != 0.0
    second_row = row + 1 if first else row
    for column in range(unknowns):
        k = int(g.index[column])
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
        if first:
            g.matrix[row, column] = e1 - d11 * q1 - d12 * q2 - n1 * grown
        if both or not first:
            g.matrix[second_row, column] = e2 - d12 * q1 - d22 * q2 - n2 * grown
    if first:
        g.matrix[row, unknowns] = -g.residual[i]
    if both or not first:
        g.matrix[second_row, unknowns] = -g.residual[j]


@inline_function
def _store(g: GroupProblem, to: Array) -> None:
    """Copy the unknowns to ``to`` (4 N,)."""
    n = 2 * g.count
    for j in range(n):
        to[j], to[n + j] = g.phi[j], g.p[j]


@inline_function
def _restore(g: GroupProblem, source: Array) -> None:
    """Copy the unknowns from ``source`` (4 N,)."""
    n = 2 * g.count
    for j in range(n):
        g.phi[j], g.p[j] = source[j], source[n + j]


@inline_function
def _move(g: GroupProblem, unknowns: int, length: float) -> None:
    """Go ``length`` times the Newton step from the point ``tried``."""
    n = 2 * g.count
    for row in range(unknowns):
        k = int(g.index[row])
        value = g.tried[k] + length * g.matrix[row, unknowns]
        if k < n:
            g.phi[k] = value
        else:
            g.p[k - n] = value


@device_function
def _full_steps(g: GroupProblem, unknowns: int, follow: bool) -> tuple[float, int]:
    found = _evaluate(g, follow)
    steps = 0
    while steps < _FULL_STEPS and found > SOLVED:
        _linearise(g, unknowns, follow)
        solve_general(g.matrix, unknowns, 1)
        _store(g, g.tried)
        _move(g, unknowns, 1.0)
        steps += 1
        last, found = found, _evaluate(g, follow)
        if last < ACCEPTED and not found < 0.5 * last:  # rounding
            if last < found:
                _restore(g, g.tried)
                found = _evaluate(g, follow)
            break
    return found, steps


@device_function
def _sweep(g: GroupProblem) -> None:
    """Solve for the forces of one connector after the other, with the radii as they are."""
    n = 2 * g.count
    for c in range(g.count):
        for j in (2 * c, 2 * c + 1):
            if g.moves[j] != 0.0 and (g.low[j] > -math.inf or g.high[j] < math.inf):
                rate, gain, p = _rate(g, j), g.s[j, j], g.p[j]
                g.p[j] = max(0.0, p - (rate - g.low[j]) / gain)
                g.p[j] += min(0.0, p - (rate - g.high[j]) / gain)
        if g.on[c] != 0.0:
            i, j = 2 * c, 2 * c + 1
            x, y = _rate(g, i) + _shift(g, i), _rate(g, j) + _shift(g, j)
            s11, s12, s22 = g.s[i, i], g.s[i, j], g.s[j, j]
            x -= s11 * g.phi[i] + s12 * g.phi[j]
            y -= s12 * g.phi[i] + s22 * g.phi[j]
            if g.moves[i] == 0.0:
                x = 0.0
            if g.moves[j] == 0.0:
                y = 0.0
            g.phi[i], g.phi[j] = least_on_disc(s11, s12, s22, x, y, g.radius[c])


@inline_function
def _rate(g: GroupProblem, j: int) -> float:
    """s+ of component j."""
    total = g.free[j]
    for k in range(2 * g.count):
        total += g.s[j, k] * (g.phi[k] + g.p[k])
    return float(total)


@device_function
def least_on_disc(
    s11: float, s12: float, s22: float, x: float, y: float, radius: float
) -> tuple[float, float]:
    """The phi, |phi| <= radius, that minimises phi.S phi/2 + (x, y).phi; least norm if S = 0.

    At the edge (S + r I) phi = -(x, y), and Newton's method on 1/|phi(r)| = 1/radius rises to r
    (More and Sorensen, SIAM J. Sci. Stat. Comput. 1983).
    """
    greater, lesser, cos, sin = eigen2(s11, s12, s22)
    a, b = cos * x + sin * y, cos * y - sin * x
    least = 1e-12 * greater
    l1, l2 = max(greater, 1e-300), max(lesser, least)
    p, q = -a / l1, -b / l2 if b != 0.0 else 0.0
    size = math.sqrt(p * p + q * q)
    if size > radius:
        if radius <= 0.0:
            return 0.0, 0.0
        r = 0.0
        for _ in range(20):
            curve = (p * p / (l1 + r) + q * q / (l2 + r)) / (size * size)
            step = (size - radius) / (radius * curve)
            r += step
            p, q = -a / (l1 + r), -b / (l2 + r)
            size = math.sqrt(p * p + q * q)
            if abs(size - radius) <= 1e-12 * radius:
                break
    return cos * p - sin * q, sin * p + cos * q


@device_function
def _damped_steps(g: GroupProblem, unknowns: int, follow: bool) -> tuple[float, int]:
    """Newton steps of lengths that decrease the residual; it, and their number."""
    found, steps = _evaluate(g, follow), 0
    while steps < _DAMPED_STEPS and found > SOLVED:
        _linearise(g, unknowns, follow)
        solve_general(g.matrix, unknowns, 1)
        _store(g, g.tried)
        steps += 1
        length, best = 1.0, math.inf
        for _ in range(_HALVINGS):
            _move(g, unknowns, length)
            best = _evaluate(g, follow)
            if best < found * (1.0 - 0.1 * length) or best <= SOLVED:
                break
            length *= 0.5
        if not best < found * 0.9999:  # no progress
            if best >= found:
                _restore(g, g.tried)
                found = _evaluate(g, follow)
            break
        found = best
    return found, steps


@device_function
def _newton(g: GroupProblem, unknowns: int) -> tuple[float, int]:
    """Newton's method from phi, p, and other ways where it does not converge.

    Returns the residual and the number of steps and sweeps.
    """
    _store(g, g.start)
    found, steps = _full_steps(g, unknowns, True)
    for attempt in range(_WAYS):
        if found <= ACCEPTED:
            break
        _restore(g, g.start)
        taken = 0
        if attempt == 0:
            found, taken = _sharp_steps(g, unknowns)
        elif attempt == 1:
            found, taken = _damped_steps(g, unknowns, True)
        elif attempt == 2:
            found, taken = _enumerated(g, unknowns)
        elif attempt == 3:
            found, taken = _with_decreasing_term(g, unknowns)
        else:
            for _ in range(_SWEEPS):
                _evaluate(g, True)
                _sweep(g)
            _store(g, g.start)
            found, taken = _damped_steps(g, unknowns, True)
            if found > ACCEPTED:
                _restore(g, g.start)
                found, more = _sharp_steps(g, unknowns)
                taken += more
            if found > ACCEPTED:
                _restore(g, g.start)
                _, more = _with_decreasing_term(g, unknowns)
                found, last = _damped_steps(g, unknowns, True)
                taken += more + last
            taken += _SWEEPS
        steps += taken
    return found, steps


@device_function
def _sharp_steps(g: GroupProblem, unknowns: int) -> tuple[float, int]:
    """Newton steps that tell stick from slip on the scale of the proximal term, then others."""
    g.sharp[0] = 1.0
    _, steps = _full_steps(g, unknowns, True)
    g.sharp[0] = 0.0
    found, taken = _full_steps(g, unknowns, True)
    return found, steps + taken


@device_function
def _with_decreasing_term(g: GroupProblem, unknowns: int) -> tuple[float, int]:
    """Newton's method with a proximal term that begins large: its problem is well conditioned."""
    found, steps = math.inf, 0
    g.epsilon[0] = 1.0
    while True:
        found, taken = _full_steps(g, unknowns, True)
        steps += taken
        if g.epsilon[0] <= EPSILON:
            break
        g.epsilon[0] = max(_DECREASE * g.epsilon[0], EPSILON)
    return found, steps


@device_function
def _enumerated(g: GroupProblem, unknowns: int) -> tuple[float, int]:
    """Newton's method from each choice of connectors that stick, the fewest first."""
    found, steps = math.inf, 0
    choices = 1 << min(g.count, _MOST_ENUMERATED)
    for size in range(1, g.count + 1):
        for choice in range(1, choices):
            chosen = 0
            for c in range(min(g.count, _MOST_ENUMERATED)):
                chosen += (choice >> c) & 1
            if chosen != size:
                continue
            _clear(g)
            for c in range(g.count):
                g.forced[c] = float((choice >> c) & 1) if c < _MOST_ENUMERATED else 0.0
            _, taken = _sharp_steps(g, unknowns)
            for c in range(g.count):
                g.forced[c] = 0.0
            found, last = _sharp_steps(g, unknowns)
            steps += taken + last
            if found <= ACCEPTED:
                return found, steps
    return found, steps


@inline_function
def _sticks(g: GroupProblem, c: int) -> bool:
    """Whether friction of connector c is within its disc, s+ = -back."""
    i, j = 2 * c, 2 * c + 1
    out = math.sqrt(g.away[i] ** 2 + g.away[j] ** 2)
    return out <= g.radius[c] * (1.0 + _AT_REST)


@device_function
def _clear(g: GroupProblem) -> None:
    for j in range(2 * g.count):
        g.phi[j] = g.p[j] = g.anchor[j] = 0.0


@device_function
def _from_stick(g: GroupProblem, was_stick: Array, unknowns: int) -> tuple[float, int]:
    """From the solution in which connectors that stuck stick, whatever their limits."""
    _clear(g)
    _evaluate(g, True)
    for c in range(g.count):
        g.fixed[c] = math.inf if was_stick[c] != 0.0 else g.radius[c]
    _, steps = _full_steps(g, unknowns, False)
    found, taken = _newton(g, unknowns)
    return found, steps + taken


@device_function
def _from_rest(g: GroupProblem, unknowns: int) -> tuple[float, int]:
    """From phi = 0: the solution of least normal force, as a rule."""
    _clear(g)
    found, steps = _newton(g, unknowns)
    if found > ACCEPTED:
        _clear(g)
        found, taken = _from_stick(g, g.on, unknowns)
        steps += taken
    return found, steps


@device_function
def _settle(g: GroupProblem, unknowns: int, found: float) -> tuple[float, int]:
    """Remove the proximal term."""
    steps = 0
    for _ in range(4):
        for j in range(2 * g.count):
            g.anchor[j] = g.phi[j]
        found = _evaluate(g, True)
        if found <= SOLVED:
            break
        found, taken = _newton(g, unknowns)
        steps += taken
    for j in range(2 * g.count):
        g.anchor[j] = g.phi[j]
    return _evaluate(g, True), steps


@device_function
def solve_group_friction(g: GroupProblem, was_stick: Array) -> tuple[float, int]:
    """Solve for ``phi`` and ``p``; returns the residual and the number of Newton steps.

    theta of a connector that had slipped is 1/2 at first, and 1 if its slip turns too far.
    """
    unknowns = _index(g)
    g.epsilon[0], g.sharp[0] = EPSILON, 0.0
    held = False
    for c in range(g.count):
        rest = g.before[2 * c] ** 2 + g.before[2 * c + 1] ** 2 == 0.0
        g.theta[c] = 1.0 if was_stick[c] != 0.0 or rest else 0.5
        held = held or (g.on[c] != 0.0 and was_stick[c] != 0.0)
    found, steps = math.inf, 0
    if held:
        found, steps = _from_stick(g, was_stick, unknowns)
        for c in range(g.count):
            if g.on[c] != 0.0 and was_stick[c] != 0.0 and not _sticks(g, c):
                held = False
    if not held or found > ACCEPTED:
        found, taken = _from_rest(g, unknowns)
        steps += taken
    for _ in range(g.count):
        turned = False
        for c in range(g.count):
            if g.on[c] != 0.0 and g.theta[c] < 1.0 and not _goes_on(g, c):
                g.theta[c], turned = 1.0, True
        if not turned:
            break
        found, taken = _newton(g, unknowns)
        steps += taken
        if found > ACCEPTED:
            found, taken = _from_rest(g, unknowns)
            steps += taken
    if found <= ACCEPTED:
        found, taken = _settle(g, unknowns, found)
        steps += taken
    return found, steps


@inline_function
def _goes_on(g: GroupProblem, c: int) -> bool:
    """Whether slip goes on in its direction, s-.s+ > |s-|^2 / 4."""
    if _sticks(g, c):
        return False
    i, j = 2 * c, 2 * c + 1
    x, y = g.before[i], g.before[j]
    return bool(x * (g.end[i] + g.back[i]) + y * (g.end[j] + g.back[j]) > 0.25 * (x * x + y * y))


@device_function
def limit_friction(g: GroupProblem) -> None:
    """Forces for a problem that was not solved: friction against slip within limits of no friction.

    With fixed limits the problem is convex: its forces are finite and feed no slip.
    """
    _clear(g)
    _evaluate(g, True)
    for c in range(g.count):
        g.fixed[c] = g.radius[c] if g.on[c] != 0.0 else math.inf
        g.theta[c] = 1.0
    for _ in range(_LAST_SWEEPS):
        _evaluate(g, False)
        _sweep(g)
    _evaluate(g, False)
