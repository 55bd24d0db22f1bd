"""A simulation as accurate as the scene's ``tolerance`` asks: which method, in which steps.

The measurements (docs/precision.md) say that with known inertia nothing reaches an accuracy at less
cost than ``minimal`` with the tolerance of its own steps below the one asked for. It owns the whole
motion, though, so where it cannot keep to that tolerance ``impulse`` takes its place in a
closed loop with as many substeps of the period as a comparison with twice as many asks for.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.errors import SceneError
from cylconn_ros.scene.packing import step_tolerance
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.closed_loop import Chosen, closed_loop

Array = NDArray[np.float64]

SAFETY = 2.0  # on the error of n substeps estimated from 2n
MOST_SUBSTEPS = 1024


def motion(scene: Scene, steps: int) -> tuple[Array, Chosen]:
    """(steps + 1, 26) states at the stamps, as accurate as ``scene.tolerance``, and how they came.

    The tolerance bounds the errors of slide and of spin, each over the way it has gone at most.
    Raises :class:`SceneError` where an inertia is unknown or no number of substeps is enough.
    """
    from cylconn_ros.simulation.minimal import solve

    times = np.asarray(scene.period * np.arange(steps + 1), dtype=np.float64)
    rtol = step_tolerance(scene.tolerance)
    try:
        found = solve(dataclasses.replace(scene, method="minimal"), float(times[-1]), rtol, times)
        if found.coarse == math.inf:
            return found.states, Chosen("minimal", 1, rtol, math.nan)
    except (SceneError, RuntimeError):
        if "unknown" in (scene.body_a.kind, scene.body_b.kind):
            raise
    return _by_substeps(scene, steps)


def _by_substeps(scene: Scene, steps: int) -> tuple[Array, Chosen]:
    """The closed loop with impulse, substeps doubled until the last doubling changed little."""
    substeps, coarse = 1, _looped(scene, steps, 1)
    while substeps < MOST_SUBSTEPS:
        fine = _looped(scene, steps, 2 * substeps)
        error = SAFETY * relative_error(coarse[1], fine[1]) / 3.0  # second order: 1/(2^2 - 1)
        substeps *= 2
        if error <= scene.tolerance:
            return fine[0], Chosen("impulse", substeps, 0.0, error)
        coarse = fine
    raise SceneError(
        f"tolerance = {scene.tolerance:g}: is not reached with {MOST_SUBSTEPS} substeps of a "
        f"period ({error:.1e}); give a shorter period or a greater tolerance"
    )


def _looped(scene: Scene, steps: int, substeps: int) -> tuple[Array, Array]:
    """States, and (length, angle), at the stamps of a loop with substeps."""
    fine = dataclasses.replace(
        scene, method="impulse", tolerance=0.0, period=scene.period / substeps
    )
    run = closed_loop(fine, steps * substeps + 1)
    place = run.outs[::substeps, [layout.LENGTH, layout.ANGLE]]
    return run.states[::substeps], place


def relative_error(place: Array, reference: Array) -> float:
    """The greatest error of slide or spin, over the greatest way that it goes.

    ``place``, ``reference``: (N, 2) length and angle. A component that does not move has none.
    """
    worst = 0.0
    for k in range(2):
        way = float(np.max(np.abs(reference[:, k] - reference[0, k])))
        apart = float(np.max(np.abs(place[:, k] - reference[:, k])))
        if way > 1e-9:
            worst = max(worst, apart / way)
    return worst
