"""Samples of a recording in one call, each with its time since the one before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import model
from cylconn_ros.core.compiled import entry
from cylconn_ros.methods.step import step

Array = NDArray[np.float64]


@entry
def run(
    method: int,
    par: Array,
    mem: Array,
    samples: Array,
    since: Array,
    period: float,
    outs: Array,
) -> None:
    """Answer (N, NSAMPLE) samples into (N, NOUT), as N calls of ``Connector.step`` would.

    ``since``: (N,) seconds since the sample before. ``period``: the scene's, 0 where it has none.
    """
    for k in range(samples.shape[0]):
        h = since[k]
        if h > 0.0 and mem[model.LAST_PERIOD] > 0.0:
            mem[model.LAST_PERIOD] = h
        step(method, par, mem, samples[k], period if period != 0.0 else h, outs[k])
