"""The method ``minimal`` as a simulation, its problem prepared: what is timed is the integration.

MuJoCo's model and SciPy's equations are not counted either. The same solution as that of
:func:`cylconn_ros.connector.minimal_simulation.solve`, from which errors are taken.
"""

from __future__ import annotations

import numpy as np

from cylconn_ros.connector.minimal_simulation import initial, solve
from cylconn_ros.connector.scene import Scene
from cylconn_ros.methods import minimal_report
from cylconn_ros.methods.minimal_motion import LOG

MOST_STEPS = 1_000_000
MOST_EVENTS = 100

__all__ = ["Prepared", "solve"]


class Prepared:
    """A scene in its own coordinates, ready to be integrated again and again.

    ``rows`` (2, WIDTH): start and end of the last solution, see methods/minimal_report.py.
    """

    def __init__(self, scene: Scene, duration: float, rtol: float) -> None:
        self.times, self.rtol = np.array([0.0, duration]), rtol
        self.par, self.joint, self.start = initial(scene)
        self.y = self.start.copy()
        self.rows = np.zeros((2, minimal_report.WIDTH))
        self.log = np.zeros((MOST_EVENTS, LOG))

    def __call__(self) -> None:
        """Integrate from the start to the end."""
        self.y[:] = self.start
        ran = minimal_report.trajectory(
            self.par, self.joint, self.y, self.times, self.rtol, 0.1 * self.times[1] + 1e-9,
            self.rows, self.log, MOST_STEPS,
        )  # fmt: skip
        if not ran.complete:
            raise RuntimeError(f"stopped at t = {ran.t:.9g} s")
