"""Forces on slide and spin at one instant: springs, dampers, friction, stops and locks.

In slip, friction is phi = -r s/|s| with the least r >= 0 of

    r = min(cap, mu(|s|, FN) FN),      FN = |Fr + Fbend + FCint| of the same instant's reactions

(core/traction.py). If there is none, slide and spin stop impulsively (a jam, the Painleve paradox).
At rest the friction disc of the accelerations decides between stick and the direction of breakaway
(core/friction_disc.py).
"""

import math
from typing import Final, NamedTuple

from cylconn_ros.core import model
from cylconn_ros.core.elements import elements_at
from cylconn_ros.core.friction import Array, Law, contact, cosine, limit
from cylconn_ros.core.friction_disc import DiscSolution, solve_disc
from cylconn_ros.core.jit import allocating_function, inline_function
from cylconn_ros.core.joint_limits import ActiveLimits, Two, eliminate_limits, imposed_force
from cylconn_ros.core.layout import FRICTIONLESS, SLIP, STICK
from cylconn_ros.core.overlap import law_at
from cylconn_ros.core.slip_curve import make_disc_problem
from cylconn_ros.core.small_matrices import Four
from cylconn_ros.core.traction import least_traction
from cylconn_ros.methods.minimal import coordinates
from cylconn_ros.methods.minimal.coordinates import (
    ReducedEquations,
    configuration,
    reduced_equations,
)
from cylconn_ros.methods.minimal.fixed_shaft import reduced_on_shaft
from cylconn_ros.methods.minimal.over_time import prescribed_acceleration

SHORT_TIME: Final = 1e-9  # s, over which the disc of accelerations is solved; any short time works

SAME_DIRECTION: Final = 0.1  # greatest relative difference of two equal accelerations
NEIGHBOUR_ANGLE: Final = 1e-3  # rad, between the slip direction and its neighbours

Sides = tuple[int, int]
"""Of slide and spin: -1, 1 at the lower, upper stop; 2 prescribed rate; 0 free."""


class Instant(NamedTuple):
    """Accelerations and forces (N, N.m) of the connector at one instant."""

    acceleration: Two  # l'', alpha''
    spring: Two
    damper: Two
    friction: Two  # f1f, m1f
    reaction: Two  # of stops and locks
    total: Two  # f1, m1
    constraint: Four  # f2 f3 m2 m3; with the fixed-base reduction in B's axes
    normal: float  # FN
    traction: float  # P
    limit: float  # friction limit: greatest P
    slip: float  # |s|
    jammed: bool  # slip has no finite force


@inline_function
def along(r: ReducedEquations, f: float, m: float) -> Four:
    """by_f1 f + by_m1 m."""
    return (
        r.by_f1[0] * f + r.by_m1[0] * m,
        r.by_f1[1] * f + r.by_m1[1] * m,
        r.by_f1[2] * f + r.by_m1[2] * m,
        r.by_f1[3] * f + r.by_m1[3] * m,
    )


@inline_function
def add4(a: Four, b: Four) -> Four:
    """The sum a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3])


@inline_function
def forces_on(par: Array, joint: Array, y: Array) -> tuple[Two, Two, Two]:
    """Forces of springs, of dampers, and their sum with all but friction and rigid stops."""
    e = model.ELASTICITY
    u1 = y[coordinates.LENGTH] - joint[coordinates.SPRING_REFERENCE]
    ur = y[coordinates.ANGLE] - joint[coordinates.SPRING_REFERENCE + 1]
    spring = (-par[e] * u1, -par[e + 1] * ur)
    damper = (-par[e + 2] * y[coordinates.SLIDE], -par[e + 3] * y[coordinates.SPIN])
    given = (imposed_force(par, 0), imposed_force(par, 1))
    if par[model.ELEMENTS] != 0.0:
        f = elements_at(par, model.ELEMENTS, 0, u1, y[coordinates.LENGTH], y[coordinates.SLIDE])
        spring, damper = (spring[0] + f.spring, spring[1]), (damper[0] + f.damper, damper[1])
        given = (given[0] + f.stop, given[1])
    if par[model.ELEMENTS + 1] != 0.0:
        f = elements_at(par, model.ELEMENTS, 1, ur, y[coordinates.ANGLE], y[coordinates.SPIN])
        spring, damper = (spring[0], spring[1] + f.spring), (damper[0], damper[1] + f.damper)
        given = (given[0], given[1] + f.stop)
    return (
        spring,
        damper,
        (spring[0] + damper[0] + given[0], spring[1] + damper[1] + given[1]),
    )


@inline_function
def compliant_stops(par: Array, y: Array) -> Two:
    """Forces of compliant stops on slide and spin."""
    one, two = 0.0, 0.0
    if par[model.ELEMENTS] != 0.0:
        x, w = y[coordinates.LENGTH], y[coordinates.SLIDE]
        one = elements_at(par, model.ELEMENTS, 0, 0.0, x, w).stop
    if par[model.ELEMENTS + 1] != 0.0:
        x, w = y[coordinates.ANGLE], y[coordinates.SPIN]
        two = elements_at(par, model.ELEMENTS, 1, 0.0, x, w).stop
    return one, two


@inline_function
def equations(par: Array, joint: Array, t: float, y: Array) -> ReducedEquations:
    """Accelerations and reactions without springs, dampers and actuation."""
    if joint[coordinates.FIXED_SHAFT] != 0.0:
        return reduced_on_shaft(joint, y)
    return reduced_equations(par, joint, y, configuration(par, joint, t, y))


@inline_function
def with_forces(r: ReducedEquations, f: float, m: float) -> ReducedEquations:
    """The equations with the forces (f1, m1) = (f, m) included."""
    free = (
        r.free[0] + r.s[0] * f + r.s[1] * m,
        r.free[1] + r.s[1] * f + r.s[2] * m,
    )
    return ReducedEquations(free, r.s, add4(r.base, along(r, f, m)), r.by_f1, r.by_m1)


@allocating_function
def instant(par: Array, joint: Array, t: float, y: Array, stuck: bool, sides: Sides) -> Instant:
    """Accelerations and forces in slip or stick; components of ``sides`` != 0 are at a limit."""
    return instant_of(par, joint, y, equations(par, joint, t, y), stuck, sides)


@inline_function
def instant_of(
    par: Array, joint: Array, y: Array, r: ReducedEquations, stuck: bool, sides: Sides
) -> Instant:
    """:func:`instant` for known equations ``r``."""
    spring, damper, push = forces_on(par, joint, y)
    r = with_forces(r, push[0], push[1])
    if stuck:
        return _stick(par, joint, y, r, spring, damper, push, sides)
    if sides[0] != 0 or sides[1] != 0:
        return _slip_at_limit(par, joint, y, r, spring, damper, push, sides)
    nothing = (0.0, 0.0)
    active = ActiveLimits(r.free, r.s, nothing, (1.0, 0.0), (0.0, 1.0))
    return _slip(par, joint, y, r, spring, damper, push, active)


@allocating_function
def _stick(
    par: Array, joint: Array, y: Array, r: ReducedEquations, spring: Two, damper: Two, push: Two,
    sides: Sides,
) -> Instant:  # fmt: skip
    """Stick: friction, stops or locks provide the forces that keep it at rest."""
    law = law_at(par, joint[coordinates.START], y[coordinates.LENGTH])
    x = eliminate_limits(r.free, r.s, (2, 2), (0.0, 0.0)).q0
    friction = (x[0] if sides[0] == 0 else 0.0, x[1] if sides[1] == 0 else 0.0)
    c = add4(r.base, along(r, x[0], x[1]))
    normal = contact(law, c).normal
    q = friction[1] / law.radius
    return Instant(
        (0.0, 0.0), spring, damper, friction, (x[0] - friction[0], x[1] - friction[1]),
        (push[0] + x[0], push[1] + x[1]), c, normal,
        math.sqrt(friction[0] * friction[0] + q * q),
        limit(law, par, 0.0, normal, cosine(law, (friction[0], q))), 0.0, False,
    )  # fmt: skip


@allocating_function
def _slip_at_limit(
    par: Array, joint: Array, y: Array, r: ReducedEquations, spring: Two, damper: Two, push: Two,
    sides: Sides,
) -> Instant:  # fmt: skip
    """Slip with a component at a limit."""
    active = eliminate_limits(r.free, r.s, sides, prescribed_acceleration(joint, sides))
    return _slip(par, joint, y, r, spring, damper, push, active)


@inline_function
def _slip(
    par: Array,
    joint: Array,
    y: Array,
    r: ReducedEquations,
    spring: Two,
    damper: Two,
    push: Two,
    active: ActiveLimits,
) -> Instant:
    """Slip: friction at its limit against the slip velocity."""
    law = law_at(par, joint[coordinates.START], y[coordinates.LENGTH])
    f, m, traction, jammed = 0.0, 0.0, 0.0, False
    v, w = y[coordinates.SLIDE], law.radius * y[coordinates.SPIN]
    slip = math.sqrt(v * v + w * w)
    if law.on and slip > 0.0:
        g, k = -v / slip, -law.radius * w / slip  # (f1f, m1f) of r = 1
        b = add4(r.base, along(r, active.q0[0], active.q0[1]))
        d = along(r, active.q1[0] * g + active.q2[0] * k, active.q1[1] * g + active.q2[1] * k)
        traction, jammed, _ = least_traction(law, par, b, d, 1.0, slip, v / slip, math.inf)
        if jammed or traction == math.inf:
            traction, jammed = 0.0, True
        f, m = traction * g, traction * k
    x = (
        active.q0[0] + active.q1[0] * f + active.q2[0] * m,
        active.q0[1] + active.q1[1] * f + active.q2[1] * m,
    )
    c = add4(r.base, along(r, x[0], x[1]))
    a = (
        active.free[0] + active.s[0] * f + active.s[1] * m,
        active.free[1] + active.s[1] * f + active.s[2] * m,
    )
    return Instant(
        a, spring, damper, (f, m), (x[0] - f, x[1] - m), (push[0] + x[0], push[1] + x[1]),
        c, contact(law, c).normal, traction, traction, slip, jammed,
    )  # fmt: skip


@allocating_function
def solve_on_disc(
    radius: float, free: Two, s: tuple[float, float, float], base: Four, r: ReducedEquations,
    active: ActiveLimits, law: Law, par: Array, was_stick: bool,
) -> DiscSolution:  # fmt: skip
    """The disc solution from rest; ``free``: rates without friction, ``s``: mobility."""
    by_p = along(r, active.q1[0], active.q1[1])
    by_q = along(r, radius * active.q2[0], radius * active.q2[1])
    d = make_disc_problem(
        (0.0, 0.0), (free[0], radius * free[1]), s[0], radius * s[1], radius * radius * s[2],
        base, by_p, by_q,
    )  # fmt: skip
    return solve_disc(law, par, d, was_stick)


@allocating_function
def regime_from_rest(
    par: Array, joint: Array, t: float, y: Array, sides: Sides, was_stick: bool
) -> tuple[int, Two]:
    """Regime from rest, and the acceleration (l'', alpha'') of breakaway."""
    law = law_at(par, joint[coordinates.START], y[coordinates.LENGTH])
    _, _, push = forces_on(par, joint, y)
    r = with_forces(equations(par, joint, t, y), push[0], push[1])
    active = eliminate_limits(r.free, r.s, sides, prescribed_acceleration(joint, sides))
    if not law.on:
        return FRICTIONLESS, active.free
    tau = SHORT_TIME
    base = add4(r.base, along(r, active.q0[0], active.q0[1]))
    s = (tau * active.s[0], tau * active.s[1], tau * active.s[2])
    free = (tau * active.free[0], tau * active.free[1])
    found = solve_on_disc(law.radius, free, s, base, r, active, law, par, was_stick)
    if found.regime == STICK:
        return STICK, (0.0, 0.0)
    return SLIP, (found.s_end[0] / tau, found.s_end[1] / (tau * law.radius))


@allocating_function
def slip_persists(par: Array, joint: Array, t: float, y: Array, sides: Sides, a: Two) -> bool:
    """Whether slip that starts from rest with accelerations ``a`` keeps its direction.

    If a direction has two tractions P = limit(FN(P)), only the lesser one is stable
    (`least_traction`): slip with the greater one changes direction at once and jams. A stable
    direction attracts its neighbours.
    """
    radius = model.law(par).radius
    v, w = SHORT_TIME * a[0], SHORT_TIME * radius * a[1]
    stable, rounding = True, 0.0
    for side in (-1, 1, 0):  # neighbours first: they give the scale of rounding
        y[coordinates.SLIDE], y[coordinates.SPIN] = (
            v - side * NEIGHBOUR_ANGLE * w,
            (w + side * NEIGHBOUR_ANGLE * v) / radius,
        )
        i = instant(par, joint, t, y, False, sides)
        b1, b2 = i.acceleration[0] - a[0], radius * (i.acceleration[1] - a[1])
        apart = math.sqrt(b1 * b1 + b2 * b2)
        if side == 0:
            stable = (
                stable
                and apart <= SAME_DIRECTION * math.sqrt(v * v + w * w) / SHORT_TIME + rounding
            )
        else:
            rounding = max(rounding, 0.01 * apart)  # of its direction
            if sides[0] == 0 and sides[1] == 0:
                stable = stable and side * (v * b2 - w * b1) <= 0.0
        stable = stable and not i.jammed
    y[coordinates.SLIDE] = y[coordinates.SPIN] = 0.0
    return stable
