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
from cylconn_ros.core.compiled import jit
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


class Available(NamedTuple):
    """What acts on slide and spin: springs and dampers, friction, and how it was found."""

    spring: tuple[float, float]  # elastic part of f1, m1
    damper: tuple[float, float]  # viscous part
    friction: tuple[float, float]  # friction part
    constraint: Four
    regime: int
    flags: int
    residual: float


@jit
def available(
    par: Array, mem: Array, o: Observed, r: Reduced, h: float, explicit: bool
) -> Available:
    """Springs, dampers and friction on slide and spin.

    Spring and damper: e - E w+ with E = k h/4 + c/2 on each component, so that with W = (I + hA
    E)^-1

        w+ = W (free + hA e) + W hA phi
    """
    at = model.ELASTICITY
    k1, kr, c1, cr = par[at], par[at + 1], par[at + 2], par[at + 3]
    v1, w1 = o.twist.v[0], o.twist.w[0]
    ref = model.REFERENCE
    u1 = o.length - model.given(par[ref + 2], mem[model.LENGTH0])
    ur = o.angle - model.given(par[ref + 3], mem[model.ANGLE0])
    e1, er = 0.25 * k1 * h + 0.5 * c1, 0.25 * kr * h + 0.5 * cr
    push1 = -k1 * (u1 + 0.25 * h * v1) - 0.5 * c1 * v1
    push2 = -kr * (ur + 0.25 * h * w1) - 0.5 * cr * w1
    a11, a12, a22 = r.a
    x = r.free[0] + a11 * push1 + a12 * push2
    y = r.free[1] + a12 * push1 + a22 * push2
    det = (1.0 + a11 * e1) * (1.0 + a22 * er) - a12 * a12 * e1 * er
    free = (
        ((1.0 + a22 * er) * x - a12 * er * y) / det,
        ((1.0 + a11 * e1) * y - a12 * e1 * x) / det,
    )
    minor = a11 * a22 - a12 * a12
    s = ((a11 + er * minor) / det, a12 / det, (a22 + e1 * minor) / det)

    phi, regime, flags, residual = _friction(
        par, mem, o, r, h, explicit, free, s, (e1, er), (push1, push2)
    )
    end1 = free[0] + s[0] * phi[0] + s[1] * phi[1]
    end2 = free[1] + s[1] * phi[0] + s[2] * phi[1]
    spring = (
        -k1 * (u1 + 0.25 * h * (v1 + end1)),
        -kr * (ur + 0.25 * h * (w1 + end2)),
    )
    damper = (-0.5 * c1 * (v1 + end1), -0.5 * cr * (w1 + end2))
    f1 = spring[0] + damper[0] + phi[0]
    m1 = spring[1] + damper[1] + phi[1]
    constraint = reactions(r, f1, m1)
    return Available(spring, damper, phi, constraint, regime, flags, residual)


@jit
def reactions(r: Reduced, f1: float, m1: float) -> Four:
    """The constraint reactions (f2, f3, m2, m3) that go with (f1, m1)."""
    return (
        r.base[0] + r.by_f1[0] * f1 + r.by_m1[0] * m1,
        r.base[1] + r.by_f1[1] * f1 + r.by_m1[1] * m1,
        r.base[2] + r.by_f1[2] * f1 + r.by_m1[2] * m1,
        r.base[3] + r.by_f1[3] * f1 + r.by_m1[3] * m1,
    )


@jit
def _friction(
    par: Array,
    mem: Array,
    o: Observed,
    r: Reduced,
    h: float,
    explicit: bool,
    free: tuple[float, float],
    s: tuple[float, float, float],
    implicit: tuple[float, float],
    push: tuple[float, float],
) -> tuple[tuple[float, float], int, int, float]:
    """(f1f, m1f), regime, flags and the residual of the law; (v1, w1)+ = free + s (f1f, m1f)."""
    law = model.law(par)
    if not law.on:
        return (0.0, 0.0), out_at.FRICTIONLESS, 0, 0.0
    radius = law.radius
    was_stick = mem[model.WAS_STICK] != 0.0
    v1, w1 = o.twist.v[0], o.twist.w[0]
    s_free = (free[0], radius * free[1])
    if was_stick:  # the place that stick holds is a constraint's target too
        if mem[model.STUCK] == 1.0:
            mem[model.HELD_LENGTH], mem[model.HELD_ANGLE] = o.length, o.angle
        keep = 0.0 if explicit else 0.5
        s_free = (
            s_free[0] + (o.length - mem[model.HELD_LENGTH]) / h + keep * v1,
            s_free[1] + radius * ((o.angle - mem[model.HELD_ANGLE]) / h + keep * w1),
        )
    # the reactions as functions of phi alone: (f1, m1) = push - E w+ + (f1f, m1f)
    e1, er = implicit
    base = reactions(r, push[0] - e1 * free[0], push[1] - er * free[1])
    p1, p2 = 1.0 - e1 * s[0], -er * s[1]
    q1, q2 = -e1 * s[1] * radius, (1.0 - er * s[2]) * radius
    x, y = r.by_f1, r.by_m1
    by_p = (
        p1 * x[0] + p2 * y[0],
        p1 * x[1] + p2 * y[1],
        p1 * x[2] + p2 * y[2],
        p1 * x[3] + p2 * y[3],
    )
    by_q = (
        q1 * x[0] + q2 * y[0],
        q1 * x[1] + q2 * y[1],
        q1 * x[2] + q2 * y[2],
        q1 * x[3] + q2 * y[3],
    )
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
        mem[model.SLIPPED] += slip * h
        if greatest > 0.0 and slip > 0.0:
            across = math.sqrt(
                (slip * p + greatest * sol.s_mean[0]) ** 2
                + (slip * q + greatest * sol.s_mean[1]) ** 2
            )
            residual = across / (slip * (size + greatest))
        mem[model.STUCK] = 0.0
    else:
        if not was_stick:
            mem[model.SLIPPED] += slip * h
        mem[model.STUCK] += 1.0
    mem[model.WAS_STICK] = 1.0 if sol.regime == out_at.STICK else 0.0
    return (p, radius * q), sol.regime, sol.flags, residual


@jit
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
    out[out_at.FORCE_FRICTION], out[out_at.MOMENT_FRICTION] = av.friction
    law = model.law(par)
    pressed = contact(law, av.constraint)
    out[out_at.REGIME] = av.regime
    out[out_at.ACCUMULATED_SLIP] = mem[model.SLIPPED]
    out[out_at.STOP_TIME] = -1.0
    if not law.on:
        write_contact(out, pressed, 0.0, 0.0, 0.0)
        return
    rate = out[out_at.SLIP_RATE] if av.regime == out_at.SLIP else 0.0
    mu = coefficient(law, par, rate, pressed.normal)
    greatest = limit(law, par, rate, pressed.normal)
    q = av.friction[1] / law.radius
    traction = math.sqrt(av.friction[0] ** 2 + q * q)
    if av.regime == out_at.SLIP:
        greatest = traction  # P = limit: mu at the mean slip rate of the step, not the sample's
        if pressed.normal > 0.0 and traction < law.cap:
            mu = traction / pressed.normal
    write_contact(out, pressed, mu, greatest, traction)
    if av.regime == out_at.STICK and mem[model.STUCK] == 1.0:
        out[out_at.STOP_TIME] = _time_to_rest(law.radius, o, r, greatest, h)


@jit
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
