"""Comparison of an archive's results with earlier ones: what changed, recording by recording."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from cylconn_ros.errors import StudyError
from cylconn_ros.study.archive.bags import BAG
from cylconn_ros.study.chunk import ERROR, STATUS
from cylconn_ros.study.dataset import Dataset


@dataclass(frozen=True)
class Change:
    """One value of one recording that is not what it was.

    Attributes
    ----------
        bag: name of the recording. column: empty for a recording of one side only.
    """

    bag: str
    column: str
    before: Any
    now: Any

    def __str__(self) -> str:
        """One line."""
        if not self.column:
            return f"{self.bag}: {self.before} before, {self.now} now"
        return f"{self.bag}: {self.column} was {_text(self.before)} and is {_text(self.now)}"


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.9g}"
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}…"


def changes(before: Dataset, now: Dataset, tolerance: float = 0.0) -> list[Change]:
    """What differs between two results of the same command, by name of the recording.

    ``tolerance``: relative difference of numbers that is no change; with one, digests do not count.
    A recording that is new is no change. Raises StudyError for results of different commands.
    """
    kinds = [one.description.get("kind", "") for one in (before, now)]
    if kinds[0] != kinds[1]:
        raise StudyError(
            f"{before.address}: holds results of {kinds[0]!r}, must be of {kinds[1]!r}"
        )
    columns = [STATUS, ERROR]
    columns += [c for c in now.description["outputs"] if c in before.description["outputs"]]
    if tolerance > 0.0 and "digest" in columns:
        columns.remove("digest")
    old, new = (_by_bag(one, columns) for one in (before, now))
    found = [Change(bag, "", "present", "missing") for bag in old if bag not in new]
    for bag, row in new.items():
        if bag in old:
            found += [
                Change(bag, column, old[bag][column], row[column])
                for column in columns
                if not _same(old[bag][column], row[column], tolerance)
            ]
    return found


def added(before: Dataset, now: Dataset) -> list[str]:
    """Names of the recordings that are new."""
    old = set(before.table([BAG])[BAG].to_pylist())
    return [bag for bag in now.table([BAG])[BAG].to_pylist() if bag not in old]


def _by_bag(dataset: Dataset, columns: list[str]) -> dict[str, dict[str, Any]]:
    rows = dataset.table([BAG, *columns]).to_pylist()
    return {row[BAG]: row for row in rows}


def _same(before: Any, now: Any, tolerance: float) -> bool:
    if isinstance(before, float) and isinstance(now, float):
        if math.isnan(before) and math.isnan(now):
            return True
        return before == now or abs(before - now) <= tolerance * max(abs(before), abs(now))
    return bool(before == now)
