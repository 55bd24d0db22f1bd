"""What went wrong while answering, in numbers: what diagnostics are made of."""

from __future__ import annotations

import dataclasses

import numpy as np

from cylconn_ros.core import layout

_WORST = (
    layout.OFFSET_VIOLATION, layout.ANGULAR_VIOLATION, layout.RESIDUAL, layout.COMPUTING_TIME,
)  # fmt: skip
_FIRST_WORST = min(_WORST)
_OFFSET, _ANGLE, _RESIDUAL, _TIME = (at - _FIRST_WORST for at in _WORST)
_WORST_NAMES = ("worst_offset", "worst_angle", "worst_residual", "worst_time")


@dataclasses.dataclass
class Health:
    """What went wrong while answering; totals since the start, ``worst_…`` since the last look."""

    undecodable: int = 0
    undecodable_text: str = ""
    not_finite: int = 0
    bad_quaternion: int = 0
    no_period: int = 0
    off_period: int = 0  # samples whose stamps are not a period apart
    seen_period: float = 0.0  # s, the last of those
    saturated: int = 0  # samples whose wrenches were scaled down to the limits
    failed: int = 0
    failure: str = ""
    commands: int = 0  # followed
    refused: int = 0  # commands that cannot be followed
    refusal: str = ""
    worst_residual: float = 0.0
    worst_offset: float = 0.0  # m
    worst_angle: float = 0.0  # rad
    worst_time: float = 0.0  # s
    flags: int = 0  # bits of ConnectorState.flags, since the last look
    stops: int = 0  # bits of ConnectorState.stop, since the last look
    regime: int = layout.FRICTIONLESS
    lock: int = 0  # bits of ConnectorState.lock

    def taken(self) -> Health:
        """A copy; begins a new stretch of ``worst_…``, flags and stops."""
        copy = dataclasses.replace(self)
        self.worst_residual = self.worst_offset = self.worst_angle = self.worst_time = 0.0
        self.flags = self.stops = 0
        return copy

    def note_one(self, out: np.ndarray, whole: list[float]) -> None:
        """Keep what diagnostics will say about one answer (NOUT,) and its whole numbers."""
        regime, stop, lock, status, flags = whole
        if status != layout.OK:
            self.not_finite += int(status == layout.NOT_FINITE)
            self.bad_quaternion += int(status == layout.BAD_QUATERNION)
            self.no_period += int(status == layout.NO_PERIOD)
            return
        numbers = out[_FIRST_WORST : layout.REGIME].tolist()
        if numbers[_RESIDUAL] > self.worst_residual:
            self.worst_residual = numbers[_RESIDUAL]
        if numbers[_OFFSET] > self.worst_offset:
            self.worst_offset = numbers[_OFFSET]
        if numbers[_ANGLE] > self.worst_angle:
            self.worst_angle = numbers[_ANGLE]
        if numbers[_TIME] > self.worst_time:
            self.worst_time = numbers[_TIME]
        bits = int(flags)
        self.flags |= bits
        self.saturated += bits & layout.LIMITED != 0
        self.stops |= int(stop)
        self.regime, self.lock = int(regime), int(lock)

    def examine(self, outs: np.ndarray) -> None:
        """Keep what diagnostics will say about (n, NOUT) answers."""
        status = outs[:, layout.STATUS]
        good = status == layout.OK
        if not good.all():
            self.not_finite += int(np.count_nonzero(status == layout.NOT_FINITE))
            self.bad_quaternion += int(np.count_nonzero(status == layout.BAD_QUATERNION))
            self.no_period += int(np.count_nonzero(status == layout.NO_PERIOD))
            outs = outs[good]
            if not len(outs):
                return
        worst = np.fmax.reduce(outs[:, _WORST])
        for name, value in zip(_WORST_NAMES, worst.tolist(), strict=True):
            if value > getattr(self, name):
                setattr(self, name, value)
        whole = outs[:, layout.REGIME : layout.NOUT].astype(np.int64)
        flags = whole[:, layout.FLAGS - layout.REGIME]
        self.flags |= int(np.bitwise_or.reduce(flags))
        self.saturated += int(np.count_nonzero(flags & layout.LIMITED))
        self.stops |= int(np.bitwise_or.reduce(whole[:, layout.STOP - layout.REGIME]))
        self.regime, self.lock = int(whole[-1, 0]), int(whole[-1, layout.LOCK - layout.REGIME])
