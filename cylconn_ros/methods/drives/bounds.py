"""Imposed motion with a greatest force, within stops and locks: one more bound on slide and spin.

The drive of a component with the target rate t and the greatest force F has the force d with

    w+ = t, |d| <= F     it holds its target        w+ < t, d = F  or  w+ > t, d = -F   it gives way

and its states (hold, +F, -F) are cases besides those of stops and friction
(methods/free_axes/complementarity.py). In each of them contacts with the stops are those of the
motion under the drive's force. A stop wins over the drive: a target beyond the bound that the stop
sets is replaced by the bound. There the reactions of drive and stop are one number, of which the
drive has what presses onto the stop.
"""

import math

from cylconn_ros.core import layout, model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.joint_limits import (
    Bounds,
    Two,
    drive_limit,
    has_stops,
    is_at_rest,
    is_motion_imposed,
    prescribed_rate,
)
from cylconn_ros.core.relative_state import RelativeState
from cylconn_ros.methods.free_axes.complementarity import (
    BY_RULE,
    FreeAxesSolution,
    ReducedStep,
    StepWithSprings,
    solve_case,
    solve_with_limits,
)
from cylconn_ros.methods.free_axes.contacts import (
    LimitedSolution,
    by_the_disc,
    stop_bounds,
    with_stops,
)
from cylconn_ros.methods.free_axes.impact_friction import NO_IMPACT
from cylconn_ros.methods.free_axes.two_impacts import StopBounds, without_stops

BLOCKED = 1e-9  # of target and pull-in speed: smallest difference from a target that is a conflict
ROUNDING = 1e-12  # relative, of forces and rates that are compared with a drive's
FREE = Bounds(-math.inf, math.inf, 0, 0)


@inline_function
def is_driven(par: Array, k: int, locked: bool) -> bool:
    """Whether a motion is imposed on component k that a stop or a greatest force can hold back."""
    return (
        is_motion_imposed(par, k)
        and not locked
        and (has_stops(par, k) or drive_limit(par, k) < math.inf)
    )


@inline_function
def differs(par: Array, k: int, target: float, rate: float) -> bool:
    """Whether a rate differs from the drive's target by more than rounding."""
    return abs(target - rate) > BLOCKED * (abs(target) + par[model.PULL_IN + k])


@inline_function
def _pushed(sp: StepWithSprings, d: Two) -> StepWithSprings:
    """The step with the forces ``d`` of the drives among the loads."""
    s11, s12, s22 = sp.s
    return StepWithSprings(
        (sp.push[0] + d[0], sp.push[1] + d[1]),
        sp.e,
        (sp.free[0] + s11 * d[0] + s12 * d[1], sp.free[1] + s12 * d[0] + s22 * d[1]),
        sp.s,
    )


@device_function
def clipped(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, sp: StepWithSprings, h: float,
    explicit: bool, k: int, b1: Bounds, b2: Bounds, eps: float,
) -> tuple[StopBounds, int]:  # fmt: skip
    """The target rate of component k within the bounds of its stops, and the stop that holds it.

    After an impact the drive is at its greatest force, towards the stop, until it holds its target.
    """
    b = b1 if k == 0 else b2
    w = o.twist.v[0] if k == 0 else o.twist.w[0]
    if not has_stops(par, k):
        return without_stops(b), 0
    most = drive_limit(par, k)
    if most < math.inf:
        most = most if w + b.low > 0.0 else -most
        sp = _pushed(sp, (most, 0.0) if k == 0 else (0.0, most))
        b1 = FREE if k == 0 else b1
        b2 = FREE if k == 1 else b2
    ends = (b.low, o.twist.w[0]) if k == 0 else (o.twist.v[0], b.low)
    c = stop_bounds(par, mem, o, r, sp, h, explicit, k, b1, b2, ends, (0.0, 0.0), eps)
    low, high = c.bounds.low, c.bounds.high
    if low <= b.low <= high:
        return without_stops(b), 0
    side = -1 if b.low < low else 1
    held = low if side < 0 else high
    rest = 1 if is_at_rest(par, k, w, held, b.low - w) else 0
    bounds = Bounds(held, held, c.bounds.impact, rest)
    return (
        StopBounds(
            bounds, c.restitution, c.rebound, c.acceleration, c.time, c.continues, NO_IMPACT
        ),
        side,
    )


@inline_function
def _violation(
    state: int, target: float, most: float, contact: int, rate: float, force: float, yields: float
) -> float:
    """Violation of the drive's conditions in its state (0, 1, -1), as a rate.

    force: of drive and stop together where it holds its target or a stop (contact -1, 1).
    """
    if state != 0:
        return max(state * (rate - target) - ROUNDING * (abs(rate) + abs(target)), 0.0)
    above = 0.0 if contact < 0 else force - most
    below = 0.0 if contact > 0 else -force - most
    return yields * max(above - ROUNDING * most, below - ROUNDING * most, 0.0)


@inline_function
def drive_share(state: int, most: float, contact: int, force: float) -> float:
    """The drive's force."""
    if state != 0:
        return state * most
    if contact > 0:
        return max(force, 0.0)
    return min(force, 0.0) if contact < 0 else force


@device_function
def solve_driven(
    par: Array, mem: Array, o: RelativeState, r: ReducedStep, sp: StepWithSprings, h: float,
    explicit: bool, b1: Bounds, b2: Bounds, eps: float, driven: tuple[bool, bool],
) -> LimitedSolution:  # fmt: skip
    """Friction, stops and drives of one step, by enumeration of the drives' states.

    b1, b2: bounds without stops; of a driven component its target rate. The case that violates
    its conditions least is taken if rounding leaves none without violation.
    """
    rates = (o.twist.v[0], o.twist.w[0])
    most = (
        drive_limit(par, 0) if driven[0] else math.inf,
        drive_limit(par, 1) if driven[1] else math.inf,
    )
    target = (b1.low, b2.low)
    least = math.inf
    none = without_stops(b1)
    zero = FreeAxesSolution(rates, (0.0, 0.0), (0.0, 0.0), layout.FRICTIONLESS, 0, (0.0, 0.0), 0.0)
    best = LimitedSolution(zero, (0, 0), (0, 0), none, none, (0.0, 0.0), False)
    for choice in range(9):
        state1, state2 = (0, 1, -1)[choice % 3], (0, 1, -1)[choice // 3]
        if (state1 != 0 and most[0] == math.inf) or (state2 != 0 and most[1] == math.inf):
            continue
        pushed = (
            state1 * most[0] if state1 != 0 else 0.0,
            state2 * most[1] if state2 != 0 else 0.0,
        )
        here = _pushed(sp, pushed)
        c1 = FREE if state1 != 0 else b1
        c2 = FREE if state2 != 0 else b2
        side1, side2 = -1 if c1.low == c1.high else 0, -1 if c2.low == c2.high else 0
        free = solve_case(par, mem, o, rates, r, here, h, explicit, side1, c1, side2, c2, BY_RULE)
        slide, spin = with_stops(par, mem, o, r, here, h, explicit, c1, c2, free, eps)
        contact1, contact2 = 0, 0
        if driven[0] and state1 == 0:
            slide, contact1 = clipped(par, mem, o, r, here, h, explicit, 0, c1, c2, eps)
        if driven[1] and state2 == 0:
            spin, contact2 = clipped(par, mem, o, r, here, h, explicit, 1, c1, c2, eps)
        is_free = side1 == 0 and side2 == 0
        slide, spin = by_the_disc(slide), by_the_disc(spin)
        solved, sides = solve_with_limits(
            par, mem, o, r, here, h, explicit, slide.bounds, spin.bounds, free, is_free
        )
        f, g = solved.reaction
        if not (driven[0] and state1 == 0):
            contact1 = sides[0] if slide.bounds.low != slide.bounds.high or state1 != 0 else 0
        if not (driven[1] and state2 == 0):
            contact2 = sides[1] if spin.bounds.low != spin.bounds.high or state2 != 0 else 0
        wrong = 0.0
        blocked = False
        d1, d2 = 0.0, 0.0
        if driven[0]:
            wrong = _violation(state1, target[0], most[0], contact1, solved.end[0], f, sp.s[0])
            blocked = contact1 != 0 and differs(par, 0, target[0], solved.end[0])
            d1 = drive_share(state1, most[0], contact1, f)
        if driven[1]:
            bad = _violation(state2, target[1], most[1], contact2, solved.end[1], g, sp.s[2])
            wrong = max(wrong, bad)
            blocked = blocked or (contact2 != 0 and differs(par, 1, target[1], solved.end[1]))
            d2 = drive_share(state2, most[1], contact2, g)
        if wrong < least:
            least = wrong
            whole = FreeAxesSolution(
                solved.end, solved.friction, (f + pushed[0], g + pushed[1]), solved.regime,
                solved.flags, solved.s_mean, solved.residual,
            )  # fmt: skip
            best = LimitedSolution(
                whole, sides, (contact1, contact2), slide, spin, (d1, d2), blocked
            )
        if wrong <= 0.0:
            break
    return best


@device_function
def is_held_against_drive(
    par: Array, mem: Array, o: RelativeState, sp: StepWithSprings, k: int, h: float, end: Two
) -> bool:
    """Whether the lock of component k holds it against a motion that is imposed on it."""
    if not is_motion_imposed(par, k):
        return False
    x, w = (o.length, o.twist.v[0]) if k == 0 else (o.angle, o.twist.w[0])
    yields = sp.s[0] if k == 0 else sp.s[2]
    wanted = prescribed_rate(par, mem, k, x, w, h, False, sp.free[k], yields).low
    return differs(par, k, wanted, end[k])
