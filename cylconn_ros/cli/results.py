"""What a run amounted to, from the connector's states: one reduction for every command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

REGIMES = ("frictionless", "stick", "slip")
FLAGS = (
    "undersampled",
    "turn ambiguous",
    "twist contradicts",
    "half turn",
    "limited",
    "several roots",
    "jammed",
    "stopped",
    "misaligned",
    "gains lowered",
    "plant_integration does not fit",
)
"""Names of the bits of ConnectorState.flags, lowest first."""

_STICK = 1
_STOPPED = 128


@dataclass(frozen=True)
class Results:
    """Numbers of a whole run (SI units)."""

    samples: int
    duration: float  # s, from the first to the last sample
    distance: float  # m, slide at the end
    turns: float  # spin at the end
    stop_time: float  # s, when it came to rest for good; NaN if it did not
    worst_offset: float  # m
    worst_misalignment: float  # rad
    worst_residual: float
    refused: int  # samples answered with a zero wrench (status not OK)
    regimes: dict[str, float]  # share of the samples in each
    flags: dict[str, int]  # samples with each flag that was ever up, except "stopped"


def reduce_states(time: npt.NDArray[np.float64], state: Mapping[str, npt.NDArray[Any]]) -> Results:
    """Reduce the states of a run.

    Parameters
    ----------
    time
        (n,) seconds, n > 0.
    state
        Fields of ConnectorState by name, n rows each.

    """
    regime, flags = np.asarray(state["regime"]), np.asarray(state["flags"]).astype(np.int64)
    shares = {name: float(np.mean(regime == k)) for k, name in enumerate(REGIMES)}
    raised = {
        name: int(np.count_nonzero(flags & (1 << bit)))
        for bit, name in enumerate(FLAGS)
        if 1 << bit != _STOPPED
    }
    return Results(
        samples=len(time),
        duration=float(time[-1] - time[0]),
        distance=float(state["displacement"][-1]),
        turns=float(state["rotation"][-1]) / (2.0 * np.pi),
        stop_time=_stop_time(time, state),
        worst_offset=_largest(state["offset_violation"]),
        worst_misalignment=_largest(state["angular_violation"]),
        worst_residual=_largest(state["residual"]),
        refused=int(np.count_nonzero(state["status"])),
        regimes={name: share for name, share in shares.items() if share > 0.0},
        flags={name: count for name, count in raised.items() if count},
    )


def _stop_time(time: npt.NDArray[np.float64], state: Mapping[str, npt.NDArray[Any]]) -> float:
    """When the last rest began: the interpolated time reported by the step that came to rest."""
    if state["regime"][-1] != _STICK:
        return float("nan")
    stops = np.flatnonzero(state["stop_time"] >= 0.0)
    if not len(stops):
        return float(time[0])  # at rest from the start
    return float(time[stops[-1]] + state["stop_time"][stops[-1]])


def _largest(values: npt.NDArray[Any]) -> float:
    """Largest magnitude; NaN if any value is not finite, so that no check passes."""
    values = np.abs(values)
    return float(values.max()) if np.isfinite(values).all() else float("nan")
