"""Impulses on slide and spin: impacts at stops, locks that close, jams.

An impulse of (f1, m1) takes the constraint's impulses with it, by_f1 f1 + by_m1 m1, and these press
shaft and sleeve together: friction has an impulse too, on the disc of the impulsive FN. FCint is
finite and has no part in it; neither has friction whose force is capped.
"""

import math

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array, Law
from cylconn_ros.core.jit import device_function
from cylconn_ros.core.joint_limits import Two, hold
from cylconn_ros.core.rigid_body import Motion
from cylconn_ros.core.vectors import add, add_scaled, cross, into, matrix, out_of, times
from cylconn_ros.methods.minimal import coordinates as at
from cylconn_ros.methods.minimal.coordinates import (
    Reduced,
    eliminated,
    inertia_at,
    place,
    wrench_on_b,
)
from cylconn_ros.methods.minimal.forces import Sides, along, disc_of

BISECTIONS = 50


@device_function
def apply(par: Array, joint: Array, t: float, y: Array, n: int, x: Two, friction: Two) -> None:
    """Change the rates in ``y`` by the impulse x = (f1, m1) dt; count it in the integrals."""
    p = place(par, joint, t, y)
    r = eliminated(inertia_at(par, p), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    force, moment = wrench_on_b(p, x, along(r, x[0], x[1]))
    y[at.SLIDE] += r.s[0] * x[0] + r.s[1] * x[1]
    y[at.SPIN] += r.s[1] * x[0] + r.s[2] * x[1]
    for k in range(2):
        y[n + 2 + k] += friction[k]
        y[n + 4 + k] += x[k]
    if joint[at.MODE] == at.BOTH_FREE:
        body = model.body(par, model.BODY_A)
        a: Motion = p.a
        axes = matrix(a.orientation)
        turning = into(axes, add(cross(p.frame.arm_a, force), moment))
        model.put(y, at.A_VELOCITY, add_scaled(a.velocity, -body.inverse_mass, force))
        dw = out_of(axes, times(body.inverse_inertia, turning))
        model.put(y, at.A_SPIN, add_scaled(a.spin, -1.0, dw))


@device_function
def bring_to(
    par: Array, joint: Array, t: float, y: Array, n: int, sides: Sides, rates: Two
) -> None:
    """Give the components of ``sides`` != 0 these rates by what impulse it takes: jams, locks."""
    p = place(par, joint, t, y)
    r = eliminated(inertia_at(par, p), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    x = hold((y[at.SLIDE], y[at.SPIN]), r.s, sides, rates).q0
    both = sides[0] != 0 and sides[1] != 0
    apply(par, joint, t, y, n, x, x if both else (0.0, 0.0))
    for k in range(2):
        if sides[k] != 0:
            y[at.SLIDE + k] = rates[k]


@device_function
def _bare(law: Law) -> Law:
    """The law of impulses: without FCint."""
    return Law(
        law.on, law.kinetic, law.static, law.decay, law.cap, law.radius, law.bending, 0.0,
        law.rate_slope, law.force_slope, law.rates, law.forces, law.table,
    )  # fmt: skip


@device_function
def _impulse(
    par: Array, y: Array, r: Reduced, k: int, eps: float, others: Sides
) -> tuple[Two, Two]:
    """(f1, m1) dt and the part of friction, for an impact of component k with restitution eps."""
    law = model.law(par)
    rate = -eps * y[at.SLIDE + k]
    sides = (1, others[1]) if k == 0 else (others[0], 1)
    target = (rate, y[at.SPIN]) if k == 0 else (y[at.SLIDE], rate)
    held = hold((y[at.SLIDE], y[at.SPIN]), r.s, sides, target)
    f, m = 0.0, 0.0
    if law.on and law.cap == math.inf:
        base = along(r, held.q0[0], held.q0[1])
        bare = _bare(law)
        found = disc_of(law.radius, held.free, held.s, base, r, held, bare, par, False)
        f, m = found.phi[0], law.radius * found.phi[1]
    x = (
        held.q0[0] + held.q1[0] * f + held.q2[0] * m,
        held.q0[1] + held.q1[1] * f + held.q2[1] * m,
    )
    return x, (f, m)


@device_function
def impact(
    par: Array, joint: Array, t: float, y: Array, n: int, k: int, eps: float, others: Sides
) -> float:
    """Reflect component k (0 slide, 1 spin) at a stop; the restitution that acts.

    It is the largest <= eps with which the kinetic energy does not grow: the work of the impulses,
    x.(w- + w+)/2, is not positive.
    """
    p = place(par, joint, t, y)
    r = eliminated(inertia_at(par, p), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    before = (y[at.SLIDE], y[at.SPIN])
    low, high, acting = 0.0, eps, eps
    x, friction = _impulse(par, y, r, k, eps, others)
    for _ in range(BISECTIONS):
        d1, d2 = r.s[0] * x[0] + r.s[1] * x[1], r.s[1] * x[0] + r.s[2] * x[1]
        work = x[0] * (before[0] + 0.5 * d1) + x[1] * (before[1] + 0.5 * d2)
        if work <= 0.0:
            low = acting
        else:
            high = acting
        if low == eps or high - low <= 1e-15 * eps or eps == 0.0:
            break
        acting = 0.5 * (low + high)
        x, friction = _impulse(par, y, r, k, acting, others)
    apply(par, joint, t, y, n, x, friction)
    y[at.SLIDE + k] = -acting * before[k]
    return acting
