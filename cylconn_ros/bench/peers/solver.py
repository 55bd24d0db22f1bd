"""Interface of all solvers: prepare a problem, solve it, read the end state.

    prepare(problem) -> solve      solve() -> end_state      end_state() -> (26,) poses and twists

``prepare`` builds the model, equations or arrays. ``solve`` computes the motion from its start and
is the only timed part. ``end_state`` converts the solver's last state to poses and twists, from
which all errors are computed. ``prepare`` may raise :class:`NotApplicableError` or
:class:`NotInstalledError`.
"""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.bench.common.errors import NotInstalledError
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]
EndState = Callable[[], Array]
Solve = Callable[[], EndState]
Kind = Literal["own", "simulator", "reduced"]


@dataclass(frozen=True)
class Problem:
    """An initial value problem: a scene from its start for ``duration`` (s).

    Attributes
    ----------
        name: of the scene. value: step (s) or relative tolerance, see ``Solver.parameter``.
        calibration: slide (m) and spin (rad) at the end of ``calibration_scene``, for the solvers
            that fit a coefficient.
    """

    name: str
    scene: Scene
    duration: float
    value: float
    calibration: Mapping[str, float] = field(default_factory=dict)

    @property
    def steps(self) -> int:
        """Number of steps of size ``value`` in the duration."""
        return round(self.duration / self.value)


@dataclass(frozen=True)
class Solver:
    """One solver configuration.

    Attributes
    ----------
        family: solvers of one family share a process; also the package that it needs.
        kind: a method of this package, a simulator, or equations reduced for each scene.
        parameter: what controls the accuracy.
        description: the configuration in a few words.
        groups: whether it solves connectors that share a body.
    """

    name: str
    family: str
    kind: Kind
    parameter: Literal["step", "tolerance"]
    description: str
    prepare: Callable[[Problem], Solve]
    groups: bool = False


def calibration_scene(scene: Scene) -> Scene:
    """The scene at 0.8 of its initial speeds and of the deflection of its spring.

    A friction coefficient is calibrated on this scene. A coefficient fitted to the scene itself
    would predict nothing.
    """
    plant, body = scene.plant, scene.body_b
    twists = [tuple(0.8 * x for x in each.twist) for each in (plant.body_a, plant.body_b)]
    slower = dataclasses.replace(
        plant,
        body_a=dataclasses.replace(plant.body_a, twist=twists[0]),
        body_b=dataclasses.replace(plant.body_b, twist=twists[1]),
    )
    pose = scene.initial_pose(1)
    if scene.elasticity.k1 > 0.0:
        body = dataclasses.replace(body, pose=(0.8 * pose[0], *pose[1:]))
    return dataclasses.replace(scene, plant=slower, body_b=body)


def package(name: str, extra: str = "peers") -> Any:
    """Import an optional package; raises NotInstalledError."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        top = name.partition(".")[0]
        if isinstance(error, ModuleNotFoundError) and (error.name or "").startswith(top):
            reason = f"{top} is not installed: install it with pip install '.[{extra}]'"
        else:
            reason = f"{top} cannot be imported: {error}"
        raise NotInstalledError(reason) from None
