"""Impacts of slide and spin that overlap: their ideal motion, one impact after the other.

Each impact is divided over two steps (core/impacts.py). If both components hit within them, the
first impact and its friction change rate and acceleration of the other component, hence the time
and the rate of the second impact, which in turn changes the motion of the first component:

    until T1: a-, phi-        from T1 to T2: a1, phi1        from T2 on: a2, phi2

The impulses of friction at T1 and T2 are rho1 P1 and rho2 P2. Friction of a step is that of the
three intervals by their shares of the step, + rho1 p1 + rho2 p2 with the forces of both stops, as
for a single impact (impact_friction.py).

If both begin at one sample, the rates at the end of both steps determine the stops' forces. If the
second begins where the first has its second step, the force of the first stop is that without the
second impact; the motion on which the other component approaches its stop is the ideal one, of
which the state at the sample does not yet have the whole first impact.
"""

import math
from typing import NamedTuple

from cylconn_ros.core import layout, model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.impacts import closes, earliest, first_rate, ideal_end, latest, reached
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.joint_limits import Bounds, Two, gap_of
from cylconn_ros.core.relative_state import RelativeState
from cylconn_ros.methods.free_axes.complementarity import (
    BY_RULE,
    FreeAxesSolution,
    ReducedStep,
    StepWithSprings,
    solve_case,
)
from cylconn_ros.methods.free_axes.impact_friction import (
    NO_IMPACT,
    ImpactFriction,
    impulses,
    shared,
    solve_impact,
)

FREE = Bounds(-math.inf, math.inf, 0, 0)


class StopBounds(NamedTuple):
    """Bounds of one component by its stops, and the impact that begins."""

    bounds: Bounds
    restitution: float  # eps'
    rebound: float  # rate of the gap after the impact
    acceleration: float  # of the gap after it
    time: float  # from the sample to the impact, s
    continues: bool  # whether the impact has another step
    friction: ImpactFriction


class _After(NamedTuple):
    """What follows an impact."""

    restitution: float
    ratio: Two
    rates: Two  # of slide and spin after it
    acceleration: Two
    friction: Two
    certain: bool


@inline_function
def without_stops(b: Bounds) -> StopBounds:
    """The bounds of a component that no stop holds."""
    return StopBounds(b, 0.0, 0.0, 0.0, 0.0, False, NO_IMPACT)


@inline_function
def _begun_at(sp: StepWithSprings, jump: Two) -> StepWithSprings:
    """The step begun with rates that differ by ``jump``."""
    e1, e2 = sp.e[0] * jump[0], sp.e[1] * jump[1]
    s11, s12, s22 = sp.s
    return StepWithSprings(
        (sp.push[0] - e1, sp.push[1] - e2),
        sp.e,
        (
            sp.free[0] + jump[0] - 2.0 * (s11 * e1 + s12 * e2),
            sp.free[1] + jump[1] - 2.0 * (s12 * e1 + s22 * e2),
        ),
        sp.s,
    )


@inline_function
def _case_side(b: Bounds) -> int:
    """The case of a component without its stops: held at a prescribed rate, or free."""
    return -1 if b.low == b.high else 0


@inline_function
def leaving(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, sp: StepWithSprings, h: float,
    explicit: bool, b1: Bounds, b2: Bounds, rates: Two,
) -> FreeAxesSolution:  # fmt: skip
    """The step without its stops that begins with the ``rates`` after the rebound."""
    jump = (rates[0] - o.twist.v[0], rates[1] - o.twist.w[0])
    return solve_case(
        par, mem, o, rates, r, _begun_at(sp, jump), h, explicit,
        _case_side(b1), b1, _case_side(b2), b2, BY_RULE,
    )  # fmt: skip


@device_function
def _after(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, sp: StepWithSprings, h: float,
    explicit: bool, rates: Two, k: int, side: int, eps: float,
) -> _After:  # fmt: skip
    """The impact of component k with ``rates`` before it, the other free, and the motion after."""
    i = impulses(par, r, rates, k, side, eps, False)
    left = leaving(par, mem, o, r, sp, h, explicit, FREE, FREE, i.after)
    a = ((left.end[0] - i.after[0]) / h, (left.end[1] - i.after[1]) / h)
    return _After(i.restitution, i.ratio, i.after, a, left.friction, i.certain)


@inline_function
def _bounds(b: Bounds, side: int, target: float) -> Bounds:
    """The bounds of a component that hits its stop, where the other bound is as in ``b``."""
    if side < 0:
        return Bounds(target, b.high, side, 0)
    return Bounds(b.low, -target, side, 0)


@device_function
def _second(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, sp: StepWithSprings, h: float,
    explicit: bool, j: int, side: int, time: float, rates: Two, before: Two, eps: float,
) -> tuple[StopBounds, _After, bool]:  # fmt: skip
    """The second impact, of component j at ``time`` with ``rates``, and what follows.

    The last is whether it is followed, not closed as a contact.
    """
    after = _after(par, mem, o, r, sp, h, explicit, rates, j, side, eps)
    rebound = max(-side * after.rates[j], 0.0)
    a = -side * after.acceleration[j]
    x, w = (o.length, o.twist.v[0]) if j == 0 else (o.angle, o.twist.w[0])
    ideal = ideal_end(rebound, a, after.restitution, 2.0 * h - time, h, explicit)
    target = first_rate(gap_of(par, j, x, side), -side * w, ideal, h, explicit)
    smooth = shared(time / h, before, after.friction)
    found = StopBounds(
        _bounds(FREE, side, target), after.restitution, rebound, a, time, True,
        ImpactFriction(True, smooth, after.ratio, rates, before, after.friction),
    )  # fmt: skip
    return found, after, after.certain and not closes(rebound, a, after.restitution, h)


@device_function
def begun_together(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, sp: StepWithSprings, h: float,
    one: StopBounds, two: StopBounds, free: FreeAxesSolution, eps: float,
) -> tuple[StopBounds, StopBounds]:  # fmt: skip
    """Both impacts in one motion; as they are if one of them is not followed."""
    k = 0 if one.time <= two.time else 1
    a, b = (one, two) if k == 0 else (two, one)
    j, side, other = 1 - k, a.bounds.impact, b.bounds.impact
    x = (o.length, o.angle)
    w = (o.twist.v[0], o.twist.w[0])
    f = a.friction
    first = _after(par, mem, o, r, sp, h, False, f.rates, k, side, eps)
    before = (free.end[j] - w[j]) / h
    gap = gap_of(par, j, x[j], other) - other * (w[j] * a.time + 0.5 * before * a.time * a.time)
    c = reached(gap, -other * first.rates[j], -other * first.acceleration[j], h, False)
    time = a.time + c.time
    if gap < 0.0 or a.time < earliest(h, False):
        return one, two
    if not time < latest(h, False):
        return (one, without_stops(FREE)) if k == 0 else (without_stops(FREE), two)
    rate = first.rates[k] + first.acceleration[k] * c.time
    away = -side * (first.rates[k] + 0.5 * first.acceleration[k] * c.time) * c.time
    rates = (rate, -other * c.rate) if k == 0 else (-other * c.rate, rate)
    found, after, follows = _second(
        par, mem, o, r, sp, h, False, j, other, time, rates, first.friction, eps
    )
    # the parabola on which the first component is after the second impact, from its stop on
    speed, fall = -side * after.rates[k], -side * after.acceleration[k]
    square = speed * speed - 2.0 * fall * away
    if not follows or away < 0.0 or square < 0.0 or speed <= 0.0:
        return one, two
    rebound = math.sqrt(square)
    since = 2.0 * away / (speed + rebound)
    ideal = ideal_end(rebound, fall, first.restitution, 2.0 * h - time + since, h, False)
    target = first_rate(gap_of(par, k, x[k], side), -side * w[k], ideal, h, False)
    smooth = shared(a.time / h, f.before, first.friction)
    a = StopBounds(
        _bounds(FREE, side, target), first.restitution, rebound, fall, time - since, True,
        ImpactFriction(True, smooth, first.ratio, f.rates, f.before, first.friction),
    )  # fmt: skip
    return (a, found) if k == 0 else (found, a)


@device_function
def begun_after(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, sp: StepWithSprings, h: float,
    k: int, a: StopBounds, b: StopBounds, eps: float,
) -> StopBounds:  # fmt: skip
    """The other component in the second step of the impact ``a`` of component k."""
    j, side = 1 - k, a.bounds.impact
    rates = (o.twist.v[0], o.twist.w[0])
    b1, b2 = (a.bounds, FREE) if k == 0 else (FREE, a.bounds)
    alone, _, holds = solve_impact(par, rates, sp, k, b1, b2, a.friction)
    if not holds:
        return b
    first = _after(par, mem, o, r, sp, h, False, a.friction.rates, k, side, a.restitution)
    x = o.length if j == 0 else o.angle
    begun = alone.end[j] - first.acceleration[j] * h  # of the ideal motion, at the sample
    behind = 0.5 * h * (rates[j] + alone.end[j]) - 0.5 * h * (begun + alone.end[j])
    found, time, hit = 0, latest(h, False), 0.0
    for other in (-1, 1):
        gap = gap_of(par, j, x, other)
        if gap < 0.0:
            return b
        gap -= other * behind
        if gap < math.inf:
            c = reached(gap, -other * begun, -other * first.acceleration[j], h, False)
            if c.time < time:
                found, time, hit = other, c.time, c.rate
    if found == 0:
        return without_stops(FREE) if b.bounds.impact != 0 else b
    if time < earliest(h, False):  # put off to when two wrenches can act, as for a single impact
        time = earliest(h, False)
        hit = -found * (begun + first.acceleration[j] * time)
    rate = alone.end[k] + first.acceleration[k] * (time - h)
    rates = (rate, -found * hit) if k == 0 else (-found * hit, rate)
    before = a.friction.after
    second, _, follows = _second(par, mem, o, r, sp, h, False, j, found, time, rates, before, eps)
    return second if follows else b


@device_function
def solve_two_impacts(
    par: Array, rates: Two, sp: StepWithSprings, one: StopBounds, two: StopBounds
) -> tuple[FreeAxesSolution, bool]:
    """The step of two impacts with their friction, and whether both stops push."""
    s11, s12, s22 = sp.s
    f, g = one.friction, two.friction
    between = g.before if f.after == g.before else f.before
    smooth = (f.smooth[0] + g.smooth[0] - between[0], f.smooth[1] + g.smooth[1] - between[1])
    u, v = (1.0 + f.ratio[0], f.ratio[1]), (g.ratio[0], 1.0 + g.ratio[1])
    by1 = (s11 * u[0] + s12 * u[1], s12 * u[0] + s22 * u[1])  # rates by the stops' forces
    by2 = (s11 * v[0] + s12 * v[1], s12 * v[0] + s22 * v[1])
    free = (
        sp.free[0] + s11 * smooth[0] + s12 * smooth[1],
        sp.free[1] + s12 * smooth[0] + s22 * smooth[1],
    )
    target = (
        one.bounds.low if one.bounds.impact < 0 else one.bounds.high,
        two.bounds.low if two.bounds.impact < 0 else two.bounds.high,
    )
    if one.continues == two.continues:
        d1, d2 = target[0] - free[0], target[1] - free[1]
        det = by1[0] * by2[1] - by1[1] * by2[0]
        p, q = (d1 * by2[1] - d2 * by2[0]) / det, (by1[0] * d2 - by1[1] * d1) / det
        end = target
    else:
        det = 1.0
        k = 1 if one.continues else 0  # its force is that without the other impact
        a = one if k == 0 else two
        b1, b2 = (a.bounds, FREE) if k == 0 else (FREE, a.bounds)
        alone = solve_impact(par, rates, sp, k, b1, b2, a.friction)[0].reaction[k]
        if k == 0:
            p = alone
            q = (target[1] - free[1] - by1[1] * p) / by2[1]
            end = (free[0] + by1[0] * p + by2[0] * q, target[1])
        else:
            q = alone
            p = (target[0] - free[0] - by2[0] * q) / by1[0]
            end = (target[0], free[1] + by1[1] * p + by2[1] * q)
    friction = (
        smooth[0] + f.ratio[0] * p + g.ratio[0] * q,
        smooth[1] + f.ratio[1] * p + g.ratio[1] * q,
    )
    law = model.law(par)
    mean = (0.5 * (rates[0] + end[0]), 0.5 * law.radius * (rates[1] + end[1]))
    found = FreeAxesSolution(end, friction, (p, q), layout.SLIP, 0, mean, 0.0)
    pushes = p * one.bounds.impact < 0.0 and q * two.bounds.impact < 0.0
    return found, pushes and det > 0.0 and by1[0] > 0.0 and by2[1] > 0.0
