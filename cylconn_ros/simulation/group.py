"""The closed loop of coupled connectors in process."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.group import Group
from cylconn_ros.connector.over_time import OverTime
from cylconn_ros.core import layout, model, plant
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.closed_loop import BLOCK, Block, Progress
from cylconn_ros.simulation.plant import Plant

Array = NDArray[np.float64]


class Bodies:
    """The bodies of several connectors, each once: the plant of a group.

    Attributes
    ----------
        frames: of all moving bodies.
        states: (26,) per connector, poses and twists of its bodies as in a sample.
    """

    def __init__(self, scenes: Sequence[Scene]) -> None:
        self._plants = [Plant(scene) for scene in scenes]
        names = [[body.frame for body in scene.bodies] for scene in scenes]
        numbers = {frame: k for k, frame in enumerate(dict.fromkeys(chain(*names)))}
        self._rows = [[numbers[frame] for frame in pair] for pair in names]
        self._total = np.zeros((len(numbers), 6))  # wrench on each body
        self._counted = _counting_once(self._plants, self._rows)
        moving = [b.frame for scene in scenes for b in scene.bodies if b.kind != "fixed"]
        self.frames = list(dict.fromkeys(moving))

    @property
    def states(self) -> list[Array]:
        """(26,) poses and twists of the bodies of each connector."""
        return [plant.state for plant in self._plants]

    @property
    def loads(self) -> list[Array]:
        """(12,) external loads on the bodies of each connector."""
        return [plant.loads for plant in self._plants]

    @property
    def over_time(self) -> list[OverTime]:
        """What changes over time, of each connector."""
        return [plant.over_time for plant in self._plants]

    @property
    def time_ns(self) -> int:
        """Simulated time, ns."""
        return self._plants[0].time_ns

    @property
    def period_ns(self) -> int:
        """A period, ns."""
        return self._plants[0].period_ns

    def step(self, wrenches: Sequence[tuple[Array, Array]]) -> None:
        """Advance a period under the wrenches of each connector on its bodies, as published."""
        self._total[:] = 0.0
        for rows, pair in zip(self._rows, wrenches, strict=True):
            for row, wrench in zip(rows, pair, strict=True):
                self._total[row] += wrench
        for (a, b), one in zip(self._rows, self._plants, strict=True):
            one.step(self._total[a], self._total[b])

    def energy(self) -> float:
        """Kinetic and gravitational energy of all bodies, J."""
        pairs = zip(self._counted, self._plants, strict=True)
        return sum(float(plant.energy(par, one.state)) for par, one in pairs)


def _counting_once(plants: Sequence[Plant], rows: Sequence[Sequence[int]]) -> list[Array]:
    """Parameter arrays in which each body is free in one plant only: for the energy of all."""
    known: set[int] = set()
    found = []
    for one, pair in zip(plants, rows, strict=True):
        par = one.par.copy()
        for row, at in zip(pair, (model.BODY_A, model.BODY_B), strict=True):
            if row in known:
                par[at] = 0.0
            known.add(row)
        found.append(par)
    return found


class GroupLoop:
    """Bodies and coupled connectors in lock step.

    Attributes
    ----------
        bodies, group: as they are after the last period.
    """

    def __init__(self, scenes: Sequence[Scene]) -> None:
        self.bodies, self.group = Bodies(scenes), Group(scenes)
        self._steps = 0

    def advance(
        self, samples: Array, outs: Array, energy: Array, iterations: NDArray[np.int64]
    ) -> None:
        """Run as many periods as the arrays have rows.

        (n, N, NSAMPLE), (n, N, NOUT), (n,) J and (n,) steps of the solver are written.
        """
        bodies, group = self.bodies, self.group
        states, loads, changing = bodies.states, bodies.loads, bodies.over_time
        changes = [c for c, each in enumerate(changing) if each.changes]
        samples[:] = 0.0
        for sample, out, k in zip(samples, outs, range(len(samples)), strict=True):
            energy[k] = bodies.energy()
            for row, state, load in zip(sample, states, loads, strict=True):
                row[layout.MOTION], row[layout.LOADS] = state, load
            for c in changes:
                changing[c].follow(group.connectors[c], self._steps)
            group.step(sample, outs=out)
            iterations[k] = group.iterations
            bodies.step([(one[0:6], one[6:12]) for one in out])
            self._steps += 1

    def blocks(self, samples: int) -> Iterator[list[Block]]:
        """Run ``samples`` periods; a block of each connector at a time, in memory used again."""
        n, size, begin = len(self.group.connectors), min(samples, BLOCK), self.bodies.time_ns
        rows, outs = np.empty((size, n, layout.NSAMPLE)), np.empty((size, n, layout.NOUT))
        energy, iterations = np.empty(size), np.empty(size, np.int64)
        for first in range(0, samples, BLOCK):
            m = min(BLOCK, samples - first)
            steps = begin + np.arange(first, first + m) * self.bodies.period_ns
            time = np.asarray(steps * 1e-9, np.float64)
            self.advance(rows[:m], outs[:m], energy[:m], iterations[:m])
            yield [
                Block(time, rows[:m, c, layout.MOTION], outs[:m, c], energy[:m]) for c in range(n)
            ]


@dataclass(frozen=True)
class GroupRun:
    """The result of a simulation of coupled connectors: N connectors, n samples."""

    time: Array  # (n,) s
    samples: Array  # (n, N, NSAMPLE)
    outs: Array  # (n, N, NOUT)
    energy: Array  # (n,) J
    iterations: NDArray[np.int64]  # (n,) of the solver for each sample
    group: Group
    bodies: Bodies


def simulate_group(
    scenes: Sequence[Scene], steps: int, progress: Progress | None = None
) -> GroupRun:
    """Run bodies and connectors in lock step for ``steps`` samples.

    ``progress`` is called with (done, total) samples at times, and at the end.
    """
    loop, n = GroupLoop(scenes), len(scenes)
    samples, outs = np.empty((steps, n, layout.NSAMPLE)), np.empty((steps, n, layout.NOUT))
    energy, iterations = np.empty(steps), np.zeros(steps, dtype=np.int64)
    for first in range(0, steps, BLOCK):
        part = slice(first, min(first + BLOCK, steps))
        loop.advance(samples[part], outs[part], energy[part], iterations[part])
        if progress is not None:
            progress(part.stop, steps)
    time = np.asarray(np.arange(steps) * loop.bodies.period_ns * 1e-9, np.float64)
    return GroupRun(time, samples, outs, energy, iterations, loop.group, loop.bodies)
