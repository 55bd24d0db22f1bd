"""Summary of a run from the connector's states; used by every command that shows a run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.connector.enums import FLAGS, REGIMES
from cylconn_ros.connector.usable import contradiction

_STICK = 1
_STOPPED = 128


@dataclass(frozen=True)
class RunSummary:
    """Summary of a whole run, SI units."""

    samples: int
    duration: float  # s, from the first to the last sample
    distance: float  # m, slide at the end
    turns: float  # rotation at the end, turns
    stop_time: float  # s, begin of the final rest; NaN if the run does not end at rest
    worst_offset: float  # m
    worst_misalignment: float  # rad
    worst_residual: float
    refused: int  # samples with a zero wrench (status not OK)
    regimes: dict[str, float]  # share of the samples in each regime that occurs, and refused
    flags: dict[str, int]  # samples with each flag that occurs, except "stopped"
    greatest: dict[str, float]  # largest magnitude of the quantities in GREATEST
    problem: str = ""  # why the run is worth nothing: all refused, or it left the joint


GREATEST = {
    "force": "N",
    "moment": "N m",
    "normal_force": "N",
    "radial_force": "N",
    "bending_moment": "N m",
}
"""Fields of ConnectorState whose largest magnitude a summary states, if it gets them; unit."""
FIELDS = (
    *GREATEST, "regime", "flags", "displacement", "rotation", "stop_time", "offset_violation",
    "angular_violation", "residual", "status",
)  # fmt: skip
"""Fields of ConnectorState that a summary needs."""


def summarise(time: npt.NDArray[np.float64], state: Mapping[str, npt.NDArray[Any]]) -> RunSummary:
    """Summarise the states of a run.

    Parameters
    ----------
    time
        (n,) seconds, n > 0.
    state
        Fields of ConnectorState by name, n rows each.

    """
    reduction = Reduction()
    reduction.add(time, state)
    return reduction.result()


class Reduction:
    """Summary of states that are added block by block."""

    def __init__(self) -> None:
        self._samples = self._refused = 0
        self._begin = self._end = self._stop = math.nan
        self._last: dict[str, float] = {}
        self._regimes = np.zeros(len(REGIMES), np.int64)
        self._flags = np.zeros(len(FLAGS), np.int64)
        self._worst = {"offset_violation": 0.0, "angular_violation": 0.0, "residual": 0.0}
        self._greatest: dict[str, float] = {}
        self._range = {name: [math.inf, -math.inf] for name in ("displacement", "rotation")}
        self._rest = math.nan  # first sample of the stick that lasts until now

    def add(self, time: npt.NDArray[np.float64], state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Add the next n > 0 states; arguments as for :func:`summarise`."""
        if not self._samples:
            self._begin = float(time[0])
        self._end = float(time[-1])
        self._samples += len(time)
        regime, flags = np.asarray(state["regime"]), np.asarray(state["flags"]).astype(np.int64)
        solved = np.asarray(state["status"]) == 0  # a refused sample has no regime
        self._regimes += [np.count_nonzero(regime[solved] == k) for k in range(len(REGIMES))]
        self._flags += [np.count_nonzero(flags & (1 << bit)) for bit in range(len(FLAGS))]
        self._refused += int(np.count_nonzero(state["status"]))
        self._last = {n: float(state[n][-1]) for n in ("displacement", "rotation", "regime")}
        events = np.where(solved, state["stop_time"], -1.0)
        self._add_rest(time, solved & (regime == _STICK), events)
        for name, ends in self._range.items():
            values = np.asarray(state[name])[solved]
            if len(values):
                ends[:] = min(ends[0], float(values.min())), max(ends[1], float(values.max()))
        for name in GREATEST:
            if name in state:
                found = _largest(np.asarray(state[name]))
                self._greatest[name] = float(np.maximum(self._greatest.get(name, 0.0), found))
        for name, worst in self._worst.items():
            self._worst[name] = float(np.maximum(worst, _largest(state[name])))

    def _add_rest(
        self,
        time: npt.NDArray[np.float64],
        stick: npt.NDArray[np.bool_],
        events: npt.NDArray[np.float64],
    ) -> None:
        """Follow the last stick: its first sample, and the interpolated time of its begin."""
        moving = np.flatnonzero(~stick)
        if len(moving):
            self._rest, self._stop = math.nan, math.nan
        begin = int(moving[-1]) + 1 if len(moving) else 0
        if math.isnan(self._rest) and begin < len(time):
            self._rest = float(time[begin])
        stops = np.flatnonzero(events[max(begin - 1, 0) :] >= 0.0) + max(begin - 1, 0)
        if len(stops):
            self._stop = float(time[stops[-1]] + events[stops[-1]])

    def _problem(self) -> str:
        if self._refused == self._samples:
            return f"no sample could be used: all {self._samples} were refused"
        slide, spin = (high - low for low, high in self._range.values())
        worst = self._worst
        return contradiction(slide, spin, worst["offset_violation"], worst["angular_violation"])

    def result(self) -> RunSummary:
        """Summary of all states added; needs at least one."""
        counts = [*self._regimes, self._refused]
        shares = zip((*REGIMES, "refused"), np.array(counts) / self._samples, strict=True)
        return RunSummary(
            samples=self._samples,
            duration=self._end - self._begin,
            distance=_without_rounding(self._last["displacement"]),
            turns=_without_rounding(self._last["rotation"] / (2.0 * np.pi)),
            stop_time=self._stop_time(),
            worst_offset=self._worst["offset_violation"],
            worst_misalignment=self._worst["angular_violation"],
            worst_residual=self._worst["residual"],
            refused=self._refused,
            regimes={name: float(share) for name, share in shares if share > 0.0},
            flags={
                name: int(count)
                for bit, (name, count) in enumerate(zip(FLAGS, self._flags, strict=True))
                if count and 1 << bit != _STOPPED
            },
            greatest=self._greatest,
            problem=self._problem(),
        )

    def _stop_time(self) -> float:
        """Begin of the last rest, s; NaN if the last sample does not stick.

        Without such a step (a method that does not interpolate, or a run that is at rest from the
        beginning), it is the first sample of the stick that lasts until the end.
        """
        return self._rest if math.isnan(self._stop) else self._stop


def _without_rounding(value: float) -> float:
    return 0.0 if abs(value) < 1e-12 else value


def _largest(values: npt.NDArray[Any]) -> float:
    """Largest magnitude; NaN if a value is not finite, so that every check fails."""
    values = np.abs(values)
    return float(values.max()) if np.isfinite(values).all() else math.nan
