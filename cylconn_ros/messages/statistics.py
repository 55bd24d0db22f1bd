"""What diagnostics will say of answers, kept in numbers while they are made."""

from __future__ import annotations

from typing import Any, Final

from cylconn_ros.core import layout
from cylconn_ros.core.jit import device_function, kernel

# Totals.
NOT_FINITE: Final = 0
BAD_QUATERNION: Final = 1
NO_PERIOD: Final = 2
OFF_PERIOD: Final = 3  # samples whose stamps are not a period apart
SEEN_PERIOD: Final = 4  # s, the last of those
SATURATED: Final = 5  # samples whose wrenches were scaled down to the limits
# Of the last answer that was a solution.
REGIME: Final = 6
LOCK: Final = 7  # bits of ConnectorState.lock
# Since somebody last looked.
FLAGS: Final = 8  # bits of ConnectorState.flags
STOPS: Final = 9  # bits of ConnectorState.stop
WORST_RESIDUAL: Final = 10
WORST_OFFSET: Final = 11  # m
WORST_ANGLE: Final = 12  # rad
WORST_TIME: Final = 13  # s
NTALLY: Final = 14
SINCE_LOOKED: Final = FLAGS

_OFF: Final = 0.01  # of a period


@device_function
def _worse(tally: Any, at: int, value: float) -> None:
    if value > tally[at]:  # what is not a number is not
        tally[at] = value


@device_function
def note(tally: Any, out: Any, h: float, period: float) -> None:
    """Keep what is to be told of an answer.

    Args:
        tally: (NTALLY,). out: (NOUT,) the answer.
        h: s since the sample before, 0 for the first. period: of the scene, s, 0 where it has none.
    """
    if period > 0.0 and h > 0.0 and abs(h - period) > _OFF * period:
        tally[OFF_PERIOD] += 1.0
        tally[SEEN_PERIOD] = h
    status = out[layout.STATUS]
    if status != layout.OK:
        if status == layout.NOT_FINITE:
            tally[NOT_FINITE] += 1.0
        elif status == layout.BAD_QUATERNION:
            tally[BAD_QUATERNION] += 1.0
        elif status == layout.NO_PERIOD:
            tally[NO_PERIOD] += 1.0
        return
    _worse(tally, WORST_RESIDUAL, out[layout.RESIDUAL])
    _worse(tally, WORST_OFFSET, out[layout.OFFSET_VIOLATION])
    _worse(tally, WORST_ANGLE, out[layout.ANGULAR_VIOLATION])
    _worse(tally, WORST_TIME, out[layout.COMPUTING_TIME])
    flags = int(out[layout.FLAGS])
    tally[FLAGS] = int(tally[FLAGS]) | flags
    tally[STOPS] = int(tally[STOPS]) | int(out[layout.STOP])
    if flags & layout.LIMITED:
        tally[SATURATED] += 1.0
    tally[REGIME] = out[layout.REGIME]
    tally[LOCK] = out[layout.LOCK]


@kernel
def note_one(tally: Any, out: Any, h: float, period: float) -> None:
    """The same, called from outside."""
    note(tally, out, h, period)


@kernel
def note_all(tally: Any, outs: Any, since: Any, period: float) -> None:
    """Keep what is to be told of (n, NOUT) answers; ``since``: (n,) as h is."""
    for k in range(outs.shape[0]):
        note(tally, outs[k], since[k], period)
