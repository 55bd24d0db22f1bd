"""The method ``minimal`` as a simulation, its problem prepared: what is timed is the integration.

MuJoCo's model and SciPy's equations are not counted either. The same solution as that of
:func:`cylconn_ros.connector.minimal_simulation.solve`, from which errors are taken.
"""

from __future__ import annotations

import numpy as np

from cylconn_ros.connector.minimal_simulation import initial, solve
from cylconn_ros.connector.scene import Scene
from cylconn_ros.methods.minimal_integrate import integrate
from cylconn_ros.methods.minimal_motion import LOG

MOST_STEPS = 1_000_000
MOST_EVENTS = 100

__all__ = ["Prepared", "solve"]


class Prepared:
    """A scene in its own coordinates, ready to be integrated again and again."""

    def __init__(self, scene: Scene, duration: float, rtol: float) -> None:
        self.duration, self.rtol = duration, rtol
        self.par, self.joint, self.start = initial(scene)
        self.y = self.start.copy()
        self.log = np.zeros((MOST_EVENTS, LOG))

    def __call__(self) -> None:
        """Integrate from the start to the end; ``y`` then holds the coordinates there."""
        self.y[:] = self.start
        ran = integrate(
            self.par, self.joint, self.y, 0.0, self.duration, self.rtol, 1e-3 * self.duration,
            False, False, self.log, 0, MOST_STEPS,
        )  # fmt: skip
        if not ran.complete:
            raise RuntimeError(f"stopped at t = {ran.t:.9g} s")
