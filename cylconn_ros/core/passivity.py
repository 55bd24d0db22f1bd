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

RECENT = 0.95  # share of the energy exchanged that counts on in the next sample
ALLOWED_GAIN = 0.1  # rise of the balance, as a share of the energy recently exchanged
FORGOTTEN_RISE = 0.15  # share of the rise that no longer counts in the next sample
REDUCED = 0.9  # factor on the gain, per sample
RESTORED = 0.02  # share of the reduction, per sample
GREATEST_REDUCTION = 0.9
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
def control_gain(mem: Array, balance: float, exchanged: float) -> None:
    """Reduce the gain of the feedback while the wrenches have put in energy; restore it slowly.

    ``balance`` (J) is the work of the wrenches without that of springs and actuation. Its rise over
    its least value is allowed up to a share of ``exchanged``, the energy of the last interval (J),
    summed over the last samples.
    """
    recent = RECENT * mem[model.RECENT_EXCHANGE] + exchanged
    mem[model.RECENT_EXCHANGE] = recent
    least = mem[model.LEAST_BALANCE]
    mem[model.LEAST_BALANCE] = min(balance, least + FORGOTTEN_RISE * (balance - least))
    reduction = mem[model.GAIN_REDUCTION]
    if balance - least > ALLOWED_GAIN * recent:
        reduction = 1.0 - (1.0 - reduction) * REDUCED
    else:
        reduction -= RESTORED * reduction if reduction > 1e-3 else reduction
    mem[model.GAIN_REDUCTION] = min(reduction, GREATEST_REDUCTION)


@inline_function
def reset_stick_position(mem: Array) -> None:
    """Make the next sample define the position that stick holds."""
    mem[model.STICK_SAMPLES] = min(mem[model.STICK_SAMPLES], 1.0)
