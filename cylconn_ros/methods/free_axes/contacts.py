"""Contacts of slide and spin with their stops within one step: which begin, and their targets.

The accelerations before and after an impact (core/impacts.py) are those of the step without the
contact, with friction as solved: a1 of the step itself, a2 of a step that begins after the rebound,
where friction has turned round.
"""

import math
from typing import NamedTuple

from cylconn_ros.core import model
from cylconn_ros.core.delay import feedback_gain
from cylconn_ros.core.free_gain import free_gain
from cylconn_ros.core.friction import Array
from cylconn_ros.core.impacts import (
    bounces,
    bounded_gap,
    closes,
    earliest,
    first_rate,
    ideal_end,
    latest,
    reached,
)
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.joint_limits import (
    REST_SHARE,
    ROUNDING,
    Bounds,
    Two,
    contact_rate,
    gap_of,
    has_stops,
    is_at_rest,
    lowered_contact,
)
from cylconn_ros.core.relative_state import RelativeState
from cylconn_ros.methods.free_axes.complementarity import (
    FreeAxesSolution,
    ReducedStep,
    StepWithSprings,
    solve_with_limits,
)
from cylconn_ros.methods.free_axes.impact_friction import (
    NO_IMPACT,
    ImpactFriction,
    impulses,
    shared,
    solve_impact,
)
from cylconn_ros.methods.free_axes.two_impacts import (
    StopBounds,
    begun_after,
    begun_together,
    leaving,
    solve_two_impacts,
    without_stops,
)

LEAST_FEEDBACK = 0.8  # gain of the feedback below which impacts have no second step
LOST = 1.2  # periods between two samples above which one was lost


class LimitedSolution(NamedTuple):
    """Friction and the reactions of stops, locks and drives of one step."""

    solved: FreeAxesSolution
    sides: tuple[int, int]  # -1, 1: at the lower, upper bound; -1 also at a prescribed rate
    contacts: tuple[int, int]  # -1, 1: in contact with that stop
    slide: StopBounds
    spin: StopBounds
    drive: Two  # forces of imposed motions, N and N.m
    blocked: bool  # a stop holds a component against its imposed motion


@inline_function
def _pulled_in(par: Array, mem: Array, k: int, x: float, w: float, h: float) -> Two:
    """Least and greatest rate where a stop is passed already."""
    low, high = -math.inf, math.inf
    below, above = gap_of(par, k, x, -1), gap_of(par, k, x, 1)
    if below < 0.0:
        low = contact_rate(par, mem, k, below, w, h)
    if above < 0.0:
        high = -contact_rate(par, mem, k, above, -w, h)
    return low, high


@inline_function
def _one_sided(b: Two, side: int, target: float, impact: int, rest: int) -> Bounds:
    """The bounds ``b`` with the gap's target rate at the lower (-1) or upper (1) stop."""
    low, high = b
    if side < 0:
        low = target
    else:
        high = -target
    if low > high:  # stops closer than the step resolves: hold the middle
        low = high = 0.5 * (low + high)
    return Bounds(low, high, impact, rest)


@inline_function
def _second_step(
    par: Array, mem: Array, r: ReducedStep, k: int, x: float, w: float, h: float, explicit: bool,
    other_fixed: bool,
) -> StopBounds:  # fmt: skip
    """Bounds of an impact's second step; a return to the stop within reach follows at once."""
    side = -1 if mem[model.PENDING_SIDE + k] < 0.0 else 1
    elapsed = mem[model.LAST_PERIOD]
    rebound, a = mem[model.PENDING_RATE + k], mem[model.PENDING_ACCELERATION + k]
    eps = mem[model.PENDING_RESTITUTION + k]
    t = elapsed + h - mem[model.PENDING_TIME + k]
    gap, rate = gap_of(par, k, x, side), -side * w
    passed = mem[model.PENDING_TIME + k] - elapsed
    if elapsed > LOST * h:  # the last wrench acted for too long: it is taken back
        back = -side * ideal_end(rebound, a, eps, t, h, explicit)[1]
        bounds = Bounds(back, back, side, 0)
        return StopBounds(bounds, eps, rebound, a, passed, False, NO_IMPACT)
    both = _pulled_in(par, mem, k, x, w, h)
    before = t - 2.0 * h + latest(h, explicit)
    again = bounces(rebound, a, eps, before + h) != bounces(rebound, a, eps, before)
    ideal = ideal_end(rebound, a, eps, t + h if again else t, h, explicit)
    friction = NO_IMPACT
    if ideal[0] == 0.0 and ideal[1] == 0.0:
        target = contact_rate(par, mem, k, gap, rate, h)
    else:
        target = first_rate(gap, rate, ideal, h, explicit) if again else ideal[1]
        friction = _kept_friction(par, mem, r, k, side, eps, passed / h, other_fixed)
    bounds = _one_sided(both, side, target, side, 0)
    return StopBounds(bounds, eps, rebound, a, passed, again, friction)


@inline_function
def _kept_friction(
    par: Array, mem: Array, r: ReducedStep, k: int, side: int, eps: float, share: float,
    other_fixed: bool,
) -> ImpactFriction:  # fmt: skip
    """Friction of an impact's second step, of which ``share`` passes before the impact."""
    at = model.PENDING_FRICTION + 7 * k
    if mem[at] == 0.0:
        return NO_IMPACT
    rates = (mem[at + 1], mem[at + 2])
    before, after = (mem[at + 3], mem[at + 4]), (mem[at + 5], mem[at + 6])
    i = impulses(par, r, rates, k, side, eps, other_fixed)
    return ImpactFriction(i.certain, shared(share, before, after), i.ratio, rates, before, after)


@device_function
def stop_bounds(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, sp: StepWithSprings, h: float,
    explicit: bool, k: int, b1: Bounds, b2: Bounds, ends: Two, friction: Two, eps: float,
) -> StopBounds:  # fmt: skip
    """Bounds of component k by its stops.

    b1, b2: bounds without stops; ends: rates at the end of the step without the stops of k, and
    the friction in it.
    """
    end = ends[0] if k == 0 else ends[1]
    other_fixed = b2.low == b2.high if k == 0 else b1.low == b1.high
    x, w = (o.length, o.twist.v[0]) if k == 0 else (o.angle, o.twist.w[0])
    if free_gain(par, mem) < 1.0:
        return without_stops(lowered_contact(par, mem, k, x, w, h))
    pending = abs(mem[model.PENDING_SIDE + k])
    if pending == 1.0 or (pending > 1.0 and mem[model.LAST_PERIOD] > LOST * h):
        return _second_step(par, mem, r, k, x, w, h, explicit, other_fixed)
    both = _pulled_in(par, mem, k, x, w, h)
    side, found = 0, reached(math.inf, 0.0, 0.0, h, explicit)
    for s in (-1, 1):
        gap, rate, change = gap_of(par, k, x, s), -s * w, -s * (sp.free[k] - w)
        if not gap < math.inf:
            continue
        target = contact_rate(par, mem, k, gap, rate, h)
        reach = REST_SHARE * abs(change) * h + ROUNDING * par[model.PULL_IN + k] * h
        still = is_at_rest(par, k, w, 0.0, change)
        if change < 0.0 and abs(gap) <= reach and still:
            return without_stops(_one_sided(both, s, target, 0, s))
        if gap < 0.0 and still:  # beyond the stop: pulled in, whatever the sign of its rounding
            continue
        if feedback_gain(par, mem) < LEAST_FEEDBACK:
            both_now = _one_sided(both, s, target, 0, 0)
            both = (both_now.low, both_now.high)
            continue
        c = reached(gap, rate, -s * (end - w) / h, h, explicit)
        if c.time < latest(h, explicit) and c.time < found.time:
            side, found = s, c
    if side == 0:
        return without_stops(Bounds(both[0], both[1], 0, 0))

    a1, gap, rate = -side * (end - w) / h, gap_of(par, k, x, side), -side * w
    time, hit = found.time, found.rate
    rates = _rates_at(o, ends, time / h, k, -side * hit)
    i = impulses(par, r, rates, k, side, eps, other_fixed)
    eps, rebound = i.restitution, -i.restitution * hit
    left = leaving(par, mem, o, r, sp, h, explicit, b1, b2, i.after)
    a2 = (-side * (left.end[0] if k == 0 else left.end[1]) - rebound) / h
    if closes(rebound, a2, eps, h):
        target = contact_rate(par, mem, k, gap, rate, h)
        bounds = _one_sided(both, side, target, side, 0)
        return StopBounds(bounds, 0.0, 0.0, 0.0, time, True, NO_IMPACT)
    if gap < 0.0 or time < earliest(h, explicit):
        time = max(time, earliest(h, explicit))
        gap, hit = bounded_gap(rate, a1, time, h, explicit)
        rebound = max(-eps * hit, 0.0)
    ideal = ideal_end(rebound, a2, eps, 2.0 * h - time, h, explicit)
    target = first_rate(gap, rate, ideal, h, explicit)
    smooth = shared(time / h, friction, left.friction)
    acts = model.law(par).on and i.certain
    return StopBounds(
        _one_sided(both, side, target, side, 0), eps, rebound, a2, time, True,
        ImpactFriction(acts, smooth, i.ratio, rates, friction, left.friction),
    )  # fmt: skip


@inline_function
def _rates_at(o: RelativeState, ends: Two, share: float, k: int, hit: float) -> Two:
    """Rates of slide and spin at an impact of component k, which has ``hit``."""
    v1, w1 = o.twist.v[0], o.twist.w[0]
    if k == 0:
        return hit, w1 + share * (ends[1] - w1)
    return v1 + share * (ends[0] - v1), hit


@inline_function
def with_stops(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, sp: StepWithSprings, h: float,
    explicit: bool, b1: Bounds, b2: Bounds, free: FreeAxesSolution, eps: float,
) -> tuple[StopBounds, StopBounds]:  # fmt: skip
    """Bounds of both components; those without stops, or with a prescribed rate, keep theirs.

    ``free``: the step without stops.
    """
    one, two = without_stops(b1), without_stops(b2)
    if has_stops(par, 0) and b1.low != b1.high:
        one = stop_bounds(par, mem, o, r, sp, h, explicit, 0, b1, b2, free.end, free.friction, eps)
    if has_stops(par, 1) and b2.low != b2.high:
        two = stop_bounds(par, mem, o, r, sp, h, explicit, 1, b1, b2, free.end, free.friction, eps)
    if explicit or not (one.friction.acts or two.friction.acts):
        return one, two
    goes_on = (abs(mem[model.PENDING_SIDE]) == 1.0, abs(mem[model.PENDING_SIDE + 1]) == 1.0)
    if not goes_on[0] and not goes_on[1]:
        if one.friction.acts and two.friction.acts:
            return begun_together(par, mem, o, r, sp, h, one, two, free, eps)
    elif goes_on[0] != goes_on[1] and b1.low != b1.high and b2.low != b2.high:
        k = 0 if goes_on[0] else 1
        a, b = (one, two) if k == 0 else (two, one)
        if a.friction.acts and not a.continues and b.bounds.rest == 0 and has_stops(par, 1 - k):
            b = begun_after(par, mem, o, r, sp, h, k, a, b, eps)
            return (a, b) if k == 0 else (b, a)
    return one, two


@inline_function
def solve_with_stops(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, sp: StepWithSprings, h: float,
    explicit: bool, slide: StopBounds, spin: StopBounds, free: FreeAxesSolution, is_free: bool,
) -> tuple[FreeAxesSolution, tuple[int, int], StopBounds, StopBounds]:  # fmt: skip
    """The solution within the bounds, the side of each component, and the bounds that act.

    The friction of an impact is that of its ideal motion; where that does not fit, the disc decides
    as in any other step.
    """
    b1, b2 = slide.bounds, spin.bounds
    rates = (o.twist.v[0], o.twist.w[0])
    if slide.friction.acts and spin.friction.acts:
        found, holds = solve_two_impacts(par, rates, sp, slide, spin)
        if holds:
            return found, (b1.impact, b2.impact), slide, spin
    if slide.friction.acts != spin.friction.acts:
        k = 0 if slide.friction.acts else 1
        friction = slide.friction if k == 0 else spin.friction
        other = b2 if k == 0 else b1
        if other.rest == 0 and other.impact == 0:
            found, sides, holds = solve_impact(par, rates, sp, k, b1, b2, friction)
            if holds:
                return found, sides, slide, spin
    found, sides = solve_with_limits(par, mem, o, r, sp, h, explicit, b1, b2, free, is_free)
    return found, sides, by_the_disc(slide), by_the_disc(spin)


@inline_function
def by_the_disc(c: StopBounds) -> StopBounds:
    """The same bounds, of an impact whose friction is on the disc."""
    return StopBounds(
        c.bounds, c.restitution, c.rebound, c.acceleration, c.time, c.continues, NO_IMPACT
    )
