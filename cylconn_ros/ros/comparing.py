"""Outputs beside outputs: where a replay parts from what was recorded, and by how much."""

from __future__ import annotations

import dataclasses
import math
import struct
from collections.abc import Sequence

import numpy as np

from cylconn_ros.recording import schema
from cylconn_ros.recording.columns import columns
from cylconn_ros.recording.errors import RecordingError
from cylconn_ros.recording.interfaces import interface

_STAMP = struct.Struct("<iI")
_KEPT = 200_000  # pairs that differ, a topic, to be looked into
LEAST = 1e-6  # of a field's unit: smaller fields are rounding errors, as residual and offset are
TIMING = "computing_time"  # of no two runs the same


@dataclasses.dataclass(frozen=True)
class Difference:
    """A field that differs.

    ``first`` is the first stamp (ns) where it parts by more than the tolerance, else where it parts
    at all; ``recorded`` and ``replayed`` are the values there; ``worst`` is the greatest
    difference, ``relative`` that over the field's greatest size; ``beyond``: more than the
    tolerance.
    """

    field: str
    first: int
    recorded: object
    replayed: object
    worst: float
    relative: float
    beyond: bool


@dataclasses.dataclass
class Topic:
    """One output topic: messages matched by their stamps."""

    name: str
    type: str
    same: int = 0
    different: int = 0
    only_recorded: int = 0
    only_replayed: int = 0
    differences: list[Difference] = dataclasses.field(default_factory=list)

    @property
    def well(self) -> bool:
        """Whether nothing differs beyond the tolerance and nothing is missing."""
        return not any(d.beyond for d in self.differences) and not self.only_recorded


class Comparison:
    """Collect both sides message by message; :meth:`result` when all are in.

    Memory holds what waits for its other side, and pairs that differ.
    """

    def __init__(self, kinds: dict[str, str], timing: dict[str, slice]) -> None:
        """``kinds`` gives the type by topic; ``timing`` the bytes of it that count as equal."""
        self._topics = {name: Topic(name, kind) for name, kind in kinds.items()}
        self._timing = timing
        self._waiting: dict[tuple[str, int, bool], bytes] = {}
        self._pairs: dict[str, list[tuple[bytes, bytes]]] = {name: [] for name in kinds}
        self._zero = bytes(6 * 8)

    @property
    def topics(self) -> frozenset[str]:
        """Topics that are compared."""
        return frozenset(self._topics)

    def recorded(self, topic: str, data: bytes) -> None:
        """A message as it was recorded."""
        self._add(topic, data, True)

    def replayed(self, topic: str, data: bytes) -> None:
        """A message of the replay."""
        self._add(topic, data, False)

    def _add(self, topic: str, data: bytes, old: bool) -> None:
        if len(data) < 12:
            return
        seconds, nanoseconds = _STAMP.unpack_from(data, 4)
        stamp = seconds * 1_000_000_000 + nanoseconds
        other = self._waiting.pop((topic, stamp, not old), None)
        if other is None:
            self._waiting[topic, stamp, old] = data
            return
        pair = (data, other) if old else (other, data)
        found = self._topics[topic]
        if self._equal(topic, *pair):
            found.same += 1
        else:
            found.different += 1
            if len(self._pairs[topic]) < _KEPT:
                self._pairs[topic].append(pair)

    def _equal(self, topic: str, one: bytes, other: bytes) -> bool:
        if one == other:
            return True
        left_out = self._timing.get(topic)
        return (
            left_out is not None
            and len(one) == len(other)
            and one[: left_out.start] == other[: left_out.start]
            and one[left_out.stop :] == other[left_out.stop :]
        )

    def result(self, tolerance: float) -> list[Topic]:
        """Every topic; ``tolerance`` is relative to the greatest size of a field, or to LEAST."""
        for (name, _, old), data in self._waiting.items():
            topic = self._topics[name]
            if old and not data.endswith(self._zero):  # no zero wrench of a pause in the input
                topic.only_recorded += 1
            elif not old:
                topic.only_replayed += 1
        for name, pairs in self._pairs.items():
            self._topics[name].differences = _differences(self._topics[name].type, pairs, tolerance)
        return list(self._topics.values())


def _differences(
    kind: str, pairs: Sequence[tuple[bytes, bytes]], tolerance: float
) -> list[Difference]:
    if not pairs:
        return []
    parsed, name = schema.parse(kind, interface(kind).definition), schema.short_name(kind)[0]
    sides = [columns(parsed, name, list(side)) for side in zip(*pairs, strict=True)]
    good = sides[0][1] & sides[1][1]
    if not good.all():
        raise RecordingError(f"{int((~good).sum())} messages of {kind} cannot be decoded")
    old, new = sides[0][0], sides[1][0]
    stamp = old["header.stamp.sec"].astype(np.int64) * 1_000_000_000 + old["header.stamp.nanosec"]
    found = []
    for field, before in old.items():
        if field == TIMING:
            continue
        after = new[field]
        if before.dtype == object or before.shape != after.shape:
            apart = np.array([str(x) != str(y) for x, y in zip(before, after, strict=True)])
            size, differs = math.nan, apart
            distance = np.where(apart, math.inf, 0.0)
        else:
            one = before.reshape(len(stamp), -1).astype(np.float64)
            two = after.reshape(len(stamp), -1).astype(np.float64)
            either = np.isnan(one) & np.isnan(two)
            gap = np.where(either, 0.0, np.abs(one - two))
            distance = np.where(np.isnan(gap), math.inf, gap).max(axis=1)
            differs, size = distance > 0.0, float(np.nanmax(np.abs(one), initial=0.0))
        if not differs.any():
            continue
        beyond = distance > tolerance * max(size, LEAST)
        at = int(np.argmax(beyond if beyond.any() else differs))
        worst = float(distance.max())
        found.append(
            Difference(
                field,
                int(stamp[at]),
                _shown(before[at]),
                _shown(after[at]),
                worst,
                worst / size if size > 0.0 else math.inf,
                bool(beyond.any()),
            )
        )
    return sorted(found, key=lambda d: (not d.beyond, d.first))


def _shown(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
