"""The laws of a run in process, for the map of stability, whose room does not know the laws."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.packing import choose_method
from cylconn_ros.connector.scene import Scene
from cylconn_ros.core import layout

Array = NDArray[np.float64]


def broken(scene: Scene, states: Array, outs: Array) -> str:
    """The first law that answers ``outs`` (N, NOUT) to ``states`` (N, 26) break, and how much.

    Empty: every law that the scene's method claims holds, for every sample from the first on.
    """
    from cylconn_ros.laws import checks, claims
    from cylconn_ros.laws.recorded import Recorded
    from cylconn_ros.laws.residual import TOLERANCE

    method = choose_method(scene)
    if method not in claims.CLAIMS:
        return ""
    n = len(states)
    samples = np.zeros((n, layout.NSAMPLE))
    samples[:, layout.MOTION] = states
    begins, periods = np.arange(n) == 0, np.full(n, scene.period)
    run = Recorded(method, scene, samples, outs, periods, begins, 0, "")
    block, _ = next(run.blocks())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a run that is lost goes through here too
        residuals = checks.check(block, method)
    for letter, values in residuals.items():
        worst = float(np.max(values, initial=0.0, where=~np.isnan(values)))
        if not worst <= TOLERANCE:
            return f"law {letter} ({claims.TITLES[letter]}) off by {worst:.1e}"
    return ""
