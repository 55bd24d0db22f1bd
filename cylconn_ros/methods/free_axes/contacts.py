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
    BY_RULE,
    FreeAxesSolution,
    ReducedStep,
    StepWithSprings,
    solve_case,
)

LEAST_FEEDBACK = 0.8  # gain of the feedback below which impacts have no second step
LOST = 1.2  # periods between two samples above which one was lost


class StopBounds(NamedTuple):
    """Bounds of one component by its stops, and the impact that begins."""

    bounds: Bounds
    restitution: float  # eps'
    rebound: float  # rate of the gap after the impact
    acceleration: float  # of the gap after it
    time: float  # from the sample to the impact, s
    continues: bool  # whether the impact has another step


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
def without_stops(b: Bounds) -> StopBounds:
    """The bounds of a component that no stop holds."""
    return StopBounds(b, 0.0, 0.0, 0.0, 0.0, False)


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
def _jump(sp: StepWithSprings, k: int, change: float, other_fixed: bool) -> Two:
    """Changes of both rates by an impulse on component k that changes its rate by ``change``."""
    if k == 0:
        return (change, 0.0 if other_fixed else change * sp.s[1] / sp.s[0])
    return (0.0 if other_fixed else change * sp.s[1] / sp.s[2], change)


@inline_function
def _case_side(b: Bounds) -> int:
    """The case of a component without its stops: held at a prescribed rate, or free."""
    return -1 if b.low == b.high else 0


@device_function
def restitution_without_gain(
    par: Array, mem: Array, o: RelativeState, rates: Two, r: ReducedStep, sp: StepWithSprings,
    h: float, explicit: bool, k: int, b1: Bounds, b2: Bounds, eps: float,
) -> float:  # fmt: skip
    """The largest restitution <= eps for which the impact does not increase the kinetic energy.

    rates: at the impact. Friction and coupled inertias could otherwise add energy: the work of the
    impulses on slide and spin, (phi + p).(w- + w+)/2 with w+ = -eps w- of component k, must be
    <= 0.
    """
    low, high = 0.0, eps
    side1 = -1 if k == 0 else _case_side(b1)
    side2 = -1 if k == 1 else _case_side(b2)
    for attempt in range(40):
        now = high if attempt == 0 else 0.5 * (low + high)
        leaving = -now * rates[k]
        c1 = Bounds(leaving, leaving, 0, 0) if k == 0 else b1
        c2 = Bounds(leaving, leaving, 0, 0) if k == 1 else b2
        s = solve_case(par, mem, o, rates, r, sp, h, explicit, side1, c1, side2, c2, BY_RULE)
        work = (s.friction[0] + s.reaction[0]) * (rates[0] + s.end[0])
        work += (s.friction[1] + s.reaction[1]) * (rates[1] + s.end[1])
        if work <= 0.0:
            low = now
            if attempt == 0:
                break
        else:
            high = now
    return low


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
    par: Array, mem: Array, k: int, x: float, w: float, h: float, explicit: bool
) -> StopBounds:
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
        return StopBounds(Bounds(back, back, side, 0), eps, rebound, a, passed, False)
    both = _pulled_in(par, mem, k, x, w, h)
    before = t - 2.0 * h + latest(h, explicit)
    again = bounces(rebound, a, eps, before + h) != bounces(rebound, a, eps, before)
    ideal = ideal_end(rebound, a, eps, t + h if again else t, h, explicit)
    if ideal[0] == 0.0 and ideal[1] == 0.0:
        target = contact_rate(par, mem, k, gap, rate, h)
    elif again:
        target = first_rate(gap, rate, ideal, h, explicit)
    else:
        target = ideal[1]
    return StopBounds(_one_sided(both, side, target, side, 0), eps, rebound, a, passed, again)


@device_function
def stop_bounds(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, sp: StepWithSprings, h: float,
    explicit: bool, k: int, b1: Bounds, b2: Bounds, end: float, eps: float,
) -> StopBounds:  # fmt: skip
    """Bounds of component k by its stops.

    b1, b2: bounds without stops; end: rate of k at the end of the step without its stops.
    """
    x, w = (o.length, o.twist.v[0]) if k == 0 else (o.angle, o.twist.w[0])
    if free_gain(par, mem) < 1.0:
        return without_stops(lowered_contact(par, mem, k, x, w, h))
    pending = abs(mem[model.PENDING_SIDE + k])
    if pending == 1.0 or (pending > 1.0 and mem[model.LAST_PERIOD] > LOST * h):
        return _second_step(par, mem, k, x, w, h, explicit)
    both = _pulled_in(par, mem, k, x, w, h)
    side, found = 0, reached(math.inf, 0.0, 0.0, h, explicit)
    for s in (-1, 1):
        gap, rate, change = gap_of(par, k, x, s), -s * w, -s * (sp.free[k] - w)
        if not gap < math.inf:
            continue
        target = contact_rate(par, mem, k, gap, rate, h)
        reach = REST_SHARE * abs(change) * h + ROUNDING * par[model.PULL_IN + k] * h
        if change < 0.0 and abs(gap) <= reach and is_at_rest(par, k, w, 0.0, change):
            return without_stops(_one_sided(both, s, target, 0, s))
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
    other_fixed = b2.low == b2.high if k == 0 else b1.low == b1.high
    time, hit = found.time, found.rate
    if eps > 0.0:
        eps = _reduced(
            par, mem, o, r, sp, h, explicit, k, b1, b2, side, rate, hit, eps
        )  # fmt: skip
    rebound = -eps * hit
    a2 = _leaving(
        par, mem, o, r, sp, h, explicit, k, b1, b2, side, rebound - rate, rebound, other_fixed
    )
    if closes(rebound, a2, eps, h):
        target = contact_rate(par, mem, k, gap, rate, h)
        return StopBounds(_one_sided(both, side, target, side, 0), 0.0, 0.0, 0.0, time, True)
    if gap < 0.0 or time < earliest(h, explicit):
        time = max(time, earliest(h, explicit))
        gap, hit = bounded_gap(rate, a1, time, h, explicit)
        rebound = max(-eps * hit, 0.0)
    ideal = ideal_end(rebound, a2, eps, 2.0 * h - time, h, explicit)
    target = first_rate(gap, rate, ideal, h, explicit)
    return StopBounds(_one_sided(both, side, target, side, 0), eps, rebound, a2, time, True)


@inline_function
def _reduced(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, sp: StepWithSprings, h: float,
    explicit: bool, k: int, b1: Bounds, b2: Bounds, side: int, rate: float, hit: float,
    eps: float,
) -> float:  # fmt: skip
    """Eps' of an impact at the rate ``hit`` of the gap."""
    change = -side * (hit - rate)
    jump = (change, 0.0) if k == 0 else (0.0, change)
    rates = (o.twist.v[0] + jump[0], o.twist.w[0] + jump[1])
    return restitution_without_gain(
        par, mem, o, rates, r, _begun_at(sp, jump), h, explicit, k, b1, b2, eps
    )


@inline_function
def _leaving(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, sp: StepWithSprings, h: float,
    explicit: bool, k: int, b1: Bounds, b2: Bounds, side: int, change: float, rebound: float,
    other_fixed: bool,
) -> float:  # fmt: skip
    """Acceleration of the gap in a step that begins after the rebound."""
    jump = _jump(sp, k, -side * change, other_fixed)
    rates = (o.twist.v[0] + jump[0], o.twist.w[0] + jump[1])
    s = solve_case(
        par, mem, o, rates, r, _begun_at(sp, jump), h, explicit,
        _case_side(b1), b1, _case_side(b2), b2, BY_RULE,
    )  # fmt: skip
    return (-side * s.end[k] - rebound) / h


@inline_function
def with_stops(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, sp: StepWithSprings, h: float,
    explicit: bool, b1: Bounds, b2: Bounds, end: Two, eps: float,
) -> tuple[StopBounds, StopBounds]:  # fmt: skip
    """Bounds of both components; those without stops, or with a prescribed rate, keep theirs."""
    one, two = without_stops(b1), without_stops(b2)
    if has_stops(par, 0) and b1.low != b1.high:
        one = stop_bounds(par, mem, o, r, sp, h, explicit, 0, b1, b2, end[0], eps)
    if has_stops(par, 1) and b2.low != b2.high:
        two = stop_bounds(par, mem, o, r, sp, h, explicit, 1, b1, b2, end[1], eps)
    return one, two
