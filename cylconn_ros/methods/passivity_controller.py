r"""Passivity controller: lowers the gains of a spring with a multiplier if they generate energy.

A spring, a damper and a multiplier on an unknown mass m, held over the period h, are stable for

    k h/2 < c < 2 m/h      whatever the mass the first, by the mass the second
    rho < c h/m            approximately: the multiplier must integrate more slowly than the damper
                           dissipates

Unstable gains generate energy. Over a window of samples

    A = sum (f - lambda0) . de + k/2 (|e|^2 - |e0|^2)

is the work of the constraint on the bodies beyond that of its steady force lambda0, plus the change
of spring energy. It is not positive if the gains are passive, except for a multiplier that follows
a changing load. If A exceeds 1 % of the energy exchanged and the peak of the spring's energy has
grown to four times the greatest one before, the multiplier's gain is reduced to a quarter; once
that gain is small, the stiffness is halved. Friction is not part of A: its dissipation would hide
the energy that the constraint generates. A rate that changes sign and grows from one sample to the
next indicates c > 2 m/h. It grows by |1 - c h/m|, and both gains are set so that c h/m = 1. Noise
of measured rates reverses and grows too, within its usual size: only a growth to OUT_OF_NOISE times
the greatest rate before it counts.
"""

import math
from typing import NamedTuple

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function, inline_function

Two = tuple[float, float]

WINDOW = 64  # samples
SHORTEST = 8  # samples, of a window that ends early because the energy grows fast
SMALL_SHARE = 1e-3  # of the requested gain: below it the multiplier is not the cause
GROWTH = 4.0  # of the peak energy over the greatest before it grew
HALF_CYCLES = 5.0  # of an oscillation that grow in a row
HALF_CYCLE_GROWTH = 1.2  # of the square of its greatest rate
STRONG_GROWTH = 4.0
OUT_OF_NOISE = 3.0  # greatest rate of a growth over the greatest one before it
FADING = 0.98, 0.95  # of that one, per sample, per half cycle
SUDDEN = 4.0  # growth of a rate at once
LEAST_SUDDEN = 5e-3  # m/s or rad/s: smaller rates are noise or reversed by a load
LEAST_RATE = 1e-3  # m/s or rad/s: smaller oscillations are harmless, or not yet known to grow
LEAST_ERROR = 1e-9  # m or rad: smaller errors are rounding

# Section of MEM for one pair of components (section); all zero at the start.
MULTIPLIER_REDUCTION = 0  # -log of the factor on the multiplier's gain
STIFFNESS_REDUCTION = 1  # -log of the factor on the stiffness
DAMPING_REDUCTION = 2  # -log of the factor on the damping
WINDOW_WORK = 3  # J, of the window so far
WINDOW_EXCHANGED = 4  # J
WINDOW_MULTIPLIER = 5  # 2: the multiplier at the window's start
WINDOW_ENERGY = 7  # J, in the spring at the window's start
PEAK_ENERGY = 8  # J, in the spring since; or of this half cycle, the square of its rate
LAST_PEAK = 9  # J, of the last window; or of the last half cycle, the square of its rate
SAMPLES = 10  # in the window so far
REVERSALS = 11  # in a row, each greater than the last
FORCE = 12  # 2: of the last step
GROWN = 3  # half cycles in a row that grew, in place of the work
DIRECTION = 12  # of the rate since its last reversal, in place of the force
ERROR = 14  # 2: of the last sample
RATE = 16  # 2
USUAL_RATE = 18  # greatest of the samples before a growth, fading
USUAL_PEAK = 19  # the same of half cycles, its square; or of windows, J
SIZE = 20


class Gains(NamedTuple):
    """Stiffness k, damping c and multiplier gain rho in use; whether they were lowered."""

    k: float
    c: float
    rho: float
    lowered: bool


@inline_function
def section(block: int) -> int:
    """Start of the section of offsets (block 0), swings (1), slide (2), spin (3).

    4 to 7: of the oscillations of both offsets and both swings.
    """
    return model.PASSIVITY_CONTROLLER + SIZE * block


@device_function
def adapted_gains(
    mem: Array, at: int, k: float, c: float, rho: float, h: float, explicit: bool
) -> Gains:
    """The requested gains as lowered so far; k at most c/h if the plant is exact.

    ``rho`` NaN: k h/(32 c), at most 0.1, which is stable down to a tenth of critical damping.
    """
    softer = math.exp(-mem[at + STIFFNESS_REDUCTION])
    damping = c * math.exp(-mem[at + DAMPING_REDUCTION])
    stiffness = k * softer
    if not explicit:
        stiffness = min(stiffness, damping / h)
    if math.isnan(rho):
        rho = min(0.1, stiffness * h / (32.0 * damping)) if damping > 0.0 else 0.0
    rho *= math.exp(-mem[at + MULTIPLIER_REDUCTION])
    return Gains(
        stiffness,
        damping,
        rho,
        mem[at + MULTIPLIER_REDUCTION] > 0.0 or stiffness < k or damping < c,
    )


@inline_function
def shares(mem: Array, at: int) -> Two:
    """Shares of the requested stiffness and damping, as lowered so far."""
    return math.exp(-mem[at + STIFFNESS_REDUCTION]), math.exp(-mem[at + DAMPING_REDUCTION])


@device_function
def update(mem: Array, at: int, g: Gains, e: Two, w: Two, multiplier: Two) -> None:
    """Add the work of the last step from this sample's error and rate; lower gains if needed."""
    d1, d2 = e[0] - mem[at + ERROR], e[1] - mem[at + ERROR + 1]
    stored = 0.5 * g.k * (e[0] * e[0] + e[1] * e[1])
    if mem[model.LAST_PERIOD] > 0.0:
        work = (mem[at + FORCE] - mem[at + WINDOW_MULTIPLIER]) * d1
        work += (mem[at + FORCE + 1] - mem[at + WINDOW_MULTIPLIER + 1]) * d2
        mem[at + WINDOW_WORK] += work
        mem[at + WINDOW_EXCHANGED] += abs(work)
        mem[at + PEAK_ENERGY] = max(mem[at + PEAK_ENERGY], stored)
        mem[at + SAMPLES] += 1.0
        _count_reversals(mem, at, w)
        balance = mem[at + WINDOW_WORK] + stored - mem[at + WINDOW_ENERGY]
        grown = balance > GROWTH * mem[at + USUAL_PEAK] > 0.0
        samples = mem[at + SAMPLES]
        if samples >= WINDOW or (samples >= SHORTEST and grown):
            _evaluate_window(mem, at, g, balance)
            _start_window(mem, at, stored, multiplier)
    else:
        _start_window(mem, at, stored, multiplier)
    mem[at + ERROR], mem[at + ERROR + 1] = e
    mem[at + RATE], mem[at + RATE + 1] = w


@device_function
def watch(mem: Array, at: int, w: float, beyond: float, least: float) -> bool:
    """Whether the gains must be lowered: the oscillation of a component grows; w: its rate.

    This does not depend on when the wrenches act, whose work does. Of each half cycle, from one
    reversal of the rate to the next, the greatest rate counts: it must grow by HALF_CYCLE_GROWTH,
    HALF_CYCLES times in a row; three times if by STRONG_GROWTH, twice if by the square of that; and
    to ``beyond`` times the square of the greatest one before, and of ``least``.
    """
    if w * mem[at + DIRECTION] <= 0.0:
        before, peak = mem[at + LAST_PEAK], mem[at + PEAK_ENERGY]
        growing = peak > max(HALF_CYCLE_GROWTH * before, LEAST_RATE * LEAST_RATE)
        step = 2.0 if peak > STRONG_GROWTH * before else 1.0
        if peak > max(STRONG_GROWTH**2 * before, OUT_OF_NOISE**2 * mem[at + USUAL_PEAK]):
            step = 0.5 * HALF_CYCLES
        if growing and before > 0.0:
            mem[at + GROWN] += step
        else:
            mem[at + GROWN] = 0.0
            mem[at + USUAL_PEAK] = max(FADING[1] * mem[at + USUAL_PEAK], before, peak)
        mem[at + LAST_PEAK], mem[at + PEAK_ENERGY] = peak, 0.0
        mem[at + DIRECTION] = w
    mem[at + PEAK_ENERGY] = max(mem[at + PEAK_ENERGY], w * w)
    greatest = max(mem[at + LAST_PEAK], mem[at + PEAK_ENERGY])
    if mem[at + GROWN] < HALF_CYCLES or greatest < beyond * max(
        mem[at + USUAL_PEAK], least * least
    ):
        return False
    mem[at + GROWN] = 0.0
    return True


@inline_function
def watch_reversals(mem: Array, at: int, w: Two) -> None:
    """Lower the gains if the rate reverses and grows from one sample to the next."""
    _count_reversals(mem, at, w)
    mem[at + RATE], mem[at + RATE + 1] = w


@inline_function
def lower(mem: Array, at: int) -> None:
    """Reduce stiffness and multiplier gain to a sixteenth and the damping to a quarter."""
    mem[at + MULTIPLIER_REDUCTION] += math.log(16.0)
    mem[at + STIFFNESS_REDUCTION] += math.log(16.0)
    mem[at + DAMPING_REDUCTION] += math.log(4.0)


@device_function
def _evaluate_window(mem: Array, at: int, g: Gains, balance: float) -> None:
    """Lower a gain if the window generated energy and its peak exceeds those before it grew."""
    peak, usual = mem[at + PEAK_ENERGY], mem[at + USUAL_PEAK]
    significant = peak > 0.5 * g.k * LEAST_ERROR * LEAST_ERROR
    if usual == 0.0 or peak < mem[at + LAST_PEAK]:
        mem[at + USUAL_PEAK] = max(FADING[1] * usual, peak)
    elif significant and peak > GROWTH * usual and balance > 0.01 * mem[at + WINDOW_EXCHANGED]:
        mem[at + USUAL_PEAK] = peak
        if math.exp(-mem[at + MULTIPLIER_REDUCTION]) > SMALL_SHARE:
            mem[at + MULTIPLIER_REDUCTION] += math.log(4.0)
        else:
            mem[at + STIFFNESS_REDUCTION] += math.log(2.0)
    mem[at + LAST_PEAK] = peak


@device_function
def _count_reversals(mem: Array, at: int, w: Two) -> None:
    """Count reversals of a growing rate; lower both gains after three, or two that double.

    A rate that grows more than SUDDEN times at once would be out of bounds after two more samples,
    and gains that are so much too great for one pair are so for the others: it lowers all.
    """
    before = math.sqrt(mem[at + RATE] ** 2 + mem[at + RATE + 1] ** 2)
    now = math.sqrt(w[0] * w[0] + w[1] * w[1])
    against = w[0] * mem[at + RATE] + w[1] * mem[at + RATE + 1] < 0.0
    if not (against and now > before):
        mem[at + REVERSALS] = 0.0
        mem[at + USUAL_RATE] = max(FADING[0] * mem[at + USUAL_RATE], before)
        return
    mem[at + REVERSALS] += 1.0
    ratio = now / before
    if now <= OUT_OF_NOISE * mem[at + USUAL_RATE]:
        return
    if ratio > SUDDEN and before > LEAST_SUDDEN:
        for block in range(4):
            _divide(mem, section(block), 1.0 + ratio)
            mem[section(block) + RATE] = mem[section(block) + RATE + 1] = 0.0  # once per sample
    elif mem[at + REVERSALS] >= 3.0 or (mem[at + REVERSALS] >= 2.0 and ratio > 2.0):
        _divide(mem, at, 1.0 + ratio)


@inline_function
def _divide(mem: Array, at: int, factor: float) -> None:
    """Divide stiffness and damping of a section by a factor."""
    mem[at + REVERSALS] = 0.0
    mem[at + STIFFNESS_REDUCTION] += math.log(factor)
    mem[at + DAMPING_REDUCTION] += math.log(factor)


@device_function
def _start_window(mem: Array, at: int, stored: float, multiplier: Two) -> None:
    """Start a window."""
    mem[at + PEAK_ENERGY] = 0.0
    mem[at + WINDOW_ENERGY] = stored
    mem[at + WINDOW_MULTIPLIER], mem[at + WINDOW_MULTIPLIER + 1] = multiplier
    mem[at + WINDOW_WORK] = mem[at + WINDOW_EXCHANGED] = mem[at + SAMPLES] = 0.0
