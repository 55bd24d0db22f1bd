"""A simulation to the relative error that the scene's ``tolerance`` states.

According to the measurements in docs/benchmarks/precision.md, ``minimal`` reaches an accuracy at
the least cost if inertia is known, with a tolerance of its steps below the stated one. If it cannot
keep that tolerance, ``impulse`` replaces it in a closed loop; the number of substeps per period
follows from a comparison with twice as many substeps.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.errors import SceneError
from cylconn_ros.methods.minimal.initial import DEFAULT_TOLERANCE
from cylconn_ros.scene.packing import step_tolerance
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.closed_loop import closed_loop
from cylconn_ros.simulation.run import Accuracy

Array = NDArray[np.float64]

SAFETY = 2.0  # on the error of n substeps estimated from 2n
MOST_SUBSTEPS = 1024


def motion(scene: Scene, steps: int) -> tuple[Array, Accuracy]:
    """(steps + 1, 26) states at the stamps to ``scene.tolerance``, and the settings used.

    The tolerance bounds the errors of slide and rotation, each relative to its largest travel.
    Raises :class:`SceneError` if an inertia is unknown or no number of substeps is enough.
    """
    from cylconn_ros.simulation.minimal import solve

    times = np.asarray(scene.period * np.arange(steps + 1), dtype=np.float64)
    rtol = step_tolerance(scene.tolerance)
    try:
        found = solve(dataclasses.replace(scene, method="minimal"), float(times[-1]), rtol, times)
        if found.coarse == math.inf:
            return found.states, Accuracy("minimal", 1, rtol, math.nan)
    except (SceneError, RuntimeError):
        if "unknown" in (scene.body_a.kind, scene.body_b.kind):
            raise
    return _by_substeps(scene, steps)


def offline(scene: Scene, steps: int) -> tuple[Array, Accuracy]:
    """(steps + 1, 26) states at the stamps by the offline method minimal, and the settings used.

    The tolerance of the integrator's steps follows from the scene's, or is 1e-12 if it states none.
    Raises :class:`SceneError` if an inertia is unknown or the integration cannot be completed.
    """
    from cylconn_ros.simulation.minimal import solve

    times = np.asarray(scene.period * np.arange(steps + 1), dtype=np.float64)
    rtol = step_tolerance(scene.tolerance) or DEFAULT_TOLERANCE
    try:
        found = solve(scene, float(times[-1]), rtol, times)
    except RuntimeError as error:
        raise SceneError(
            f"method = {scene.method!r}: {error}; use impulse, which handles this motion"
        ) from error
    return found.states, Accuracy(scene.method, 1, rtol, math.nan)


def _by_substeps(scene: Scene, steps: int) -> tuple[Array, Accuracy]:
    """The closed loop with impulse; substeps are doubled until the estimated error is small."""
    substeps, coarse = 1, _loop_with_substeps(scene, steps, 1)
    while substeps < MOST_SUBSTEPS:
        fine = _loop_with_substeps(scene, steps, 2 * substeps)
        error = SAFETY * relative_error(coarse[1], fine[1]) / 3.0  # second order: 1/(2^2 - 1)
        substeps *= 2
        if error <= scene.tolerance:
            return fine[0], Accuracy("impulse", substeps, 0.0, error)
        coarse = fine
    raise SceneError(
        f"tolerance = {scene.tolerance:g}: is not reached with {MOST_SUBSTEPS} substeps of a "
        f"period ({error:.1e}); give a shorter period or a greater tolerance"
    )


def _loop_with_substeps(scene: Scene, steps: int, substeps: int) -> tuple[Array, Array]:
    """States, and (length, angle), at the stamps of a loop with substeps."""
    fine = dataclasses.replace(
        scene, method="impulse", tolerance=0.0, period=scene.period / substeps
    )
    run = closed_loop(fine, steps * substeps + 1)
    position = run.outs[::substeps, [layout.LENGTH, layout.ANGLE]]
    return run.states[::substeps], position


def relative_error(position: Array, reference: Array) -> float:
    """The larger error of slide and rotation, each relative to its largest travel.

    ``position``, ``reference``: (N, 2) length (m) and angle (rad). A component at rest has none.
    """
    worst = 0.0
    for k in range(2):
        travel = float(np.max(np.abs(reference[:, k] - reference[0, k])))
        error = float(np.max(np.abs(position[:, k] - reference[:, k])))
        if travel > 1e-9:
            worst = max(worst, error / travel)
    return worst
