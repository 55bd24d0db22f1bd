"""Table of the messages of one topic: a NumPy column per field."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.connector.outputs import DERIVED, acceleration
from cylconn_ros.errors import RecordingError, UnknownNameError

STAMP = ("header.stamp.sec", "header.stamp.nanosec")
"""Fields of a header stamp."""


class UnknownFieldError(RecordingError, UnknownNameError):
    """A topic has no field of this name; the message lists its fields."""

    def __init__(self, topic: str, name: str, fields: Iterable[str]) -> None:
        known = ", ".join(fields) or "none"
        Exception.__init__(self, f"{topic} has no field {name!r}; it has {known}")


@dataclass(frozen=True)
class Table:
    """Messages of one topic, in recording order.

    ``table["pose.position.x"]`` is the column of a field, shape (n,) or (n, k); ``len(table)`` is
    n. Messages that do not match their type are omitted and counted in ``undecodable``.
    """

    topic: str
    type: str
    log_time: npt.NDArray[np.int64]  # (n,) ns since the epoch, time of recording
    publish_time: npt.NDArray[np.int64]  # (n,) ns since the epoch, time of publication
    columns: Mapping[str, npt.NDArray[Any]]
    undecodable: int

    def __len__(self) -> int:
        return len(self.log_time)

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        """Return the column of a field; raise UnknownFieldError if there is none.

        States also have ``acceleration`` and ``angular_acceleration``
        (:func:`~cylconn_ros.connector.outputs.acceleration`).
        """
        if name in DERIVED and DERIVED[name] in self.columns and name not in self.columns:
            step = np.diff(self.stamp) * 1e-9
            return acceleration(step, self.columns[DERIVED[name]][:, 0])
        try:
            return self.columns[name]
        except KeyError:
            raise UnknownFieldError(self.topic, name, self.columns) from None

    @property
    def stamp(self) -> npt.NDArray[np.int64]:
        """Header stamps, ns, shape (n,)."""
        seconds = self["header.stamp.sec"].astype(np.int64)
        return seconds * 1_000_000_000 + self["header.stamp.nanosec"]

    @property
    def time(self) -> npt.NDArray[np.float64]:
        """Seconds since the first header stamp, shape (n,)."""
        stamp = self.stamp
        return np.asarray((stamp - stamp[:1]) * 1e-9, dtype=np.float64)
