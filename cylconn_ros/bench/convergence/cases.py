"""Scenes of the library as convergence cases: the errors of a run against reference solutions."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cylconn_ros.bench.common.results import Errors
from cylconn_ros.bench.common.settings import SceneLoader
from cylconn_ros.reference import library
from cylconn_ros.reference.answers import Expected
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.simulate import Run

DURATIONS = {
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
"""Duration (s) of each case by the name of its scene; a multiple of every period up to 4 ms."""


@dataclass(frozen=True)
class ConvergenceCase:
    """A scene with its reference solution, which does not depend on the sample period."""

    name: str
    scene: Scene
    duration: float
    reference: Sequence[Expected]

    def errors(self, run: Run) -> Errors:
        """Errors of a run; NaN if a method does not compute the quantity."""
        found = {
            each.name: (abs(float(each.of(run)) - each.value), each.unit) for each in self.reference
        }
        violation = float(np.abs(run["offset_violation"]).max())
        return {**found, "constraint": (violation, "m")}


def convergence_case(load: SceneLoader, name: str) -> ConvergenceCase:
    """One case, by the name of its scene."""
    scene, duration = load(name), DURATIONS[name]
    plant = dataclasses.replace(scene.plant, duration=duration)
    scene = dataclasses.replace(scene, plant=plant)
    return ConvergenceCase(name, scene, duration, library.expected(name, scene, duration))


def convergence_cases(load: SceneLoader) -> Iterator[ConvergenceCase]:
    """All cases."""
    for name in DURATIONS:
        yield convergence_case(load, name)
