"""The drive of method penalty: a spring-damper between a component and a position that moves.

The position xd approaches the imposed one at no more than the approach speed and then follows it,
or moves at the imposed velocity; the force is -k (x - xd) - c (w - vd), at most max_force. It does
not move beyond a stop, and where the force is at its limit it stays at the distance at which the
spring-damper has just that force: what holds the motion back does not load the spring further.
"""

import math
from typing import NamedTuple

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function


class DriveForce(NamedTuple):
    """Force of the drive of one component."""

    force: float  # N or N.m
    stop: int  # the stop that holds its position back: 1 lower, 2 upper, 0 none
    blocked: bool


@inline_function
def is_moved_from(par: Array, k: int, at: float) -> bool:
    """Whether the imposed motion of component k leads away from the position ``at``."""
    position, rate = par[model.COMMAND + 3 * k], par[model.COMMAND + 3 * k + 1]
    return model.value_or(rate, 0.0) != 0.0 or model.value_or(position, at) != at


@device_function
def drive_force(
    par: Array, mem: Array, k: int, x: float, w: float, h: float, stiff: float, damp: float
) -> DriveForce:
    """The force of component k at position x and rate w, with the gains ``stiff`` and ``damp``."""
    command, drive = model.COMMAND + 3 * k, model.DRIVE + 2 * k
    most, reach = par[drive], h * par[drive + 1]
    rate, at = model.value_or(par[command + 1], 0.0), mem[model.DRIVE_POSITION + k]
    follows = rate
    if not math.isnan(par[command]):
        move = min(max(mem[model.IMPOSED_POSITION + k] - at, -reach), reach)
        at, follows = at + move, rate + move / h
    low, high = par[model.STOPS + 2 * k], par[model.STOPS + 2 * k + 1]
    stop, blocked = 0, False
    if at + h * rate < low:
        at, stop, blocked = low, 1, follows < 0.0
        follows = rate = max(rate, 0.0)
    elif at + h * rate > high:
        at, stop, blocked = high, 2, follows > 0.0
        follows = rate = min(rate, 0.0)
    force = -stiff * (x - at) - damp * (w - follows)
    if abs(force) > most:
        force = math.copysign(most, force)
        if stiff > 0.0:
            at = x + (force + damp * (w - follows)) / stiff
    mem[model.DRIVE_POSITION + k] = at + h * rate
    return DriveForce(force, stop, blocked)
