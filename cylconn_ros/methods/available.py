"""What acts on slide and spin, once the constrained components are eliminated.

Springs and dampers act at the mean of the step, -k (u + h (w- + w+)/4) - c (w- + w+)/2: implicit
and second order. They are taken into S before friction is solved on the disc (core/disc.py).

Stick holds a place, not only a speed: from its second sample on, s+ is measured from the target
that brings the place back within a step, as a constraint's is, so that stick on moving bodies does
not creep.
"""

import math
from typing import NamedTuple

from cylconn_ros.core import layout as out_at
from cylconn_ros.core import model
from cylconn_ros.core.answer import write_contact, write_forces
from cylconn_ros.core.bounds import (
    Bounds,
    Held,
    Two,
    advance_imposed,
    bounds,
    hold,
    imposed,
    imposed_force,
    locks,
    start_imposed,
)
from cylconn_ros.core.compiled import inline, jit
from cylconn_ros.core.disc import disc_problem, reaction, solve_disc
from cylconn_ros.core.friction import Array, coefficient, contact, limit
from cylconn_ros.core.linear import Four
from cylconn_ros.core.observe import Observed
from cylconn_ros.core.vectors import Vector


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


class Available(NamedTuple):
    """What acts on slide and spin, part by part, and what follows for the constraint."""

    spring: Two
    damper: Two
    actuation: Two
    solved: Solved
    constraint: Four
    stop: int  # bits of ConnectorState.stop
    lock: int
    restitution: float


@inline
def available(
    par: Array, mem: Array, o: Observed, r: Reduced, h: float, explicit: bool
) -> Available:
    """Everything on slide and spin; remembers stick, impacts and locks."""
    v1, w1 = o.twist.v[0], o.twist.w[0]
    actuation = (imposed_force(par, 0), imposed_force(par, 1))
    sp = _sprung(par, mem, o, r, h, actuation)
    component = int(par[model.LOCK])
    locked = False
    if component == 1:
        locked = locks(par, mem, o.length, v1, h)
    elif component == 2:
        locked = locks(par, mem, o.angle, w1, h)
    start_imposed(par, mem, 0, o.length)
    start_imposed(par, mem, 1, o.angle)

    eps = par[model.STOPS + 4]
    b1 = bounds(par, mem, 0, o.length, v1, h, eps, locked and component == 1)
    b2 = bounds(par, mem, 1, o.angle, w1, h, eps, locked and component == 2)
    if b1.impact != 0 or b2.impact != 0:
        eps = _restitution(par, mem, o, r, sp, h, explicit, b1, b2, eps)
        b1 = bounds(par, mem, 0, o.length, v1, h, eps, locked and component == 1)
        b2 = bounds(par, mem, 1, o.angle, w1, h, eps, locked and component == 2)
    solved, sides = _within(par, mem, o, r, sp, h, explicit, b1, b2)

    stop = 0
    if not (imposed(par, 0) or (locked and component == 1)):
        stop |= _stop_bits(sides[0])
    if not (imposed(par, 1) or (locked and component == 2)):
        stop |= _stop_bits(sides[1]) << 2
    restitution = _remember_impacts(mem, o, b1, b2, eps)
    _remember_friction(par, mem, o, solved, h)
    advance_imposed(par, mem, h)
    at = model.ELASTICITY
    k1, kr, c1, cr = par[at], par[at + 1], par[at + 2], par[at + 3]
    u1, ur = _stretch(par, mem, o)
    end = solved.end
    spring = (-k1 * (u1 + 0.25 * h * (v1 + end[0])), -kr * (ur + 0.25 * h * (w1 + end[1])))
    damper = (-0.5 * c1 * (v1 + end[0]), -0.5 * cr * (w1 + end[1]))
    f1 = spring[0] + damper[0] + actuation[0] + solved.friction[0] + solved.reaction[0]
    m1 = spring[1] + damper[1] + actuation[1] + solved.friction[1] + solved.reaction[1]
    mem[model.LAST_TOTAL], mem[model.LAST_TOTAL + 1] = f1, m1
    for k in range(2):
        drive = solved.reaction[k] if imposed(par, k) else 0.0
        mem[model.LAST_ACTUATION + k] = actuation[k] + drive
    lock = component if locked else 0
    return Available(
        spring, damper, actuation, solved, reactions(r, f1, m1), stop, lock, restitution
    )


@inline
def _stop_bits(side: int) -> int:
    """Which stop of a component is in contact: 1 the lower, 2 the upper."""
    if side < 0:
        return 1
    return 2 if side > 0 else 0


@inline
def _stretch(par: Array, mem: Array, o: Observed) -> Two:
    """u1mat and ur1mat: from the constitutive reference."""
    ref = model.REFERENCE
    return (
        o.length - model.given(par[ref + 2], mem[model.LENGTH0]),
        o.angle - model.given(par[ref + 3], mem[model.ANGLE0]),
    )


@inline
def _sprung(par: Array, mem: Array, o: Observed, r: Reduced, h: float, actuation: Two) -> Sprung:
    """Take in e - E w+ with E = k h/4 + c/2: with W = (I + hA E)^-1, S = W hA."""
    at = model.ELASTICITY
    k1, kr, c1, cr = par[at], par[at + 1], par[at + 2], par[at + 3]
    v1, w1 = o.twist.v[0], o.twist.w[0]
    u1, ur = _stretch(par, mem, o)
    e1, er = 0.25 * k1 * h + 0.5 * c1, 0.25 * kr * h + 0.5 * cr
    push1 = actuation[0] - k1 * (u1 + 0.25 * h * v1) - 0.5 * c1 * v1
    push2 = actuation[1] - kr * (ur + 0.25 * h * w1) - 0.5 * cr * w1
    a11, a12, a22 = r.a
    x = r.free[0] + a11 * push1 + a12 * push2
    y = r.free[1] + a12 * push1 + a22 * push2
    det = (1.0 + a11 * e1) * (1.0 + a22 * er) - a12 * a12 * e1 * er
    minor = a11 * a22 - a12 * a12
    return Sprung(
        (push1, push2),
        (e1, er),
        (
            ((1.0 + a22 * er) * x - a12 * er * y) / det,
            ((1.0 + a11 * e1) * y - a12 * e1 * x) / det,
        ),
        ((a11 + er * minor) / det, a12 / det, (a22 + e1 * minor) / det),
    )


@inline
def _within(
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
    """
    fixed1, fixed2 = b1.low == b1.high, b2.low == b2.high
    best, best_sides, least = (
        _solved(par, mem, o, r, sp, h, explicit, 0, b1, 0, b2),
        (0, 0),
        math.inf,
    )
    for choice in range(9):
        side1, side2 = (0, -1, 1)[choice % 3], (0, -1, 1)[choice // 3]
        if fixed1:
            if side1 != 0:
                continue
            side1 = -1
        elif (side1 < 0 and b1.low == -math.inf) or (side1 > 0 and b1.high == math.inf):
            continue
        if fixed2:
            if side2 != 0:
                continue
            side2 = -1
        elif (side2 < 0 and b2.low == -math.inf) or (side2 > 0 and b2.high == math.inf):
            continue
        found = best
        if side1 != 0 or side2 != 0:
            found = _solved(par, mem, o, r, sp, h, explicit, side1, b1, side2, b2)
        wrong = _wrong(b1, fixed1, side1, found.end[0], found.reaction[0], sp.s[0])
        wrong = max(wrong, _wrong(b2, fixed2, side2, found.end[1], found.reaction[1], sp.s[2]))
        if wrong < least:
            best, best_sides, least = found, (side1, side2), wrong
        if wrong <= 0.0:
            break
    return best, best_sides


@inline
def _wrong(b: Bounds, fixed: bool, side: int, rate: float, reaction: float, s: float) -> float:
    """By how much, as a rate, a choice breaks its own condition; 0: it does not."""
    if fixed:
        return 0.0
    slack = 1e-13 * abs(rate)
    if side == 0:
        return max(b.low - rate - slack, rate - b.high - slack, 0.0)
    return max(s * reaction * side, 0.0)


@jit
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
) -> Solved:
    """Friction and reactions with the components of side -1 (lower bound) and 1 (upper) held."""
    t1 = b1.low if side1 < 0 else b1.high
    t2 = b2.low if side2 < 0 else b2.high
    held = hold(sp.free, sp.s, (side1, side2), (t1, t2))
    friction, regime, flags, s_mean, residual = _friction(
        par, mem, o, r, sp, held, h, explicit, side1 != 0, side2 != 0
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


@jit
def _restitution(
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
        s = _solved(par, mem, o, r, sp, h, explicit, b1.impact, c1, b2.impact, c2)
        work = (s.friction[0] + s.reaction[0]) * (v1 + s.end[0])
        work += (s.friction[1] + s.reaction[1]) * (w1 + s.end[1])
        if work <= 0.0:
            low = now
            if attempt == 0:
                break
        else:
            high = now
    return low


@inline
def _remember_impacts(mem: Array, o: Observed, b1: Bounds, b2: Bounds, eps: float) -> float:
    """Keep what an impact's second step needs; the coefficient that acts in this step."""
    acting = 0.0
    rates = (o.twist.v[0], o.twist.w[0])
    for k in range(2):
        impact = b1.impact if k == 0 else b2.impact
        if mem[model.PENDING_SIDE + k] != 0.0:
            acting = mem[model.PENDING_RESTITUTION]
            mem[model.PENDING_SIDE + k] = 0.0
        elif impact != 0:
            acting = eps
            mem[model.PENDING_SIDE + k] = impact
            mem[model.PENDING_RATE + k] = -eps * rates[k]
            mem[model.PENDING_RESTITUTION] = eps
    return acting


@inline
def reactions(r: Reduced, f1: float, m1: float) -> Four:
    """The constraint reactions (f2, f3, m2, m3) that go with (f1, m1)."""
    return (
        r.base[0] + r.by_f1[0] * f1 + r.by_m1[0] * m1,
        r.base[1] + r.by_f1[1] * f1 + r.by_m1[1] * m1,
        r.base[2] + r.by_f1[2] * f1 + r.by_m1[2] * m1,
        r.base[3] + r.by_f1[3] * f1 + r.by_m1[3] * m1,
    )


@inline
def _along(r: Reduced, f1: float, m1: float) -> Four:
    """by_f1 f1 + by_m1 m1."""
    return (
        r.by_f1[0] * f1 + r.by_m1[0] * m1,
        r.by_f1[1] * f1 + r.by_m1[1] * m1,
        r.by_f1[2] * f1 + r.by_m1[2] * m1,
        r.by_f1[3] * f1 + r.by_m1[3] * m1,
    )


@inline
def _friction(
    par: Array,
    mem: Array,
    o: Observed,
    r: Reduced,
    sp: Sprung,
    held: Held,
    h: float,
    explicit: bool,
    slide_held: bool,
    spin_held: bool,
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
        keep = 0.0 if explicit else 0.5
        if not slide_held:
            back = (o.length - mem[model.HELD_LENGTH]) / h + keep * v1
            s_free = (s_free[0] + back, s_free[1])
        if not spin_held:
            back = (o.angle - mem[model.HELD_ANGLE]) / h + keep * w1
            s_free = (s_free[0], s_free[1] + radius * back)
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
    sol = solve_disc(law, par, d, was_stick)

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


@inline
def _remember_friction(par: Array, mem: Array, o: Observed, solved: Solved, h: float) -> None:
    """Accumulated slip and how long it has stuck."""
    if solved.regime == out_at.FRICTIONLESS:
        return
    was_stick = mem[model.WAS_STICK] != 0.0
    slip = math.sqrt(solved.s_mean[0] ** 2 + solved.s_mean[1] ** 2)
    if solved.regime == out_at.SLIP:
        mem[model.SLIPPED] += slip * h
        mem[model.STUCK] = 0.0
    else:
        if not was_stick:
            mem[model.SLIPPED] += slip * h
        mem[model.STUCK] += 1.0
    mem[model.WAS_STICK] = 1.0 if solved.regime == out_at.STICK else 0.0


@inline
def report(
    par: Array,
    mem: Array,
    out: Array,
    o: Observed,
    r: Reduced,
    av: Available,
    force: Vector,
    moment: Vector,
    h: float,
) -> None:
    """Write forces, their parts and the state of friction."""
    write_forces(out, force, moment)
    out[out_at.FORCE_ELASTIC], out[out_at.MOMENT_ELASTIC] = av.spring
    out[out_at.FORCE_VISCOUS], out[out_at.MOMENT_VISCOUS] = av.damper
    out[out_at.FORCE_FRICTION], out[out_at.MOMENT_FRICTION] = av.solved.friction
    out[out_at.FORCE_ACTUATION], out[out_at.MOMENT_ACTUATION] = av.actuation
    out[out_at.FORCE_REACTION], out[out_at.MOMENT_REACTION] = av.solved.reaction
    out[out_at.STOP], out[out_at.LOCK], out[out_at.RESTITUTION] = av.stop, av.lock, av.restitution
    law = model.law(par)
    pressed = contact(law, av.constraint)
    out[out_at.REGIME] = av.solved.regime
    out[out_at.ACCUMULATED_SLIP] = mem[model.SLIPPED]
    out[out_at.STOP_TIME] = -1.0
    if not law.on:
        write_contact(out, pressed, 0.0, 0.0, 0.0)
        return
    rate = out[out_at.SLIP_RATE] if av.solved.regime == out_at.SLIP else 0.0
    mu = coefficient(law, par, rate, pressed.normal)
    greatest = limit(law, par, rate, pressed.normal)
    q = av.solved.friction[1] / law.radius
    traction = math.sqrt(av.solved.friction[0] ** 2 + q * q)
    if av.solved.regime == out_at.SLIP:
        greatest = traction  # P = limit: mu at the mean slip rate of the step, not the sample's
        if pressed.normal > 0.0 and traction < law.cap:
            mu = traction / pressed.normal
    write_contact(out, pressed, mu, greatest, traction)
    if av.solved.regime == out_at.STICK and mem[model.STUCK] == 1.0:
        out[out_at.STOP_TIME] = _time_to_rest(law.radius, o, r, greatest, h)


@inline
def _time_to_rest(radius: float, o: Observed, r: Reduced, greatest: float, h: float) -> float:
    """|s| / |ds/dt| with friction at its limit against the slip velocity, at most the period."""
    s1, s2 = o.twist.v[0], radius * o.twist.w[0]
    size = math.sqrt(s1 * s1 + s2 * s2)
    if size == 0.0:
        return 0.0
    f1, m1 = -greatest * s1 / size, -greatest * radius * s2 / size
    d1 = r.free[0] + r.a[0] * f1 + r.a[1] * m1 - s1
    d2 = radius * (r.free[1] + r.a[1] * f1 + r.a[2] * m1) - s2
    slowing = -(d1 * s1 + d2 * s2) / size
    if slowing <= size:  # would not stop by friction alone within the period
        return h
    return h * size / slowing
