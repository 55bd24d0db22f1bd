"""The passivity account: work of the wrenches on the motion that was.

    W = sum f . dx + h tau . (w + w+)/2        of both bodies, at their mass centres

A change of position that the twists cannot explain is no motion: somebody has put the body there,
or a simulation has begun anew under running stamps. In the interval in which a body jumps its
motion is what the twists say, and what the springs take up or give back besides is not theirs.
What sticks is held where it is from then on.
"""

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import inline_function
from cylconn_ros.core.vectors import Vector, dot

UNEXPLAINED = 0.08  # share of the motion's square, seen and told, by which they may differ


@inline_function
def jumped(par: Array, moved: Vector, told: Vector, apart: float, h: float) -> bool:
    """Whether a motion ``moved`` over h, of which ``told`` is what twists say, is none.

    ``apart``: the square of what they differ by. More than a share of both, and than what would be
    pulled in within h.
    """
    least = par[model.PULL_IN] * h
    return apart > UNEXPLAINED * (dot(moved, moved) + dot(told, told)) + least * least


@inline_function
def count(mem: Array, work: float) -> None:
    """Add the work of one wrench on one body."""
    mem[model.WORK] += work
    mem[model.EXCHANGED] += abs(work)


@inline_function
def release(mem: Array) -> None:
    """Let what sticks hold the place where it is from now on."""
    mem[model.STUCK] = min(mem[model.STUCK], 1.0)
