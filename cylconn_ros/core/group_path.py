"""Solution of the friction problem of a group along a path (core/group_problem.py).

With the limits multiplied by a share lambda, the solutions (u, lambda), u = (phi, p), form a path
that begins at lambda = 0 without friction. With S > 0 solutions are bounded, since friction takes
energy: phi.S phi <= -phi.free. The path then reaches lambda = 1; where friction has several
solutions, lambda decreases on parts of it. Its first point with lambda = 1 is the solution that
belongs to no friction.

The path consists of smooth pieces on which each connector either sticks or slips. It is followed by
its arc length, with predictor and corrector, to the end of a piece, where one connector changes
over. The sign of the determinant of (dH/d(u, lambda), tangent) is the same on all pieces and tells
the direction (Allgower and Georg, Numerical Continuation Methods, 1990, chapters 2, 6 and 12).
"""

import math
from typing import Final

from cylconn_ros.core.dense import solve_general
from cylconn_ros.core.group_newton import ACCEPTED, full_steps
from cylconn_ros.core.group_problem import GroupProblem, evaluate, is_within, linearise
from cylconn_ros.core.jit import device_function, inline_function

_POINTS: Final = 300  # on a path
_FIRST: Final = 0.25  # length of a step; the limits without friction are 1
_LEAST: Final = 1e-9
_CORRECTIONS: Final = 6
_NEARBY: Final = 0.3  # greatest correction, of the length of a step
_ON_PATH: Final = 1e-10  # residual
_LOCATED: Final = 1e-10  # accuracy of the end of a piece, relative to the limit
_NEAR_END: Final = 1e-2  # of lambda, from where Newton's method alone reaches the end
_SECANTS: Final = 40


@inline_function
def _distance(g: GroupProblem, c: int) -> float:
    """Distance of the point that is projected on the disc of c from its centre."""
    return math.sqrt(g.away[2 * c] ** 2 + g.away[2 * c + 1] ** 2)


@inline_function
def _unknown(g: GroupProblem, row: int) -> float:
    n, k = 2 * g.number, int(g.listed[row])
    return float(g.phi[k] if k < n else g.p[k - n])


@inline_function
def _set_unknown(g: GroupProblem, row: int, value: float) -> None:
    n, k = 2 * g.number, int(g.listed[row])
    if k < n:
        g.phi[k] = value
    else:
        g.p[k - n] = value


@inline_function
def _passed(g: GroupProblem) -> tuple[float, int]:
    """How far the piece's end is passed, > 0 if it is; and the connector that changes over.

    -1: the end of the path.
    """
    worst, which = g.share[0] - 1.0, -1
    for c in range(g.number):
        if g.on[c] != 0.0:
            out, radius = _distance(g, c), g.radius[c]
            size = out + radius
            off = g.forced[c] * (out - radius) / size if size > 0.0 else 0.0
            if off > worst:
                worst, which = off, c
    return worst, which


@device_function
def _linearise(g: GroupProblem, unknowns: int, scale: float, corrects: bool) -> int:
    """Solve for the step to the path across the tangent, or for the next tangent.

    Returns the sign of the determinant; the solution is the last column of ``matrix``.
    """
    n = 2 * g.number
    linearise(g, unknowns, True)
    for row in range(unknowns):
        j, by = int(g.listed[row]), 0.0
        if j < n:
            out = _distance(g, j // 2)
            if not is_within(g, j // 2, out):
                by = -g.limits[j // 2] * g.away[j] / out
        g.matrix[row, unknowns + 1] = g.matrix[row, unknowns] if corrects else 0.0
        g.matrix[row, unknowns] = by
    for column in range(unknowns):
        g.matrix[unknowns, column] = g.tangent[column] / (scale * scale)
    g.matrix[unknowns, unknowns] = g.tangent[unknowns]
    g.matrix[unknowns, unknowns + 1] = 0.0 if corrects else 1.0
    return solve_general(g.matrix, unknowns + 1, 1)


@device_function
def _turn(g: GroupProblem, unknowns: int, scale: float, direction: int) -> int:
    """Update the tangent; returns the sign that all tangents have, 0 if there is none."""
    sign = _linearise(g, unknowns, scale, False)
    if sign == 0:
        return 0
    size = g.matrix[unknowns, unknowns + 1] ** 2
    for row in range(unknowns):
        size += (g.matrix[row, unknowns + 1] / scale) ** 2
    factor = 1.0 / math.sqrt(size)
    if direction != 0 and sign != direction:
        factor = -factor
    for row in range(unknowns + 1):
        g.tangent[row] = factor * g.matrix[row, unknowns + 1]
    return direction if direction != 0 else sign


@device_function
def _advance(g: GroupProblem, unknowns: int, scale: float, length: float) -> tuple[bool, int]:
    """Go to the point of the path ``length`` along the tangent from ``origin``.

    Returns whether there is one nearby, and the number of Newton steps.
    """
    for row in range(unknowns):
        _set_unknown(g, row, g.origin[row] + length * g.tangent[row])
    g.share[0] = g.origin[unknowns] + length * g.tangent[unknowns]
    found, steps = evaluate(g, True), 0
    while found > _ON_PATH and steps < _CORRECTIONS:
        if _linearise(g, unknowns, scale, True) == 0:
            return False, steps + 1
        steps += 1
        size = g.matrix[unknowns, unknowns + 1] ** 2
        for row in range(unknowns):
            size += (g.matrix[row, unknowns + 1] / scale) ** 2
            _set_unknown(g, row, _unknown(g, row) + g.matrix[row, unknowns + 1])
        g.share[0] += g.matrix[unknowns, unknowns + 1]
        last, found = found, evaluate(g, True)
        far = not size <= (_NEARBY * length) ** 2
        if far or (found > _ON_PATH and not found < 0.5 * last):
            return False, steps
    return found <= _ON_PATH, steps


@device_function
def _go_on(g: GroupProblem, unknowns: int, scale: float, length: float) -> tuple[float, int, int]:
    """Go on by at most ``length``, and not beyond the end of the piece.

    Returns the length of the next step (0: there is none), the connector that changes over (-1:
    the path ends, -2: none) and the number of Newton steps.
    """
    begun, _ = _passed(g)
    begun, steps = min(begun, 0.0), 0
    while length >= _LEAST:
        there, taken = _advance(g, unknowns, scale, length)
        steps += taken
        off, which = _passed(g)
        if there and off <= 0.0:
            return 2.0 * length, -2, steps
        low, high, before, after = 0.0, length, begun if begun < 0.0 else -off, off
        for k in range(_SECANTS):  # of Illinois; the origin is on the piece
            if not there or abs(off) <= (_LOCATED if which >= 0 else _NEAR_END):
                break
            at = low - before * (high - low) / (after - before)
            at = at if k % 8 != 7 else 0.5 * (low + high)
            there, taken = _advance(g, unknowns, scale, at)
            steps += taken
            off, which = _passed(g)
            if off > 0.0:
                high, after = at, off
                before *= 0.5
            else:
                low, before = at, off
                after *= 0.5
        if there:
            return length, which, steps
        length *= 0.25
    return 0.0, -2, steps


@device_function
def _scale(g: GroupProblem) -> float:
    """A force by which phi and p are compared with lambda."""
    limits, loads = 0.0, 0.0
    for c in range(g.number):
        if g.on[c] != 0.0:
            limits = max(limits, g.limits[c])
            loads = max(loads, (g.size[2 * c] + g.size[2 * c + 1]) / g.gain[c])
    return limits if limits > 0.0 else (loads if loads > 0.0 else 1.0)


@device_function
def follow_path(g: GroupProblem, unknowns: int) -> tuple[float, int]:
    """Solve for phi and p from no friction on; returns the residual and the Newton steps."""
    for j in range(2 * g.number):
        g.phi[j] = g.p[j] = 0.0
    g.share[0] = 0.0
    found, steps = full_steps(g, unknowns, True)
    scale, length, direction = _scale(g), _FIRST, 0
    for c in range(g.number):
        g.forced[c] = 1.0 if _distance(g, c) == 0.0 else -1.0
    for row in range(unknowns):
        g.tangent[row] = 0.0
    g.tangent[unknowns] = 1.0
    for _ in range(_POINTS if found <= ACCEPTED else 0):
        direction = _turn(g, unknowns, scale, direction)
        steps += 1
        if direction == 0:
            break
        for row in range(unknowns):
            g.origin[row] = _unknown(g, row)
        g.origin[unknowns] = g.share[0]
        length, which, taken = _go_on(g, unknowns, scale, length)
        steps += taken
        if length == 0.0 or which == -1:
            break
        if which >= 0:
            g.forced[which] = -g.forced[which]
    g.share[0] = 1.0
    _, last = full_steps(g, unknowns, True)
    for c in range(g.number):
        g.forced[c] = 0.0
    found, taken = full_steps(g, unknowns, True)
    return found, steps + last + taken
