"""Forces on the free axes, slide and spin, after elimination of the constrained components.

Springs and dampers act at the mean of the step, -k (u + h (w- + w+)/4) - c (w- + w+)/2: implicit
and second order; tables and compliant stops with their mean over it (free_axes/elements.py). They
are included in S before friction and the reactions of stops, locks and imposed motion are solved
(methods/free_axes/complementarity.py).
"""

import math
from typing import NamedTuple

from cylconn_ros.core import layout, model
from cylconn_ros.core.delay import reliable_restitution
from cylconn_ros.core.free_gain import lag_of, stable_damping, stable_stiffness
from cylconn_ros.core.friction import Array, Law, coefficient, contact, cosine, limit, share_of
from cylconn_ros.core.jit import inline_function
from cylconn_ros.core.joint_limits import (
    Bounds,
    Two,
    advance_imposed_motion,
    has_stops,
    imposed_force,
    is_motion_imposed,
    prescribed_rate,
    start_imposed_motion,
    stop_bits,
    update_lock,
)
from cylconn_ros.core.output_wrenches import write_contact, write_forces
from cylconn_ros.core.relative_state import RelativeState
from cylconn_ros.core.small_matrices import Four
from cylconn_ros.core.traction import least_traction
from cylconn_ros.core.vectors import Vector
from cylconn_ros.methods.drives.bounds import is_driven, is_held_against_drive, solve_driven
from cylconn_ros.methods.free_axes.complementarity import (
    BY_RULE,
    FreeAxesSolution,
    ReducedStep,
    StepWithSprings,
    reactions,
    solve_case,
)
from cylconn_ros.methods.free_axes.contacts import LimitedSolution, solve_with_stops, with_stops
from cylconn_ros.methods.free_axes.elements import (
    HALVED_AFTER,
    MOST_SOLUTIONS,
    add_elements,
    are_settled,
    elements_of,
    has_any_element,
    linearise_about,
)
from cylconn_ros.methods.free_axes.two_impacts import StopBounds, without_stops


class FreeAxes(NamedTuple):
    """Forces and moments (N, N.m) on slide and spin by component, and the constraint reactions."""

    spring: Two
    damper: Two
    actuation: Two
    solved: FreeAxesSolution
    constraint: Four
    stop: int  # bits of ConnectorState.stop
    lock: int  # component that is locked
    restitution: float
    flags: int  # DRIVE_BLOCKED, NOT_CONVERGED


class PosedFreeAxes(NamedTuple):
    """Slide and spin before friction and the reactions of stops and drives are solved."""

    sp: StepWithSprings
    b1: Bounds  # of slide, by lock and imposed motion
    b2: Bounds  # of spin
    closed: tuple[bool, bool]  # held by the lock
    eps: float


@inline_function
def solve_free_axes(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, h: float, explicit: bool
) -> FreeAxes:
    """Solve slide and spin; ``mem`` is updated for stick, impacts, locks and imposed motion.

    ``explicit``: semi-implicit plant, whose positions follow the end velocity.
    """
    elastic = has_any_element(par)
    if elastic:
        linearise_about(mem, (o.twist.v[0], o.twist.w[0]), 1.0)
    q = pose_free_axes(par, mem, o, r, h)
    driven = (is_driven(par, 0, q.closed[0]), is_driven(par, 1, q.closed[1]))
    count = 0
    while True:
        if driven[0] or driven[1]:
            found = solve_driven(par, mem, o, r, q.sp, h, explicit, q.b1, q.b2, q.eps, driven)
        else:
            found = _solve_undriven(par, mem, o, r, q, h, explicit)
        count += 1
        if not elastic:
            break
        f, p = found.solved.friction, found.solved.reaction
        others = (abs(f[0]) + abs(p[0]), abs(f[1]) + abs(p[1]))
        if are_settled(par, mem, o, r, h, found.solved.end, others):
            break
        if count == MOST_SOLUTIONS:
            break
        linearise_about(mem, found.solved.end, 1.0 if count < HALVED_AFTER else 0.5)
        sp = with_springs(par, mem, o, r, h, (imposed_force(par, 0), imposed_force(par, 1)))
        q = PosedFreeAxes(sp, q.b1, q.b2, q.closed, q.eps)
    if elastic:
        linearise_about(mem, found.solved.end, 1.0)
    return complete_free_axes(par, mem, o, r, q, found, h, count == MOST_SOLUTIONS)


@inline_function
def pose_free_axes(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, h: float
) -> PosedFreeAxes:
    """Springs, dampers, locks and imposed motion of the step; ``mem`` is updated for the latter."""
    v1, w1 = o.twist.v[0], o.twist.w[0]
    sp = with_springs(par, mem, o, r, h, (imposed_force(par, 0), imposed_force(par, 1)))
    component = int(par[model.LOCK])
    closed1, closed2 = False, False
    if component == 1:
        closed1 = update_lock(par, mem, o.length, v1, h)
    elif component == 2:
        closed2 = update_lock(par, mem, o.angle, w1, h)
    start_imposed_motion(par, mem, 0, o.length)
    start_imposed_motion(par, mem, 1, o.angle)
    b1 = prescribed_rate(par, mem, 0, o.length, v1, h, closed1, sp.free[0], sp.s[0])
    b2 = prescribed_rate(par, mem, 1, o.angle, w1, h, closed2, sp.free[1], sp.s[2])
    return PosedFreeAxes(sp, b1, b2, (closed1, closed2), reliable_restitution(par, mem))


@inline_function
def complete_free_axes(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, q: PosedFreeAxes,
    found: LimitedSolution, h: float, unsettled: bool,
) -> FreeAxes:  # fmt: skip
    """Forces by component for the solution ``found``; ``mem`` is updated for the next step.

    ``unsettled``: tables and compliant stops have not been solved.
    """
    restitution = 0.0
    if has_stops(par, 0) or has_stops(par, 1):
        restitution = _store_impact(mem, 0, found.slide, found.sides[0])
        restitution = max(restitution, _store_impact(mem, 1, found.spin, found.sides[1]))
    solved, blocked = found.solved, found.blocked
    lock = int(par[model.LOCK]) if q.closed[0] or q.closed[1] else 0
    if lock != 0 and is_held_against_drive(par, mem, o, q.sp, lock - 1, h, solved.end):
        blocked = True
    _store_friction(par, mem, o, solved, h)
    advance_imposed_motion(par, mem, h)
    v1, w1 = o.twist.v[0], o.twist.w[0]
    k1, kr, c1, cr = _coefficients(par, mem, r, h)
    u1, ur = _elongation(par, mem, o, h)
    end, actuation = solved.end, (imposed_force(par, 0), imposed_force(par, 1))
    spring = (-k1 * (u1 + 0.25 * h * (v1 + end[0])), -kr * (ur + 0.25 * h * (w1 + end[1])))
    damper = (-0.5 * c1 * (v1 + end[0]), -0.5 * cr * (w1 + end[1]))
    stop = stop_bits(found.contacts[0]) | stop_bits(found.contacts[1]) << 2
    if has_any_element(par):
        one, two = elements_of(par, mem, o, r, h, 0), elements_of(par, mem, o, r, h, 1)
        spring = (spring[0] + one.spring, spring[1] + two.spring)
        damper = (damper[0] + one.damper, damper[1] + two.damper)
        stop |= stop_bits(one.side) | stop_bits(two.side) << 2
        p, q2 = solved.reaction
        solved = FreeAxesSolution(
            end, solved.friction, (p + one.stop, q2 + two.stop), solved.regime, solved.flags,
            solved.s_mean, solved.residual,
        )  # fmt: skip
    f1 = spring[0] + damper[0] + actuation[0] + solved.friction[0] + solved.reaction[0]
    m1 = spring[1] + damper[1] + actuation[1] + solved.friction[1] + solved.reaction[1]
    mem[model.LAST_FREE_FORCES], mem[model.LAST_FREE_FORCES + 1] = f1, m1
    for k in range(2):
        moved = found.drive[k] if is_motion_imposed(par, k) else 0.0
        mem[model.LAST_ACTUATION + k] = actuation[k] + moved
    flags = layout.DRIVE_BLOCKED if blocked else 0
    if unsettled:
        flags |= layout.NOT_CONVERGED
    return FreeAxes(
        spring, damper, actuation, solved, reactions(r, f1, m1), stop, lock, restitution, flags
    )


@inline_function
def _solve_undriven(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, q: PosedFreeAxes, h: float,
    explicit: bool,
) -> LimitedSolution:  # fmt: skip
    """Friction and stops where no drive can be held back."""
    rates, b1, b2 = (o.twist.v[0], o.twist.w[0]), q.b1, q.b2
    side1, side2 = -1 if b1.low == b1.high else 0, -1 if b2.low == b2.high else 0
    free = solve_case(par, mem, o, rates, r, q.sp, h, explicit, side1, b1, side2, b2, BY_RULE)
    solved, sides = free, (side1, side2)
    slide, spin = without_stops(b1), without_stops(b2)
    if has_stops(par, 0) or has_stops(par, 1):
        slide, spin = with_stops(par, mem, o, r, q.sp, h, explicit, b1, b2, free, q.eps)
        is_free = side1 == 0 and side2 == 0
        solved, sides, slide, spin = solve_with_stops(
            par, mem, o, r, q.sp, h, explicit, slide, spin, free, is_free
        )
    contacts = (0 if side1 != 0 else sides[0], 0 if side2 != 0 else sides[1])
    return LimitedSolution(solved, sides, contacts, slide, spin, solved.reaction, False)


@inline_function
def _elongation(par: Array, mem: Array, o: RelativeState, h: float) -> Two:
    """u1mat (m) and ur1mat (rad): elongations from the constitutive reference, when they act."""
    ref, lag = model.REFERENCE, lag_of(par, mem, h)
    u1 = o.length - model.value_or(par[ref + 2], mem[model.LENGTH0])
    ur = o.angle - model.value_or(par[ref + 3], mem[model.ANGLE0])
    if lag > 0.0:
        return u1 + lag * o.twist.v[0], ur + lag * o.twist.w[0]
    return u1, ur


@inline_function
def _coefficients(
    par: Array, mem: Array, r: ReducedStep, h: float
) -> tuple[float, float, float, float]:
    """k1, kr1, c1, cr1, weakened where the lag requires it (core/free_gain.py)."""
    at, lag = model.ELASTICITY, lag_of(par, mem, h)
    slide, spin = r.a[0] / h, r.a[2] / h
    return (
        stable_stiffness(par[at], slide, lag),
        stable_stiffness(par[at + 1], spin, lag),
        stable_damping(par[at + 2], slide, lag),
        stable_damping(par[at + 3], spin, lag),
    )


@inline_function
def with_springs(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, h: float, actuation: Two
) -> StepWithSprings:
    """Include spring and damper, push - E w+ with E = k h/4 + c/2: S = (I + hA E)^-1 hA."""
    k1, kr, c1, cr = _coefficients(par, mem, r, h)
    v1, w1 = o.twist.v[0], o.twist.w[0]
    u1, ur = _elongation(par, mem, o, h)
    e1, er = 0.25 * k1 * h + 0.5 * c1, 0.25 * kr * h + 0.5 * cr
    push1 = actuation[0] - k1 * (u1 + 0.25 * h * v1) - 0.5 * c1 * v1
    push2 = actuation[1] - kr * (ur + 0.25 * h * w1) - 0.5 * cr * w1
    a11, a12, a22 = r.a
    if has_any_element(par):
        more1, more2 = add_elements(par, mem, o, r, h)
        push1, push2 = push1 + more1[0], push2 + more2[0]
        e1, er = e1 + more1[1], er + more2[1]
    elif e1 == 0.0 and er == 0.0:
        x = r.free[0] + a11 * actuation[0] + a12 * actuation[1]
        y = r.free[1] + a12 * actuation[0] + a22 * actuation[1]
        return StepWithSprings(actuation, (0.0, 0.0), (x, y), r.a)
    x = r.free[0] + a11 * push1 + a12 * push2
    y = r.free[1] + a12 * push1 + a22 * push2
    det = (1.0 + a11 * e1) * (1.0 + a22 * er) - a12 * a12 * e1 * er
    minor = a11 * a22 - a12 * a12
    return StepWithSprings(
        (push1, push2),
        (e1, er),
        (
            ((1.0 + a22 * er) * x - a12 * er * y) / det,
            ((1.0 + a11 * e1) * y - a12 * e1 * x) / det,
        ),
        ((a11 + er * minor) / det, a12 / det, (a22 + e1 * minor) / det),
    )


@inline_function
def _store_impact(mem: Array, k: int, c: StopBounds, side: int) -> float:
    """Store the second step of an impact; returns the restitution that acts in this step.

    There is none if something other than the stop held the component back. After the last step
    the side is stored twice as large: if the next sample is lost, its wrench is taken back too.
    """
    if c.bounds.impact == 0:
        mem[model.PENDING_SIDE + k] = 0.0
        return 0.0
    mem[model.PENDING_SIDE + k] = (1.0 if c.continues else 2.0) * c.bounds.impact if side else 0.0
    mem[model.PENDING_RATE + k] = c.rebound
    mem[model.PENDING_ACCELERATION + k] = c.acceleration
    mem[model.PENDING_TIME + k] = c.time
    mem[model.PENDING_RESTITUTION + k] = c.restitution
    at, friction = model.PENDING_FRICTION + 7 * k, c.friction
    mem[at] = 1.0 if friction.acts else 0.0
    mem[at + 1], mem[at + 2] = friction.rates
    mem[at + 3], mem[at + 4] = friction.before
    mem[at + 5], mem[at + 6] = friction.after
    return c.restitution


@inline_function
def _store_friction(
    par: Array, mem: Array, o: RelativeState, solved: FreeAxesSolution, h: float
) -> None:
    """Store the accumulated slip and the number of samples in stick."""
    if solved.regime == layout.FRICTIONLESS:
        return
    was_stick = mem[model.WAS_STICK] != 0.0
    slip = math.sqrt(solved.s_mean[0] ** 2 + solved.s_mean[1] ** 2)
    if solved.regime == layout.SLIP:
        mem[model.ACCUMULATED_SLIP] += slip * h
        mem[model.STICK_SAMPLES] = 0.0
    else:
        if not was_stick:
            mem[model.ACCUMULATED_SLIP] += slip * h
        mem[model.STICK_SAMPLES] += 1.0
    mem[model.WAS_STICK] = 1.0 if solved.regime == layout.STICK else 0.0


@inline_function
def write_state(
    par: Array,
    mem: Array,
    out: Array,
    o: RelativeState,
    r: ReducedStep,
    av: FreeAxes,
    force: Vector,
    moment: Vector,
    h: float,
) -> None:
    """Write forces, their components and the friction state to ``out``."""
    write_forces(out, force, moment)
    out[layout.FORCE_ELASTIC], out[layout.MOMENT_ELASTIC] = av.spring
    out[layout.FORCE_VISCOUS], out[layout.MOMENT_VISCOUS] = av.damper
    out[layout.FORCE_FRICTION], out[layout.MOMENT_FRICTION] = av.solved.friction
    out[layout.FORCE_ACTUATION], out[layout.MOMENT_ACTUATION] = av.actuation
    out[layout.FORCE_REACTION], out[layout.MOMENT_REACTION] = av.solved.reaction
    out[layout.STOP], out[layout.LOCK], out[layout.RESTITUTION] = av.stop, av.lock, av.restitution
    law = model.law(par)
    pressed = contact(law, av.constraint)
    out[layout.REGIME] = av.solved.regime
    out[layout.ACCUMULATED_SLIP] = mem[model.ACCUMULATED_SLIP]
    out[layout.STOP_TIME] = -1.0
    if not law.on:
        write_contact(out, pressed, 0.0, 0.0, 0.0)
        return
    rate = out[layout.SLIP_RATE] if av.solved.regime == layout.SLIP else 0.0
    q = av.solved.friction[1] / law.radius
    c = cosine(law, (av.solved.friction[0], q))
    mu = coefficient(law, par, rate, pressed.normal) * share_of(law, c)
    greatest = limit(law, par, rate, pressed.normal, c)
    traction = math.sqrt(av.solved.friction[0] ** 2 + q * q)
    if av.solved.regime == layout.SLIP:
        greatest = traction  # P = limit: mu at the mean slip rate of the step
        if pressed.normal > 0.0 and traction < law.cap:
            mu = traction / pressed.normal
    write_contact(out, pressed, mu, greatest, traction)
    if av.solved.regime == layout.STICK and mem[model.STICK_SAMPLES] == 1.0:
        out[layout.STOP_TIME] = _time_to_rest(law, par, o, r, av, h)


@inline_function
def _time_to_rest(
    law: Law, par: Array, o: RelativeState, r: ReducedStep, av: FreeAxes, h: float
) -> float:
    """|s| / |ds/dt| with friction against the slip velocity, s, at most the period."""
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
    p, jammed, _ = least_traction(law, par, base, by, 1.0, size, s1 / size, math.inf)
    if jammed or not math.isfinite(p):
        return 0.0
    f1, m1 = push[0] + p * x, push[1] + p * y
    d1 = r.free[0] + r.a[0] * f1 + r.a[1] * m1 - s1
    d2 = law.radius * (r.free[1] + r.a[1] * f1 + r.a[2] * m1) - s2
    slowing = -(d1 * s1 + d2 * s2) / size
    if not slowing > size:  # does not stop within the period
        return h
    return h * size / slowing
