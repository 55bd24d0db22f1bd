"""Solvers of the stability map: the methods of this package and external solvers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cylconn_ros.bench.common.errors import NotApplicableError
from cylconn_ros.bench.common.methods import with_method
from cylconn_ros.bench.common.timing import Array
from cylconn_ros.bench.stability.careful import CarefulNode
from cylconn_ros.bench.stability.channel import Faults
from cylconn_ros.bench.stability.loop import Trace, closed_loop, loads_of
from cylconn_ros.bench.stability.naive import NaivePenalty
from cylconn_ros.connector.connector import Connector
from cylconn_ros.connector.synchronizer import SampleMatcher
from cylconn_ros.core import layout
from cylconn_ros.errors import SceneError
from cylconn_ros.methods.traits import SOLVERS, TRAITS
from cylconn_ros.scene.scene import Scene

OFFLINE = "minimal offline"
CAREFUL = "careful user"
NAIVE = "naive penalty"
MUJOCO, MUJOCO_LOOP = "MuJoCo", "MuJoCo loop"
INTEGRATORS = ("implicitfast", "RK4")
RTOL = 1e-8  # of the offline solution
MAX_STEPS = 200_000  # of the offline solution, between two samples

Simulate = Callable[[Scene, Faults], Trace]


@dataclass(frozen=True)
class Solver:
    """Simulates a scene for its duration, with faults.

    Attributes
    ----------
        about: the set-up in a few words.
        setups: one or several set-ups; the best one counts. Each raises NotApplicableError if it
            does not support a scene, NotInstalledError if a package is missing.
    """

    name: str
    about: str
    setups: tuple[Simulate, ...]


class ConnectorSolver:
    """A Connector behind a synchronizer, as in the node: each stamp is processed once."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.connector = Connector(scene)
        self.matcher = SampleMatcher(scene)
        self.out: Array = np.zeros(layout.NOUT)
        self.matcher.sample[layout.LOADS] = loads_of(scene)  # known from the scene, not sent
        self._moving = [k for k, body in enumerate(scene.bodies) if body.kind != "fixed"]
        self._world = scene.world_frame

    def step(self, sample: Array) -> Array:
        """(12,) wrenches of the next sample (NSAMPLE,)."""
        return self.connector.step(sample, out=self.out)[: layout.STATE0]

    def receive(self, stamp: int, sample: Array) -> Array:
        """(12,) the newest wrenches after any sample has arrived; stamp in ns."""
        numbers, matched = sample.tolist(), None
        for body in self._moving:
            at = (layout.A_POSE, layout.B_POSE)[body]
            self.matcher.pose(body, stamp, self._world, numbers[at : at + 7])
            matched = self.matcher.twist(body, stamp, self._world, numbers[at + 7 : at + 13])
        if matched is not None and not matched.repeated:
            if matched.restarted:
                self.connector.reset(keep_in_flight=True)
            self.connector.step(self.matcher.sample, matched.h, self.out)
        return self.out[: layout.STATE0]


def solvers() -> list[Solver]:
    """All solvers in the order of the map's columns."""
    gains = "; gains of a careful user for each scene"
    methods = [
        Solver(name, traits.summary + (gains if traits.uses_gains else ""), (_Method(name),))
        for name, traits in TRAITS.items()
        if name in SOLVERS
    ]
    return [
        *methods[:1],
        Solver(OFFLINE, "no wrench: integrated in joint coordinates to 1e-8", (_offline,)),
        *methods[1:],
        Solver(NAIVE, "the same springs, friction mu FN tanh(|s|/1 mm/s)", (_naive,)),
        Solver(CAREFUL, "impulses, friction of the last step's reaction, damped", (_careful,)),
        Solver(
            MUJOCO,
            "slide and hinge, frictionloss of the start; the better of implicitfast and RK4",
            tuple(_Mujoco(integrator, friction_loop=False) for integrator in INTEGRATORS),
        ),
        Solver(
            MUJOCO_LOOP,
            "frictionloss of the last step's reaction; the better of implicitfast and RK4",
            tuple(_Mujoco(integrator, friction_loop=True) for integrator in INTEGRATORS),
        ),
    ]


@dataclass(frozen=True)
class _Method:
    method: str

    def __call__(self, scene: Scene, faults: Faults) -> Trace:
        known = scene if TRAITS[self.method].needs_inertia else _with_unknown_inertia(scene)
        configured = with_method(known, self.method)
        return closed_loop(configured, ConnectorSolver(configured), faults)


def _with_unknown_inertia(scene: Scene) -> Scene:
    """The scene with free bodies of unknown inertia, for methods that do not need it."""
    values = scene.parameters()
    for body in ("body_a", "body_b"):
        if values[f"{body}.kind"] == "free":
            values[f"{body}.kind"] = "unknown"
    try:
        return Scene.from_parameters(values)
    except SceneError as error:
        raise NotApplicableError(str(error)) from None


def _naive(scene: Scene, faults: Faults) -> Trace:
    if scene.latency > 0:
        raise NotApplicableError("has no latency compensation")
    if scene.elasticity.k1 > 0.0 or scene.friction.overlap_change != "constant":
        raise NotApplicableError("has no spring of the slide and no changing overlap")
    return closed_loop(scene, NaivePenalty(with_method(scene, "penalty")), faults)


def _careful(scene: Scene, faults: Faults) -> Trace:
    return closed_loop(scene, CarefulNode(scene), faults)


def _require_no_faults(faults: Faults) -> None:
    if faults.any:
        raise NotApplicableError("has no channel: it simulates the joint itself")


def _offline(scene: Scene, faults: Faults) -> Trace:
    from cylconn_ros.simulation.minimal import solve

    _require_no_faults(faults)
    if scene.reference.misalignment == "zero" and scene.node_b.orientation:
        raise NotApplicableError("joint coordinates keep the misalignment: no pull-in")
    times = np.arange(0.0, scene.plant.duration, scene.period, dtype=np.float64)
    return Trace(times, solve(scene, times[-1], RTOL, times, MAX_STEPS).states)


@dataclass(frozen=True)
class _Mujoco:
    integrator: str
    friction_loop: bool

    def __call__(self, scene: Scene, faults: Faults) -> Trace:
        from cylconn_ros.bench.stability.mujoco import simulate

        _require_no_faults(faults)
        return simulate(scene, self.integrator, self.friction_loop)
