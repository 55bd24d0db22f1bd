"""The closed loop of plant and connector in process, compiled: the steps of the two nodes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector import batch
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout, plant
from cylconn_ros.core.jit import parallel_kernel
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.run import Run

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

_BLOCK = 2048  # samples per compiled call, between two calls of the progress function


@parallel_kernel
def run_loop(
    method: int,
    par: Array,
    mem: Array,
    period: float,
    plant_par: Array,
    state: Array,
    loads: Array,
    samples: Array,
    outs: Array,
    energy: Array,
) -> None:
    """Run N periods; ``mem`` and ``state`` (26,) are advanced.

    Args:
        method, par, mem, period: of the connector (Connector.kernel_arguments).
        plant_par: parameter array of the plant. loads: (12,) external loads on A and B.
        samples: (N, NSAMPLE), outs: (N, NOUT), energy: (N,) J: written.
    """
    for k in range(samples.shape[0]):
        energy[k] = plant.energy(plant_par, state)
        for i in range(26):
            samples[k, i] = state[i]
        for i in range(12):
            samples[k, 26 + i] = loads[i]
        out = outs[k]
        batch.process(method, par, mem, samples[k], 0.0, period, out)
        plant.step(plant_par, state, out[0:6], out[6:12], loads, period)


def closed_loop(scene: Scene, samples: int, progress: Progress | None = None) -> Run:
    """Run plant and connector in lock step for ``samples`` samples; see simulate()."""
    bodies, connector = Plant(scene), Connector(scene)
    method, par, mem, period = connector.kernel_arguments()
    rows = np.empty((samples, layout.NSAMPLE))
    outs = np.empty((samples, layout.NOUT))
    energy = np.empty(samples)
    for first in range(0, samples, _BLOCK):
        part = slice(first, min(first + _BLOCK, samples))
        run_loop(
            method, par, mem, period, bodies.par, bodies.state, bodies.loads,
            rows[part], outs[part], energy[part],
        )  # fmt: skip
        if progress is not None:
            progress(part.stop, samples)
    bodies.move(bodies.state, samples)
    time = times(scene, samples)
    return Run(scene, time, rows[:, layout.MOTION], outs, energy, connector, bodies)


def times(scene: Scene, samples: int) -> Array:
    """(N,) s, the stamps of the samples: whole nanoseconds, as the plant node publishes them."""
    return np.asarray(np.arange(samples) * round(scene.period * 1e9) * 1e-9, dtype=np.float64)
