"""Counters of processed samples, kept as numbers for compiled code; diagnostics report them."""

from __future__ import annotations

from typing import Any, Final

from cylconn_ros.core import layout
from cylconn_ros.core.jit import device_function, kernel

# Indices of the array of counters. Totals:
NOT_FINITE: Final = 0
BAD_QUATERNION: Final = 1
NO_PERIOD: Final = 2
OFF_PERIOD: Final = 3  # samples whose stamps are not one period apart
SEEN_PERIOD: Final = 4  # s, difference of the stamps of the last of those
SATURATED: Final = 5  # samples whose wrenches were scaled down to the limits
# Of the last sample with a solution:
REGIME: Final = 6
LOCK: Final = 7  # bits of ConnectorState.lock
# Since the last report:
FLAGS: Final = 8  # bits of ConnectorState.flags
STOPS: Final = 9  # bits of ConnectorState.stop
WORST_RESIDUAL: Final = 10
WORST_OFFSET: Final = 11  # m
WORST_ANGLE: Final = 12  # rad
WORST_TIME: Final = 13  # s
NCOUNTER: Final = 14
SINCE_REPORT: Final = FLAGS  # the first of the counters that begin again with each report

_PERIOD_TOLERANCE: Final = 0.01  # of a period


@device_function
def _raise_to(counters: Any, at: int, value: float) -> None:
    if value > counters[at]:  # false for NaN
        counters[at] = value


@device_function
def count(counters: Any, out: Any, h: float, period: float) -> None:
    """Count a processed sample.

    Args:
        counters: (NCOUNTER,). out: (NOUT,) outputs of the sample.
        h: s since the sample before, 0 for the first.
        period: of the scene, s; 0 if the scene states none.
    """
    if period > 0.0 and h > 0.0 and abs(h - period) > _PERIOD_TOLERANCE * period:
        counters[OFF_PERIOD] += 1.0
        counters[SEEN_PERIOD] = h
    status = out[layout.STATUS]
    if status != layout.OK:
        if status == layout.NOT_FINITE:
            counters[NOT_FINITE] += 1.0
        elif status == layout.BAD_QUATERNION:
            counters[BAD_QUATERNION] += 1.0
        elif status == layout.NO_PERIOD:
            counters[NO_PERIOD] += 1.0
        return
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
def count_one(counters: Any, out: Any, h: float, period: float) -> None:
    """Call :func:`count` from Python."""
    count(counters, out, h, period)


@kernel
def count_all(counters: Any, outs: Any, since: Any, period: float) -> None:
    """Count n samples: outputs (n, NOUT), and (n,) seconds since the sample before."""
    for k in range(outs.shape[0]):
        count(counters, outs[k], since[k], period)
