"""The closed loop of coupled connectors in process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.frames import into_world
from cylconn_ros.connector.group import Group
from cylconn_ros.connector.over_time import OverTime
from cylconn_ros.core import layout
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.closed_loop import Progress
from cylconn_ros.simulation.plant import Plant

Array = NDArray[np.float64]

_STATES = (slice(0, 13), slice(13, 26))  # pose and twist of A, of B


class Bodies:
    """The bodies of several connectors, each once: the plant of a group.

    Attributes
    ----------
        frames: of all moving bodies.
        states: (26,) per connector, poses and twists of its bodies as in a sample.
    """

    def __init__(self, scenes: Sequence[Scene]) -> None:
        self._plants = [Plant(scene) for scene in scenes]
        self._frames = [[body.frame for body in scene.bodies] for scene in scenes]
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

    def step(self, wrenches: Sequence[tuple[Array, Array]]) -> None:
        """Advance a period under the wrenches of each connector on its bodies, as published."""
        total: dict[str, Array] = {}
        for frames, pair in zip(self._frames, wrenches, strict=True):
            for frame, wrench in zip(frames, pair, strict=True):
                total[frame] = total.get(frame, np.zeros(6)) + wrench
        for frames, plant in zip(self._frames, self._plants, strict=True):
            plant.step(total[frames[0]], total[frames[1]])

    def energy(self) -> float:
        """Kinetic and gravitational energy of all bodies, J."""
        known: dict[str, float] = {}
        for frames, plant in zip(self._frames, self._plants, strict=True):
            for k, frame in enumerate(frames):
                known.setdefault(frame, _energy(plant, k))
        return sum(known.values())


def _energy(plant: Plant, k: int) -> float:
    """Kinetic and gravitational energy of body A (0) or B (1) of a plant, J."""
    body = plant.scene.bodies[k]
    if body.kind != "free":
        return 0.0
    pose, twist = np.split(plant.state[_STATES[k]], [7])
    axes = np.reshape(
        [into_world(pose.tolist(), [*e, 0.0, 0.0, 0.0])[:3] for e in np.eye(3)], (3, 3)
    ).T
    arm, spin = axes @ body.com, twist[3:]
    velocity = twist[:3] + np.cross(spin, arm)
    ixx, ixy, ixz, iyy, iyz, izz = body.inertia
    inertia = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    w = axes.T @ spin
    kinetic = 0.5 * (body.mass * velocity @ velocity + w @ inertia @ w)
    return float(kinetic - body.mass * np.dot(plant.scene.gravity, pose[:3] + arm))


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
    bodies, group = Bodies(scenes), Group(scenes)
    n = len(scenes)
    time, energy = np.empty(steps), np.empty(steps)
    samples, outs = np.zeros((steps, n, layout.NSAMPLE)), np.empty((steps, n, layout.NOUT))
    iterations = np.zeros(steps, dtype=np.int64)
    for k in range(steps):
        time[k], energy[k] = bodies.time_ns * 1e-9, bodies.energy()
        for c in range(n):
            samples[k, c, layout.MOTION] = bodies.states[c]
            samples[k, c, layout.LOADS] = bodies.loads[c]
            bodies.over_time[c].follow(group.connectors[c], k)
        group.step(samples[k], outs=outs[k])
        iterations[k] = group.iterations
        bodies.step([(out[0:6], out[6:12]) for out in outs[k]])
        if progress is not None and (k % 1024 == 0 or k + 1 == steps):
            progress(k + 1, steps)
    return GroupRun(time, samples, outs, energy, iterations, group, bodies)
