"""Scenes of the library as problems: the errors of a run against answers from elsewhere."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cylconn_ros.bench.common.settings import SceneLoader
from cylconn_ros.bench.precision.trials import Errors
from cylconn_ros.reference import library
from cylconn_ros.reference.answers import Expected
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.simulate import Run

HANDFUL = {
    "coast": 1.0,
    "slide_and_spin": 1.0,
    "demo": 5.0,
    "eccentric_rotor": 2.0,
    "near_jam": 0.2,
    "incline": 1.0,
    "incline_stick": 1.0,
    "dry_friction_oscillator": 2.5,
    "telescopic_strut": 2.0,
    "bead_on_rod": 1.0,
    "hub_and_rotor": 1.0,
    "free_flight": 1.0,
}
"""Scenes whose orders are fitted, and for how long they run, s; periods up to 4 ms divide that."""


@dataclass(frozen=True)
class Problem:
    """A scene of the library with its answer, whatever the period it is run at."""

    name: str
    scene: Scene
    duration: float
    answer: Sequence[Expected]

    def errors(self, run: Run) -> Errors:
        """How far off a run is; NaN where a method does not give a quantity."""
        found = {
            each.name: (abs(float(each.of(run)) - each.value), each.unit) for each in self.answer
        }
        violation = float(np.abs(run.state("offset_violation")).max())
        return {**found, "constraint": (violation, "m")}


def problem(load: SceneLoader, name: str) -> Problem:
    """One problem by the name of its scene."""
    scene, duration = load(name), HANDFUL[name]
    plant = dataclasses.replace(scene.plant, duration=duration)
    scene = dataclasses.replace(scene, plant=plant)
    return Problem(name, scene, duration, library.expected(name, scene, duration))


def handful(load: SceneLoader) -> Iterator[Problem]:
    """All problems whose orders are fitted."""
    for name in HANDFUL:
        yield problem(load, name)
