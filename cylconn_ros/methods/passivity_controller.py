r"""Watch over gains that nobody can choose for certain: the passivity account of two components.

A spring, a damper and a multiplier on an unknown mass m, held over the period h, are stable for

    k h/2 < c < 2 m/h      whatever the mass the first, by the mass the second
    rho < c h/m            roughly: the multiplier must gather more slowly than the damper removes

Seen from outside, unstable gains make energy. Over a window of samples

    A = sum (f - lambda0) . de + k/2 (|e|^2 - |e0|^2)

is the work that the constraint did on the bodies beyond that of its steady force lambda0, plus
what its spring gained: not positive where the gains are passive, but for a multiplier that follows
a changing load. Where A exceeds 1 % of the energy exchanged and the spring's energy peaks at four
times that of the quietest window before, the multiplier's gain is lowered to a quarter, and once
that is small the stiffness. Friction takes no part in A: its loss would hide the constraint's gain.
A rate that is reversed and grows from one sample to the next is the sign of c > 2 m/h: as it grows
by |1 - c h/m|, both gains are set to make c h/m = 1.
"""

import math
from typing import NamedTuple

from cylconn_ros.core import model
from cylconn_ros.core.friction import Array
from cylconn_ros.core.jit import device_function

Two = tuple[float, float]

WINDOW = 64  # samples
SHORTEST = 8  # samples, of a window that ends early as energy grows fast
SMALL_SHARE = 1e-3  # of the gain asked for: below it the multiplier is not at fault
GROWN = 4.0  # times the energy of the quietest window
LEAST_ERROR = 1e-9  # m or rad: growth below it is rounding

# One guard's stretch of MEM; all zero at the start.
RATIO = 0  # -log of the factor on the multiplier's gain
STIFFNESS = 1  # -log of the factor on the stiffness
DAMPING = 2  # -log of the factor on the damping
ACCOUNT = 3  # J, of the window so far
EXCHANGED = 4  # J
STEADY = 5  # 2: the multiplier at the window's start
STORED = 7  # J, in the spring at the window's start
PEAK = 8  # J, in the spring since
QUIET = 9  # J, the least peak of a window since gains were lowered; 0: no window yet
SAMPLES = 10  # in the window so far
REVERSALS = 11  # in a row, each greater than the last
FORCE = 12  # 2: of the last answer
ERROR = 14  # 2: of the last sample
RATE = 16  # 2
SIZE = 18


class Gains(NamedTuple):
    """Stiffness, damping and the multiplier's share, as they may be used."""

    k: float
    c: float
    rho: float
    lowered: bool


@device_function
def gains(mem: Array, at: int, k: float, c: float, rho: float, h: float, explicit: bool) -> Gains:
    """The gains asked for, as lowered so far; k at most c/h where the plant is exact.

    ``rho`` NaN: k h/(32 c), at most 0.1, which is stable down to a tenth of critical damping.
    """
    softer = math.exp(-mem[at + STIFFNESS])
    damping = c * math.exp(-mem[at + DAMPING])
    stiffness = k * softer
    if not explicit:
        stiffness = min(stiffness, damping / h)
    if math.isnan(rho):
        rho = min(0.1, stiffness * h / (32.0 * damping)) if damping > 0.0 else 0.0
    rho *= math.exp(-mem[at + RATIO])
    return Gains(stiffness, damping, rho, mem[at + RATIO] > 0.0 or stiffness < k or damping < c)


@device_function
def watch(mem: Array, at: int, g: Gains, e: Two, w: Two, multiplier: Two) -> None:
    """Account for the last answer with this sample's error and rate; lower gains as needed."""
    d1, d2 = e[0] - mem[at + ERROR], e[1] - mem[at + ERROR + 1]
    stored = 0.5 * g.k * (e[0] * e[0] + e[1] * e[1])
    if mem[model.LAST_PERIOD] > 0.0:
        work = (mem[at + FORCE] - mem[at + STEADY]) * d1
        work += (mem[at + FORCE + 1] - mem[at + STEADY + 1]) * d2
        mem[at + ACCOUNT] += work
        mem[at + EXCHANGED] += abs(work)
        mem[at + PEAK] = max(mem[at + PEAK], stored)
        mem[at + SAMPLES] += 1.0
        _reversed(mem, at, w)
        balance = mem[at + ACCOUNT] + stored - mem[at + STORED]
        grown = balance > GROWN * mem[at + QUIET] > 0.0
        samples = mem[at + SAMPLES]
        if samples >= WINDOW or (samples >= SHORTEST and grown):
            _judge(mem, at, g, balance)
            _open(mem, at, stored, multiplier)
    else:
        _open(mem, at, stored, multiplier)
    mem[at + ERROR], mem[at + ERROR + 1] = e
    mem[at + RATE], mem[at + RATE + 1] = w


@device_function
def _judge(mem: Array, at: int, g: Gains, balance: float) -> None:
    """Lower a gain if the window made energy and has grown beyond the quietest one."""
    peak, quiet = mem[at + PEAK], mem[at + QUIET]
    seen = peak > 0.5 * g.k * LEAST_ERROR * LEAST_ERROR
    if quiet == 0.0 or peak < quiet:
        mem[at + QUIET] = peak
    elif seen and peak > GROWN * quiet and balance > 0.01 * mem[at + EXCHANGED]:
        mem[at + QUIET] = peak
        if math.exp(-mem[at + RATIO]) > SMALL_SHARE:
            mem[at + RATIO] += math.log(4.0)
        else:
            mem[at + STIFFNESS] += math.log(2.0)


@device_function
def _reversed(mem: Array, at: int, w: Two) -> None:
    """Count reversals of a growing rate; after three, or two that double, lower both gains."""
    before = math.sqrt(mem[at + RATE] ** 2 + mem[at + RATE + 1] ** 2)
    now = math.sqrt(w[0] * w[0] + w[1] * w[1])
    against = w[0] * mem[at + RATE] + w[1] * mem[at + RATE + 1] < 0.0
    if not (against and now > before):
        mem[at + REVERSALS] = 0.0
        return
    mem[at + REVERSALS] += 1.0
    ratio = now / before
    if mem[at + REVERSALS] >= 3.0 or (mem[at + REVERSALS] >= 2.0 and ratio > 2.0):
        mem[at + REVERSALS] = 0.0
        mem[at + STIFFNESS] += math.log(1.0 + ratio)
        mem[at + DAMPING] += math.log(1.0 + ratio)


@device_function
def _open(mem: Array, at: int, stored: float, multiplier: Two) -> None:
    """Begin a window."""
    mem[at + PEAK] = 0.0
    mem[at + STORED] = stored
    mem[at + STEADY], mem[at + STEADY + 1] = multiplier
    mem[at + ACCOUNT] = mem[at + EXCHANGED] = mem[at + SAMPLES] = 0.0
