"""Samples of a recording in one call, each with its time since the one before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import model
from cylconn_ros.core.jit import device_function, kernel
from cylconn_ros.methods.dispatch import step

Array = NDArray[np.float64]


@device_function
def answer(
    method: int,
    par: Array,
    mem: Array,
    sample: Array,
    h: float,
    period: float,
    out: Array,
) -> None:
    """Answer a sample (NSAMPLE,) into (NOUT,), as ``Connector.step`` does.

    ``h``: seconds since the sample before. ``period``: the scene's, 0 where it has none.
    """
    if h > 0.0 and mem[model.LAST_PERIOD] > 0.0:
        mem[model.LAST_PERIOD] = h
    step(method, par, mem, sample, period if period != 0.0 else h, out)


@kernel
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
        answer(method, par, mem, samples[k], since[k], period, outs[k])
