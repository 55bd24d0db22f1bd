"""A scene in process, without ROS: the closed loop, or the motion to a stated accuracy."""

from __future__ import annotations

import numpy as np

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.closed_loop import Progress, Run, closed_loop
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.to_tolerance import motion

__all__ = ["Run", "simulate"]


def simulate(scene: Scene, steps: int, progress: Progress | None = None) -> Run:
    """Run plant and connector in lock step for ``steps`` samples.

    Where the scene states a ``tolerance`` and leaves the method to us, the motion is computed to
    that accuracy (simulation/to_tolerance.py) and the connector answers its samples.

    Args:
        progress: called with (done, steps) now and then, and at the end.

    Raises :class:`~cylconn_ros.scene.schema.SceneError` for a scene that cannot be served
    or moved.
    """
    if scene.tolerance > 0.0 and scene.method == "auto":
        return _accurate(scene, steps, progress)
    return closed_loop(scene, steps, progress)


def _accurate(scene: Scene, steps: int, progress: Progress | None) -> Run:
    """The motion to the scene's tolerance, and the answers to its samples."""
    plant, connector = Plant(scene), Connector(scene)
    states, chosen = motion(scene, steps)
    samples = np.zeros((steps, layout.NSAMPLE))
    samples[:, layout.MOTION], samples[:, layout.LOADS] = states[:-1], plant.loads
    outs, energy = connector.run(samples), np.empty(steps)
    for k in range(steps):
        plant.state[:] = states[k]
        energy[k] = plant.energy()
        if progress is not None and k % 64 == 0:
            progress(k, steps)
    plant.move(states[-1], steps)
    if progress is not None:
        progress(steps, steps)
    time = np.asarray(scene.period * np.arange(steps), dtype=np.float64)
    return Run(time, states[:-1], outs, energy, connector, plant, chosen)
