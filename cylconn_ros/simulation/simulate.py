"""Simulate a scene in process, without ROS: the closed loop, or a motion to a stated accuracy."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.errors import SceneError
from cylconn_ros.methods.traits import LIVE
from cylconn_ros.scene.packing import choose_method
from cylconn_ros.scene.scene import Scene
from cylconn_ros.scene.schema import show
from cylconn_ros.simulation.closed_loop import Progress, closed_loop, times
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.run import Accuracy, Run
from cylconn_ros.simulation.to_tolerance import motion, offline

__all__ = ["Run", "simulate", "sweep"]

Array = NDArray[np.float64]


def simulate(
    scene: Scene,
    duration: float | None = None,
    *,
    samples: int | None = None,
    progress: Progress | None = None,
) -> Run:
    """Simulate the scene with its plant and connector in lock step.

    Wrenches act late as ``plant.latency`` says (by default as ``latency`` if that is > 0).

    Args:
        duration: s, by default the scene's ``plant.duration``. The run includes the state at its
            end: ``duration / period + 1`` samples, rounded to whole periods.
        samples: number of samples, in place of ``duration``.
        progress: called with (done, total) samples at times, and at the end.

    If the scene states a ``tolerance`` with the method auto, the motion is computed to that
    accuracy (simulation/to_tolerance.py); the method minimal computes the motion in joint
    coordinates. In both cases the connector then processes the samples of this motion.

    Raises :class:`~cylconn_ros.errors.SceneError` for a scene that cannot be simulated, for
    instance with an unknown inertia, and for a duration that is not finite.

    Example::

        run = cr.simulate(cr.load(cr.shipped("demo")), duration=5.0)
        print(run.time[-1], run["displacement"][-1])
    """
    if samples is None:
        samples = samples_of(scene, duration)
    elif duration is not None:
        raise ValueError(f"samples = {samples}: must not be given together with duration")
    to_tolerance = scene.tolerance > 0.0 and scene.method == "auto"
    if (choose_method(scene) not in LIVE or to_tolerance) and scene.plant_latency > 0.0:
        name = "latency" if math.isnan(scene.plant.latency) else "plant.latency"
        raise SceneError(
            f"{name} = {show(scene.plant_latency)}: must be 0 for a motion that is computed "
            "without wrenches (the method minimal, or a tolerance); remove it, or use impulse"
        )
    if choose_method(scene) not in LIVE:
        return _along(scene, offline(scene, samples), samples, progress)
    if to_tolerance:
        return _along(scene, motion(scene, samples), samples, progress)
    return closed_loop(scene, samples, progress)


def samples_of(scene: Scene, duration: float | None = None) -> int:
    """Number of samples from 0 to ``duration`` (s; by default the scene's), both included.

    Raises SceneError for a duration that is not finite or negative, or a scene without a period.
    """
    try:
        seconds = float(scene.plant.duration if duration is None else duration)
    except (TypeError, ValueError):
        raise SceneError(f"duration = {show(duration)}: must be a number of seconds") from None
    if scene.period <= 0.0:
        raise SceneError("period = 0.0: must be > 0 s for a simulation")
    if not 0.0 <= seconds < math.inf:
        name = "plant.duration" if duration is None else "duration"
        raise SceneError(f"{name} = {show(seconds)}: must be finite and >= 0 s for a simulation")
    return round(seconds / scene.period) + 1


def sweep(
    scene: Scene,
    vary: Mapping[str, Sequence[Any]],
    duration: float | None = None,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
) -> list[Run]:
    """Simulate the scene for every combination of parameter values, on all cores.

    Args:
        vary: dotted parameter names and the values of each; the last name varies fastest.
        duration: s, as for :func:`simulate`. workers: threads; by default one per core.
        progress: called with (done, total) runs.

    Returns the runs in order; ``run.scene`` is the scene of each. All scenes are checked before the
    first run: raises :class:`~cylconn_ros.errors.SceneError` for an unusable value.

    Example::

        scene = cr.load(cr.shipped("coast"))
        runs = cr.sweep(scene, {"friction.coefficient": [0.1, 0.2, 0.3]}, duration=1.0)
        print([run["displacement"][-1] for run in runs])
    """
    scenes = [
        scene.replace(dict(zip(vary, values, strict=True))) for values in product(*vary.values())
    ]
    runs: list[Run] = []
    if not scenes:
        return runs

    def finished(run: Run) -> None:
        runs.append(run)
        if progress is not None:
            progress(len(runs), len(scenes))

    finished(simulate(scenes[0], duration))  # compiles, which threads would do at the same time
    with ThreadPoolExecutor(workers or os.cpu_count()) as pool:
        for run in pool.map(lambda one: simulate(one, duration), scenes[1:]):
            finished(run)
    return runs


def _along(
    scene: Scene, computed: tuple[Array, Accuracy], samples: int, progress: Progress | None
) -> Run:
    """The connector's outputs along a motion computed beforehand.

    That motion does not follow from the connector's wrenches, so that it tells no latency.
    """
    plant = Plant(scene)
    connector = Connector(dataclasses.replace(scene, method="auto", latency=0))
    states, accuracy = computed
    rows = np.zeros((samples, layout.NSAMPLE))
    rows[:, layout.MOTION], rows[:, layout.LOADS] = states[:-1], plant.loads
    outs, energy = connector.run(rows), np.empty(samples)
    for k in range(samples):
        plant.state[:] = states[k]
        energy[k] = plant.energy()
    plant.move(states[-1], samples)
    if progress is not None:
        progress(samples, samples)
    time = times(scene, samples)
    return Run(scene, time, states[:-1], outs, energy, connector, plant, accuracy)
