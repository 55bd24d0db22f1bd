"""Loads and commands of a scene over time, held over each period (scene/over_time.py).

What a period holds is the mean over it, so that its impulse is exact. A load is that of the plant's
period, which its sample states. Preload and commands are for the period in which the sample's
wrench acts, ``plant_latency`` periods later. A commanded velocity is reached at the end of that
period, as the connector imposes it, and a commanded position is passed at its begin with the mean
rate. All of it is of second order, with a latency too (test/simulation/test_over_time.py).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.connector import Connector
from cylconn_ros.scene import over_time
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]
Imposed = tuple[float, float, float]
"""Position, velocity and force of a component; NaN: not imposed."""


class OverTime:
    """Loads and commands of one connector by the number of the period.

    Attributes
    ----------
        loads_change, commands_change: whether loads, preload or commands change over time.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene, self._period = scene, scene.period
        self._delay = scene.plant_latency
        self._loads = np.array([*scene.plant.body_a.load, *scene.plant.body_b.load])
        self._factors = over_time.loads(scene)
        self._preload = scene.plant.preload_amplitude
        self._commands = over_time.commands(scene)
        self.loads_change = any(each.on for each in self._factors)
        self.commands_change = self._preload.on or any(each.on for each in self._commands)

    @property
    def changes(self) -> bool:
        """Whether anything changes over time."""
        return self.loads_change or self.commands_change

    def loads(self, k: int) -> Array:
        """(12,) loads on A and B that act in period k, as in its sample."""
        shares = [each.average(*self._times(float(k))) for each in self._factors]
        return self._loads * np.repeat(shares, 6)

    def preload(self, k: int) -> float | None:
        """FCint (N) for sample k; None: it does not change."""
        if not self._preload.on:
            return None
        begin, end = self._times(k + self._delay)
        return self._scene.friction.preload * self._preload.average(begin, end)

    def commands(self, k: int) -> dict[str, Imposed]:
        """Motion or force by component for sample k; of those that change."""
        begin, end = self._times(k + self._delay)
        found: dict[str, Imposed] = {}
        command = self._scene.command
        for name, factor in zip(("slide", "spin"), self._commands, strict=True):
            if not factor.on:
                continue
            given = getattr(command, name)
            position, velocity, force = math.nan, math.nan, math.nan
            if not math.isnan(given.position):
                position = given.position * factor.at(begin)
                velocity = (given.position * factor.at(end) - position) / (end - begin)
            elif not math.isnan(given.velocity):
                last = self._scene.plant_integration == "exact"
                share = factor.at(end) if last else factor.average(begin, end)
                velocity = given.velocity * share
            else:
                force = given.force * factor.average(begin, end)
            found[name] = position, velocity, force
        return found

    def follow(self, connector: Connector, k: int) -> None:
        """Set preload and commands of sample k, as its messages would."""
        preload = self.preload(k)
        if preload is not None:
            connector.set_preload(preload)
        for name, imposed in self.commands(k).items():
            connector.impose(name, *imposed)

    def _times(self, period: float) -> tuple[float, float]:
        """Begin and end of a period, s."""
        return period * self._period, (period + 1.0) * self._period
