"""Stops, locks and imposed motion: bounds on the rate of slide and spin at the end of the step.

A bound at distance ``gap`` with the gap's rate w (negative: approaching) requires w+ >= t, and its
reaction p satisfies 0 <= p _|_ w+ - t >= 0. The targets t are those that one held wrench per step
can reach:

    contact          t = -gap/h - w/2            reaches the bound at rest, in two steps
    impact           two steps, see core/impacts.py
    lock, motion     w+ = vc - (x - xc)/h - (w - vc)/2, bilateral

An impact begins if the stop is reached within one and a half steps (one, if positions follow the
end velocity: semi-implicit plant) under the acceleration of everything but the stop; that of the
free case of methods/free_axes/complementarity.py. A contact closes where the series of bounces ends
within a step. A component is free where neither holds. Violations are removed at no more than the
pull-in speed.
"""

import math
from typing import Final, NamedTuple

from cylconn_ros.core import model
from cylconn_ros.core.delay import (
    correction_share,
    feedback_gain,
    rate_share,
)
from cylconn_ros.core.free_gain import free_gain
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function

Two = tuple[float, float]
REST_SHARE: Final = 1e-6  # of the change of rate in a step, below which a held component rests
ROUNDING: Final = 1e-13  # of the pull-in speed


class Bounds(NamedTuple):
    """Least and greatest rate at the end of the step; equal: prescribed.

    ``impact``: -1 or 1 if an impact at the lower or upper stop begins. ``rest``: the side (1: also
    of a prescribed rate) at which the component is at rest, so that friction does not slip there.
    """

    low: float
    high: float
    impact: int
    rest: int


class ActiveLimits(NamedTuple):
    """Slide and spin with the active limits eliminated; phi is friction alone.

    w+ = free + S phi and phi + p = q0 + q1 phi1 + q2 phi2, p the reactions; components (v1, w1),
    (f1, m1).
    """

    free: Two
    s: tuple[float, float, float]  # 11, 12, 22
    q0: Two
    q1: Two
    q2: Two


@inline_function
def _contact_rate(
    gap: float, w: float, h: float, pull: float, explicit: bool, alpha: float
) -> float:
    """The contact target t, with the gain alpha of its feedback."""
    if alpha < 1.0:
        kept = (1.0 - alpha) * (1.0 - alpha) * min(w, 0.0)
        share = alpha * alpha
        rise = min((-gap if gap > 0.0 else -share * gap) / h, pull)
        return rise + kept - (0.0 if explicit else 0.5 * share * w)
    rise = min(-gap / h, pull)
    return rise if explicit else rise - 0.5 * w


@inline_function
def _lowered_rate(x: float, w: float, h: float, pull: float, most: float, alpha: float) -> float:
    """The rate at the end of a step with the gain alpha < 1 towards x = 0 (core/free_gain.py).

    pull, most: greatest speeds towards x = 0 from below and from above.
    """
    return w - alpha * (w + min(max(0.25 * alpha * x / h, -pull), most))


@inline_function
def _target_rate(
    par: Array, mem: Array, x: float, w: float, at: float, rate: float, h: float, pull: float,
    deceleration: float,
) -> float:  # fmt: skip
    """The rate that brings x onto the position ``at`` of a bilateral target with ``rate``.

    pull: greatest speed of the approach; deceleration: at which it can be stopped.
    """
    explicit = model.output(par).semi_implicit
    alpha = free_gain(par, mem)
    if deceleration < math.inf:
        pull = min(pull, stoppable_speed(abs(at - x), deceleration, h))
    if alpha < 1.0:
        return rate + _lowered_rate(x - at, w - rate, h, pull, pull, alpha)
    if deceleration < math.inf:
        back = correction_share(par, mem) * (at - x) / h
        back -= rate_share(par, mem, explicit) * (w - rate)
        return rate + min(max(back, -pull), pull)
    pull = max(pull, 1.5 * abs(w - rate))  # deceleration is not limited
    back = min(max(correction_share(par, mem) * (at - x) / h, -pull), pull)
    return rate + back - rate_share(par, mem, explicit) * (w - rate)


@inline_function
def stoppable_speed(distance: float, deceleration: float, h: float) -> float:
    """The speed at the end of a step from which a deceleration stops within the distance.

    v with v^2/(2a) + v h/2 = distance; distance/h where the deceleration is large.
    """
    half = 0.5 * deceleration * h
    return (
        2.0
        * deceleration
        * distance
        / (half + math.sqrt(half * half + 2.0 * deceleration * distance))
    )


@inline_function
def is_at_rest(par: Array, k: int, w: float, target: float, change: float) -> bool:
    """Whether rate and target of a held component are rounding.

    change: of its rate in a step if nothing held it, without friction.
    """
    least = REST_SHARE * abs(change) + ROUNDING * par[model.PULL_IN + k]
    return abs(w) <= least and abs(target) <= least


@inline_function
def _prescribed(par: Array, k: int, w: float, rate: float, change: float) -> Bounds:
    return Bounds(rate, rate, 0, 1 if is_at_rest(par, k, w, rate, change) else 0)


@device_function
def prescribed_rate(
    par: Array, mem: Array, k: int, x: float, w: float, h: float, locked: bool, free: float,
    yields: float,
) -> Bounds:  # fmt: skip
    """Bounds of component k (0 slide, 1 spin) at position x and rate w without its stops.

    free: the rate at the end of the step without friction and reactions; yields: its change by a
    unit of force.
    """
    if locked:
        at, pull = mem[model.LOCK_POSITION], par[model.PULL_IN + k]
        rate = _target_rate(par, mem, x, w, at, 0.0, h, pull, math.inf)
        return _prescribed(par, k, w, rate, free - w)
    command = model.COMMAND + 3 * k
    rate = par[command + 1]
    if not math.isnan(par[command]):
        at, pull = mem[model.IMPOSED_POSITION + k], par[model.DRIVE + 2 * k + 1]
        most = drive_limit(par, k) * yields / h  # acceleration by the drive alone
        if most < math.inf:  # what else acts may push on, up to a part of it
            most = 0.8 * max(most - abs(free - w) / h, 0.1 * most)
        rate = _target_rate(par, mem, x, w, at, model.value_or(rate, 0.0), h, pull, most)
        return _prescribed(par, k, w, rate, free - w)
    if not math.isnan(rate):
        rate += (1.0 - free_gain(par, mem)) * (w - rate)
        return _prescribed(par, k, w, rate, free - w)
    return Bounds(-math.inf, math.inf, 0, 0)


@inline_function
def has_stops(par: Array, k: int) -> bool:
    """Whether component k has a stop."""
    return par[model.STOPS + 2 * k] > -math.inf or par[model.STOPS + 2 * k + 1] < math.inf


@inline_function
def stop_bits(side: int) -> int:
    """Stop of a component that is in contact: 1 the lower, 2 the upper, 0 none."""
    if side < 0:
        return 1
    return 2 if side > 0 else 0


@inline_function
def gap_of(par: Array, k: int, x: float, side: int) -> float:
    """Distance of component k at x from its lower (-1) or upper (1) stop."""
    at = model.STOPS + 2 * k
    return x - par[at] if side < 0 else par[at + 1] - x


@inline_function
def contact_rate(par: Array, mem: Array, k: int, gap: float, w: float, h: float) -> float:
    """The contact target t of a gap with the rate w."""
    explicit = model.output(par).semi_implicit
    pull = par[model.PULL_IN + k]
    return _contact_rate(gap, w, h, pull, explicit, feedback_gain(par, mem))


@inline_function
def lowered_contact(par: Array, mem: Array, k: int, x: float, w: float, h: float) -> Bounds:
    """Bounds by the stops with a gain alpha < 1 (core/free_gain.py), without restitution."""
    pull, gain = par[model.PULL_IN + k], free_gain(par, mem)
    below, above = gap_of(par, k, x, -1), gap_of(par, k, x, 1)
    low = _lowered_rate(below, w, h, pull, math.inf, gain)
    return Bounds(low, max(low, -_lowered_rate(above, -w, h, pull, math.inf, gain)), 0, 0)


@inline_function
def is_motion_imposed(par: Array, k: int) -> bool:
    """Whether a motion is imposed on component k."""
    at = model.COMMAND + 3 * k
    return not (math.isnan(par[at]) and math.isnan(par[at + 1]))


@inline_function
def drive_limit(par: Array, k: int) -> float:
    """The greatest force or moment of the motion imposed on component k; infinite: no limit."""
    return par[model.DRIVE + 2 * k]


@inline_function
def imposed_force(par: Array, k: int) -> float:
    """The force or moment imposed on component k, with the constant one that resists it."""
    return model.value_or(par[model.COMMAND + 3 * k + 2], 0.0) - par[model.OFFSET + k]


@inline_function
def start_imposed_motion(par: Array, mem: Array, k: int, x: float) -> None:
    """An imposed motion starts from its commanded position, else from the present one."""
    if math.isnan(mem[model.IMPOSED_POSITION + k]) or mem[model.LAST_PERIOD] == 0.0:
        mem[model.IMPOSED_POSITION + k] = model.value_or(par[model.COMMAND + 3 * k], x)
        mem[model.DRIVE_POSITION + k] = x


@inline_function
def advance_imposed_motion(par: Array, mem: Array, h: float) -> None:
    """Advance the positions of imposed motions by their velocities."""
    for k in range(2):
        mem[model.IMPOSED_POSITION + k] += h * model.value_or(par[model.COMMAND + 3 * k + 1], 0.0)


@device_function
def update_lock(par: Array, mem: Array, x: float, w: float, h: float) -> bool:
    """Close the lock if its criterion is met; whether it is closed.

    By position: the component passes the position, or will within a step and a half, and is locked
    there. By force: the force exceeds the criterion, and the component is locked where it can be
    brought to rest within the step.
    """
    if mem[model.LOCKED] != 0.0:
        return True
    k = int(par[model.LOCK]) - 1
    position, force = par[model.LOCK + 1], par[model.LOCK + 2]
    last = mem[model.LAST_LOCK_POSITION]
    mem[model.LAST_LOCK_POSITION] = x
    away = x - position
    if not math.isnan(position):
        passed = mem[model.LAST_PERIOD] > 0.0 and away * (last - position) <= 0.0
        if passed or (away * w < 0.0 and abs(away) < 1.5 * h * abs(w)):
            mem[model.LOCKED], mem[model.LOCK_POSITION] = 1.0, position
            return True
    if not math.isnan(force) and abs(mem[model.LAST_FREE_FORCES + k]) > force:
        rest = 0.0 if model.output(par).semi_implicit else 0.5 * h * w
        mem[model.LOCKED], mem[model.LOCK_POSITION] = 1.0, x + rest
        return True
    return False


@inline_function
def eliminate_limits(
    free: Two, s: tuple[float, float, float], sides: tuple[int, int], t: Two
) -> ActiveLimits:
    """Eliminate the components whose side is not 0: their rate at the end of the step is t."""
    s11, s12, s22 = s
    if sides[0] == 0 and sides[1] == 0:
        return ActiveLimits(free, s, (0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
    d1, d2 = t[0] - free[0], t[1] - free[1]
    none = (0.0, 0.0, 0.0)
    if sides[0] != 0 and sides[1] != 0:
        det = s11 * s22 - s12 * s12
        q0 = ((s22 * d1 - s12 * d2) / det, (s11 * d2 - s12 * d1) / det)
        return ActiveLimits(t, none, q0, (0.0, 0.0), (0.0, 0.0))
    if sides[0] != 0:
        share = s12 / s11
        return ActiveLimits(
            (t[0], free[1] + share * d1),
            (0.0, 0.0, s22 - share * s12),
            (d1 / s11, 0.0),
            (0.0, 0.0),
            (-share, 1.0),
        )
    share = s12 / s22
    return ActiveLimits(
        (free[0] + share * d2, t[1]),
        (s11 - share * s12, 0.0, 0.0),
        (0.0, d2 / s22),
        (1.0, -share),
        (0.0, 0.0),
    )
