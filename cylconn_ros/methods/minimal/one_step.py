"""One step of the integration, explicit (DOP853) or, through slow slip, implicit (Radau IIA)."""

import math
from typing import NamedTuple

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function
from cylconn_ros.core.joint_limits import Two
from cylconn_ros.methods.minimal import coordinates as at
from cylconn_ros.methods.minimal.derivatives import rates_of_stage, size_of
from cylconn_ros.methods.minimal.dop853 import AT_END, E3, E5, STAGES, A, B, C
from cylconn_ros.methods.minimal.forces import Sides
from cylconn_ros.methods.minimal.radau import stiff_error, stiff_step

DIRECTION = 1e-3  # of the slip rate, by which a step may change its direction wrongly


class State(NamedTuple):
    """Which equations hold, and how they are integrated."""

    stuck: bool
    sides: Sides
    locked: bool
    stiff: bool
    held: bool  # stuck beyond what friction may, since slip would jam at once
    until: float  # s: stuck until then whatever may be, for the sake of progress


class Tried(NamedTuple):
    """A step: its length (0: none has a finite force), the next one's, its error, evaluations."""

    h: float
    next: float
    error: float
    evaluations: int


@device_function
def step(
    par: Array, joint: Array, t: float, y: Array, h: float, s: State, slip: float, k: Array,
    new: Array, system: Array,
) -> bool:  # fmt: skip
    """One step into ``new`` (k[0]: the rates at its start); whether it could be made."""
    if s.stiff:
        radius = model.law(par).radius
        return stiff_step(par, joint, t, y, h, s.sides, slip, radius, k, new, system)
    n, row = size_of(joint), 0  # the equations know nothing of the integrals
    for stage in range(1, STAGES):
        row += stage - 1
        for i in range(n):
            new[i] = y[i]
        for j in range(stage):
            share = h * A[row + j]
            if share != 0.0:
                for i in range(n):
                    new[i] += share * k[j, i]
        if rates_of_stage(par, joint, t + C[stage] * h, new, s.stuck, s.sides, k[stage]):
            return False
    new[:] = y
    for j in range(STAGES):
        share = h * B[j]
        if share != 0.0:
            for i in range(y.shape[0]):
                new[i] += share * k[j, i]
    return True


@device_function
def _error(y: Array, new: Array, k: Array, h: float, n: int, tolerance: float, slow: Two) -> float:
    """The estimated error of a step over what is allowed: Hairer's mixture of orders 5 and 3."""
    fifth, third = 0.0, 0.0
    for i in range(n):
        e5, e3 = 0.0, 0.0
        for j in range(STAGES):
            e5 += E5[j] * k[j, i]
            e3 += E3[j] * k[j, i]
        allowed = tolerance * (0.1 + max(abs(y[i]), abs(new[i])))
        if i == at.SLIDE or i == at.SPIN:
            allowed = min(allowed, slow[i - at.SLIDE])
        fifth += (e5 / allowed) ** 2
        third += (e3 / allowed) ** 2
    if fifth == 0.0:
        return 0.0
    return abs(h) * fifth / math.sqrt((fifth + 0.01 * third) * n)


@device_function
def stiffness_shown(h: float, slip: float, radius: float, k: Array) -> float:
    """How fast friction pulls the direction of slip into place, 1/s, as an explicit step shows it.

    Its last stage (k[STAGES - 1]) and the whole of it (k[STAGES]) are at the same time, a little
    apart.
    """
    last = STAGES - 1
    v, w = B[last] * k[last, at.SLIDE], B[last] * k[last, at.SPIN]
    for stage in range(last):
        v += AT_END[stage] * k[stage, at.SLIDE]
        w += AT_END[stage] * k[stage, at.SPIN]
    apart = h * math.sqrt(v * v + (radius * w) ** 2)
    if apart <= 1e-14 * slip:  # rounding
        return 0.0
    a, b = k[STAGES, at.SLIDE] - k[last, at.SLIDE], k[STAGES, at.SPIN] - k[last, at.SPIN]
    return math.sqrt(a * a + (radius * b) ** 2) / apart


@device_function
def ahead(
    par: Array, joint: Array, t: float, y: Array, h: float, s: State, slip: float,
    least: float, floor: float, tolerance: float, before: Two, k: Array, new: Array,
    system: Array,
) -> Tried:  # fmt: skip
    """A step of at most h within tolerance into ``new``.

    ``slip`` at its start; the two rates may not be off by more than a share of it whatever the
    tolerance, so that slow slip keeps its direction. ``least``: where no step of this length has
    finite forces, none has; ``floor``: where none is within tolerance, it is taken. ``before``
    (length and error of the last step, 0: none) tells the trend: towards rest each step is shorter
    than the last (Gustafsson's predictive controller).
    """
    n, evaluations, failed = size_of(joint), 0, False
    law = model.law(par)
    slow = (math.inf, math.inf)
    if law.on and not s.stuck and slip > 0.0:
        slow = (DIRECTION * slip, DIRECTION * slip / law.radius)
    power = -0.25 if s.stiff else -0.125
    while True:
        evaluations += 30 if s.stiff else STAGES
        if not step(par, joint, t, y, h, s, slip, k, new, system):
            failed = True
            if h <= max(least, floor):
                return Tried(0.0, h, math.inf, evaluations)
            h = max(0.25 * h, min(h, floor))
            continue
        e = (
            stiff_error(y, new, k, n, tolerance, slow)
            if s.stiff
            else _error(y, new, k, h, n, tolerance, slow)
        )
        if e <= 1.0 or h <= max(least, floor):
            grown = min(10.0, 0.9 * e**power) if e > 0.0 else 10.0
            if before[0] > 0.0 and before[1] > 0.0 and e > 0.0:
                trend = 0.9 * h / before[0] * (before[1] / e) ** -power * e**power
                grown = min(grown, trend)
            if failed:  # what lies ahead is near
                grown = min(grown, 1.0)
            return Tried(h, h * max(grown, 0.2), e, evaluations)
        h = max(h * max(0.2, 0.9 * e**power), min(h, floor)) if e < math.inf else 0.25 * h
