"""Simulate a scene in process, without ROS: the closed loop, or a motion to a stated accuracy."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.errors import SceneError
from cylconn_ros.methods.traits import LIVE
from cylconn_ros.scene.packing import choose_method
from cylconn_ros.scene.scene import Scene
from cylconn_ros.scene.schema import show
from cylconn_ros.simulation.closed_loop import Block, ClosedLoop, Progress, closed_loop, times
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.run import Accuracy, Run
from cylconn_ros.simulation.to_tolerance import motion, offline

__all__ = ["Run", "simulate", "simulate_blocks"]

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
    if not _is_loop(scene):
        to_tolerance = choose_method(scene) in LIVE
        computed = motion(scene, samples) if to_tolerance else offline(scene, samples)
        return _along(scene, computed, samples, progress)
    return closed_loop(scene, samples, progress)


def simulate_blocks(scene: Scene, duration: float | None = None) -> Iterator[Block]:
    """Simulate as :func:`simulate` and yield the samples in blocks, whose content is replaced.

    The memory of a closed loop does not grow with its duration. Errors are those of simulate.
    """
    samples = samples_of(scene, duration)
    if _is_loop(scene):
        yield from ClosedLoop(scene).blocks(samples)
        return
    run = simulate(scene, samples=samples)
    yield Block(run.time, run.states, run.outs, run.energy)


def _is_loop(scene: Scene) -> bool:
    """Whether a simulation is a closed loop, and no motion that is computed without wrenches.

    Raises SceneError for such a motion with wrenches that act late.
    """
    if choose_method(scene) in LIVE and not (scene.tolerance > 0.0 and scene.method == "auto"):
        return True
    if scene.plant_latency > 0.0:
        name = "latency" if math.isnan(scene.plant.latency) else "plant.latency"
        raise SceneError(
            f"{name} = {show(scene.plant_latency)}: must be 0 for a motion that is computed "
            "without wrenches (the method minimal, or a tolerance); remove it, or use impulse"
        )
    return False


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
    changing, energy = plant.over_time, np.empty(samples)
    outs = np.empty((samples, layout.NOUT)) if changing.changes else connector.run(rows)
    if changing.changes:  # as a replay takes its messages
        for k in range(samples):
            changing.follow(connector, k)
            rows[k, layout.LOADS] = changing.loads(k)
            outs[k] = connector.run(rows[k : k + 1])[0]
    for k in range(samples):
        plant.state[:] = states[k]
        energy[k] = plant.energy()
    plant.move(states[-1], samples)
    if progress is not None:
        progress(samples, samples)
    time = times(scene, samples)
    return Run(scene, time, states[:-1], outs, energy, connector, plant, accuracy)
