"""Counters of processed samples, kept as numbers for compiled code; diagnostics report them."""

from __future__ import annotations

import math
from typing import Any, Final

from cylconn_ros.core import layout
from cylconn_ros.core.jit import device_function, kernel
from cylconn_ros.core.relative_state import MAX_INPUT

# Indices of the array of counters. Totals:
NOT_FINITE: Final = 0  # samples with an input that is not finite
BAD_QUATERNION: Final = 1
NO_PERIOD: Final = 2
OFF_PERIOD: Final = 3  # samples whose stamps are not one period apart
SEEN_PERIOD: Final = 4  # s, difference of the stamps of the last of those
SATURATED: Final = 5  # samples whose wrenches were scaled down to the limits
NOT_FINITE_AT: Final = 6  # index of that input in the last such sample (core/layout.py)
TOO_LARGE: Final = 7  # samples with an input that is finite, but too large to compute with
TOO_LARGE_AT: Final = 8  # index of that input in the last such sample
SEEN_VALUE: Final = 9  # its value
OVERFLOWED: Final = 10  # samples of usable inputs whose outputs are not finite
OFF_NORM: Final = 11  # 2, of A, of B: samples with an orientation whose norm is not 1
SEEN_NORM: Final = 13  # 2, norms of the last of those
# Of the last sample with a solution:
REGIME: Final = 15
LOCK: Final = 16  # bits of ConnectorState.lock
# Since the last report:
FLAGS: Final = 17  # bits of ConnectorState.flags
STOPS: Final = 18  # bits of ConnectorState.stop
WORST_RESIDUAL: Final = 19
WORST_OFFSET: Final = 20  # m
WORST_ANGLE: Final = 21  # rad
WORST_TIME: Final = 22  # s
NCOUNTER: Final = 23
SINCE_REPORT: Final = FLAGS  # the first of the counters that begin again with each report

NORM_TOLERANCE: Final = 0.005  # of the norm of an orientation, which is normalised in any case
_PERIOD_TOLERANCE: Final = 0.01  # of a period


@device_function
def _raise_to(counters: Any, at: int, value: float) -> None:
    if value > counters[at]:  # false for NaN
        counters[at] = value


@device_function
def _count_not_finite(counters: Any, sample: Any) -> None:
    """Count a sample that the step called not finite: for an input, or for an overflow."""
    for k in range(layout.NSAMPLE):
        if not math.isfinite(sample[k]):
            counters[NOT_FINITE] += 1.0
            counters[NOT_FINITE_AT] = k
            return
    for k in range(layout.NSAMPLE):
        if abs(sample[k]) >= MAX_INPUT:
            counters[TOO_LARGE] += 1.0
            counters[TOO_LARGE_AT], counters[SEEN_VALUE] = k, sample[k]
            return
    counters[OVERFLOWED] += 1.0


@device_function
def _count_off_norm(counters: Any, sample: Any) -> None:
    """Count the orientations whose norm is not 1."""
    for body in range(2):
        at = (layout.A_POSE if body == 0 else layout.B_POSE) + 3
        square = 0.0
        for k in range(at, at + 4):
            square += sample[k] * sample[k]
        norm = math.sqrt(square)
        if abs(norm - 1.0) > NORM_TOLERANCE:
            counters[OFF_NORM + body] += 1.0
            counters[SEEN_NORM + body] = norm


@device_function
def count(counters: Any, sample: Any, out: Any, h: float, period: float) -> None:
    """Count a processed sample.

    Args:
        counters: (NCOUNTER,). sample: (NSAMPLE,). out: (NOUT,) outputs of the sample.
        h: s since the sample before, 0 for the first.
        period: of the scene, s; 0 if the scene states none.
    """
    if period > 0.0 and h > 0.0 and abs(h - period) > _PERIOD_TOLERANCE * period:
        counters[OFF_PERIOD] += 1.0
        counters[SEEN_PERIOD] = h
    status = out[layout.STATUS]
    if status != layout.OK:
        if status == layout.NOT_FINITE:
            _count_not_finite(counters, sample)
        elif status == layout.BAD_QUATERNION:
            counters[BAD_QUATERNION] += 1.0
        elif status == layout.NO_PERIOD:
            counters[NO_PERIOD] += 1.0
        return
    _count_off_norm(counters, sample)
    _raise_to(counters, WORST_RESIDUAL, out[layout.RESIDUAL])
    _raise_to(counters, WORST_OFFSET, out[layout.OFFSET_VIOLATION])
    _raise_to(counters, WORST_ANGLE, out[layout.ANGULAR_VIOLATION])
    _raise_to(counters, WORST_TIME, out[layout.COMPUTING_TIME])
    flags = int(out[layout.FLAGS])
    counters[FLAGS] = int(counters[FLAGS]) | flags
    counters[STOPS] = int(counters[STOPS]) | int(out[layout.STOP])
    if flags & layout.LIMITED:
        counters[SATURATED] += 1.0
    counters[REGIME] = out[layout.REGIME]
    counters[LOCK] = out[layout.LOCK]


@kernel
def count_one(counters: Any, sample: Any, out: Any, h: float, period: float) -> None:
    """Call :func:`count` from Python."""
    count(counters, sample, out, h, period)


@kernel
def count_all(counters: Any, samples: Any, outs: Any, since: Any, period: float) -> None:
    """Count n samples: (n, NSAMPLE), outputs (n, NOUT), and (n,) s since the sample before."""
    for k in range(outs.shape[0]):
        count(counters, samples[k], outs[k], since[k], period)
