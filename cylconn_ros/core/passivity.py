"""Passivity observer: work of the wrenches on the measured motion (Hannaford and Ryu, 2002).

    W = sum f . dx + h tau . (w + w+)/2        of both bodies, at their mass centres

A change of position that the twists do not explain is a jump, not motion: the body was teleported
or the simulation was reset while the stamps kept running. For the interval of a jump the motion is
integrated from the twists, the change of spring energy is excluded from the balance, and the stick
position is taken from the next sample.
"""

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import inline_function
from cylconn_ros.core.vectors import Vector, dot

JUMP_SHARE = 0.08  # largest squared difference, as a share of both squared motions


@inline_function
def has_jumped(par: Array, moved: Vector, predicted: Vector, apart: float, h: float) -> bool:
    """Whether a change of position ``moved`` within h is a jump.

    ``predicted``: the change that the twists give. ``apart``: the square of their difference, m^2.
    A jump exceeds JUMP_SHARE of both motions and the constraint correction within h.
    """
    least = par[model.PULL_IN] * h
    return apart > JUMP_SHARE * (dot(moved, moved) + dot(predicted, predicted)) + least * least


@inline_function
def add_work(mem: Array, work: float) -> None:
    """Add the work of one wrench on one body."""
    mem[model.WORK] += work
    mem[model.WORK_EXCHANGED] += abs(work)


@inline_function
def reset_stick_position(mem: Array) -> None:
    """Make the next sample define the position that stick holds."""
    mem[model.STICK_SAMPLES] = min(mem[model.STICK_SAMPLES], 1.0)
