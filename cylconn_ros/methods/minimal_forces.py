"""What acts on slide and spin at one instant: springs, dampers, friction, stops and locks.

While it slides, friction is phi = -r s/|s| with the least r >= 0 of

    r = min(cap, mu(|s|, FN) FN),      FN = |Fr + Fbend + FCint| of the same instant's reactions

Fr + Fbend is convex in r, so Newton's method from r = 0 runs monotonically into the least root, or
meets a tangent that no longer falls: then there is none, and slide and spin stop impulsively (a
jam, Painleve's situation). At rest the disc of the accelerations decides between stick and the
direction of breaking away (core/disc.py).
"""

import math
from typing import Final, NamedTuple

from cylconn_ros.core import model
from cylconn_ros.core.bounds import Held, Two, hold
from cylconn_ros.core.compiled import inline, jit
from cylconn_ros.core.disc import Solution, disc_problem, solve_disc
from cylconn_ros.core.friction import Array, Law, coefficient, contact, limit
from cylconn_ros.core.layout import FRICTIONLESS, SLIP, STICK
from cylconn_ros.core.linear import Four
from cylconn_ros.methods import minimal_place as at
from cylconn_ros.methods.minimal_place import Place, Reduced, place, reduced

INSTANT: Final = 1e-9  # s, over which the disc of accelerations is solved: any short time does

Sides = tuple[int, int]  # of slide and spin: -1, 1 at the lower, upper stop; 2 locked; 0 free


class Instant(NamedTuple):
    """The state of the connector at one instant."""

    place: Place
    acceleration: Two  # l'', alpha''
    spring: Two
    damper: Two
    friction: Two  # f1f, m1f
    reaction: Two  # of stops and locks
    total: Two  # f1, m1
    constraint: Four
    normal: float  # FN
    traction: float  # P
    limit: float  # of P; in stick, what it may reach
    slip: float  # |s|
    stiffness: float  # 1/s, at most, at which friction pulls the direction of slip into place
    jammed: bool  # sliding on has no finite force


@inline
def along(r: Reduced, f: float, m: float) -> Four:
    """by_f1 f + by_m1 m."""
    return (
        r.by_f1[0] * f + r.by_m1[0] * m,
        r.by_f1[1] * f + r.by_m1[1] * m,
        r.by_f1[2] * f + r.by_m1[2] * m,
        r.by_f1[3] * f + r.by_m1[3] * m,
    )


@inline
def plus(a: Four, b: Four) -> Four:
    """A + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3])


@inline
def _pressed(law: Law, b: Four, d: Four, r: float) -> tuple[float, float]:
    """Fr + Fbend + FCint of the reactions b + r d, and its derivative by r."""
    f2, f3, m2, m3 = b[0] + r * d[0], b[1] + r * d[1], b[2] + r * d[2], b[3] + r * d[3]
    radial, moment = math.sqrt(f2 * f2 + f3 * f3), math.sqrt(m2 * m2 + m3 * m3)
    rise = 0.0
    if radial > 0.0:
        rise += (f2 * d[0] + f3 * d[1]) / radial
    else:
        rise += math.sqrt(d[0] * d[0] + d[1] * d[1])
    if moment > 0.0:
        rise += law.bending * (m2 * d[2] + m3 * d[3]) / moment
    else:
        rise += law.bending * math.sqrt(d[2] * d[2] + d[3] * d[3])
    return radial + law.bending * moment + law.preload, rise


@jit
def sliding_force(law: Law, par: Array, b: Four, d: Four, slip: float) -> tuple[float, bool]:
    """The least r, and whether there is none. Reactions b + r d, at slip rate ``slip``."""
    p, rise = _pressed(law, b, d, 0.0)
    if law.force_slope > 0.0:
        return _by_bounds(law, par, b, d, slip)
    mu = coefficient(law, par, slip, abs(p))
    r = 0.0
    if p >= 0.0:
        for _ in range(100):
            over = mu * p - r
            if over <= 1e-16 * r or over <= 0.0:
                return r, False
            fall = 1.0 - mu * rise
            if fall <= 0.0:
                return law.cap, law.cap == math.inf
            last = r
            r += over / fall
            if r >= law.cap:
                return law.cap, False
            if r - last <= 1e-16 * r:
                return r, False
            p, rise = _pressed(law, b, d, r)
        return r, False
    # FN = -(Fr + Fbend + FCint): -mu p - r is concave, with one root below -mu FCint
    low, high = 0.0, -mu * law.preload
    for _ in range(100):
        over = -mu * p - r
        if over > 0.0:
            low = r
        else:
            high = r
        if abs(over) <= 1e-16 * high or high - low <= 1e-16 * high:
            break
        fall = 1.0 + mu * rise
        r = r + over / fall if fall > 0.0 else high
        if not low < r < high:
            r = 0.5 * (low + high)
        p, rise = _pressed(law, b, d, r)
    return min(r, law.cap), False


@jit
def _by_bounds(law: Law, par: Array, b: Four, d: Four, slip: float) -> tuple[float, bool]:
    """The least root where mu varies with FN: steps that cannot pass one, then a secant."""
    growth = math.sqrt(d[0] * d[0] + d[1] * d[1])
    growth += law.bending * math.sqrt(d[2] * d[2] + d[3] * d[3])
    r, step = 0.0, 0.0
    greatest = 1e6 * (1.0 + abs(_pressed(law, b, d, 0.0)[0]))
    for _ in range(10000):
        normal = abs(_pressed(law, b, d, r)[0])
        over = limit(law, par, slip, normal) - r
        if over <= 1e-15 * r:
            return r, False
        mu = coefficient(law, par, slip, normal)
        steepest = growth * (mu + law.force_slope * (normal + growth * step))
        step = over / (1.0 + steepest)
        # where the way is clear of kinks a secant step ends just short of the root
        r += step
        if r > greatest:
            break
    return r, r > greatest


@inline
def forces_on(par: Array, joint: Array, y: Array) -> tuple[Two, Two, Two]:
    """Spring, damper, actuation on slide and spin."""
    e = model.ELASTICITY
    u1 = y[at.LENGTH] - joint[at.CONSTITUTIVE]
    ur = y[at.ANGLE] - joint[at.CONSTITUTIVE + 1]
    return (
        (-par[e] * u1, -par[e + 1] * ur),
        (-par[e + 2] * y[at.SLIDE], -par[e + 3] * y[at.SPIN]),
        (
            model.given(par[model.COMMAND + 2], 0.0),
            model.given(par[model.COMMAND + 5], 0.0),
        ),
    )


@inline
def _free_of(par: Array, joint: Array, t: float, y: Array) -> tuple[Place, Reduced, Two, Two, Two]:
    """Place, and the equations with springs, dampers and actuation taken in."""
    p = place(par, joint, t, y)
    r = reduced(par, joint, y, p)
    spring, damper, actuation = forces_on(par, joint, y)
    f, m = spring[0] + damper[0] + actuation[0], spring[1] + damper[1] + actuation[1]
    free = (
        r.free[0] + r.s[0] * f + r.s[1] * m,
        r.free[1] + r.s[1] * f + r.s[2] * m,
    )
    base = plus(r.base, along(r, f, m))
    return p, Reduced(free, r.s, base, r.by_f1, r.by_m1), spring, damper, (f, m)


@jit
def instant(par: Array, joint: Array, t: float, y: Array, stuck: bool, sides: Sides) -> Instant:
    """Accelerations and forces, sliding or stuck, with the components of ``sides`` != 0 held."""
    law = model.law(par)
    p, r, spring, damper, push = _free_of(par, joint, t, y)
    if stuck:
        held = hold(r.free, r.s, (2, 2), (0.0, 0.0))
        x = held.q0
        friction = (x[0] if sides[0] == 0 else 0.0, x[1] if sides[1] == 0 else 0.0)
        c = plus(r.base, along(r, x[0], x[1]))
        normal = contact(law, c).normal
        q = friction[1] / law.radius
        return Instant(
            p, (0.0, 0.0), spring, damper, friction, (x[0] - friction[0], x[1] - friction[1]),
            (push[0] + x[0], push[1] + x[1]), c, normal,
            math.sqrt(friction[0] * friction[0] + q * q), limit(law, par, 0.0, normal),
            0.0, 0.0, False,
        )  # fmt: skip
    held = Held(r.free, r.s, (0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
    if sides[0] != 0 or sides[1] != 0:
        held = hold(r.free, r.s, sides, (0.0, 0.0))
    friction, traction, stiffness, jammed = (0.0, 0.0), 0.0, 0.0, False
    v, w = y[at.SLIDE], law.radius * y[at.SPIN]
    slip = math.sqrt(v * v + w * w)
    if law.on and slip > 0.0:
        g, k = -v / slip, -law.radius * w / slip  # (f1f, m1f) of r = 1
        b = plus(r.base, along(r, held.q0[0], held.q0[1]))
        d = along(r, held.q1[0] * g + held.q2[0] * k, held.q1[1] * g + held.q2[1] * k)
        traction, jammed = sliding_force(law, par, b, d, slip)
        if jammed:
            traction = 0.0
        friction = (traction * g, traction * k)
        stiffness = traction * (held.s[0] + law.radius * law.radius * held.s[2]) / slip
    f, m = friction
    x = (
        held.q0[0] + held.q1[0] * f + held.q2[0] * m,
        held.q0[1] + held.q1[1] * f + held.q2[1] * m,
    )
    c = plus(r.base, along(r, x[0], x[1]))
    a = (
        held.free[0] + held.s[0] * f + held.s[1] * m,
        held.free[1] + held.s[1] * f + held.s[2] * m,
    )
    return Instant(
        p, a, spring, damper, friction, (x[0] - f, x[1] - m), (push[0] + x[0], push[1] + x[1]),
        c, contact(law, c).normal, traction, traction, slip, stiffness,
        jammed,
    )  # fmt: skip


@jit
def disc_of(
    radius: float, free: Two, s: tuple[float, float, float], base: Four, r: Reduced, held: Held,
    law: Law, par: Array, was_stick: bool,
) -> Solution:  # fmt: skip
    """The solution on the disc from rest: ``free`` the rates without friction, s what it adds."""
    by_p = along(r, held.q1[0], held.q1[1])
    by_q = along(r, radius * held.q2[0], radius * held.q2[1])
    d = disc_problem(
        (0.0, 0.0), (free[0], radius * free[1]), s[0], radius * s[1], radius * radius * s[2],
        base, by_p, by_q,
    )  # fmt: skip
    return solve_disc(law, par, d, was_stick)


@jit
def from_rest(
    par: Array, joint: Array, t: float, y: Array, sides: Sides, was_stick: bool
) -> tuple[int, Two]:
    """Regime at rest, and the acceleration (l'', alpha'') with which it breaks away."""
    law = model.law(par)
    _, r, _, _, _ = _free_of(par, joint, t, y)
    held = hold(r.free, r.s, sides, (0.0, 0.0))
    if not law.on:
        return FRICTIONLESS, held.free
    tau = INSTANT
    base = plus(r.base, along(r, held.q0[0], held.q0[1]))
    s = (tau * held.s[0], tau * held.s[1], tau * held.s[2])
    free = (tau * held.free[0], tau * held.free[1])
    found = disc_of(law.radius, free, s, base, r, held, law, par, was_stick)
    if found.regime == STICK:
        return STICK, (0.0, 0.0)
    return SLIP, (found.s_end[0] / tau, found.s_end[1] / (tau * law.radius))
