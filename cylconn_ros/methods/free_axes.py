"""What acts on slide and spin, part by part, once the constrained components are eliminated.

Springs and dampers act at the mean of the step, -k (u + h (w- + w+)/4) - c (w- + w+)/2: implicit
and second order. They are taken into S before friction and the reactions of stops, locks and
imposed motion are solved (methods/complementarity.py).
"""

import math
from typing import NamedTuple

from cylconn_ros.core import layout as out_at
from cylconn_ros.core import model
from cylconn_ros.core.friction import Array, Law, coefficient, contact, limit
from cylconn_ros.core.jit import inline_function
from cylconn_ros.core.joint_limits import (
    Bounds,
    Two,
    advance_imposed,
    bounds,
    imposed,
    imposed_force,
    locks,
    start_imposed,
)
from cylconn_ros.core.output_wrenches import write_contact, write_forces
from cylconn_ros.core.relative_state import Observed
from cylconn_ros.core.small_matrices import Four
from cylconn_ros.core.traction import least_traction
from cylconn_ros.core.vectors import Vector
from cylconn_ros.methods.complementarity import (
    Reduced,
    Solved,
    Sprung,
    reactions,
    restitution_without_gain,
    within,
)


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


@inline_function
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
        eps = restitution_without_gain(par, mem, o, r, sp, h, explicit, b1, b2, eps)
        b1 = bounds(par, mem, 0, o.length, v1, h, eps, locked and component == 1)
        b2 = bounds(par, mem, 1, o.angle, w1, h, eps, locked and component == 2)
    solved, sides = within(par, mem, o, r, sp, h, explicit, b1, b2)

    stop = 0
    if not (imposed(par, 0) or (locked and component == 1)):
        stop |= _stop_bits(sides[0])
    if not (imposed(par, 1) or (locked and component == 2)):
        stop |= _stop_bits(sides[1]) << 2
    restitution = _remember_impacts(mem, o, b1, b2, eps, explicit, sides)
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


@inline_function
def _stop_bits(side: int) -> int:
    """Which stop of a component is in contact: 1 the lower, 2 the upper."""
    if side < 0:
        return 1
    return 2 if side > 0 else 0


@inline_function
def _stretch(par: Array, mem: Array, o: Observed) -> Two:
    """u1mat and ur1mat: from the constitutive reference."""
    ref = model.REFERENCE
    return (
        o.length - model.given(par[ref + 2], mem[model.LENGTH0]),
        o.angle - model.given(par[ref + 3], mem[model.ANGLE0]),
    )


@inline_function
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
    if e1 == 0.0 and er == 0.0:
        x = r.free[0] + a11 * actuation[0] + a12 * actuation[1]
        y = r.free[1] + a12 * actuation[0] + a22 * actuation[1]
        return Sprung(actuation, (0.0, 0.0), (x, y), r.a)
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


@inline_function
def _remember_impacts(
    mem: Array, o: Observed, b1: Bounds, b2: Bounds, eps: float, explicit: bool,
    sides: tuple[int, int],
) -> float:  # fmt: skip
    """Keep what an impact's second step needs; the coefficient that acts in this step.

    None follows where something else than the stop held the component back, nor on a semi-implicit
    plant (``explicit``), whose impacts are one step.
    """
    acting = 0.0
    rates = (o.twist.v[0], o.twist.w[0])
    for k in range(2):
        impact = b1.impact if k == 0 else b2.impact
        if mem[model.PENDING_SIDE + k] != 0.0:
            acting = mem[model.PENDING_RESTITUTION]
            mem[model.PENDING_SIDE + k] = 0.0
        elif impact != 0:
            acting = eps
            mem[model.PENDING_SIDE + k] = 0.0 if explicit or sides[k] == 0 else impact
            mem[model.PENDING_RATE + k] = -eps * rates[k]
            mem[model.PENDING_RESTITUTION] = eps
    return acting


@inline_function
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


@inline_function
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
        out[out_at.STOP_TIME] = _time_to_rest(law, par, o, r, av, h)


@inline_function
def _time_to_rest(law: Law, par: Array, o: Observed, r: Reduced, av: Available, h: float) -> float:
    """|s| / |ds/dt| with sliding friction against the slip velocity, at most the period."""
    s1, s2 = o.twist.v[0], law.radius * o.twist.w[0]
    size = math.sqrt(s1 * s1 + s2 * s2)
    if size == 0.0:
        return 0.0
    x, y = -s1 / size, -law.radius * s2 / size  # (f1, m1) of a unit traction
    push = (
        av.spring[0] + av.damper[0] + av.actuation[0] + av.solved.reaction[0],
        av.spring[1] + av.damper[1] + av.actuation[1] + av.solved.reaction[1],
    )
    b, c = r.by_f1, r.by_m1
    by = (x * b[0] + y * c[0], x * b[1] + y * c[1], x * b[2] + y * c[2], x * b[3] + y * c[3])
    base = reactions(r, push[0], push[1])
    p, jammed, _ = least_traction(law, par, base, by, 1.0, size, math.inf)
    if jammed or not math.isfinite(p):
        return 0.0
    f1, m1 = push[0] + p * x, push[1] + p * y
    d1 = r.free[0] + r.a[0] * f1 + r.a[1] * m1 - s1
    d2 = law.radius * (r.free[1] + r.a[1] * f1 + r.a[2] * m1) - s2
    slowing = -(d1 * s1 + d2 * s2) / size
    if not slowing > size:  # would not stop within the period
        return h
    return h * size / slowing
