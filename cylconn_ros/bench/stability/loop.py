"""Closed loop of two bodies and a solver that computes wrenches from their samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cylconn_ros.bench.common.timing import Array
from cylconn_ros.bench.faults.free_running import FreeRunningPlant, Lag
from cylconn_ros.bench.stability.channel import JUMP, PAUSE, Channel, Faults, teleport
from cylconn_ros.core import layout, plant
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene


class SampleSolver(Protocol):
    """Computes wrenches from samples."""

    @property
    def out(self) -> Array | None:
        """(NOUT,) the whole output of a Connector for the last sample; None for another solver."""

    def step(self, sample: Array) -> Array:
        """(12,) force and torque on A and B, world axes, about the mass centres."""

    def receive(self, stamp: int, sample: Array) -> Array:
        """The same for a sample from a channel: it may be late, repeated or corrupt."""


@dataclass(frozen=True)
class Trace:
    """Motion of the bodies.

    Attributes
    ----------
        time: (N,) s. states: (N, 26) poses and twists. wrenches: (N, 12) that acted, or None.
        starts: samples at which the state was set: the initial state, a restart, a teleport.
        diverged: whether it ended early because a state was not finite.
        outs: (N, NOUT) outputs of a Connector for these states; None with a channel.
        solver_scene: the scene of that Connector.
    """

    time: Array
    states: Array
    wrenches: Array | None = None
    starts: tuple[int, ...] = (0,)
    diverged: bool = False
    outs: Array | None = None
    solver_scene: Scene | None = None


def closed_loop(scene: Scene, solver: SampleSolver, faults: Faults | None = None) -> Trace:
    """Run for the scene's duration; end early if a state is not finite."""
    faults = faults or Faults()
    if faults.free_running:
        return _free_running(scene, solver, faults)
    return _faulty(scene, solver, faults) if faults.any else _direct(scene, solver)


class _Bodies:
    """The plant, moved with any period."""

    def __init__(self, scene: Scene) -> None:
        self.par = pack(scene, plant=True)
        self.start = initial_state(scene)
        self.loads = loads_of(scene)
        self.state = self.start.copy()

    def step(self, wrench: Array, h: float) -> bool:
        """Move by h (s) under (12,) wrenches; return whether the state is finite."""
        plant.step(self.par, self.state, wrench[:6], wrench[6:], self.loads, h)
        return bool(np.isfinite(self.state).all())


def initial_state(scene: Scene) -> Array:
    """(26,) initial poses and twists of A and B."""
    start = [part for k in (0, 1) for part in (scene.initial_pose(k), scene.initial_twist(k))]
    return np.array([x for part in start for x in part])


def loads_of(scene: Scene) -> Array:
    """(12,) external force and torque on A and B, besides gravity."""
    return np.array([*scene.plant.body_a.load, *scene.plant.body_b.load])


def _steps(scene: Scene) -> int:
    return max(20, round(scene.plant.duration / scene.period))


def _direct(scene: Scene, solver: SampleSolver) -> Trace:
    n, h, bodies = _steps(scene), scene.period, _Bodies(scene)
    states, wrenches = np.zeros((n, layout.NSAMPLE)), np.zeros((n, 12))
    outs, done = np.zeros((n, layout.NOUT)), n
    states[:, layout.LOADS] = bodies.loads
    for k in range(n):
        states[k, layout.MOTION] = bodies.state
        wrenches[k] = solver.step(states[k])
        if solver.out is not None:
            outs[k] = solver.out
        if not bodies.step(wrenches[k], h):
            done = k + 1
            break
    return Trace(
        h * np.arange(done, dtype=np.float64),
        states[:done, layout.MOTION],
        wrenches[:done],
        diverged=not np.isfinite(bodies.state).all(),
        outs=None if solver.out is None else outs[:done],
        solver_scene=scene,
    )


def _faulty(scene: Scene, solver: SampleSolver, faults: Faults) -> Trace:
    n, bodies = _steps(scene), _Bodies(scene)
    channel = Channel(faults, _sent_fields(scene))
    states, wrenches, time = np.zeros((n, 26)), np.zeros((n, 12)), np.zeros(n)
    sample = np.zeros(layout.NSAMPLE)
    newest: Array = np.zeros(12)
    now, clock, starts, half, done = 0.0, 0.0, [0], n // 2, n
    for k in range(n):
        repeats = 1
        if k == half:
            repeats = PAUSE if faults.pause else 1
            clock -= JUMP if faults.jump else 0.0
            if faults.restart:
                bodies.state[:], clock = bodies.start, 0.0
            if faults.teleport:
                bodies.state[:] = teleport(bodies.state)
            starts += [k] if faults.displaces_bodies else []
        sample[layout.MOTION] = bodies.state
        for _ in range(repeats):
            for stamp, arrived in channel.deliver(k, round(clock * 1e9), sample):
                newest = solver.receive(stamp, arrived)
        time[k], states[k], wrenches[k] = now, bodies.state, channel.act(newest)
        h = scene.period * channel.period_factor()
        if not bodies.step(wrenches[k], h):
            done = k + 1
            break
        now, clock = now + h, clock + h
    diverged = not np.isfinite(bodies.state).all()
    return Trace(time[:done], states[:done], wrenches[:done], tuple(starts), diverged)


def _free_running(scene: Scene, solver: SampleSolver, faults: Faults) -> Trace:
    n, h, free = _steps(scene), scene.period, FreeRunningPlant(scene)
    lag, random = Lag(faults.lag, faults.lag_kind), np.random.default_rng(faults.seed)
    states, wrenches, sample = np.zeros((n, 26)), np.zeros((n, 12)), np.zeros(layout.NSAMPLE)
    finite, done = True, n
    for k in range(n):
        sample[layout.MOTION], sample[layout.LOADS] = free.plant.state, free.plant.loads
        states[k] = free.plant.state
        wrenches[k] = solver.receive(round(k * h * 1e9), sample)
        free.put(k, (k + lag.of_sample(k, h, n * h, random)) * h, wrenches[k].copy())
        finite = free.move(k * h, h)
        if not finite:
            done = k + 1
            break
    return Trace(
        h * np.arange(done, dtype=np.float64), states[:done], wrenches[:done], diverged=not finite
    )


def _sent_fields(scene: Scene) -> list[int]:
    """Indices in a sample of the moving bodies' fields."""
    starts = (layout.A_POSE, layout.B_POSE)
    moving = [at for at, body in zip(starts, scene.bodies, strict=True) if body.kind != "fixed"]
    return [field for at in moving for field in range(at, at + 13)]
