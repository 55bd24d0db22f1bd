"""The closed loop of two bodies and somebody who answers their samples; only wrenches go out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cylconn_ros.bench.common.timing import Array
from cylconn_ros.bench.stability import channel
from cylconn_ros.bench.stability.channel import Channel, Faults
from cylconn_ros.core import layout, plant
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene


class Servant(Protocol):
    """Whoever turns samples into wrenches."""

    @property
    def out(self) -> Array | None:
        """(NOUT,) the whole of the last answer, of a connector of ours."""

    def answer(self, sample: Array) -> Array:
        """(12,) force and torque on A and B, world axes, about the mass centres."""

    def receive(self, stamp: int, sample: Array) -> Array:
        """The same for what came through a channel: perhaps late, again, or not usable."""


@dataclass(frozen=True)
class Trace:
    """What the bodies did.

    Attributes
    ----------
        time: (N,) s. states: (N, 26) poses and twists. wrenches: (N, 12) as they acted, or None.
        begins: samples at which the motion was set by somebody else: the start, a teleport.
        lost: whether it ended early, because a state was not finite.
        outs: (N, NOUT) answers of a connector of ours to these states; None with a channel.
        served: the scene as that connector was given it.
    """

    time: Array
    states: Array
    wrenches: Array | None = None
    begins: tuple[int, ...] = (0,)
    lost: bool = False
    outs: Array | None = None
    served: Scene | None = None


def closed(scene: Scene, servant: Servant, faults: Faults | None = None) -> Trace:
    """Run for the scene's duration; ends early where a state is not finite any more."""
    faults = faults or Faults()
    return _faulty(scene, servant, faults) if faults.any else _direct(scene, servant)


class _Bodies:
    """The plant, which takes any period."""

    def __init__(self, scene: Scene) -> None:
        self.par = pack(scene, plant=True)
        self.start = np.array(
            [
                *scene.initial_pose(0),
                *scene.initial_twist(0),
                *scene.initial_pose(1),
                *scene.initial_twist(1),
            ]
        )
        self.loads = loads_of(scene)
        self.state = self.start.copy()

    def step(self, wrench: Array, h: float) -> bool:
        """Move by h; whether the state is still finite."""
        plant.step(self.par, self.state, wrench[:6], wrench[6:], self.loads, h)
        return bool(np.isfinite(self.state).all())


def loads_of(scene: Scene) -> Array:
    """(12,) force and torque that the scene's plant puts on A and B besides gravity."""
    return np.array([*scene.plant.body_a.load, *scene.plant.body_b.load])


def _steps(scene: Scene) -> int:
    return max(20, round(scene.plant.duration / scene.period))


def _direct(scene: Scene, servant: Servant) -> Trace:
    n, h, bodies = _steps(scene), scene.period, _Bodies(scene)
    states, wrenches = np.zeros((n, layout.NSAMPLE)), np.zeros((n, 12))
    outs, done = np.zeros((n, layout.NOUT)), n
    states[:, layout.LOADS] = bodies.loads
    for k in range(n):
        states[k, layout.MOTION] = bodies.state
        wrenches[k] = servant.answer(states[k])
        if servant.out is not None:
            outs[k] = servant.out
        if not bodies.step(wrenches[k], h):
            done = k + 1
            break
    return Trace(
        h * np.arange(done, dtype=np.float64),
        states[:done, layout.MOTION],
        wrenches[:done],
        lost=not np.isfinite(bodies.state).all(),
        outs=None if servant.out is None else outs[:done],
        served=scene,
    )


def _faulty(scene: Scene, servant: Servant, faults: Faults) -> Trace:
    n, bodies = _steps(scene), _Bodies(scene)
    way = Channel(faults, _sent(scene))
    states, wrenches, time = np.zeros((n, 26)), np.zeros((n, 12)), np.zeros(n)
    sample = np.zeros(layout.NSAMPLE)
    newest: Array = np.zeros(12)
    now, clock, begins, half, done = 0.0, 0.0, [0], n // 2, n
    for k in range(n):
        again = 1
        if k == half:
            again = channel.PAUSE if faults.pause else 1
            clock -= channel.JUMP if faults.jump else 0.0
            if faults.restart:
                bodies.state[:], clock = bodies.start, 0.0
            if faults.teleport:
                bodies.state[:] = channel.teleported(bodies.state)
            begins += [k] if faults.begins_anew else []
        sample[layout.MOTION] = bodies.state
        for _ in range(again):
            for stamp, arrived in way.deliver(k, round(clock * 1e9), sample):
                newest = servant.receive(stamp, arrived)
        time[k], states[k], wrenches[k] = now, bodies.state, way.act(newest)
        h = scene.period * way.stretch()
        if not bodies.step(wrenches[k], h):
            done = k + 1
            break
        now, clock = now + h, clock + h
    lost = not np.isfinite(bodies.state).all()
    return Trace(time[:done], states[:done], wrenches[:done], tuple(begins), lost)


def _sent(scene: Scene) -> list[int]:
    """Places in a sample of the moving bodies' fields."""
    starts = (layout.A_POSE, layout.B_POSE)
    moving = [at for at, body in zip(starts, scene.bodies, strict=True) if body.kind != "fixed"]
    return [field for at in moving for field in range(at, at + 13)]
