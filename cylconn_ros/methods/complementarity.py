"""Friction and the reactions of stops, locks and imposed motion on slide and spin, within one step.

Each component is free, or held at one of its bounds (core/joint_limits.py); the held ones are eliminated
and friction is solved on what is left (core/friction_disc.py). The choice that fulfils its own conditions is
the solution.

Stick holds a place, not only a speed: from its second sample on, s+ is measured from the target
that brings the place back within a step, as a constraint's is, so that stick on moving bodies does
not creep.
"""

import math
from typing import NamedTuple

from cylconn_ros.core import layout as out_at
from cylconn_ros.core import model
from cylconn_ros.core.friction import Array, contact, limit
from cylconn_ros.core.friction_disc import solve_disc, solve_otherwise
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.joint_limits import Bounds, Held, Two, hold
from cylconn_ros.core.latency import share_removed
from cylconn_ros.core.relative_state import Observed
from cylconn_ros.core.slip_curve import disc_problem, reaction
from cylconn_ros.core.small_matrices import Four

TRIFLE = 1e-15  # of what cancels in a rate
NAMED, RESTING, SLIDING = 0, 1, 2  # which solution of friction: the rule's, or another


class Reduced(NamedTuple):
    """The step with the constrained components eliminated: (f1, m1) is what is left.

    (f2 f3 m2 m3) = base + by_f1 f1 + by_m1 m1;   (v1, w1)+ = free + h A (f1, m1)
    """

    base: Four
    by_f1: Four
    by_m1: Four
    free: tuple[float, float]
    a: tuple[float, float, float]  # h A: 11, 12, 22


class Sprung(NamedTuple):
    """The step with springs, dampers and actuation taken in; x = (phi + p) is what is left.

    (f1, m1) = push - E w+ + x,    (v1, w1)+ = free + S x,    E = diag(e)
    """

    push: Two
    e: Two
    free: Two
    s: tuple[float, float, float]  # 11, 12, 22


class Solved(NamedTuple):
    """Friction and reactions for one choice of the components that are held."""

    end: Two  # (v1, w1)+
    friction: Two  # f1f, m1f
    reaction: Two  # of stops, locks and imposed motion
    regime: int
    flags: int
    s_mean: Two
    residual: float


@inline_function
def reactions(r: Reduced, f1: float, m1: float) -> Four:
    """The constraint reactions (f2, f3, m2, m3) that go with (f1, m1)."""
    return (
        r.base[0] + r.by_f1[0] * f1 + r.by_m1[0] * m1,
        r.base[1] + r.by_f1[1] * f1 + r.by_m1[1] * m1,
        r.base[2] + r.by_f1[2] * f1 + r.by_m1[2] * m1,
        r.base[3] + r.by_f1[3] * f1 + r.by_m1[3] * m1,
    )


@inline_function
def _along(r: Reduced, f1: float, m1: float) -> Four:
    """by_f1 f1 + by_m1 m1."""
    return (
        r.by_f1[0] * f1 + r.by_m1[0] * m1,
        r.by_f1[1] * f1 + r.by_m1[1] * m1,
        r.by_f1[2] * f1 + r.by_m1[2] * m1,
        r.by_f1[3] * f1 + r.by_m1[3] * m1,
    )


@inline_function
def within(
    par: Array,
    mem: Array,
    o: Observed,
    r: Reduced,
    sp: Sprung,
    h: float,
    explicit: bool,
    b1: Bounds,
    b2: Bounds,
) -> tuple[Solved, tuple[int, int]]:
    """The solution within the bounds: 0 <= p _|_ w+ - t >= 0 on each, by trying who is held.

    Few components, so few choices: free, or held at either bound. Mostly the first is the one.
    Where friction has several solutions the one that the rule names may fit nowhere: then those
    next to stick are tried, and then those of least traction where the rule names stick.
    """
    fixed1, fixed2 = b1.low == b1.high, b2.low == b2.high
    best, best_sides, least = (
        _solved(par, mem, o, r, sp, h, explicit, 0, b1, 0, b2, NAMED),
        (0, 0),
        math.inf,
    )
    for choice in range(27):
        side1, side2, which = (0, -1, 1)[choice % 3], (0, -1, 1)[choice // 3 % 3], choice // 9
        offered1, side1 = _offered(b1, side1)
        offered2, side2 = _offered(b2, side2)
        if not (offered1 and offered2):
            continue
        found = best
        if side1 != 0 or side2 != 0 or which != NAMED:
            found = _solved(par, mem, o, r, sp, h, explicit, side1, b1, side2, b2, which)
        p, q = found.reaction
        wrong = max(
            _wrong(b1, fixed1, side1, found.end[0], p * sp.s[0], sp.free[0]),
            _wrong(b2, fixed2, side2, found.end[1], q * sp.s[2], sp.free[1]),
        )
        if wrong < least:
            best, best_sides, least = found, (side1, side2), wrong
        if wrong <= 0.0:
            break
    return best, best_sides


@inline_function
def _offered(b: Bounds, side: int) -> tuple[bool, int]:
    """Whether ``side`` is a choice, and which bound it stands for: a fixed rate is just one."""
    if b.low == b.high:
        return side == 0, -1
    none = (side < 0 and b.low == -math.inf) or (side > 0 and b.high == math.inf)
    return not none, side


@inline_function
def _wrong(b: Bounds, fixed: bool, side: int, rate: float, pushed: float, free: float) -> float:
    """By how much, as a rate, a choice breaks its own condition; 0: it does not.

    pushed: what the reaction adds to the rate; free: the rate without friction and reactions.
    """
    if fixed:
        return 0.0
    slack = 1e-13 * abs(rate) + TRIFLE * abs(free)
    if side == 0:
        return max(b.low - rate - slack, rate - b.high - slack, 0.0)
    return max(pushed * side - slack, 0.0)


@device_function
def _solved(
    par: Array,
    mem: Array,
    o: Observed,
    r: Reduced,
    sp: Sprung,
    h: float,
    explicit: bool,
    side1: int,
    b1: Bounds,
    side2: int,
    b2: Bounds,
    which: int,
) -> Solved:
    """Friction and reactions with the components of side -1 (lower bound) and 1 (upper) held."""
    t1 = b1.low if side1 < 0 else b1.high
    t2 = b2.low if side2 < 0 else b2.high
    held = hold(sp.free, sp.s, (side1, side2), (t1, t2))
    friction, regime, flags, s_mean, residual = _friction(
        par, mem, o, r, sp, held, h, explicit, which
    )
    f, g = friction
    end = (
        held.free[0] + held.s[0] * f + held.s[1] * g,
        held.free[1] + held.s[1] * f + held.s[2] * g,
    )
    reaction_ = (
        held.q0[0] + (held.q1[0] - 1.0) * f + held.q2[0] * g,
        held.q0[1] + held.q1[1] * f + (held.q2[1] - 1.0) * g,
    )
    return Solved(end, friction, reaction_, regime, flags, s_mean, residual)


@device_function
def restitution_without_gain(
    par: Array,
    mem: Array,
    o: Observed,
    r: Reduced,
    sp: Sprung,
    h: float,
    explicit: bool,
    b1: Bounds,
    b2: Bounds,
    eps: float,
) -> float:
    """The largest coefficient <= eps with which the impact does not gain kinetic energy.

    Friction and coupled inertias can otherwise feed it: the work of the impulses on slide and spin,
    (phi + p).(w- + w+)/2 with w+ = -eps w- on what impacts, must not be positive.
    """
    v1, w1 = o.twist.v[0], o.twist.w[0]
    low, high = 0.0, eps
    for attempt in range(40):
        now = high if attempt == 0 else 0.5 * (low + high)
        c1 = Bounds(-now * v1, -now * v1, 0) if b1.impact != 0 else b1
        c2 = Bounds(-now * w1, -now * w1, 0) if b2.impact != 0 else b2
        s = _solved(par, mem, o, r, sp, h, explicit, b1.impact, c1, b2.impact, c2, NAMED)
        work = (s.friction[0] + s.reaction[0]) * (v1 + s.end[0])
        work += (s.friction[1] + s.reaction[1]) * (w1 + s.end[1])
        if work <= 0.0:
            low = now
            if attempt == 0:
                break
        else:
            high = now
    return low


@inline_function
def _friction(
    par: Array,
    mem: Array,
    o: Observed,
    r: Reduced,
    sp: Sprung,
    held: Held,
    h: float,
    explicit: bool,
    which: int,
) -> tuple[Two, int, int, Two, float]:
    """(f1f, m1f), regime, flags, s~ and the residual of the law."""
    law = model.law(par)
    if not law.on:
        return (0.0, 0.0), out_at.FRICTIONLESS, 0, (0.0, 0.0), 0.0
    radius = law.radius
    was_stick = mem[model.WAS_STICK] != 0.0
    v1, w1 = o.twist.v[0], o.twist.w[0]
    free, s = held.free, held.s
    s_free = (free[0], radius * free[1])
    if was_stick:  # the place that stick holds is a constraint's target too
        if mem[model.STUCK] == 1.0:
            mem[model.HELD_LENGTH], mem[model.HELD_ANGLE] = o.length, o.angle
        keep, share = 0.0 if explicit else 0.5, share_removed(par, mem)
        back = share * (o.length - mem[model.HELD_LENGTH]) / h + keep * v1
        turn = share * (o.angle - mem[model.HELD_ANGLE]) / h + keep * w1
        s_free = (s_free[0] + back, s_free[1] + radius * turn)
    # the reactions as functions of phi: (f1, m1) = push - E (free + S phi) + q0 + q1 phi1 + q2 phi2
    e1, er = sp.e
    base = reactions(
        r, sp.push[0] - e1 * free[0] + held.q0[0], sp.push[1] - er * free[1] + held.q0[1]
    )
    by_p = _along(r, held.q1[0] - e1 * s[0], held.q1[1] - er * s[1])
    by_q = _along(r, radius * (held.q2[0] - e1 * s[1]), radius * (held.q2[1] - er * s[2]))
    d = disc_problem(
        (v1, radius * w1), s_free, s[0], radius * s[1], radius * radius * s[2], base, by_p, by_q
    )
    if which == NAMED:
        sol = solve_disc(law, par, d, was_stick)
    else:
        sol = solve_otherwise(law, par, d, which == SLIDING)

    p, q = sol.phi
    size = math.sqrt(p * p + q * q)
    normal = contact(law, reaction(d, sol.phi)).normal
    slip = math.sqrt(sol.s_mean[0] ** 2 + sol.s_mean[1] ** 2)
    residual = 0.0
    if sol.regime == out_at.SLIP:
        greatest = limit(law, par, slip, normal)
        if greatest > 0.0 and slip > 0.0:
            across = math.sqrt(
                (slip * p + greatest * sol.s_mean[0]) ** 2
                + (slip * q + greatest * sol.s_mean[1]) ** 2
            )
            residual = across / (slip * (size + greatest))
    return (p, radius * q), sol.regime, sol.flags, sol.s_mean, residual
