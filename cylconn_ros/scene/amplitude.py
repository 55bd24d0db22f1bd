"""A factor over time: piecewise linear through points, or a mean with a sine.

The plant multiplies loads, preload and commands by it (scene/over_time.py). The points are those of
a tabular amplitude of finite-element programs, mean and sine those of a periodic one.
"""

from __future__ import annotations

import bisect
import dataclasses
import math
from typing import NamedTuple

from cylconn_ros.scene.schema import parameter

NAN = math.nan


class Piece(NamedTuple):
    """The factor from ``start`` (s) on: value + slope (t - start) + sine sin(omega t + phase)."""

    start: float
    value: float
    slope: float
    sine: float
    omega: float  # rad/s
    phase: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class Amplitude:
    """Factor over time, 1 unless ``times`` or ``frequency`` is given.

    Example::

        ramp = cr.Amplitude(times=(0.0, 0.5), values=(0.0, 1.0))
        shaker = cr.Amplitude(amplitude=1.0, frequency=20.0)
    """

    times: tuple[float, ...] = parameter(
        (), ge=0.0, unit="s", doc="Times, ascending, at least 2; []: no table."
    )
    values: tuple[float, ...] = parameter(
        (), unit="1", doc="Factor at each time, linear in between, constant before and after."
    )
    frequency: float = parameter(
        NAN,
        gt=0.0,
        unit="Hz",
        doc="Frequency f of the factor mean + amplitude sin(2 pi f t + phase); .nan: no sine.",
    )
    mean: float = parameter(0.0, unit="1", doc="Mean of the sine.")
    amplitude: float = parameter(1.0, unit="1", doc="Amplitude of the sine.")
    phase: float = parameter(0.0, unit="rad", doc="Phase of the sine at t = 0.")

    @property
    def on(self) -> bool:
        """Whether the factor changes with time."""
        return bool(self.times) or not math.isnan(self.frequency)

    @property
    def range(self) -> tuple[float, float]:
        """Least and greatest factor."""
        if self.times:
            return min(self.values), max(self.values)
        if self.on:
            return self.mean - abs(self.amplitude), self.mean + abs(self.amplitude)
        return 1.0, 1.0

    def at(self, t: float) -> float:
        """The factor at t, s."""
        if self.times:
            return self._between(t)
        return self.mean + self.amplitude * math.sin(self._angle(t)) if self.on else 1.0

    def average(self, begin: float, end: float) -> float:
        """Mean of the factor from ``begin`` to ``end`` > ``begin``, s: exact."""
        if not self.times:
            if not self.on:
                return 1.0
            half = math.pi * self.frequency * (end - begin)
            share = math.sin(half) / half
            return self.mean + self.amplitude * share * math.sin(self._angle(0.5 * (begin + end)))
        inside = self.times[
            bisect.bisect_right(self.times, begin) : bisect.bisect_left(self.times, end)
        ]
        edges = (begin, *inside, end)
        factors = [self._between(t) for t in edges]
        if min(factors) == max(factors):
            return factors[0]
        whole = sum(
            0.5 * (factors[k] + factors[k + 1]) * (edges[k + 1] - edges[k])
            for k in range(len(edges) - 1)
        )
        return whole / (end - begin)

    def pieces(self) -> list[Piece]:
        """The factor in smooth pieces; the first begins at 0."""
        if not self.times:
            if not self.on:
                return [Piece(0.0, 1.0, 0.0, 0.0, 0.0, 0.0)]
            omega = 2.0 * math.pi * self.frequency
            return [Piece(0.0, self.mean, 0.0, self.amplitude, omega, self.phase)]
        found = [Piece(0.0, self.values[0], 0.0, 0.0, 0.0, 0.0)] if self.times[0] > 0.0 else []
        for k, start in enumerate(self.times):
            slope = 0.0
            if k + 1 < len(self.times):
                slope = (self.values[k + 1] - self.values[k]) / (self.times[k + 1] - start)
            found.append(Piece(start, self.values[k], slope, 0.0, 0.0, 0.0))
        return found

    def _angle(self, t: float) -> float:
        return 2.0 * math.pi * self.frequency * t + self.phase

    def _between(self, t: float) -> float:
        """The factor of the table at t."""
        k = bisect.bisect_right(self.times, t)
        if k == 0:
            return self.values[0]
        if k == len(self.times):
            return self.values[-1]
        t0, t1, a0, a1 = *self.times[k - 1 : k + 1], *self.values[k - 1 : k + 1]
        return a0 + (a1 - a0) * ((t - t0) / (t1 - t0))
