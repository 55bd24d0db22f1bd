"""Constraints of connectors that share bodies: what each brings, and their elimination together.

:func:`prepare` computes the quantities of a connector before wrenches act, with the functions of
the step of a single one; :func:`eliminate` the reactions of all for given forces on slide and spin,
as methods/coupled/step.py states them.
"""

import math
from typing import Final, NamedTuple

from cylconn_ros.core import layout, model
from cylconn_ros.core.delay import correction_share, rate_share
from cylconn_ros.core.free_gain import update_gain
from cylconn_ros.core.friction import Array
from cylconn_ros.core.group_problem import GroupProblem
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.kinematics import Frame, Twist, relative_twist
from cylconn_ros.core.least_norm import (
    factor_projected,
    null_space,
    project,
    solve_projected,
)
from cylconn_ros.core.relative_state import measure
from cylconn_ros.core.rigid_body import Body, Motion
from cylconn_ros.core.vectors import Quaternion, Vector, into, matrix, norm, out_of, times
from cylconn_ros.methods import impulse
from cylconn_ros.methods.coupled.contacts import NLIMITS, NSOLUTION, rounding, write_limits
from cylconn_ros.methods.dispatch import begin
from cylconn_ros.methods.free_axes.complementarity import ReducedStep
from cylconn_ros.methods.free_axes.elements import linearise_about
from cylconn_ros.methods.free_axes.step import pose_free_axes
from cylconn_ros.methods.free_axes.two_impacts import without_stops

# --- prepared (NPREPARED,): quantities of a connector before wrenches act ---
JACOBIAN_A: Final = 0  # 6 x 6, J~ of A: columns are its velocity and spin, world axes
JACOBIAN_B: Final = 36
INVERSE_A: Final = 72  # 3 x 3, inverse inertia about the mass centre, world axes, at q~
INVERSE_B: Final = 81
FREE: Final = 90  # J~ vf, 6
JACOBIAN_CHANGE: Final = 96  # 6
TARGET: Final = 102  # 4
MEASURED: Final = 106  # v1, w1 of the sample, 2
PUSH: Final = 108  # springs, dampers, actuation: (f1, m1) = push - E w+ + x, 2
E: Final = 110  # 2
BACK: Final = 112  # the rate that restores the position that stick holds, 2
WAS_STICK: Final = 114
TERMS: Final = 115  # sizes of the terms of J~ vf, slide and spin, 2
LIMITS: Final = 117  # 2 x NLIMITS, methods/coupled/contacts.py
SOLUTION: Final = LIMITS + 2 * NLIMITS  # NSOLUTION, the group's
ABOUT: Final = SOLUTION + NSOLUTION  # rates about which tables and compliant stops are linearised
NPREPARED: Final = ABOUT + 2

# --- constants of a connector in its group (NCONSTANTS,) ---
PLACE_A: Final = 0  # number of the body among the free ones of the group; -1: none
PLACE_B: Final = 1
ARM: Final = 2  # m, that relates moments to forces
RADIUS: Final = 3  # m, the same for slide and spin
NCONSTANTS: Final = 4

MOVABLE: Final = 1e-9  # relative mobility of a component; below it the other connectors hold it

_ZERO: Final = (0.0, 0.0, 0.0)
_IDENTITY: Final = (0.0, 0.0, 0.0, 1.0)


class Arrays(NamedTuple):
    """Parts of the working memory of a step; N connectors, q = 4 N, n = 2 N."""

    scratch: Array  # (NMEM,) memory of a trial
    kept: Array  # (SIZE,) numbers of a friction law
    prepared: Array  # (N, NPREPARED)
    moved: Array  # (N, 72) J~ M^-1 of A, of B
    g: Array  # (6 N, 6 N) Delassus operator
    like: Array  # (q, q) J J^T of the constrained rows for bodies of equal mass
    k: Array  # (q, q) constrained rows of G, scaled, factored
    z: Array  # (q, q) null space in rows
    order: Array  # (q,)
    scale: Array  # (q,)
    x: Array  # (n + 1, q) solutions for phi, and the constant one in the last row
    a: Array  # (n, n) h A
    slip: Array  # (n,)
    system: Array  # (n, 2 n + 1)
    forces: Array  # (n,) f1, m1 of all
    was_stick: Array  # (N,)
    rank: Array  # (1,) of the constraints


@inline_function
def _unit(k: int) -> Vector:
    """The unit vector k of three; zero for another number."""
    return (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)


@inline_function
def _write_jacobians(f: Frame, prepared: Array) -> None:
    still = Motion(_ZERO, _IDENTITY, _ZERO, _ZERO)
    for k in range(6):
        unit = Motion(_ZERO, _IDENTITY, _unit(k), _unit(k - 3))
        a, b = relative_twist(f, unit, still), relative_twist(f, still, unit)
        for i in range(3):
            prepared[JACOBIAN_A + 6 * i + k], prepared[JACOBIAN_A + 6 * (i + 3) + k] = (
                a.v[i],
                a.w[i],
            )
            prepared[JACOBIAN_B + 6 * i + k], prepared[JACOBIAN_B + 6 * (i + 3) + k] = (
                b.v[i],
                b.w[i],
            )


@inline_function
def _write_inverse(body: Body, q: Quaternion, prepared: Array, at: int) -> None:
    axes = matrix(q)
    for k in range(3):
        column = out_of(axes, times(body.inverse_inertia, into(axes, _unit(k))))
        for i in range(3):
            prepared[at + 3 * i + k] = column[i] if body.free else 0.0


@inline_function
def _put_twist(a: Array, at: int, twist: Twist) -> None:
    model.write_vector(a, at, twist.v)
    model.write_vector(a, at + 3, twist.w)


@device_function
def prepare(par: Array, mem: Array, sample: Array, h: float, out: Array, prepared: Array) -> int:
    """Write ``prepared`` (NPREPARED,) for a sample; returns the status of a step.

    ``mem`` is updated as by a step, so that the caller passes a copy; ``out`` is scratch space.
    """
    status = begin(par, mem, sample, h, out)
    if status != layout.OK:
        return status
    o = measure(par, mem, sample, h, out)
    s = impulse.prepare_step(par, mem, sample, o, h, False)
    _write_jacobians(s.acting, prepared)
    _write_inverse(o.body_a, s.a.middle.orientation, prepared, INVERSE_A)
    _write_inverse(o.body_b, s.b.middle.orientation, prepared, INVERSE_B)
    _put_twist(prepared, FREE, s.free)
    _put_twist(prepared, JACOBIAN_CHANGE, s.jacobian_change)
    turns = (norm(s.a.end.spin), norm(s.b.end.spin))
    arms = norm(s.acting.arm_a) * turns[0] + norm(s.acting.arm_b) * turns[1]
    prepared[TERMS] = norm(s.a.end.velocity) + norm(s.b.end.velocity) + arms
    prepared[TERMS + 1] = turns[0] + turns[1]
    for k in range(4):
        prepared[TARGET + k] = s.target[k]
    update_gain(par, mem, o.twist.v[0], o.twist.w[0], h)
    linearise_about(mem, (o.twist.v[0], o.twist.w[0]), 1.0)
    q = pose_free_axes(par, mem, o, s.reduced, h)
    write_limits(
        par, prepared[LIMITS:], o, h, q.closed,
        without_stops(q.b1), 0, without_stops(q.b2), 0,
    )  # fmt: skip
    was_stick = mem[model.WAS_STICK] != 0.0
    keep = rate_share(par, mem, model.output(par).semi_implicit)
    share = correction_share(par, mem)
    for k in range(2):
        x, w = (o.length, o.twist.v[0]) if k == 0 else (o.angle, o.twist.w[0])
        prepared[MEASURED + k] = prepared[ABOUT + k] = w
        prepared[PUSH + k], prepared[E + k] = q.sp.push[k], q.sp.e[k]
        held = x if mem[model.STICK_SAMPLES] == 1.0 else mem[model.STICK_LENGTH + k]
        back = share * (x - held) / h + keep * w if was_stick else 0.0
        prepared[BACK + k] = back if abs(back) > rounding(o, k) / h else 0.0
    prepared[WAS_STICK] = 1.0 if was_stick else 0.0
    return layout.OK


@inline_function
def write_moved(par: Array, constants: Array, prepared: Array, moved: Array) -> None:
    """J~ M^-1 of both bodies; zero for a body that is not free."""
    for side in range(2):
        body = model.BODY_A if side == 0 else model.BODY_B
        free = constants[PLACE_A + side] >= 0.0
        inverse_mass = par[body + 2] if free else 0.0
        rates, tensor = JACOBIAN_A + 36 * side, INVERSE_A + 9 * side
        for i in range(6):
            for k in range(3):
                moved[36 * side + 6 * i + k] = prepared[rates + 6 * i + k] * inverse_mass
                total = 0.0
                for m in range(3):
                    total += prepared[rates + 6 * i + 3 + m] * prepared[tensor + 3 * m + k]
                moved[36 * side + 6 * i + 3 + k] = total if free else 0.0


@device_function
def write_delassus(a: Arrays, count: int, par: Array, constants: Array) -> None:
    """G of all, and J J^T of the constrained rows for bodies of unit mass and gyration."""
    for c in range(count):
        for d in range(c + 1):
            for i in range(6):
                for j in range(6):
                    a.g[6 * c + i, 6 * d + j] = 0.0
            for i in range(4):
                for j in range(4):
                    a.like[4 * c + i, 4 * d + j] = 0.0
            for side in range(2):
                for other in range(2):
                    same = constants[c, PLACE_A + side] == constants[d, PLACE_A + other]
                    if same and constants[c, PLACE_A + side] >= 0.0:
                        _add_shared(a, par[c], c, d, side, other)
            for i in range(6):
                for j in range(6):
                    a.g[6 * d + j, 6 * c + i] = a.g[6 * c + i, 6 * d + j]
            for i in range(4):
                for j in range(4):
                    a.like[4 * d + j, 4 * c + i] = a.like[4 * c + i, 4 * d + j]


@inline_function
def _add_shared(a: Arrays, par: Array, c: int, d: int, side: int, other: int) -> None:
    """Add the part of one shared body to the blocks of connectors c and d."""
    moved, rates = 36 * side, JACOBIAN_A + 36 * other
    own = JACOBIAN_A + 36 * side
    tensor, mass = INVERSE_A + 9 * side, model.BODY_A + 1 if side == 0 else model.BODY_B + 1
    trace = a.prepared[c, tensor] + a.prepared[c, tensor + 4] + a.prepared[c, tensor + 8]
    turning = par[mass] * trace / 3.0  # 1 / gyration^2
    for i in range(6):
        for j in range(6):
            total = 0.0
            for k in range(6):
                total += a.moved[c, moved + 6 * i + k] * a.prepared[d, rates + 6 * j + k]
            a.g[6 * c + i, 6 * d + j] += total
    for i in range(4):
        for j in range(4):
            at, to = own + 6 * _row(i), rates + 6 * _row(j)
            total = 0.0
            for k in range(6):
                weight = 1.0 if k < 3 else turning
                total += weight * a.prepared[c, at + k] * a.prepared[d, to + k]
            a.like[4 * c + i, 4 * d + j] += total


@inline_function
def _row(i: int) -> int:
    """The component of a relative twist that the constrained row i of four is."""
    return i + 1 if i < 2 else i + 2


@device_function
def eliminate(a: Arrays, count: int, constants: Array, h: float) -> float:
    """Eliminate the constraints of all; returns the rate by which they contradict each other."""
    n, q = 2 * count, 4 * count
    for i in range(q):
        gi, arm_i = 6 * (i // 4) + _row(i % 4), constants[i // 4, ARM] if i % 4 > 1 else 1.0
        for j in range(q):
            arm_j = constants[j // 4, ARM] if j % 4 > 1 else 1.0
            a.like[i, j] *= arm_i * arm_j
            a.k[i, j] = arm_i * arm_j * a.g[gi, 6 * (j // 4) + _row(j % 4)]
        for j in range(n):
            a.x[j, i] = -arm_i * a.g[gi, 6 * (j // 2) + 3 * (j % 2)]
        c = i // 4
        rate = a.prepared[c, TARGET + i % 4] - a.prepared[c, FREE + _row(i % 4)]
        a.x[n, i] = arm_i * rate / h
    rank = null_space(a.like, q, a.order, a.scale, a.z)
    a.rank[0] = rank
    factor_projected(a.k, q, rank, a.order, a.z)
    off = 0.0
    for j in range(n + 1):
        off = solve_projected(a.k, q, rank, a.order, a.z, a.x[j])
        for i in range(q):
            if i % 4 > 1:
                a.x[j, i] *= constants[i // 4, ARM]
    for i in range(n):
        gi = 6 * (i // 2) + 3 * (i % 2)
        for j in range(n + 1):
            total = 0.0
            for k in range(q):
                total += a.g[gi, 6 * (k // 4) + _row(k % 4)] * a.x[j, k]
            if j < n:
                a.a[i, j] = h * (a.g[gi, 6 * (j // 2) + 3 * (j % 2)] + total)
            else:
                at = 3 * (i % 2)
                free = a.prepared[i // 2, FREE + at] + a.prepared[i // 2, JACOBIAN_CHANGE + at]
                a.slip[i] = free + h * total
    for i in range(n):
        gi = 6 * (i // 2) + 3 * (i % 2)
        if not a.a[i, i] > MOVABLE * h * a.g[gi, gi]:
            a.slip[i] = 0.0
            for j in range(n):
                a.a[i, j] = a.a[j, i] = 0.0
    return off * h


@device_function
def constraint_residual(a: Arrays, count: int, outs: Array, constants: Array, h: float) -> float:
    """Residual of the constrained rows relative to their greatest terms, within their range."""
    q, greatest = 4 * count, 0.0
    for i in range(q):
        c, row = i // 4, _row(i % 4)
        arm = constants[c, ARM] if i % 4 > 1 else 1.0
        total = a.prepared[c, FREE + row] - a.prepared[c, TARGET + i % 4]
        size = abs(a.prepared[c, FREE + row]) + abs(a.prepared[c, TARGET + i % 4])
        for d in range(count):
            for k in range(6):
                at = layout.FORCE + k if k < 3 else layout.MOMENT + k - 3
                term = h * a.g[6 * c + row, 6 * d + k] * outs[d, at]
                total += term
                size += abs(term)
        a.scale[i] = total * arm
        greatest = max(greatest, size * arm)
    project(a.z, q - int(a.rank[0]), q, a.scale)
    worst = 0.0
    for i in range(q):
        worst = max(worst, abs(a.scale[i]))
    return worst / greatest if greatest > 0.0 else 0.0


@device_function
def change(a: Arrays, g: GroupProblem, outs: Array, constants: Array) -> float:
    """How much the completed steps differ from the solution of the group, relative.

    Relative to the greatest force, and to one that changes a rate by its own terms.
    """
    worst, greatest = 0.0, 0.0
    for j in range(2 * g.number):
        c, k = j // 2, j % 2
        r = constants[c, RADIUS] if k == 1 else 1.0
        f = outs[c, layout.FORCE if k == 0 else layout.MOMENT] / r
        arm = constants[c, ARM]
        normal = math.sqrt(
            outs[c, layout.FORCE + 1] ** 2
            + outs[c, layout.FORCE + 2] ** 2
            + (outs[c, layout.MOMENT + 1] ** 2 + outs[c, layout.MOMENT + 2] ** 2) / (arm * arm)
        )
        greatest = max(greatest, abs(f), normal, g.size[j] / g.gain[c])
        if a.a[j, j] > 0.0:
            worst = max(worst, abs(f - a.forces[j] / r))
    return worst / greatest if greatest > 0.0 else 0.0


@inline_function
def reduced_step(a: Arrays, c: int, count: int, h: float) -> ReducedStep:
    """The step of connector c with the forces on slide and spin of the others known."""
    n, i, j = 2 * count, 2 * c, 2 * c + 1
    b0, b1, b2, b3 = a.x[n, 4 * c], a.x[n, 4 * c + 1], a.x[n, 4 * c + 2], a.x[n, 4 * c + 3]
    free1, free2 = a.slip[i], a.slip[j]
    for k in range(n):
        if k // 2 != c:
            f = a.forces[k]
            b0 += a.x[k, 4 * c] * f
            b1 += a.x[k, 4 * c + 1] * f
            b2 += a.x[k, 4 * c + 2] * f
            b3 += a.x[k, 4 * c + 3] * f
            free1 += a.a[i, k] * f
            free2 += a.a[j, k] * f
    a11, a22 = a.a[i, i], a.a[j, j]
    if a11 == 0.0:  # held by the others: any mobility gives no force
        a11 = h * a.g[6 * c, 6 * c]
    if a22 == 0.0:
        a22 = h * a.g[6 * c + 3, 6 * c + 3]
    return ReducedStep(
        (b0, b1, b2, b3),
        (a.x[i, 4 * c], a.x[i, 4 * c + 1], a.x[i, 4 * c + 2], a.x[i, 4 * c + 3]),
        (a.x[j, 4 * c], a.x[j, 4 * c + 1], a.x[j, 4 * c + 2], a.x[j, 4 * c + 3]),
        (free1, free2),
        (a11, a.a[i, j], a22),
    )
