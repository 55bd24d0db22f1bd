"""Who tries to survive: our methods, and as guests what people use instead."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cylconn_ros.bench.common.errors import LeftOutError
from cylconn_ros.bench.common.methods import available, served_by
from cylconn_ros.bench.common.timing import Array
from cylconn_ros.bench.stability.channel import Faults
from cylconn_ros.bench.stability.loop import Trace, closed, loads_of
from cylconn_ros.bench.stability.naive import PenaltyNode
from cylconn_ros.connector.connector import Connector
from cylconn_ros.connector.synchronizer import SampleMatcher
from cylconn_ros.core import layout
from cylconn_ros.errors import SceneError
from cylconn_ros.scene.scene import Scene

OFFLINE = "minimal offline"
HAND = "penalty by hand"
MUJOCO, MUJOCO_LOOP = "MuJoCo", "MuJoCo loop"
UNKNOWING = ("penalty", "augmented_lagrangian")
INTEGRATORS = ("implicitfast", "RK4")
RTOL = 1e-8
MOST_STEPS = 200_000  # of the offline solution, between two samples

Mover = Callable[[Scene, Faults], Trace]


@dataclass(frozen=True)
class Contestant:
    """Moves a scene's bodies for its duration, through faults.

    Attributes
    ----------
        about: the set-up in a few words.
        moves: one way to do it, or several of which the best counts. They raise LeftOutError where
            they do not go with a scene, AbsentError where a package is missing.
    """

    name: str
    about: str
    moves: tuple[Mover, ...]


class Ours:
    """A connector, fed as the node feeds it: matched by stamp, answering each stamp once."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.connector = Connector(scene)
        self.matcher = SampleMatcher(scene)
        self.out: Array = np.zeros(layout.NOUT)
        self.matcher.sample[layout.LOADS] = loads_of(scene)  # known from the scene, not sent
        self._moving = [k for k, body in enumerate(scene.bodies) if body.kind != "fixed"]
        self._world = scene.world_frame

    def answer(self, sample: Array) -> Array:
        """(12,) of a sample that is the next."""
        return self.connector.step(sample, out=self.out)[: layout.STATE0]

    def receive(self, stamp: int, sample: Array) -> Array:
        """(12,) the newest answer after a sample that may be any."""
        numbers, matched = sample.tolist(), None
        for body in self._moving:
            at = (layout.A_POSE, layout.B_POSE)[body]
            self.matcher.pose(body, stamp, self._world, numbers[at : at + 7])
            matched = self.matcher.twist(body, stamp, self._world, numbers[at + 7 : at + 13])
        if matched is not None and not matched.repeated:
            if matched.restarted:
                self.connector.begin_anew()
            self.connector.step(self.matcher.sample, matched.h, self.out)
        return self.out[: layout.STATE0]


def contestants() -> list[Contestant]:
    """Everybody, in the order of the map's columns."""
    about = {
        "impulse": "the default where inertia is known",
        "minimal": "the mean wrench of the integrated motion",
        "baumgarte": "the textbook: multipliers of accelerations, regularised friction",
        "augmented_lagrangian": "gains of a careful user for each scene",
        "penalty": "gains of a careful user for each scene",
    }
    ours = [
        Contestant(name, about[name], (_Served(name),)) for name in about if name in available()
    ]
    return [
        *ours[:2],
        Contestant(OFFLINE, "no wrench: the scene in its own coordinates, 1e-8", (_offline,)),
        *ours[2:],
        Contestant(HAND, "the same springs, friction mu FN tanh(|s|/1 mm/s)", (_by_hand,)),
        Contestant(
            MUJOCO,
            "slide and hinge, frictionloss of the start; the better of implicitfast and RK4",
            tuple(_Mujoco(integrator, looped=False) for integrator in INTEGRATORS),
        ),
        Contestant(
            MUJOCO_LOOP,
            "frictionloss of the last step's reaction; the better of implicitfast and RK4",
            tuple(_Mujoco(integrator, looped=True) for integrator in INTEGRATORS),
        ),
    ]


@dataclass(frozen=True)
class _Served:
    method: str

    def __call__(self, scene: Scene, faults: Faults) -> Trace:
        known = scene if self.method not in UNKNOWING else _unknown(scene)
        served = served_by(known, self.method)
        return closed(served, Ours(served), faults)


def _unknown(scene: Scene) -> Scene:
    """The scene without what a method for unknown inertia would not be told."""
    values = scene.parameters()
    for body in ("body_a", "body_b"):
        if values[f"{body}.kind"] == "free":
            values[f"{body}.kind"] = "unknown"
    try:
        return Scene.from_parameters(values)
    except SceneError as error:
        raise LeftOutError(str(error)) from None


def _by_hand(scene: Scene, faults: Faults) -> Trace:
    if scene.latency != 0:
        raise LeftOutError("knows nothing of late wrenches")
    return closed(scene, PenaltyNode(served_by(scene, "penalty")), faults)


def _alone(faults: Faults) -> None:
    if faults.any:
        raise LeftOutError("nothing is sent: the joint is within")


def _offline(scene: Scene, faults: Faults) -> Trace:
    from cylconn_ros.simulation.minimal import solve

    _alone(faults)
    if scene.reference.misalignment == "zero" and scene.node_b.orientation:
        raise LeftOutError("its coordinates hold the misalignment: nothing is pulled in")
    times = np.arange(0.0, scene.plant.duration, scene.period, dtype=np.float64)
    return Trace(times, solve(scene, times[-1], RTOL, times, MOST_STEPS).states)


@dataclass(frozen=True)
class _Mujoco:
    integrator: str
    looped: bool

    def __call__(self, scene: Scene, faults: Faults) -> Trace:
        from cylconn_ros.bench.stability.mujoco import moved

        _alone(faults)
        return moved(scene, self.integrator, self.looped)
