"""The method ``minimal`` as a simulation, its problem prepared: what is timed is the integration.

MuJoCo's model and SciPy's equations are not counted either. The same solution as that of
:func:`cylconn_ros.simulation.minimal.solve`, from which errors are taken.
"""

from __future__ import annotations

import numpy as np

from cylconn_ros.methods.minimal import dense_output
from cylconn_ros.methods.minimal.events import LOG
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.minimal import initial, solve

MOST_STEPS = 1_000_000
MOST_EVENTS = 100

__all__ = ["Prepared", "solve"]


class Prepared:
    """A scene in its own coordinates, ready to be integrated again and again.

    ``rows`` (2, WIDTH): start and end of the last solution, see methods/minimal/dense_output.py.
    """

    def __init__(self, scene: Scene, duration: float, rtol: float) -> None:
        self.times, self.rtol = np.array([0.0, duration]), rtol
        self.par, self.joint, self.start = initial(scene)
        self.y = self.start.copy()
        self.rows = np.zeros((2, dense_output.WIDTH))
        self.log = np.zeros((MOST_EVENTS, LOG))

    def __call__(self) -> None:
        """Integrate from the start to the end."""
        self.y[:] = self.start
        ran = dense_output.trajectory(
            self.par, self.joint, self.y, self.times, self.rtol, 0.1 * self.times[1] + 1e-9,
            self.rows, self.log, MOST_STEPS,
        )  # fmt: skip
        if not ran.complete:
            raise RuntimeError(f"stopped at t = {ran.t:.9g} s")
