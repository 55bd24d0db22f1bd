"""One integration step: explicit (DOP853), or implicit (Radau IIA) for slow slip."""

import math
from typing import NamedTuple

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import allocating_function
from cylconn_ros.core.joint_limits import Two
from cylconn_ros.methods.minimal import coordinates
from cylconn_ros.methods.minimal.derivatives import size_of, stage_derivatives
from cylconn_ros.methods.minimal.dop853 import E3, E5, LAST_STAGE_DIFFERENCE, STAGES, A, B, C
from cylconn_ros.methods.minimal.forces import Sides
from cylconn_ros.methods.minimal.radau import stiff_error, stiff_step

DIRECTION_SHARE = 1e-3  # greatest error of the rates, relative to the slip rate


class ContactState(NamedTuple):
    """The equations that hold, and their integration method."""

    stuck: bool
    sides: Sides
    locked: bool
    stiff: bool
    beyond_limit: bool  # sticks beyond the friction limit, since slip would jam at once
    until: float  # s: sticks at least until this time, so that the integration advances


class StepResult(NamedTuple):
    """A step: length (0: no finite force), length of the next, error norm, evaluations."""

    h: float
    next: float
    error: float
    evaluations: int


@allocating_function
def step(
    par: Array, joint: Array, t: float, y: Array, h: float, s: ContactState, slip: float, k: Array,
    new: Array, system: Array,
) -> bool:  # fmt: skip
    """One step into ``new`` (k[0]: derivatives at its start); False if no force is finite."""
    if s.stiff:
        radius = model.law(par).radius
        return stiff_step(par, joint, t, y, h, s.sides, slip, radius, k, new, system)
    n, row = size_of(joint), 0  # the equations do not depend on the integrals
    for stage in range(1, STAGES):
        row += stage - 1
        for i in range(n):
            new[i] = y[i]
        for j in range(stage):
            share = h * A[row + j]
            if share != 0.0:
                for i in range(n):
                    new[i] += share * k[j, i]
        if stage_derivatives(par, joint, t + C[stage] * h, new, s.stuck, s.sides, k[stage]):
            return False
    new[:] = y
    for j in range(STAGES):
        share = h * B[j]
        if share != 0.0:
            for i in range(y.shape[0]):
                new[i] += share * k[j, i]
    return True


@allocating_function
def _error_norm(
    y: Array, new: Array, k: Array, h: float, n: int, tolerance: float, rate_tolerance: Two
) -> float:
    """Estimated error over the allowed one: Hairer's combination of orders 5 and 3."""
    fifth, third = 0.0, 0.0
    for i in range(n):
        e5, e3 = 0.0, 0.0
        for j in range(STAGES):
            e5 += E5[j] * k[j, i]
            e3 += E3[j] * k[j, i]
        allowed = tolerance * (0.1 + max(abs(y[i]), abs(new[i])))
        if i == coordinates.SLIDE or i == coordinates.SPIN:
            allowed = min(allowed, rate_tolerance[i - coordinates.SLIDE])
        fifth += (e5 / allowed) ** 2
        third += (e3 / allowed) ** 2
    if fifth == 0.0:
        return 0.0
    return abs(h) * fifth / math.sqrt((fifth + 0.01 * third) * n)


@allocating_function
def stiffness_estimate(h: float, slip: float, radius: float, k: Array) -> float:
    """Stiffness of friction on the slip direction, 1/s, estimated from an explicit step.

    Its last stage (k[STAGES - 1]) and its end (k[STAGES]) are at the same time with slightly
    different rates.
    """
    last = STAGES - 1
    v, w = B[last] * k[last, coordinates.SLIDE], B[last] * k[last, coordinates.SPIN]
    for stage in range(last):
        v += LAST_STAGE_DIFFERENCE[stage] * k[stage, coordinates.SLIDE]
        w += LAST_STAGE_DIFFERENCE[stage] * k[stage, coordinates.SPIN]
    apart = h * math.sqrt(v * v + (radius * w) ** 2)
    if apart <= 1e-14 * slip:  # rounding
        return 0.0
    a, b = (
        k[STAGES, coordinates.SLIDE] - k[last, coordinates.SLIDE],
        k[STAGES, coordinates.SPIN] - k[last, coordinates.SPIN],
    )
    return math.sqrt(a * a + (radius * b) ** 2) / apart


@allocating_function
def adaptive_step(
    par: Array, joint: Array, t: float, y: Array, h: float, s: ContactState, slip: float,
    least: float, floor: float, tolerance: float, before: Two, k: Array, new: Array,
    system: Array,
) -> StepResult:  # fmt: skip
    """A step of at most h within the tolerance, into ``new``.

    slip: |s| at the start, m/s. The error of both rates is at most DIRECTION_SHARE of it whatever
    the tolerance, so that slow slip keeps its direction. least: if no step of this length has
    finite forces, none has. floor: a step of this length is taken even if it exceeds the tolerance.
    before: length and error of the last step, 0: none. They give the trend: towards rest each step
    is shorter than the last (Gustafsson's predictive controller).
    """
    n, evaluations, failed = size_of(joint), 0, False
    law = model.law(par)
    rate_tolerance = (math.inf, math.inf)
    if law.on and not s.stuck and slip > 0.0:
        rate_tolerance = (DIRECTION_SHARE * slip, DIRECTION_SHARE * slip / law.radius)
    power = -0.25 if s.stiff else -0.125
    while True:
        evaluations += 30 if s.stiff else STAGES
        if not step(par, joint, t, y, h, s, slip, k, new, system):
            failed = True
            if h <= max(least, floor):
                return StepResult(0.0, h, math.inf, evaluations)
            h = max(0.25 * h, min(h, floor))
            continue
        e = (
            stiff_error(y, new, k, n, tolerance, rate_tolerance)
            if s.stiff
            else _error_norm(y, new, k, h, n, tolerance, rate_tolerance)
        )
        if e <= 1.0 or h <= max(least, floor):
            grown = min(10.0, 0.9 * e**power) if e > 0.0 else 10.0
            if before[0] > 0.0 and before[1] > 0.0 and e > 0.0:
                trend = 0.9 * h / before[0] * (before[1] / e) ** -power * e**power
                grown = min(grown, trend)
            if failed:  # close to a state without finite forces
                grown = min(grown, 1.0)
            return StepResult(h, h * max(grown, 0.2), e, evaluations)
        h = max(h * max(0.2, 0.9 * e**power), min(h, floor)) if e < math.inf else 0.25 * h
