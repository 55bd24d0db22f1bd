"""Loads, preload and imposed motion or force over time, as continuous functions.

Five factors multiply, in this order: load on A, load on B, preload, what is imposed on slide, on
spin. Between two kinks each is

    a(t) = value + slope (t - start) + sine sin(omega t + phase)

An integration ends at a kink, so that every step is smooth. The accelerations of an imposed
position, a'' times it, and of an imposed velocity, a' times it, are those of the prescribed rates.
"""

import math
from typing import Final

from cylconn_ros.core import friction, model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import allocating_function
from cylconn_ros.core.joint_limits import Two
from cylconn_ros.methods.minimal import coordinates
from cylconn_ros.methods.minimal.coordinates import (
    BASE,
    HELD,
    IMPOSED_ACCELERATION,
    LOADS,
    LONGEST_STEP,
    OVER_TIME,
    PIECES,
)

FACTORS: Final = 5
PIECE: Final = 6  # numbers of a factor
PRELOAD: Final = 12  # in BASE, after the loads
COMMAND: Final = 13


@allocating_function
def _factor(joint: Array, which: int, t: float) -> tuple[float, float, float]:
    """A factor at t and its first two derivatives."""
    at = PIECES + PIECE * which
    start, value, slope = joint[at], joint[at + 1], joint[at + 2]
    sine, omega = joint[at + 3], joint[at + 4]
    angle = omega * t + joint[at + 5]
    s, c = math.sin(angle), math.cos(angle)
    return (
        value + slope * (t - start) + sine * s,
        slope + sine * omega * c,
        -sine * omega * omega * s,
    )


@allocating_function
def set_time(par: Array, joint: Array, t: float) -> None:
    """Set loads, preload and imposed motion or force in ``joint`` and ``par`` to those at t."""
    if joint[OVER_TIME] == 0.0:
        return
    for body in range(2):
        a = _factor(joint, body, t)[0]
        for k in range(6 * body, 6 * body + 6):
            joint[LOADS + k] = joint[BASE + k] * a
    par[model.FRICTION + friction.PRELOAD] = joint[BASE + PRELOAD] * _factor(joint, 2, t)[0]
    for k in range(2):
        at, base = model.COMMAND + 3 * k, BASE + COMMAND + 3 * k
        a, rate, change = _factor(joint, 3 + k, t)
        acceleration = 0.0
        if not math.isnan(joint[base]):
            par[at] = joint[base] * a
            given = model.value_or(joint[base + 1], 0.0)
            par[at + 1] = joint[base] * rate + given
            acceleration = joint[base] * change
        elif not math.isnan(joint[base + 1]):
            par[at + 1] = joint[base + 1] * a
            acceleration = joint[base + 1] * rate
        par[at + 2] = joint[base + 2] * a
        held = int(joint[HELD]) == k + 1
        joint[IMPOSED_ACCELERATION + k] = 0.0 if held else acceleration


@allocating_function
def prescribed_acceleration(joint: Array, sides: tuple[int, int]) -> Two:
    """Accelerations of slide and spin at limits (``sides`` != 0): zero but of imposed motions."""
    return (
        joint[IMPOSED_ACCELERATION] if sides[0] == 2 else 0.0,
        joint[IMPOSED_ACCELERATION + 1] if sides[1] == 2 else 0.0,
    )


@allocating_function
def longest_step(joint: Array) -> float:
    """Longest step in which no cycle of a sine is missed, s; infinite: no sine."""
    return joint[LONGEST_STEP] if joint[LONGEST_STEP] > 0.0 else math.inf


@allocating_function
def hold(joint: Array, k: int) -> None:
    """Note that a lock holds component k against a motion imposed on it."""
    joint[coordinates.HELD] = k + 1.0
