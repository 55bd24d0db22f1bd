"""Commands of actuators over time, from a CSV file."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from cylconn_ros.errors import ModelError

_MOST_ROWS = 1_000_000


class Motion:
    """Commands of actuators over simulated time, linear between the rows and held at both ends.

    Attributes
    ----------
        names: of actuators, or of joints that an actuator drives.
    """

    def __init__(self, path: Path) -> None:
        """Read a table with the columns ``time`` (s, increasing) and one per actuator.

        Raises ModelError with the line of what cannot be used.
        """
        try:
            with path.open(newline="", encoding="utf-8") as file:
                lines = csv.reader(file)
                head = next(lines, [])
                rows = [_numbers(path, number, head, line)
                        for number, line in enumerate(lines, 2) if line]  # fmt: skip
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise ModelError(f"{path}: cannot be read: {error}") from None
        self.names = [name.strip() for name in head[1:]]
        if not self.names or head[0].strip() != "time" or len(set(self.names)) < len(self.names):
            raise ModelError(
                f"{path}: line 1: must be time and different names of actuators; is "
                f"{','.join(head)[:80] or 'empty'}"
            )
        if not rows:
            raise ModelError(f"{path}: has no row")
        table = np.array(rows)
        self._times, self._values = table[:, 0], table[:, 1:]
        if not (np.diff(self._times) > 0.0).all():
            late = int(np.argmin(np.diff(self._times) > 0.0)) + 1
            raise ModelError(f"{path}: time = {self._times[late]:g}: must be later than before it")

    def at(self, time: float) -> dict[str, float]:
        """The commands at a time in s, by name."""
        return {
            name: float(np.interp(time, self._times, self._values[:, k]))
            for k, name in enumerate(self.names)
        }


def _numbers(path: Path, number: int, head: list[str], line: list[str]) -> list[float]:
    if number > _MOST_ROWS:
        raise ModelError(f"{path}: has more than {_MOST_ROWS} rows")
    try:
        values = [float(text) for text in line]
    except ValueError:
        values = []
    if len(values) != len(head) or not np.isfinite(values).all():
        raise ModelError(
            f"{path}: line {number}: must be {len(head)} finite numbers; is {','.join(line)[:80]}"
        )
    return values
