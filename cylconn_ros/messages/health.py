"""Errors and counters of a message pipeline, for diagnostics."""

from __future__ import annotations

import dataclasses

import numpy as np

from cylconn_ros.messages import statistics


def _integer(at: int) -> property:
    """A counter as an int."""
    return property(lambda health: int(health.numbers[at]))


def _float(at: int) -> property:
    """A counter as a float."""
    return property(lambda health: float(health.numbers[at]))


@dataclasses.dataclass
class Health:
    """Errors and counters: totals since the start; ``worst_…``, flags and stops since a report.

    Attributes
    ----------
        numbers: (NCOUNTER,) counters of processed samples (messages/statistics.py); the properties
            give them names.
    """

    undecodable: int = 0
    undecodable_text: str = ""
    failed: int = 0
    failure: str = ""
    commands: int = 0  # accepted
    refused: int = 0  # commands that are invalid
    refusal: str = ""
    numbers: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(statistics.NCOUNTER))

    not_finite = _integer(statistics.NOT_FINITE)
    not_finite_at = _integer(statistics.NOT_FINITE_AT)
    too_large = _integer(statistics.TOO_LARGE)
    too_large_at = _integer(statistics.TOO_LARGE_AT)
    seen_value = _float(statistics.SEEN_VALUE)
    overflowed = _integer(statistics.OVERFLOWED)
    bad_quaternion = _integer(statistics.BAD_QUATERNION)
    no_period = _integer(statistics.NO_PERIOD)
    off_period = _integer(statistics.OFF_PERIOD)
    seen_period = _float(statistics.SEEN_PERIOD)
    saturated = _integer(statistics.SATURATED)
    worst_residual = _float(statistics.WORST_RESIDUAL)
    worst_offset = _float(statistics.WORST_OFFSET)
    worst_angle = _float(statistics.WORST_ANGLE)
    worst_time = _float(statistics.WORST_TIME)
    flags = _integer(statistics.FLAGS)
    stops = _integer(statistics.STOPS)
    regime = _integer(statistics.REGIME)
    lock = _integer(statistics.LOCK)

    @property
    def off_norm(self) -> tuple[int, int]:
        """Samples with an orientation whose norm is not 1, of A and of B."""
        a, b = self.numbers[statistics.OFF_NORM : statistics.OFF_NORM + 2]
        return int(a), int(b)

    @property
    def seen_norm(self) -> tuple[float, float]:
        """The last such norm of A and of B."""
        a, b = self.numbers[statistics.SEEN_NORM : statistics.SEEN_NORM + 2]
        return float(a), float(b)

    def report(self) -> Health:
        """A copy; afterwards ``worst_…``, flags and stops begin again."""
        copy = dataclasses.replace(self, numbers=self.numbers.copy())
        self.numbers[statistics.SINCE_REPORT :] = 0.0
        return copy
