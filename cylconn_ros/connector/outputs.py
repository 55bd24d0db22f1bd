"""The numbers of an output array (NOUT,) by name, and the result of one step."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector import enums
from cylconn_ros.core import layout
from cylconn_ros.errors import UnknownNameError

Array = NDArray[np.float64]

ENUMS: Final = {
    "regime": layout.REGIME,
    "stop": layout.STOP,
    "lock": layout.LOCK,
    "status": layout.STATUS,
    "flags": layout.FLAGS,
}
"""The integer fields of ConnectorState and their indices in an output array."""

COLUMNS: Final[dict[str, int | slice]] = {
    "force_a": slice(layout.FORCE_A, layout.FORCE_A + 3),
    "torque_a": slice(layout.TORQUE_A, layout.TORQUE_A + 3),
    "force_b": slice(layout.FORCE_B, layout.FORCE_B + 3),
    "torque_b": slice(layout.TORQUE_B, layout.TORQUE_B + 3),
    **{
        name: layout.STATE_INDEX[name]
        if width == 1
        else slice(layout.STATE_INDEX[name], layout.STATE_INDEX[name] + width)
        for name, width in layout.STATE_FIELDS
    },
    **ENUMS,
}
"""Name of each output and its place in an output array: the published wrenches (axes and point as
``wrench.axes``, ``wrench.point`` say) and the fields of ConnectorState."""

DERIVED: Final = {"acceleration": "velocity", "angular_acceleration": "angular_velocity"}
"""Columns of a run that are computed on request, and the fields from whose first component."""


def acceleration(step: Array, rate: Array) -> Array:
    """Mean acceleration of slide or spin over the period that begins with each sample, (N,).

    The forces of a sample act in that period, so that m a is their sum in the same row: exactly if
    nothing else moves. It is the acceleration in the middle of the period to second order. NaN for
    the last sample, and where time does not advance.

    step: (N - 1,) s, from each sample to the next.
    rate: (N,) first component of ``velocity`` (m/s) or ``angular_velocity`` (rad/s).
    """
    found = np.full(len(rate), np.nan)
    np.divide(np.diff(rate), step, out=found[:-1], where=step > 0.0)
    return found


def column(outs: Array, name: str) -> Any:
    """The output ``name`` of (NOUT,) or (N, NOUT): a number, (k,), (N,) or (N, k).

    Raises UnknownNameError, which lists the names.
    """
    try:
        return outs[..., COLUMNS[name]]
    except KeyError:
        raise UnknownNameError(name, COLUMNS) from None


class StepResult:
    """The outputs of one step, by name.

    ``result["normal_force"]`` gives a float, ``result["offset"]`` an array; ``result.names`` lists
    the fields of ConnectorState and the wrenches. SI units; ``force`` and ``moment`` act on B at
    node b in the axes of node a; ``force_b`` and ``torque_b`` are the published wrench on B.

    Attributes
    ----------
        array: (NOUT,) all outputs (core/layout.py).
    """

    __slots__ = ("array",)

    def __init__(self, array: Array) -> None:
        self.array = array

    def __getitem__(self, name: str) -> Any:
        """An output by name. Raises UnknownNameError (a KeyError) that lists the names."""
        found = column(self.array, name)
        if name in ENUMS:
            return int(found)
        return float(found) if np.ndim(found) == 0 else found

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all outputs."""
        return tuple(COLUMNS)

    @property
    def force_a(self) -> Array:
        """(3,) N, published force on body A."""
        return self.array[COLUMNS["force_a"]]

    @property
    def torque_a(self) -> Array:
        """(3,) N.m, published torque on body A."""
        return self.array[COLUMNS["torque_a"]]

    @property
    def force_b(self) -> Array:
        """(3,) N, published force on body B."""
        return self.array[COLUMNS["force_b"]]

    @property
    def torque_b(self) -> Array:
        """(3,) N.m, published torque on body B."""
        return self.array[COLUMNS["torque_b"]]

    @property
    def regime(self) -> str:
        """``frictionless``, ``stick`` or ``slip``."""
        return enums.REGIMES[self["regime"]]

    @property
    def status(self) -> str:
        """``ok``, or the reason for the zero wrench, such as ``not finite``."""
        number = self["status"]
        return enums.STATUS[number - 1] if number else "ok"

    @property
    def flags(self) -> tuple[str, ...]:
        """Names of the flags that are set, such as ``jammed`` or ``undersampled``."""
        return enums.names_of(enums.FLAGS, self["flags"])

    @property
    def active_stops(self) -> tuple[str, ...]:
        """Names of the stops in contact, such as ``length max``."""
        return enums.names_of(enums.STOPS, self["stop"])

    def __repr__(self) -> str:
        """Regime, force on B and flags."""
        flags = f", flags={', '.join(self.flags)}" if self.flags else ""
        return (
            f"StepResult({self.status}, {self.regime}, force_b={self.force_b.tolist()}, "
            f"torque_b={self.torque_b.tolist()}{flags})"
        )
