"""Wrenches on their way to the plant: each acts a stated number of periods after its sample."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import plant as physics
from cylconn_ros.simulation.plant import Plant

Array = NDArray[np.float64]


class WrenchDelay:
    """Wrenches that act ``delay`` periods after the stamp of their sample; zero before the first.

    A wrench that arrives later than that acts from the next step on. Each is taken up at the pose
    of its action (core/plant.py); with a fraction of a period the step is split there.
    """

    def __init__(self, plant: Plant, delay: float) -> None:
        self._plant, self._delay = plant, delay
        self._acting = np.zeros(12)
        # number of the sample, body, wrench; zero for the samples before the first
        self._under_way: list[tuple[int, int, Array]] = [
            (-k, body, np.zeros(12)) for k in range(1, math.ceil(delay) + 1) for body in (0, 1)
        ]

    def put(self, body: int, stamp: int, wrench: Array) -> None:
        """Send a wrench (6,), as published, on A (0) or B (1); ``stamp`` (ns) of its sample."""
        published = np.zeros(12)
        published[6 * body : 6 * body + 6] = wrench
        self._under_way.append((round(stamp / self._plant.period_ns), body, published))

    def step(self) -> None:
        """Advance the plant by one period."""
        plant, now, h = self._plant, self._plant.steps, self._plant.scene.period
        remaining = [self._delay - (now - sample) for sample, _, _ in self._under_way]
        due = sorted(
            (max(rest, 0.0), sample, body, k)
            for k, (rest, (sample, body, _)) in enumerate(
                zip(remaining, self._under_way, strict=True)
            )
            if rest < 1.0
        )
        passed = 0.0
        for rest, _, body, k in due:
            if rest * h > passed:
                physics.advance(
                    plant.par, plant.state, self._acting, plant.loads, rest * h - passed
                )
                passed = rest * h
            physics.take_up(plant.par, plant.state, body, self._under_way[k][2], self._acting)
        physics.advance(plant.par, plant.state, self._acting, plant.loads, h - passed)
        self._under_way = [
            one for one, rest in zip(self._under_way, remaining, strict=True) if rest >= 1.0
        ]
        plant.move(plant.state, now + 1)
