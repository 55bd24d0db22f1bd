"""Compiled calls of the step: one sample, or many samples in one call."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout, model
from cylconn_ros.core.jit import device_function, kernel
from cylconn_ros.core.sample_period import period_in_use
from cylconn_ros.methods import dispatch

Array = NDArray[np.float64]

WRONG_SHAPE: Final = -1


@device_function
def process(
    handle: Any,
    par: Array,
    mem: Array,
    sample: Array,
    h: float,
    period: float,
    out: Array,
) -> int:
    """Process a sample (NSAMPLE,) into (NOUT,); returns the status.

    Args:
        handle: of the method's step function (methods/dispatch.py).
        h: s since the previous sample, 0: one period. period: s, the scene's, 0 if it has none.
            The motion decides where the two contradict each other (core/sample_period.py).
    """
    return dispatch.step(handle, par, mem, sample, take_period(mem, sample, h, period), out)


@device_function
def take_period(mem: Array, sample: Array, h: float, period: float) -> float:
    """The period of the coming step, s; ``h`` and ``period`` as for :func:`process`."""
    used = period_in_use(mem, sample, h, period)
    if h > 0.0 and mem[model.LAST_PERIOD] > 0.0:
        mem[model.LAST_PERIOD] = h
    return used


@kernel
def step_period(mem: Array, sample: Array, h: float, period: float) -> float:
    """As :func:`take_period`, called from Python."""
    return take_period(mem, sample, h, period)


@kernel
def step(
    handle: Any,
    par: Array,
    mem: Array,
    sample: Array,
    h: float,
    period: float,
    out: Array,
) -> int:
    """As :func:`process`, called from Python; WRONG_SHAPE, with nothing done, for short arrays."""
    if sample.shape[0] != layout.NSAMPLE or out.shape[0] != layout.NOUT:
        return WRONG_SHAPE
    return process(handle, par, mem, sample, h, period, out)


@kernel
def run(
    handle: Any,
    par: Array,
    mem: Array,
    samples: Array,
    since: Array,
    period: float,
    outs: Array,
) -> None:
    """Process (N, NSAMPLE) samples in order into (N, NOUT), as N calls of :func:`step`.

    ``since``: (N,) s since the previous sample, 0: one period. ``period``: s, 0 if there is none.
    """
    for k in range(samples.shape[0]):
        process(handle, par, mem, samples[k], since[k], period, outs[k])


class PeriodInUse:
    """The periods for which the wrenches of given samples are computed, without computing them."""

    def __init__(self, declared: float) -> None:
        """``declared``: s, the scene's period, 0 if the stamps are to give it."""
        self._declared, self._memory = declared, np.zeros(model.NMEM)

    def of(self, sample: Array, h: float) -> float:
        """The period (s) of the next sample, ``h`` s after the last one; 0 for the first."""
        return float(step_period(self._memory, sample, h, self._declared))
