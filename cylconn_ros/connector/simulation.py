"""The closed loop in process: plant and connector step of the two nodes, without ROS."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.accuracy import Chosen, motion
from cylconn_ros.connector.connector import Connector
from cylconn_ros.connector.plant import Plant
from cylconn_ros.connector.scene import Scene
from cylconn_ros.core import layout

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Run:
    """What a simulation gives.

    Attributes
    ----------
        time: (N,) stamps, s.
        states: (N, 26) poses and twists of both bodies at the stamps (core/layout.py).
        outs: (N, NOUT) the connector's answers to them.
        energy: (N,) kinetic and gravitational energy of both bodies at the stamps, J.
        connector: the connector, as it is after the last sample.
        plant: the plant, one period after the last sample.
        computed: how, where the scene states a tolerance.
    """

    time: Array
    states: Array
    outs: Array
    energy: Array
    connector: Connector
    plant: Plant
    computed: Chosen | None = None

    def state(self, name: str) -> Array:
        """(N,) or (N, k): a field of ConnectorState over the run."""
        at = layout.STATE_INDEX[name]
        width = dict(layout.STATE_FIELDS)[name]
        return self.outs[:, at] if width == 1 else self.outs[:, at : at + width]


def simulate(scene: Scene, steps: int, progress: Callable[[int, int], None] | None = None) -> Run:
    """Run plant and connector in lock step for ``steps`` samples.

    Where the scene states a ``tolerance`` and leaves the method to us, the motion is computed to
    that accuracy (connector/accuracy.py) and the connector answers its samples.

    Args:
        progress: called with (done, steps) now and then, and at the end.

    Raises :class:`~cylconn_ros.connector.parameters.SceneError` for a scene that cannot be served
    or moved.
    """
    if scene.tolerance > 0.0 and scene.method == "auto":
        return _accurate(scene, steps, progress)
    plant, connector = Plant(scene), Connector(scene)
    time = np.empty(steps)
    outs = np.empty((steps, layout.NOUT))
    samples = np.zeros((steps, layout.NSAMPLE))
    energy = np.empty(steps)
    for k in range(steps):
        time[k] = plant.time_ns * 1e-9
        energy[k] = plant.energy()
        samples[k, layout.MOTION] = plant.state
        samples[k, layout.LOADS] = plant.loads
        out = connector.step(samples[k], out=outs[k])
        plant.step(out[layout.FORCE_A : layout.FORCE_B], out[layout.FORCE_B : layout.STATE0])
        if progress is not None and k % 64 == 0:
            progress(k, steps)
    if progress is not None:
        progress(steps, steps)
    return Run(time, samples[:, layout.MOTION], outs, energy, connector, plant)


def _accurate(scene: Scene, steps: int, progress: Callable[[int, int], None] | None) -> Run:
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
