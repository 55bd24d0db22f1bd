"""The period for which a wrench is computed: the declared one, or the interval of the stamps.

A wrench that is computed for a period h and acts for r h changes a rate r times as much as it
should: errors are multiplied by 1 - r in every step, and grow from r = 2 on. A declared period that
the samples contradict is therefore replaced by the interval between them once the motion confirms
it. With p, v the position and velocity of a body's origin, v~ one of v-, v and their mean, the
interval t explains the motion if

    |p - p- - t v~|^2 + |2 vec(q q-^-1 dq(t w~)^-1)|^2 (1 m)^2

is less than a quarter (CLEARLY) of its value for the period in use. Stamps of the clock from a
simulator of fixed steps are no times of the motion: they are not confirmed, and the period stays.

The declared period is in use again as soon as an interval agrees with it. Lost samples make an
interval longer once or a few times: CONFIRMED equal ones in succession are needed. If no
interval has agreed with the period in use yet, two are, or one beyond FEW_LOST periods.
"""

from typing import Final

from cylconn_ros.core import layout, model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function
from cylconn_ros.core.relative_state import sample_status
from cylconn_ros.core.vectors import (
    Quaternion,
    Vector,
    add,
    add_scaled,
    conjugate,
    dot,
    multiply,
    scale,
    sub,
    turned,
)

APART: Final = 0.25  # share by which an interval differs from another
CONFIRMED: Final = 4.0  # intervals
FEW_LOST: Final = 3.5  # periods: an interval up to it may be one in which samples were lost
CLEARLY: Final = 0.25
LEAST_MOTION: Final = 1e-9  # m and rad, relative to the distance from the origin plus 1
FOLLOWED: Final = 0.02  # share of an interval in the mean of those in use

_IN_USE: Final = model.PERIOD_IN_USE
_AGREED: Final = model.PERIOD_IN_USE + 1  # whether an interval has agreed with the period in use
_SEEN: Final = model.PERIOD_IN_USE + 2  # s, an interval that differs from it
_TIMES: Final = model.PERIOD_IN_USE + 3  # such intervals in succession that the motion confirms
_STORED: Final = model.PERIOD_IN_USE + 4  # whether SAMPLE_BEFORE is the last sample
_NMOTION: Final = layout.A_LOAD  # poses and twists of both bodies


@inline_function
def agree(a: float, b: float) -> bool:
    """Whether two intervals are equal, but for the scatter of stamps."""
    return abs(a - b) <= APART * min(a, b)


@device_function
def period_in_use(mem: Array, sample: Array, h: float, declared: float) -> float:
    """The period (s) of the coming step.

    Args:
        mem: (NMEM,) memory of the connector, advanced. sample: (NSAMPLE,) the new one.
        h: s since the last sample, 0 if there is none. declared: s, the scene's ``period``, 0 if
            the stamps are to give it.

    The motion of a sample that cannot be used is not compared.
    """
    if declared == 0.0:
        return h
    if h > 0.0 and agree(h, declared):
        mem[_IN_USE] = mem[_TIMES] = mem[_STORED] = 0.0
        mem[_AGREED] = 1.0
        return declared
    in_use = mem[_IN_USE] if mem[_IN_USE] != 0.0 else declared
    again = h <= 0.0 and mem[model.HAS_REFERENCE] != 0.0  # no interval: a period after the last
    if (again and mem[_STORED] == 0.0) or sample_status(sample) != layout.OK:
        return in_use
    if again:
        mem[_STORED] = 0.0
        return in_use
    if h > 0.0:
        in_use = _contradicted(mem, sample, h, declared)
    else:
        mem[_TIMES] = 0.0
    _store(mem, sample)
    return in_use


@device_function
def _store(mem: Array, sample: Array) -> None:
    """Store the motion, which the next one is compared with if its interval is contradicted."""
    for k in range(_NMOTION):
        mem[model.SAMPLE_BEFORE + k] = sample[k]
    mem[_STORED] = 1.0


@device_function
def _contradicted(mem: Array, sample: Array, h: float, declared: float) -> float:
    """As :func:`period_in_use`, of an interval that is not the declared one."""
    in_use = mem[_IN_USE] if mem[_IN_USE] != 0.0 else declared
    if agree(h, in_use):
        in_use += FOLLOWED * (h - in_use)
        mem[_IN_USE], mem[_AGREED], mem[_TIMES] = in_use, 1.0, 0.0
        return in_use
    if not (mem[_TIMES] > 0.0 and agree(h, mem[_SEEN])):
        mem[_SEEN], mem[_TIMES] = h, 0.0
    found = _confirms(mem, sample, h, in_use)
    if found < 0:
        mem[_TIMES] = 0.0
    elif found > 0:
        mem[_TIMES] += 1.0
    needed = 2.0 if in_use < h < FEW_LOST * in_use else 1.0
    if mem[_TIMES] >= (CONFIRMED if mem[_AGREED] != 0.0 else needed):
        mem[_IN_USE], mem[_AGREED], mem[_TIMES] = h, 1.0, 0.0
        return h
    return in_use


@device_function
def _confirms(mem: Array, sample: Array, h: float, other: float) -> int:
    """1 if the motion since the last sample took ``h``, -1 if ``other``, 0 if neither is clear."""
    if mem[_STORED] == 0.0:
        return 0
    last = mem[model.SAMPLE_BEFORE : model.SAMPLE_BEFORE + _NMOTION]
    by_h = by_other = 0.0
    for at in (layout.A_POSE, layout.B_POSE):
        by_h += _misfit(last, sample, at, h)
        by_other += _misfit(last, sample, at, other)
    if by_h < CLEARLY * by_other:
        return 1
    return -1 if by_other < CLEARLY * by_h else 0


@device_function
def _misfit(last: Array, sample: Array, at: int, t: float) -> float:
    """Square of what a body moved (m, rad) besides its twists times t; 0 if that is rounding."""
    place, before = model.vector(sample, at), model.vector(last, at)
    moved = sub(place, before)
    q, q_before = model.quaternion(sample, at + 3), model.quaternion(last, at + 3)
    v, w = model.vector(sample, at + 7), model.vector(sample, at + 10)
    v_before, w_before = model.vector(last, at + 7), model.vector(last, at + 10)
    size = dot(moved, moved)
    shift = _shift(moved, v, t)
    shift = min(shift, _shift(moved, v_before, t))
    shift = min(shift, _shift(moved, scale(0.5, add(v, v_before)), t))
    turn = _turn(q, q_before, w, t)
    turn = min(turn, _turn(q, q_before, w_before, t))
    turn = min(turn, _turn(q, q_before, scale(0.5, add(w, w_before)), t))
    least = LEAST_MOTION * LEAST_MOTION
    if max(size, shift) <= least * (1.0 + dot(place, place)):
        shift = 0.0
    if turn <= least:
        turn = 0.0
    return shift + turn


@inline_function
def _shift(moved: Vector, v: Vector, t: float) -> float:
    """Square of what a motion (m) is besides v t."""
    rest = add_scaled(moved, -t, v)
    return dot(rest, rest)


@inline_function
def _turn(q: Quaternion, before: Quaternion, w: Vector, t: float) -> float:
    """Square of twice the sine of half the angle between a turn and w t."""
    rest = multiply(q, conjugate(turned(before, scale(t, w))))
    return 4.0 * (rest[0] * rest[0] + rest[1] * rest[1] + rest[2] * rest[2])
