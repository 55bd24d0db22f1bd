"""What every contestant is asked, and what it answers.

    prepare(task) -> solve      solve() -> read      read() -> (26,) poses and twists at the end

``prepare`` builds model, equations or arrays; ``solve`` starts anew every time, and alone is timed;
``read`` turns the end of it into what everybody is judged by. ``prepare`` may raise
:class:`LeftOutError` or :class:`AbsentError`.
"""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.bench.common.errors import AbsentError
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]
Read = Callable[[], Array]
Solve = Callable[[], Read]
Kind = Literal["ours", "simulator", "hand"]


@dataclass(frozen=True)
class Task:
    """A scene from its start for ``duration`` (s).

    Attributes
    ----------
        name: of the scene. value: the step (s), or the relative tolerance, as ``Contestant.knob``
        says. truth: slide (m) and spin (rad) at the end of ``milder``, for those that calibrate.
    """

    name: str
    scene: Scene
    duration: float
    value: float
    truth: Mapping[str, float] = field(default_factory=dict)

    @property
    def steps(self) -> int:
        """How many steps of ``value`` the duration has."""
        return round(self.duration / self.value)


@dataclass(frozen=True)
class Contestant:
    """Somebody in one set-up.

    Attributes
    ----------
        family: whose process it runs in; also the package that it needs.
        kind: ours, a simulator, or equations made by hand for one scene.
        knob: what accuracy is asked by.
        about: the set-up in a few words.
    """

    name: str
    family: str
    kind: Kind
    knob: Literal["step", "tolerance"]
    about: str
    prepare: Callable[[Task], Solve]


def milder(scene: Scene) -> Scene:
    """The scene at four fifths of its speed, and of its spring's deflection.

    What a coefficient is calibrated on: one that were fitted to the very answer it is asked for
    would not predict anything.
    """
    plant, body = scene.plant, scene.body_b
    twists = [tuple(0.8 * x for x in each.twist) for each in (plant.body_a, plant.body_b)]
    moved = dataclasses.replace(
        plant,
        body_a=dataclasses.replace(plant.body_a, twist=twists[0]),
        body_b=dataclasses.replace(plant.body_b, twist=twists[1]),
    )
    pose = scene.initial_pose(1)
    if scene.elasticity.k1 > 0.0:
        body = dataclasses.replace(body, pose=(0.8 * pose[0], *pose[1:]))
    return dataclasses.replace(scene, plant=moved, body_b=body)


def package(name: str, extra: str = "peers") -> Any:
    """An optional package; raises AbsentError."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        known = name.partition(".")[0]
        if isinstance(error, ModuleNotFoundError) and (error.name or "").startswith(known):
            reason = f"{known} is not installed: pip install '.[{extra}]' brings it"
        else:
            reason = f"{known} cannot be imported: {error}"
        raise AbsentError(reason) from None
