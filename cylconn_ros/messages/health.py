"""What went wrong while answering, in numbers: what diagnostics are made of."""

from __future__ import annotations

import dataclasses

import numpy as np

from cylconn_ros.messages import statistics


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
        numbers: (NTALLY,) of the answers themselves (messages/statistics.py); they have names here.
    """

    undecodable: int = 0
    undecodable_text: str = ""
    failed: int = 0
    failure: str = ""
    commands: int = 0  # followed
    refused: int = 0  # commands that cannot be followed
    refusal: str = ""
    numbers: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(statistics.NTALLY))

    not_finite = _whole(statistics.NOT_FINITE)
    bad_quaternion = _whole(statistics.BAD_QUATERNION)
    no_period = _whole(statistics.NO_PERIOD)
    off_period = _whole(statistics.OFF_PERIOD)
    seen_period = _real(statistics.SEEN_PERIOD)
    saturated = _whole(statistics.SATURATED)
    worst_residual = _real(statistics.WORST_RESIDUAL)
    worst_offset = _real(statistics.WORST_OFFSET)
    worst_angle = _real(statistics.WORST_ANGLE)
    worst_time = _real(statistics.WORST_TIME)
    flags = _whole(statistics.FLAGS)
    stops = _whole(statistics.STOPS)
    regime = _whole(statistics.REGIME)
    lock = _whole(statistics.LOCK)

    def taken(self) -> Health:
        """A copy; begins a new stretch of ``worst_…``, flags and stops."""
        copy = dataclasses.replace(self, numbers=self.numbers.copy())
        self.numbers[statistics.SINCE_LOOKED :] = 0.0
        return copy
