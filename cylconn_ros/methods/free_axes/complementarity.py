"""Friction and the reactions of stops, locks and imposed motion on slide and spin, within one step.

Each component is free, or at one of its limits (core/joint_limits.py). The components at a limit
are eliminated and friction is solved on the rest (core/friction_disc.py). The cases are enumerated;
the case that satisfies its complementarity conditions is the solution.

Stick holds a position, not only a rate: from its second sample on, s+ is measured from the target
that restores the position within a step, as for a constraint, so that stick on moving bodies does
not creep.
"""

import math
from typing import NamedTuple

from cylconn_ros.core import layout, model
from cylconn_ros.core.delay import correction_share, feedback_gain, rate_share
from cylconn_ros.core.free_gain import free_gain, holds_position
from cylconn_ros.core.friction import Array, contact, cosine, limit
from cylconn_ros.core.friction_disc import DiscSolution, solve_alternative, solve_disc
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.joint_limits import ActiveLimits, Bounds, Two, eliminate_limits
from cylconn_ros.core.relative_state import RelativeState
from cylconn_ros.core.slip_curve import DiscProblem, make_disc_problem, reaction
from cylconn_ros.core.small_matrices import Four

ROUNDING_SHARE = 1e-15  # of the terms that cancel in a rate
# Selection among several friction solutions: by the rule of core/friction_disc.py, or another one.
BY_RULE, NEAREST_STICK, LEAST_TRACTION = 0, 1, 2


class ReducedStep(NamedTuple):
    """The step after elimination of the constrained components (Schur complement) for (f1, m1).

    (f2 f3 m2 m3) = base + by_f1 f1 + by_m1 m1;   (v1, w1)+ = free + h A (f1, m1)
    """

    base: Four
    by_f1: Four
    by_m1: Four
    free: tuple[float, float]
    a: tuple[float, float, float]  # h A: 11, 12, 22


class StepWithSprings(NamedTuple):
    """The reduced step including springs, dampers and actuation; x = phi + p is unknown.

    (f1, m1) = push - E w+ + x,    (v1, w1)+ = free + S x,    E = diag(e)
    """

    push: Two
    e: Two
    free: Two
    s: tuple[float, float, float]  # 11, 12, 22


class FreeAxesSolution(NamedTuple):
    """Friction and reactions for one case of active limits."""

    end: Two  # (v1, w1)+
    friction: Two  # f1f, m1f
    reaction: Two  # of stops, locks and imposed motion
    regime: int
    flags: int
    s_mean: Two
    residual: float


@inline_function
def reactions(r: ReducedStep, f1: float, m1: float) -> Four:
    """The constraint reactions (f2, f3, m2, m3) for (f1, m1)."""
    return (
        r.base[0] + r.by_f1[0] * f1 + r.by_m1[0] * m1,
        r.base[1] + r.by_f1[1] * f1 + r.by_m1[1] * m1,
        r.base[2] + r.by_f1[2] * f1 + r.by_m1[2] * m1,
        r.base[3] + r.by_f1[3] * f1 + r.by_m1[3] * m1,
    )


@inline_function
def free_reactions(r: ReducedStep, f1: float, m1: float) -> Four:
    """by_f1 f1 + by_m1 m1."""
    return (
        r.by_f1[0] * f1 + r.by_m1[0] * m1,
        r.by_f1[1] * f1 + r.by_m1[1] * m1,
        r.by_f1[2] * f1 + r.by_m1[2] * m1,
        r.by_f1[3] * f1 + r.by_m1[3] * m1,
    )


@inline_function
def solve_with_limits(
    par: Array,
    mem: Array,
    o: RelativeState,
    r: ReducedStep,
    sp: StepWithSprings,
    h: float,
    explicit: bool,
    b1: Bounds,
    b2: Bounds,
    free: FreeAxesSolution,
    is_free: bool,
) -> tuple[FreeAxesSolution, tuple[int, int]]:
    """The solution within the bounds: 0 <= p _|_ w+ - t >= 0 on each, by case enumeration.

    Each of the two components is free, at its lower or at its upper bound; usually the first case,
    both free, is the solution. If friction has several solutions, none of the cases may be valid
    with the one of the selection rule: then the solutions nearest to stick are tried, and then
    those of least traction. ``free``: the solution without stops; ``is_free``: it is the case in
    which both are free. Returns the solution and the side of each component.
    """
    fixed1, fixed2 = b1.low == b1.high, b2.low == b2.high
    rates = (o.twist.v[0], o.twist.w[0])
    best, best_sides, least = free, (0, 0), math.inf
    # a component that rests at a stop is tried there first: friction could hold it as well
    for choice in range(0 if b1.rest != 0 or b2.rest != 0 else 9, 36):
        side1, side2 = (0, -1, 1)[choice % 3], (0, -1, 1)[choice // 3 % 3]
        which = max(choice // 9 - 1, 0)
        if choice < 9 and not (_rests(b1, fixed1, side1) and _rests(b2, fixed2, side2)):
            continue
        offered1, side1 = _is_candidate(b1, side1)
        offered2, side2 = _is_candidate(b2, side2)
        if not (offered1 and offered2):
            continue
        found = free
        if not is_free or side1 != 0 or side2 != 0 or which != BY_RULE:
            found = solve_case(par, mem, o, rates, r, sp, h, explicit, side1, b1, side2, b2, which)
        p, q = found.reaction
        wrong = max(
            _limit_violation(b1, fixed1, side1, found.end[0], p * sp.s[0], sp.free[0]),
            _limit_violation(b2, fixed2, side2, found.end[1], q * sp.s[2], sp.free[1]),
        )
        if wrong < least:
            best, best_sides, least = found, (side1, side2), wrong
        if wrong <= 0.0:
            break
    return best, best_sides


@inline_function
def _rests(b: Bounds, fixed: bool, side: int) -> bool:
    """Whether a case keeps a component at rest where it rests; any case if it does not."""
    return b.rest == 0 or fixed or side == b.rest


@inline_function
def _is_candidate(b: Bounds, side: int) -> tuple[bool, int]:
    """Whether ``side`` is a case, and the bound that it stands for; a fixed rate has one case."""
    if b.low == b.high:
        return side == 0, -1
    none = (side < 0 and b.low == -math.inf) or (side > 0 and b.high == math.inf)
    return not none, side


@inline_function
def _limit_violation(
    b: Bounds, fixed: bool, side: int, rate: float, added: float, free: float
) -> float:
    """Violation of the complementarity condition of a case, as a rate; 0 if it is satisfied.

    added: change of the rate by the reaction; free: the rate without friction and reactions.
    """
    if fixed:
        return 0.0
    slack = 1e-13 * abs(rate) + ROUNDING_SHARE * abs(free)
    if side == 0:
        return max(b.low - rate - slack, rate - b.high - slack, 0.0)
    return max(added * side - slack, 0.0)


@device_function
def solve_case(
    par: Array,
    mem: Array,
    o: RelativeState,
    rates: Two,
    r: ReducedStep,
    sp: StepWithSprings,
    h: float,
    explicit: bool,
    side1: int,
    b1: Bounds,
    side2: int,
    b2: Bounds,
    which: int,
) -> FreeAxesSolution:
    """Friction and reactions with the components at their lower (-1) or upper (1) bound.

    rates: of slide and spin at the beginning of the step. A component that rests at its bound does
    not slip, not even by rounding: the bound holds it, and friction takes no share of its load.
    """
    t1 = b1.low if side1 < 0 else b1.high
    t2 = b2.low if side2 < 0 else b2.high
    active = eliminate_limits(sp.free, sp.s, (side1, side2), (t1, t2))
    friction, regime, flags, s_mean, residual = _friction(
        par, mem, o, rates, r, sp, active, h, explicit, which,
        (side1 != 0 and b1.rest != 0, side2 != 0 and b2.rest != 0),
    )  # fmt: skip
    f, g = friction
    end = (
        active.free[0] + active.s[0] * f + active.s[1] * g,
        active.free[1] + active.s[1] * f + active.s[2] * g,
    )
    reaction_ = (
        active.q0[0] + (active.q1[0] - 1.0) * f + active.q2[0] * g,
        active.q0[1] + active.q1[1] * f + (active.q2[1] - 1.0) * g,
    )
    return FreeAxesSolution(end, friction, reaction_, regime, flags, s_mean, residual)


@inline_function
def _solve_lowered(
    par: Array, mem: Array, o: RelativeState, d: DiscProblem, s: tuple[float, float, float],
    h: float, alpha: float,
) -> DiscSolution:  # fmt: skip
    """Friction with the gain alpha < 1 (core/free_gain.py): stick is s+ = (1 - alpha) s- ...

    It follows slip only where friction then takes energy; from stick on it also holds a position.
    """
    law, was_stick = model.law(par), mem[model.WAS_STICK] != 0.0
    s1, s2 = d.s_minus
    back1, back2 = (1.0 - alpha) * s1, (1.0 - alpha) * s2
    if not (was_stick and holds_position(mem, alpha)):
        mem[model.STICK_LENGTH], mem[model.STICK_ANGLE] = o.length, o.angle
    else:
        share = 0.25 * alpha * alpha / h
        back1 -= share * (o.length - mem[model.STICK_LENGTH])
        back2 -= share * law.radius * (o.angle - mem[model.STICK_ANGLE])
    radius = law.radius
    held = make_disc_problem(
        d.s_minus, (d.s_free[0] - back1, d.s_free[1] - back2),
        s[0], radius * s[1], radius * radius * s[2], d.base, d.c1, d.c2,
    )  # fmt: skip
    found = solve_disc(law, par, held, True)
    power = found.phi[0] * s1 + found.phi[1] * s2
    if found.regime == layout.STICK and (was_stick or power <= 0.0):
        mean = (1.0 - 0.5 * alpha) * s1, (1.0 - 0.5 * alpha) * s2
        return DiscSolution(found.phi, (back1, back2), mean, layout.STICK, found.flags)
    return solve_disc(law, par, d, False)


@inline_function
def _friction(
    par: Array,
    mem: Array,
    o: RelativeState,
    rates: Two,
    r: ReducedStep,
    sp: StepWithSprings,
    active: ActiveLimits,
    h: float,
    explicit: bool,
    which: int,
    rests: tuple[bool, bool],
) -> tuple[Two, int, int, Two, float]:
    """(f1f, m1f), regime, flags, s~ and the residual of the law."""
    law = model.law(par)
    if not law.on:
        return (0.0, 0.0), layout.FRICTIONLESS, 0, (0.0, 0.0), 0.0
    radius = law.radius
    was_stick = mem[model.WAS_STICK] != 0.0
    v1, w1 = rates
    free, s = active.free, active.s
    s_free = (free[0], radius * free[1])
    alpha = free_gain(par, mem)
    if was_stick and alpha == 1.0:  # the position that stick holds is a target, as for a constraint
        if mem[model.STICK_SAMPLES] == 1.0:
            mem[model.STICK_LENGTH], mem[model.STICK_ANGLE] = o.length, o.angle
        keep, share = rate_share(par, mem, explicit), correction_share(par, mem)
        back = share * (o.length - mem[model.STICK_LENGTH]) / h + keep * v1
        turn = share * (o.angle - mem[model.STICK_ANGLE]) / h + keep * w1
        s_free = (s_free[0] + back, s_free[1] + radius * turn)
    else:  # a slip that ends is not stopped at once if the time of action is uncertain
        kept = (1.0 - feedback_gain(par, mem)) ** 2
        s_free = (s_free[0] - kept * v1, s_free[1] - kept * radius * w1)
    v1, first = (0.0, 0.0) if rests[0] else (v1, s_free[0])
    w1, second = (0.0, 0.0) if rests[1] else (w1, s_free[1])
    s_free = (first, second)
    # the reactions as functions of phi: (f1, m1) = push - E (free + S phi) + q0 + q1 phi1 + q2 phi2
    e1, er = sp.e
    base = reactions(
        r, sp.push[0] - e1 * free[0] + active.q0[0], sp.push[1] - er * free[1] + active.q0[1]
    )
    by_p = free_reactions(r, active.q1[0] - e1 * s[0], active.q1[1] - er * s[1])
    by_q = free_reactions(
        r, radius * (active.q2[0] - e1 * s[1]), radius * (active.q2[1] - er * s[2])
    )
    d = make_disc_problem(
        (v1, radius * w1), s_free, s[0], radius * s[1], radius * radius * s[2], base, by_p, by_q
    )
    if alpha < 1.0 and which == BY_RULE:
        sol = _solve_lowered(par, mem, o, d, s, h, alpha)
    elif which == BY_RULE:
        sol = solve_disc(law, par, d, was_stick)
    else:
        sol = solve_alternative(law, par, d, which == LEAST_TRACTION)

    p, q = sol.phi
    size = math.sqrt(p * p + q * q)
    normal = contact(law, reaction(d, sol.phi)).normal
    slip = math.sqrt(sol.s_mean[0] ** 2 + sol.s_mean[1] ** 2)
    residual = 0.0
    if sol.regime == layout.SLIP:
        greatest = limit(law, par, slip, normal, cosine(law, sol.phi))
        if greatest > 0.0 and slip > 0.0:
            across = math.sqrt(
                (slip * p + greatest * sol.s_mean[0]) ** 2
                + (slip * q + greatest * sol.s_mean[1]) ** 2
            )
            residual = across / (slip * (size + greatest))
    return (p, radius * q), sol.regime, sol.flags, sol.s_mean, residual
