"""What went wrong while answering, in numbers: what diagnostics are made of."""

from __future__ import annotations

import dataclasses

import numpy as np

from cylconn_ros.ros.express import tally


def _whole(at: int) -> property:
    """A whole number of the tally."""
    return property(lambda health: int(health.numbers[at]))


def _real(at: int) -> property:
    """A number of the tally."""
    return property(lambda health: float(health.numbers[at]))


@dataclasses.dataclass
class Health:
    """What went wrong while answering; totals since the start, ``worst_…`` since the last look.

    Attributes
    ----------
        numbers: (NTALLY,) of the answers themselves (ros/express/tally.py); they have names here.
    """

    undecodable: int = 0
    undecodable_text: str = ""
    failed: int = 0
    failure: str = ""
    commands: int = 0  # followed
    refused: int = 0  # commands that cannot be followed
    refusal: str = ""
    numbers: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(tally.NTALLY))

    not_finite = _whole(tally.NOT_FINITE)
    bad_quaternion = _whole(tally.BAD_QUATERNION)
    no_period = _whole(tally.NO_PERIOD)
    off_period = _whole(tally.OFF_PERIOD)
    seen_period = _real(tally.SEEN_PERIOD)
    saturated = _whole(tally.SATURATED)
    worst_residual = _real(tally.WORST_RESIDUAL)
    worst_offset = _real(tally.WORST_OFFSET)
    worst_angle = _real(tally.WORST_ANGLE)
    worst_time = _real(tally.WORST_TIME)
    flags = _whole(tally.FLAGS)
    stops = _whole(tally.STOPS)
    regime = _whole(tally.REGIME)
    lock = _whole(tally.LOCK)

    def taken(self) -> Health:
        """A copy; begins a new stretch of ``worst_…``, flags and stops."""
        copy = dataclasses.replace(self, numbers=self.numbers.copy())
        self.numbers[tally.SINCE_LOOKED :] = 0.0
        return copy
