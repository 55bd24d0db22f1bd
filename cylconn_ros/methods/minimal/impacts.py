"""Impulses on slide and spin: impacts at stops, locks that close, jams.

An impulse of (f1, m1) causes impulses of the constraint, by_f1 f1 + by_m1 m1, which produce a
normal impulse between shaft and sleeve: friction has an impulse too, on the disc of the impulsive
FN. The preload FCint is finite and has no impulse; neither has friction whose force is capped.
"""

import math

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array, without_preload
from cylconn_ros.core.jit import allocating_function
from cylconn_ros.core.joint_limits import Two, eliminate_limits
from cylconn_ros.core.overlap import law_at
from cylconn_ros.core.rigid_body import Motion
from cylconn_ros.core.vectors import add, add_scaled, cross, into, matrix, out_of, times
from cylconn_ros.methods.minimal import coordinates
from cylconn_ros.methods.minimal.coordinates import (
    ReducedEquations,
    configuration,
    delassus_at,
    eliminate_constraint,
    wrench_on_b,
)
from cylconn_ros.methods.minimal.forces import Sides, along, solve_on_disc

BISECTIONS = 50


@allocating_function
def apply_impulse(
    par: Array, joint: Array, t: float, y: Array, n: int, x: Two, friction: Two
) -> None:
    """Change the rates in ``y`` by the impulse x = (f1, m1) dt; add it to the integrals."""
    p = configuration(par, joint, t, y)
    r = eliminate_constraint(delassus_at(par, p), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    force, moment = wrench_on_b(p, x, along(r, x[0], x[1]))
    y[coordinates.SLIDE] += r.s[0] * x[0] + r.s[1] * x[1]
    y[coordinates.SPIN] += r.s[1] * x[0] + r.s[2] * x[1]
    for k in range(2):
        y[n + 2 + k] += friction[k]
        y[n + 4 + k] += x[k]
    if joint[coordinates.MODE] == coordinates.BOTH_FREE:
        body = model.body(par, model.BODY_A)
        a: Motion = p.a
        axes = matrix(a.orientation)
        turning = into(axes, add(cross(p.frame.arm_a, force), moment))
        model.write_vector(
            y, coordinates.A_VELOCITY, add_scaled(a.velocity, -body.inverse_mass, force)
        )
        dw = out_of(axes, times(body.inverse_inertia, turning))
        model.write_vector(y, coordinates.A_SPIN, add_scaled(a.spin, -1.0, dw))


@allocating_function
def impose_rates(
    par: Array, joint: Array, t: float, y: Array, n: int, sides: Sides, rates: Two
) -> None:
    """Impose rates on the components of ``sides`` != 0 by an impulse: jams, locks."""
    p = configuration(par, joint, t, y)
    r = eliminate_constraint(delassus_at(par, p), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    x = eliminate_limits((y[coordinates.SLIDE], y[coordinates.SPIN]), r.s, sides, rates).q0
    both = sides[0] != 0 and sides[1] != 0
    apply_impulse(par, joint, t, y, n, x, x if both else (0.0, 0.0))
    for k in range(2):
        if sides[k] != 0:
            y[coordinates.SLIDE + k] = rates[k]


@allocating_function
def _impact_impulse(
    par: Array, joint: Array, y: Array, r: ReducedEquations, k: int, eps: float, others: Sides
) -> tuple[Two, Two]:
    """(f1, m1) dt and the friction impulse, for an impact of component k with restitution eps."""
    law = law_at(par, joint[coordinates.START], y[coordinates.LENGTH])
    rate = -eps * y[coordinates.SLIDE + k]
    sides = (1, others[1]) if k == 0 else (others[0], 1)
    target = (rate, y[coordinates.SPIN]) if k == 0 else (y[coordinates.SLIDE], rate)
    active = eliminate_limits((y[coordinates.SLIDE], y[coordinates.SPIN]), r.s, sides, target)
    f, m = 0.0, 0.0
    if law.on and law.cap == math.inf:
        base = along(r, active.q0[0], active.q0[1])
        of_impulses = without_preload(law)
        found = solve_on_disc(
            law.radius, active.free, active.s, base, r, active, of_impulses, par, False
        )
        f, m = found.phi[0], law.radius * found.phi[1]
    x = (
        active.q0[0] + active.q1[0] * f + active.q2[0] * m,
        active.q0[1] + active.q1[1] * f + active.q2[1] * m,
    )
    return x, (f, m)


@allocating_function
def impact(
    par: Array, joint: Array, t: float, y: Array, n: int, k: int, eps: float, others: Sides
) -> float:
    """Reflect component k (0 slide, 1 spin) at a stop; returns the restitution that acts.

    It is the largest <= eps for which the kinetic energy does not increase: the work of the
    impulses, x.(w- + w+)/2, is not positive.
    """
    p = configuration(par, joint, t, y)
    r = eliminate_constraint(delassus_at(par, p), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    before = (y[coordinates.SLIDE], y[coordinates.SPIN])
    low, high, acting = 0.0, eps, eps
    x, friction = _impact_impulse(par, joint, y, r, k, eps, others)
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
        x, friction = _impact_impulse(par, joint, y, r, k, acting, others)
    apply_impulse(par, joint, t, y, n, x, friction)
    y[coordinates.SLIDE + k] = -acting * before[k]
    return acting
