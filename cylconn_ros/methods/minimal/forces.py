"""What acts on slide and spin at one instant: springs, dampers, friction, stops and locks.

While it slides, friction is phi = -r s/|s| with the least r >= 0 of

    r = min(cap, mu(|s|, FN) FN),      FN = |Fr + Fbend + FCint| of the same instant's reactions

(core/traction.py). Where there is none, slide and spin stop impulsively (a jam, Painleve's
situation). At rest the disc of the accelerations decides between stick and the
direction of breaking away (core/friction_disc.py).
"""

import math
from typing import Final, NamedTuple

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array, Law, contact, limit
from cylconn_ros.core.friction_disc import Solution, solve_disc
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.joint_limits import Held, Two, hold, imposed_force
from cylconn_ros.core.layout import FRICTIONLESS, SLIP, STICK
from cylconn_ros.core.slip_curve import disc_problem
from cylconn_ros.core.small_matrices import Four
from cylconn_ros.core.traction import least_traction
from cylconn_ros.methods.minimal import coordinates as at
from cylconn_ros.methods.minimal.coordinates import Reduced, place, reduced
from cylconn_ros.methods.minimal.fixed_shaft import reduced_on_shaft

INSTANT: Final = 1e-9  # s, over which the disc of accelerations is solved: any short time does

SAME: Final = 0.1  # the greatest share by which two accelerations may differ and be one
ASIDE: Final = 1e-3  # rad, from the direction of slip to its neighbours

Sides = tuple[
    int, int
]  # of slide and spin: -1, 1 at the lower, upper stop; 2 keeps its rate; 0 free


class Instant(NamedTuple):
    """The state of the connector at one instant."""

    acceleration: Two  # l'', alpha''
    spring: Two
    damper: Two
    friction: Two  # f1f, m1f
    reaction: Two  # of stops and locks
    total: Two  # f1, m1
    constraint: Four  # of the lean equations: in B's axes
    normal: float  # FN
    traction: float  # P
    limit: float  # of P; in stick, what it may reach
    slip: float  # |s|
    jammed: bool  # sliding on has no finite force


@inline_function
def along(r: Reduced, f: float, m: float) -> Four:
    """by_f1 f + by_m1 m."""
    return (
        r.by_f1[0] * f + r.by_m1[0] * m,
        r.by_f1[1] * f + r.by_m1[1] * m,
        r.by_f1[2] * f + r.by_m1[2] * m,
        r.by_f1[3] * f + r.by_m1[3] * m,
    )


@inline_function
def plus(a: Four, b: Four) -> Four:
    """A + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3])


@inline_function
def forces_on(par: Array, joint: Array, y: Array) -> tuple[Two, Two, Two]:
    """Of springs, of dampers, and what they and actuation sum to, on slide and spin."""
    e = model.ELASTICITY
    u1 = y[at.LENGTH] - joint[at.CONSTITUTIVE]
    ur = y[at.ANGLE] - joint[at.CONSTITUTIVE + 1]
    spring = (-par[e] * u1, -par[e + 1] * ur)
    damper = (-par[e + 2] * y[at.SLIDE], -par[e + 3] * y[at.SPIN])
    given = (imposed_force(par, 0), imposed_force(par, 1))
    return (
        spring,
        damper,
        (spring[0] + damper[0] + given[0], spring[1] + damper[1] + given[1]),
    )


@inline_function
def equations(par: Array, joint: Array, t: float, y: Array) -> Reduced:
    """Accelerations and reactions without springs, dampers and actuation."""
    if joint[at.SHAFT] != 0.0:
        return reduced_on_shaft(joint, y)
    return reduced(par, joint, y, place(par, joint, t, y))


@inline_function
def pushed(r: Reduced, f: float, m: float) -> Reduced:
    """The equations with (f1, m1) = (f, m) taken in."""
    free = (
        r.free[0] + r.s[0] * f + r.s[1] * m,
        r.free[1] + r.s[1] * f + r.s[2] * m,
    )
    return Reduced(free, r.s, plus(r.base, along(r, f, m)), r.by_f1, r.by_m1)


@device_function
def instant(par: Array, joint: Array, t: float, y: Array, stuck: bool, sides: Sides) -> Instant:
    """Accelerations and forces, sliding or stuck, with the components of ``sides`` != 0 held."""
    return instant_of(par, joint, y, equations(par, joint, t, y), stuck, sides)


@inline_function
def instant_of(
    par: Array, joint: Array, y: Array, r: Reduced, stuck: bool, sides: Sides
) -> Instant:
    """As :func:`instant`, where the equations ``r`` are known."""
    spring, damper, push = forces_on(par, joint, y)
    r = pushed(r, push[0], push[1])
    if stuck:
        return _stuck(par, r, spring, damper, push, sides)
    if sides[0] != 0 or sides[1] != 0:
        return _held(par, y, r, spring, damper, push, sides)
    nothing = (0.0, 0.0)
    return _sliding(
        par, y, r, spring, damper, push, Held(r.free, r.s, nothing, (1.0, 0.0), (0.0, 1.0))
    )


@device_function
def _stuck(par: Array, r: Reduced, spring: Two, damper: Two, push: Two, sides: Sides) -> Instant:
    """At rest: friction, or what else holds a component, takes whatever keeps it there."""
    law = model.law(par)
    x = hold(r.free, r.s, (2, 2), (0.0, 0.0)).q0
    friction = (x[0] if sides[0] == 0 else 0.0, x[1] if sides[1] == 0 else 0.0)
    c = plus(r.base, along(r, x[0], x[1]))
    normal = contact(law, c).normal
    q = friction[1] / law.radius
    return Instant(
        (0.0, 0.0), spring, damper, friction, (x[0] - friction[0], x[1] - friction[1]),
        (push[0] + x[0], push[1] + x[1]), c, normal,
        math.sqrt(friction[0] * friction[0] + q * q), limit(law, par, 0.0, normal), 0.0, False,
    )  # fmt: skip


@device_function
def _held(
    par: Array, y: Array, r: Reduced, spring: Two, damper: Two, push: Two, sides: Sides
) -> Instant:
    """Sliding, with a component held."""
    return _sliding(par, y, r, spring, damper, push, hold(r.free, r.s, sides, (0.0, 0.0)))


@inline_function
def _sliding(
    par: Array, y: Array, r: Reduced, spring: Two, damper: Two, push: Two, held: Held
) -> Instant:
    """Sliding: friction of full size against the slip velocity."""
    law = model.law(par)
    f, m, traction, jammed = 0.0, 0.0, 0.0, False
    v, w = y[at.SLIDE], law.radius * y[at.SPIN]
    slip = math.sqrt(v * v + w * w)
    if law.on and slip > 0.0:
        g, k = -v / slip, -law.radius * w / slip  # (f1f, m1f) of r = 1
        b = plus(r.base, along(r, held.q0[0], held.q0[1]))
        d = along(r, held.q1[0] * g + held.q2[0] * k, held.q1[1] * g + held.q2[1] * k)
        traction, jammed, _ = least_traction(law, par, b, d, 1.0, slip, math.inf)
        if jammed or traction == math.inf:
            traction, jammed = 0.0, True
        f, m = traction * g, traction * k
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
        a, spring, damper, (f, m), (x[0] - f, x[1] - m), (push[0] + x[0], push[1] + x[1]),
        c, contact(law, c).normal, traction, traction, slip, jammed,
    )  # fmt: skip


@device_function
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


@device_function
def from_rest(
    par: Array, joint: Array, t: float, y: Array, sides: Sides, was_stick: bool
) -> tuple[int, Two]:
    """Regime at rest, and the acceleration (l'', alpha'') with which it breaks away."""
    law = model.law(par)
    _, _, push = forces_on(par, joint, y)
    r = pushed(equations(par, joint, t, y), push[0], push[1])
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


@device_function
def carries_on(par: Array, joint: Array, t: float, y: Array, sides: Sides, a: Two) -> bool:
    """Whether the slip that begins from rest with accelerations ``a`` goes on as it begins.

    Where a direction has two tractions P = limit(FN(P)), only the lesser lasts (`least_traction`):
    slip that needs the greater turns away at once, and jams. What lasts draws its neighbours in.
    """
    radius = model.law(par).radius
    v, w = INSTANT * a[0], INSTANT * radius * a[1]
    lasts, rounding = True, 0.0
    for side in (-1, 1, 0):  # neighbours first: they show how large its forces are
        y[at.SLIDE], y[at.SPIN] = v - side * ASIDE * w, (w + side * ASIDE * v) / radius
        i = instant(par, joint, t, y, False, sides)
        b1, b2 = i.acceleration[0] - a[0], radius * (i.acceleration[1] - a[1])
        apart = math.sqrt(b1 * b1 + b2 * b2)
        if side == 0:
            lasts = lasts and apart <= SAME * math.sqrt(v * v + w * w) / INSTANT + rounding
        else:
            rounding = max(rounding, 0.01 * apart)  # of its direction
            if sides[0] == 0 and sides[1] == 0:
                lasts = lasts and side * (v * b2 - w * b1) <= 0.0
        lasts = lasts and not i.jammed
    y[at.SLIDE] = y[at.SPIN] = 0.0
    return lasts
