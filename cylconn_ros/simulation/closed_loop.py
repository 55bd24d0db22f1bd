"""The closed loop in process: plant and connector step of the two nodes, without ROS."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Chosen:
    """How a motion is computed.

    Attributes
    ----------
        method: minimal or impulse. substeps: of a period. step_tolerance: minimal's, 0 for impulse.
        estimate: relative error that is left, NaN where it was not estimated.
    """

    method: str
    substeps: int
    step_tolerance: float
    estimate: float

    def __str__(self) -> str:
        """One line for whoever reads the run."""
        if self.method == "minimal":
            return f"minimal, its steps to {self.step_tolerance:.0e}"
        error = f", estimated error {self.estimate:.0e}" if math.isfinite(self.estimate) else ""
        return f"impulse, {self.substeps} substeps a period{error}"


@dataclass(frozen=True)
class Run:
    """What a simulation gives.

    Attributes
    ----------
        time: (N,) stamps, s.
        states: (N, 26) poses and twists of both bodies at the stamps (core/layout.py).
        outs: (N, NOUT) the connector's answers to them.
        energy: (N,) kinetic and gravitational energy of both bodies at the stamps, J.
        connector: the connector, as it is after the last sample.
        plant: the plant, one period after the last sample.
        computed: how, where the scene states a tolerance.
    """

    time: Array
    states: Array
    outs: Array
    energy: Array
    connector: Connector
    plant: Plant
    computed: Chosen | None = None

    def state(self, name: str) -> Array:
        """(N,) or (N, k): a field of ConnectorState over the run."""
        at = layout.STATE_INDEX[name]
        width = dict(layout.STATE_FIELDS)[name]
        return self.outs[:, at] if width == 1 else self.outs[:, at : at + width]


def closed_loop(scene: Scene, steps: int, progress: Progress | None = None) -> Run:
    """Run plant and connector in lock step for ``steps`` samples; see simulation.simulate."""
    plant, connector = Plant(scene), Connector(scene)
    time = np.empty(steps)
    outs = np.empty((steps, layout.NOUT))
    samples = np.zeros((steps, layout.NSAMPLE))
    energy = np.empty(steps)
    for k in range(steps):
        time[k] = plant.time_ns * 1e-9
        energy[k] = plant.energy()
        samples[k, layout.MOTION] = plant.state
        samples[k, layout.LOADS] = plant.loads
        out = connector.step(samples[k], out=outs[k])
        plant.step(out[layout.FORCE_A : layout.FORCE_B], out[layout.FORCE_B : layout.STATE0])
        if progress is not None and k % 64 == 0:
            progress(k, steps)
    if progress is not None:
        progress(steps, steps)
    return Run(time, samples[:, layout.MOTION], outs, energy, connector, plant)
