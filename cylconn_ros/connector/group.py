"""Coupled connectors: connectors that share bodies, solved together for the same stamp.

The step is that of methods/coupled/step.py: reactions of least norm, and friction, stops and
drives of all connectors as one problem.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector import batch
from cylconn_ros.connector.connector import Connector
from cylconn_ros.connector.description import describe_model
from cylconn_ros.core import layout, model
from cylconn_ros.errors import SceneError
from cylconn_ros.methods.coupled import step as coupled
from cylconn_ros.methods.coupled.memory import working_size
from cylconn_ros.scene import shared_bodies
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]


class Group:
    """Coupled connectors that process one sample each per stamp.

    Attributes
    ----------
        connectors: in the order of the scenes; their parameters and memories are the group's.
        iterations: number of steps of the solver for the last sample. residual: of the last
        sample, of the problem of the group.

    A single connector is processed by :meth:`Connector.step`. Raises SceneError if scenes disagree
    about a shared body or cannot be coupled.
    """

    def __init__(
        self, scenes: Sequence[Scene], connectors: Sequence[Connector] | None = None
    ) -> None:
        """``connectors``: of the scenes, with their memories; by default new ones."""
        named = {f"connectors[{k}]": scene for k, scene in enumerate(scenes)}
        shared_bodies.check(named)
        if len(shared_bodies.groups(named)) > 1:
            raise SceneError("connectors of a group must have bodies in common")
        self.connectors = list(connectors or [Connector(scene) for scene in scenes])
        self._report = np.zeros(coupled.NREPORT)
        n = len(scenes)
        if n > 1:
            for connector in self.connectors:  # without delay compensation
                connector.par[model.LATENCY] = connector.par[model.LATENCY_CHECKED] = 0.0
                connector.model, connector.not_modelled = describe_model(
                    connector.scene, connector.method, coupled=True
                )
        longest = max(len(connector.par) for connector in self.connectors)
        self._par, self._mem = np.zeros((n, longest)), np.zeros((n, model.NMEM))
        for connector, par, mem in zip(self.connectors, self._par, self._mem, strict=True):
            connector.use_arrays(par[: len(connector.par)], mem)
        self._constants = _constants(scenes)
        self._work = np.zeros((1, working_size(n)))

    @property
    def iterations(self) -> int:
        """Number of steps of the solver for the last sample."""
        return int(self._report[coupled.STEPS])

    @property
    def residual(self) -> float:
        """Residual of the last sample, of the problem of the group."""
        return float(self._report[coupled.RESIDUAL])

    def reset(self) -> None:
        """Forget the reference configuration and all history."""
        for connector in self.connectors:
            connector.reset()

    def step(self, samples: Array, h: float = 0.0, outs: Array | None = None) -> Array:
        """Process one sample of each connector: (N, NSAMPLE) of one stamp into (N, NOUT).

        Samples must agree about a shared body. If a sample cannot be used, all wrenches are zero
        and every ``STATUS`` is that of the first such sample. ``h`` as for Connector.step.
        """
        if outs is None:
            outs = np.empty((len(self.connectors), layout.NOUT))
        if len(self.connectors) == 1:
            self.connectors[0].step(samples[0], h, outs[0])
            return outs
        periods = [connector.scene.period for connector in self.connectors]
        used = map(batch.step_period, self._mem, samples, repeat(h), periods)
        h = min(used)  # the same for all
        status = coupled.step_group(
            self._par, self._mem, samples, h, outs, self._constants, self._work, self._report
        )
        if status != layout.OK:
            if status == layout.NOT_FINITE and np.isfinite(samples).all():
                self.reset()
            outs[:] = 0.0
            outs[:, layout.STATUS] = status
        return outs


def _constants(scenes: Sequence[Scene]) -> Array:
    """(N, NCONSTANTS) numbers of the free bodies, arms and radii of the connectors."""
    frames = [body.frame for scene in scenes for body in scene.bodies if body.kind == "free"]
    numbers = {frame: k for k, frame in enumerate(dict.fromkeys(frames))}
    return np.array(
        [
            [
                *(numbers[b.frame] if b.kind == "free" else -1 for b in scene.bodies),
                arm(scene),
                _radius(scene),
            ]
            for scene in scenes
        ],
        dtype=np.float64,
    )


def arm(scene: Scene) -> float:
    """The arm (m) that relates moments to forces: half the overlap, else the radius.

    If neither is given, the radius of gyration of the lightest free body.
    """
    if scene.friction.overlap > 0.0:
        return 0.5 * scene.friction.overlap
    if scene.friction.radius > 0.0:
        return scene.friction.radius
    free = min((b for b in scene.bodies if b.kind == "free"), key=lambda b: b.mass, default=None)
    if free is None:
        return 1.0
    ixx, _, _, iyy, _, izz = free.inertia
    return float(np.sqrt((ixx + iyy + izz) / (3.0 * free.mass)))


def _radius(scene: Scene) -> float:
    return scene.friction.radius if scene.friction.radius > 0.0 else arm(scene)
