"""Delay of measured twists against measured poses.

A twist that is tau late satisfies, over any interval,

    change of place - integral of the rate = tau * change of the rate

Errors of the integral grow with the square root of its length only, so tau is known to a small part
of a sample period. A recording whose places follow from its rates by a semi-implicit Euler step has
half a period.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.identification.forces.intervals import Intervals

Array = NDArray[np.float64]

SIGNIFICANT = 4.0  # standard deviations of a delay that counts
ALLOWED = 0.75  # sample periods
BLOCK = 64  # intervals over which a rate is integrated
ENDS = 4  # intervals over which a rate at the end of a block is averaged
MIN_BLOCKS = 12


class Delay(NamedTuple):
    """Delay of the twists against the poses."""

    component: str  # slide or spin
    value: float  # s; positive: the twist is late
    deviation: float  # s, standard deviation
    periods: float  # the value in sample periods

    def describe(self) -> str:
        """Say what was seen, what is expected and what to do."""
        way = "late" if self.value > 0.0 else "early"
        spread = 1.96 * self.deviation * abs(self.periods / self.value)
        return (
            f"the twist of the {self.component} is {abs(self.periods):.2f} ± {spread:.2g} sample "
            f"periods {way} against the poses (expected: at most {ALLOWED:g}); record twists "
            "without a filter, with the stamp of the motion that they describe; or take the twists "
            "from the poses (--bandwidth 50)"
        )

    @property
    def counts(self) -> bool:
        """Whether it is certain and large enough to change the forces."""
        certain = abs(self.value) > SIGNIFICANT * self.deviation
        return certain and abs(self.periods) > ALLOWED


def twist_delay(measured: Intervals) -> Delay:
    """Estimate the delay of slide and spin; the more certain of both.

    Infinite deviation if there are too few intervals or the rate does not change.
    """
    found = [_delay(measured, k, name) for k, name in enumerate(("slide", "spin"))]
    return min(found, key=lambda one: one.deviation)


def _delay(measured: Intervals, k: int, name: str) -> Delay:
    x, v, dt = measured.places[:, k], measured.rates[:, k], measured.dt
    gap = np.zeros(len(x))
    gap[1:] = np.diff(x) - 0.5 * dt[1:] * (v[1:] + v[:-1])
    if name == "spin":  # an angle may be given modulo a turn
        gap -= 2.0 * np.pi * np.round(gap / (2.0 * np.pi))
    count = (len(x) - 1) // BLOCK
    rows = 1 + np.arange(count * BLOCK).reshape(count, BLOCK)
    rows = rows[measured.usable[rows].all(axis=1)]
    none = Delay(name, 0.0, np.inf, 0.0)
    if len(rows) < MIN_BLOCKS:
        return none
    # Averages over rows that lie symmetrically about the ends, without a shift to first order.
    inner = rows[:, ENDS:-ENDS]
    left = v[rows[:, 0, None] + np.arange(2 * ENDS - 1)].mean(axis=1)
    right = v[rows[:, -1, None] - np.arange(2 * ENDS - 1)].mean(axis=1)
    total, change = gap[inner].sum(axis=1), right - left
    square = float(change @ change)
    if square <= 0.0:
        return none
    value = float(change @ total) / square
    rest = total - value * change
    deviation = float(np.sqrt(np.square(change * rest).sum())) / square
    return Delay(name, value, deviation, value / measured.step)
