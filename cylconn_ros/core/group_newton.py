"""Newton's method for the friction problem of a group (core/group_problem.py).

The semismooth Newton method on H = 0 with full steps, or with step lengths that decrease |H|.
"""

import math
from typing import Final

from cylconn_ros.core.dense import solve_general
from cylconn_ros.core.friction import Array
from cylconn_ros.core.group_problem import GroupProblem, evaluate, linearise
from cylconn_ros.core.jit import device_function, inline_function

SOLVED: Final = 1e-14  # residual that cannot be improved
ACCEPTED: Final = 1e-12  # residual of a solution
_FULL_STEPS: Final = 8
_DAMPED_STEPS: Final = 12
_HALVINGS: Final = 8


@inline_function
def store(g: GroupProblem, to: Array) -> None:
    """Copy the unknowns to ``to`` (4 N,)."""
    n = 2 * g.number
    for j in range(n):
        to[j], to[n + j] = g.phi[j], g.p[j]


@inline_function
def restore(g: GroupProblem, source: Array) -> None:
    """Copy the unknowns from ``source`` (4 N,)."""
    n = 2 * g.number
    for j in range(n):
        g.phi[j], g.p[j] = source[j], source[n + j]


@inline_function
def move(g: GroupProblem, unknowns: int, length: float) -> None:
    """Go ``length`` times the Newton step from the point ``tried``."""
    n = 2 * g.number
    for row in range(unknowns):
        k = int(g.listed[row])
        value = g.tried[k] + length * g.matrix[row, unknowns]
        if k < n:
            g.phi[k] = value
        else:
            g.p[k - n] = value


@device_function
def full_steps(g: GroupProblem, unknowns: int, follow: bool) -> tuple[float, int]:
    """Newton steps until the residual is rounding; it, and their number.

    ``follow``: the radii follow the reactions; else they are the fixed ones.
    """
    found = evaluate(g, follow)
    steps = 0
    while steps < _FULL_STEPS and found > SOLVED:
        linearise(g, unknowns, follow)
        solve_general(g.matrix, unknowns, 1)
        store(g, g.tried)
        move(g, unknowns, 1.0)
        steps += 1
        last, found = found, evaluate(g, follow)
        if last < ACCEPTED and not found < 0.5 * last:  # rounding
            if last < found:
                restore(g, g.tried)
                found = evaluate(g, follow)
            break
    return found, steps


@device_function
def damped_steps(g: GroupProblem, unknowns: int, follow: bool) -> tuple[float, int]:
    """Newton steps of lengths that decrease the residual; it, and their number."""
    found, steps = evaluate(g, follow), 0
    while steps < _DAMPED_STEPS and found > SOLVED:
        linearise(g, unknowns, follow)
        solve_general(g.matrix, unknowns, 1)
        store(g, g.tried)
        steps += 1
        length, best = 1.0, math.inf
        for _ in range(_HALVINGS):
            move(g, unknowns, length)
            best = evaluate(g, follow)
            if best < found * (1.0 - 0.1 * length) or best <= SOLVED:
                break
            length *= 0.5
        if not best < found * 0.9999:  # no progress
            if best >= found:
                restore(g, g.tried)
                found = evaluate(g, follow)
            break
        found = best
    return found, steps


@device_function
def sharp_steps(g: GroupProblem, unknowns: int) -> tuple[float, int]:
    """Newton steps that tell stick from slip on the scale of the proximal term, then others."""
    g.sharp[0] = 1.0
    _, steps = full_steps(g, unknowns, True)
    g.sharp[0] = 0.0
    found, taken = full_steps(g, unknowns, True)
    return found, steps + taken


@device_function
def clear(g: GroupProblem) -> None:
    """Set phi and p to zero, and where the proximal term is measured from."""
    n = 2 * g.number
    for j in range(n):
        g.phi[j] = g.p[j] = g.anchor[j] = g.anchor[n + j] = 0.0
