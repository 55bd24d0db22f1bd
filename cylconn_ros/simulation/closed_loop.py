"""The closed loop of plant and connector in process, compiled: the steps of the two nodes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector import batch
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout, model, plant
from cylconn_ros.core.jit import parallel_kernel
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.run import Run

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

BLOCK = 2048  # samples per compiled call, between two calls of the progress function


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


@dataclasses.dataclass(frozen=True)
class Block:
    """Consecutive samples of a run: views whose content the next block may replace.

    Attributes
    ----------
        time: (n,) s. states: (n, 26) poses and twists of both bodies. outs: (n, NOUT).
        energy: (n,) J.
    """

    time: Array
    states: Array
    outs: Array
    energy: Array


class ClosedLoop:
    """Plant and connector in lock step; wrenches act late as ``plant.latency`` says.

    If they do not act late, nothing is left to measure of a latency that is not given: the
    connector takes it as 0, and its outputs are the same bits.

    Attributes
    ----------
        plant, connector: as they are after the last period.
    """

    def __init__(self, scene: Scene) -> None:
        self.plant, self.connector = Plant(scene), Connector(scene)
        self._delay = scene.plant_latency
        par = self.connector.par
        if self._delay == 0.0 and par[model.LATENCY] == model.MEASURED:
            par[model.LATENCY] = 0.0
        self._sent, self._acting = np.zeros((int(self._delay) + 1, 12)), np.zeros(12)

    def advance(self, samples: Array, outs: Array, energy: Array) -> None:
        """Run as many periods as the arrays (n, NSAMPLE), (n, NOUT) and (n,) have rows.

        One compiled call, which releases the interpreter's lock; one a period if loads or commands
        change over time.
        """
        handle, par, mem, period = self.connector.kernel_arguments()
        plant = self.plant
        changing, count = plant.over_time, len(samples)
        size = 1 if changing.changes else max(count, 1)
        for first in range(0, count, size):
            part = slice(first, first + size)
            if changing.changes:
                changing.follow(self.connector, plant.steps)
            run_loop(
                handle, par, mem, period, plant.par, plant.state, plant.loads,
                self._delay, self._sent, self._acting, samples[part], outs[part], energy[part],
            )  # fmt: skip
            plant.move(plant.state, plant.steps + len(samples[part]))

    def blocks(self, samples: int) -> Iterator[Block]:
        """Run ``samples`` periods in blocks, in memory that does not grow with their number."""
        size = min(samples, BLOCK)
        rows, outs = np.empty((size, layout.NSAMPLE)), np.empty((size, layout.NOUT))
        energy = np.empty(size)
        for first in range(0, samples, BLOCK):
            n = min(BLOCK, samples - first)
            time = np.asarray(np.arange(first, first + n) * self.plant.period_ns * 1e-9, float)
            self.advance(rows[:n], outs[:n], energy[:n])
            yield Block(time, rows[:n, layout.MOTION], outs[:n], energy[:n])


def closed_loop(scene: Scene, samples: int, progress: Progress | None = None) -> Run:
    """Run plant and connector in lock step for ``samples`` samples; see simulate().

    The plant delays the wrenches by ``plant.latency``.
    """
    loop = ClosedLoop(scene)
    rows = np.empty((samples, layout.NSAMPLE))
    outs = np.empty((samples, layout.NOUT))
    energy = np.empty(samples)
    for first in range(0, samples, BLOCK):
        part = slice(first, min(first + BLOCK, samples))
        loop.advance(rows[part], outs[part], energy[part])
        if progress is not None:
            progress(part.stop, samples)
    time, states = times(scene, samples), rows[:, layout.MOTION]
    return Run(scene, time, states, outs, energy, loop.connector, loop.plant)


def times(scene: Scene, samples: int) -> Array:
    """(N,) s, the stamps of the samples: whole nanoseconds, as the plant node publishes them."""
    return np.asarray(np.arange(samples) * round(scene.period * 1e9) * 1e-9, dtype=np.float64)
