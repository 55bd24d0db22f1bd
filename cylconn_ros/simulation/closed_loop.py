"""The closed loop of plant and connector in process, compiled: the steps of the two nodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

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
    handle: Any,
    par: Array,
    mem: Array,
    period: float,
    plant_par: Array,
    state: Array,
    loads: Array,
    delay: float,
    sent: Array,
    acting: Array,
    samples: Array,
    outs: Array,
    energy: Array,
) -> None:
    """Run N periods; ``mem``, ``state`` (26,), ``sent`` and ``acting`` are advanced.

    Args:
        handle, par, mem, period: of the connector (Connector.kernel_arguments).
        plant_par: parameter array of the plant. loads: (12,) external loads on A and B.
        delay, sent, acting: periods between a sample and the action of its wrench, the wrenches
            sent and those that act (core/plant.py, step_late).
        samples: (N, NSAMPLE), outs: (N, NOUT), energy: (N,) J: written.
    """
    for k in range(samples.shape[0]):
        energy[k] = plant.energy(plant_par, state)
        for i in range(26):
            samples[k, i] = state[i]
        for i in range(12):
            samples[k, 26 + i] = loads[i]
        out = outs[k]
        batch.process(handle, par, mem, samples[k], 0.0, period, out)
        if delay == 0.0:
            plant.step(plant_par, state, out[0:6], out[6:12], loads, period)
            continue
        for i in range(sent.shape[0] - 1, 0, -1):
            for j in range(12):
                sent[i, j] = sent[i - 1, j]
        for j in range(12):
            sent[0, j] = out[j]
        plant.step_late(plant_par, state, sent, acting, loads, delay, period)


def closed_loop(scene: Scene, samples: int, progress: Progress | None = None) -> Run:
    """Run plant and connector in lock step for ``samples`` samples; see simulate().

    The plant delays the wrenches by ``plant.latency``.
    """
    bodies, connector = Plant(scene), Connector(scene)
    handle, par, mem, period = connector.kernel_arguments()
    rows = np.empty((samples, layout.NSAMPLE))
    outs = np.empty((samples, layout.NOUT))
    energy = np.empty(samples)
    delay = scene.plant_latency
    sent, acting = np.zeros((int(delay) + 1, 12)), np.zeros(12)
    changing = bodies.over_time
    size = 1 if changing.changes else _BLOCK  # samples with the same loads and commands
    for first in range(0, samples, size):
        part = slice(first, min(first + size, samples))
        if changing.changes:
            changing.follow(connector, first)
            bodies.loads[:] = changing.loads(first)
        run_loop(
            handle, par, mem, period, bodies.par, bodies.state, bodies.loads,
            delay, sent, acting, rows[part], outs[part], energy[part],
        )  # fmt: skip
        if progress is not None and (part.stop % _BLOCK == 0 or part.stop == samples):
            progress(part.stop, samples)
    bodies.move(bodies.state, samples)
    time = times(scene, samples)
    return Run(scene, time, rows[:, layout.MOTION], outs, energy, connector, bodies)


def times(scene: Scene, samples: int) -> Array:
    """(N,) s, the stamps of the samples: whole nanoseconds, as the plant node publishes them."""
    return np.asarray(np.arange(samples) * round(scene.period * 1e9) * 1e-9, dtype=np.float64)
