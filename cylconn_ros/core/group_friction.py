"""Solution of the friction problem of connectors that share bodies (core/group_problem.py).

A semismooth Newton method solves H = 0 (core/group_newton.py; Facchinei and Pang, Finite-
Dimensional Variational Inequalities and Complementarity Problems, 2003, chapters 8 and 12). Where
it does not converge, regimes are enumerated if there are few connectors, and the solutions are
followed from no friction on (core/group_path.py).

Among several solutions: from a cold start or after slip, that found from no friction, which is as a
rule the one of least normal force; connectors that stuck first try to stick. theta is 1/2 for a
connector that slipped, and 1 where its slip turns too far.
"""

import math
from typing import Final

from cylconn_ros.core.friction import Array
from cylconn_ros.core.group_newton import (
    ACCEPTED,
    SOLVED,
    clear,
    damped_steps,
    full_steps,
    restore,
    sharp_steps,
    store,
)
from cylconn_ros.core.group_path import follow_path
from cylconn_ros.core.group_problem import (
    GroupProblem,
    contradiction,
    evaluate,
    kept_share,
    list_unknowns,
    reaction_at,
    shift,
    sticks,
)
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.small_matrices import eigen2

EPSILON: Final = 1e-7
_LAST_SWEEPS: Final = 100
_WAYS: Final = 5
_MOST_ENUMERATED: Final = 3  # connectors; with more, a path takes fewer steps
_SETTLINGS: Final = 8
_DECREASE: Final = 0.03  # of the proximal term
_CONTRADICTS: Final = 1e-2  # of a rate


@device_function
def _sweep(g: GroupProblem) -> None:
    """Solve for the forces of one connector after the other, with the radii as they are."""
    for c in range(g.number):
        for j in (2 * c, 2 * c + 1):
            if g.moves[j] != 0.0 and (g.low[j] > -math.inf or g.high[j] < math.inf):
                g.p[j] = reaction_at(g, j, g.p[j], _rate(g, j))
        if g.on[c] != 0.0:
            i, j = 2 * c, 2 * c + 1
            x, y = _rate(g, i) + shift(g, i), _rate(g, j) + shift(g, j)
            s11, s12, s22 = g.s[i, i], g.s[i, j], g.s[j, j]
            x -= s11 * g.phi[i] + s12 * g.phi[j]
            y -= s12 * g.phi[i] + s22 * g.phi[j]
            if g.slips[i] == 0.0:
                x = 0.0
            if g.slips[j] == 0.0:
                y = 0.0
            g.phi[i], g.phi[j] = least_on_disc(s11, s12, s22, x, y, g.radius[c])


@inline_function
def _rate(g: GroupProblem, j: int) -> float:
    """s+ of component j."""
    total = g.free[j]
    for k in range(2 * g.number):
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
def _newton(g: GroupProblem, unknowns: int) -> tuple[float, int]:
    """Newton's method from phi, p, and other ways where it does not converge.

    Returns the least residual that is found and the number of steps.
    """
    store(g, g.start)
    found, steps = full_steps(g, unknowns, True)
    if found <= ACCEPTED:
        return found, steps
    least = math.inf
    for way in range(_WAYS):
        if found < least:
            least = found
            store(g, g.best)
        _, taken = _by_way(g, unknowns, way)
        steps += taken
        found = evaluate(g, True)
        if found <= ACCEPTED:
            return found, steps
    if least < found:
        restore(g, g.best)
        found = evaluate(g, True)
    return found, steps


@device_function
def _by_way(g: GroupProblem, unknowns: int, way: int) -> tuple[float, int]:
    restore(g, g.start)
    if way == 0:
        return sharp_steps(g, unknowns)
    if way == 1:
        return damped_steps(g, unknowns, True)
    if way == 2:
        return _enumerated(g, unknowns) if g.number <= _MOST_ENUMERATED else (math.inf, 0)
    if way == 3:
        return follow_path(g, unknowns)
    return _with_decreasing_term(g, unknowns)


@device_function
def _enumerated(g: GroupProblem, unknowns: int) -> tuple[float, int]:
    """Newton's method from each choice of connectors that stick, the fewest first."""
    found, steps = math.inf, 0
    for size in range(1, g.number + 1):
        for choice in range(1, 1 << g.number):
            chosen = 0
            for c in range(g.number):
                chosen += (choice >> c) & 1
            if chosen != size:
                continue
            for j in range(2 * g.number):
                g.phi[j] = g.p[j] = 0.0
            for c in range(g.number):
                g.forced[c] = float((choice >> c) & 1)
            _, taken = sharp_steps(g, unknowns)
            for c in range(g.number):
                g.forced[c] = 0.0
            found, last = sharp_steps(g, unknowns)
            steps += taken + last
            if found <= ACCEPTED:
                return found, steps
    return found, steps


@device_function
def _with_decreasing_term(g: GroupProblem, unknowns: int) -> tuple[float, int]:
    """Newton's method with a proximal term that begins large: its problem is well conditioned."""
    found, steps = math.inf, 0
    g.epsilon[0] = 1.0
    while True:
        found, taken = full_steps(g, unknowns, True)
        steps += taken
        if found > ACCEPTED:
            found, taken = follow_path(g, unknowns)
            steps += taken
        if g.epsilon[0] <= EPSILON:
            break
        g.epsilon[0] = max(_DECREASE * g.epsilon[0], EPSILON)
    return found, steps


@device_function
def _from_stick(g: GroupProblem, was_stick: Array, unknowns: int) -> tuple[float, int]:
    """From the solution in which connectors that stuck stick, whatever their limits."""
    clear(g)
    evaluate(g, True)
    for c in range(g.number):
        g.fixed[c] = math.inf if was_stick[c] != 0.0 else g.radius[c]
    _, steps = full_steps(g, unknowns, False)
    store(g, g.start)
    found, taken = full_steps(g, unknowns, True)
    if found > ACCEPTED:
        restore(g, g.start)
        found, last = sharp_steps(g, unknowns)
        taken += last
    return found, steps + taken


@device_function
def _from_rest(g: GroupProblem, unknowns: int) -> tuple[float, int]:
    """From phi = 0: the solution of least normal force, as a rule."""
    clear(g)
    found, steps = _newton(g, unknowns)
    if found > ACCEPTED:
        clear(g)
        found, taken = _from_stick(g, g.on, unknowns)
        steps += taken
    return found, steps


@device_function
def _settle(g: GroupProblem, unknowns: int, found: float) -> tuple[float, int]:
    """Remove the proximal term, as long as that decreases the residual.

    It does not where rounding sets rates that have to vanish together against each other.
    """
    steps = 0
    store(g, g.anchor)
    found = evaluate(g, True)
    for _ in range(_SETTLINGS):
        if found <= SOLVED:
            break
        store(g, g.settled)
        _, taken = _newton(g, unknowns)
        steps += taken
        store(g, g.anchor)
        before, found = found, evaluate(g, True)
        if not found < 0.9 * before:
            if not found <= before:
                restore(g, g.settled)
                store(g, g.anchor)
                found = evaluate(g, True)
            break
    return found, steps


@device_function
def solve_group_friction(g: GroupProblem, was_stick: Array) -> tuple[float, int]:
    """Solve for ``phi`` and ``p``; returns the residual and the number of Newton steps.

    theta of a connector that had slipped is 1/2 at first, and 1 if its slip turns too far.
    """
    unknowns = list_unknowns(g)
    g.epsilon[0], g.sharp[0] = EPSILON, 0.0
    held = False
    for c in range(g.number):
        rest = g.before[2 * c] ** 2 + g.before[2 * c + 1] ** 2 == 0.0
        g.theta[c] = 1.0 if was_stick[c] != 0.0 or rest else 0.5
        held = held or (g.on[c] != 0.0 and was_stick[c] != 0.0)
    found, steps = math.inf, 0
    if held:
        found, steps = _from_stick(g, was_stick, unknowns)
        for c in range(g.number):
            if g.on[c] != 0.0 and was_stick[c] != 0.0 and not sticks(g, c):
                held = False
    if not held or found > ACCEPTED:
        found, taken = _from_rest(g, unknowns)
        steps += taken
    for _ in range(g.number):
        turned, least = -1, 0.25
        for c in range(g.number):  # one at a time: the others may then go on
            if g.on[c] != 0.0 and g.theta[c] < 1.0:
                share = kept_share(g, c)
                if not share > least or (turned < 0 and not share > 0.25):
                    turned, least = c, share
        if turned < 0:
            break
        g.theta[turned] = 1.0
        found, taken = _newton(g, unknowns)
        steps += taken
        if found > ACCEPTED:
            found, taken = _from_rest(g, unknowns)
            steps += taken
    if found <= ACCEPTED:
        against = contradiction(g)
        if against > _CONTRADICTS:
            return against, steps
        found, taken = _settle(g, unknowns, found)
        steps += taken
    return found, steps


@device_function
def limit_friction(g: GroupProblem) -> None:
    """Forces for a problem that was not solved: friction against slip within limits of no friction.

    With fixed limits the problem is convex: its forces are finite and feed no slip.
    """
    clear(g)
    evaluate(g, True)
    for c in range(g.number):
        g.fixed[c] = g.radius[c] if g.on[c] != 0.0 else math.inf
        g.theta[c] = 1.0
    for _ in range(_LAST_SWEEPS):
        evaluate(g, False)
        _sweep(g)
    evaluate(g, False)
