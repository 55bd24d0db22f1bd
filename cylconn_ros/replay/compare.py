"""Outputs beside outputs: where a replay parts from what was recorded, and by how much."""

from __future__ import annotations

import dataclasses
import math
import struct
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording import schema
from cylconn_ros.recording.columns import columns
from cylconn_ros.recording.message_definitions import interface

_STAMP = struct.Struct("<iI")
_LOT = 4096  # pairs that differ to be looked into at once
_WAIT = 100_000  # messages of a topic that wait for their other side at most
_ZERO = bytes(6 * 8)
LEAST = 1e-6  # of a field's unit: smaller fields are rounding errors, as residual and offset are
TIMING = "computing_time"  # of no two runs the same

Rows = NDArray[np.uint8]


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
    """Collect both sides; :meth:`result` when all are in.

    Memory holds what waits for its other side, and some pairs that differ.
    """

    def __init__(
        self, kinds: dict[str, str], timing: dict[str, slice], tolerance: float = 0.0
    ) -> None:
        """Compare topics of the types ``kinds``.

        ``timing``: the bytes, by topic, that count as equal. ``tolerance``: relative to the
        greatest size of a field among the messages that differ.
        """
        self._topics = {name: Topic(name, kind) for name, kind in kinds.items()}
        self._timing = timing
        self._waiting: dict[str, dict[tuple[int, bool], bytes]] = {name: {} for name in kinds}
        self._pairs: dict[str, list[tuple[bytes, bytes]]] = {name: [] for name in kinds}
        self._fields = {name: _Fields(kind, tolerance) for name, kind in kinds.items()}

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

    def both(self, topic: str, recorded: Rows, replayed: Rows) -> None:
        """Messages of the same size as (n, bytes) uint8, recorded and replayed, in their orders."""
        old, new = _stamps(recorded), _stamps(replayed)
        if len(old) == len(new) and np.array_equal(old, new):
            every: NDArray[np.intp] = np.arange(len(old))
            first = second = every
        else:
            _, first, second = np.intersect1d(old, new, return_indices=True)
        shared = old[first]
        if (
            recorded.shape[1] != replayed.shape[1]
            or len(np.unique(old)) < len(old)
            or len(np.unique(new)) < len(new)
            or _any_of(self._waiting[topic], shared)
        ):
            first = second = np.arange(0)
        for side, pairs, rows in ((True, first, recorded), (False, second, replayed)):
            alone = np.ones(len(rows), np.bool_)
            alone[pairs] = False
            for k in np.flatnonzero(alone):
                self._add(topic, rows[k].tobytes(), side)
        before, after = recorded[first], replayed[second]
        differs = before != after
        left_out = self._timing.get(topic)
        if left_out is not None:
            differs[:, left_out] = False
        apart = np.flatnonzero(differs.any(axis=1))
        self._topics[topic].same += len(first) - len(apart)
        for k in apart:
            self._differ(topic, before[k].tobytes(), after[k].tobytes())

    def _add(self, topic: str, data: bytes, old: bool) -> None:
        if len(data) < 12:
            return
        seconds, nanoseconds = _STAMP.unpack_from(data, 4)
        stamp = seconds * 1_000_000_000 + nanoseconds
        waiting = self._waiting[topic]
        other = waiting.pop((stamp, not old), None)
        if other is None:
            if len(waiting) >= _WAIT:
                self._alone(topic, next(iter(waiting)))
            waiting[stamp, old] = data
            return
        pair = (data, other) if old else (other, data)
        if self._equal(topic, *pair):
            self._topics[topic].same += 1
        else:
            self._differ(topic, *pair)

    def _differ(self, topic: str, old: bytes, new: bytes) -> None:
        self._topics[topic].different += 1
        pairs = self._pairs[topic]
        pairs.append((old, new))
        if len(pairs) >= _LOT:
            self._fields[topic].add(pairs)
            pairs.clear()

    def _alone(self, topic: str, which: tuple[int, bool]) -> None:
        """Count a message that has waited in vain."""
        data = self._waiting[topic].pop(which)
        found = self._topics[topic]
        if not which[1]:
            found.only_replayed += 1
        elif not data.endswith(_ZERO):  # no zero wrench of a pause in the input
            found.only_recorded += 1

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

    def result(self) -> list[Topic]:
        """Every topic."""
        for name, topic in self._topics.items():
            for which in list(self._waiting[name]):
                self._alone(name, which)
            if self._pairs[name]:
                self._fields[name].add(self._pairs[name])
                self._pairs[name].clear()
            topic.differences = self._fields[name].differences()
        return list(self._topics.values())


def _stamps(rows: Rows) -> NDArray[np.int64]:
    times = np.ascontiguousarray(rows[:, 4:12])
    seconds = times.view("<i4")[:, 0].astype(np.int64)
    return np.asarray(seconds * 1_000_000_000 + times.view("<u4")[:, 1], np.int64)


def _any_of(waiting: Mapping[tuple[int, bool], bytes], stamps: NDArray[np.int64]) -> bool:
    """Whether some of the stamps wait."""
    return bool(waiting) and bool(np.isin([stamp for stamp, _ in waiting], stamps).any())


@dataclasses.dataclass
class _Field:
    """A field's differences so far."""

    size: float = 0.0
    worst: float = 0.0
    first: _Parting | None = None
    # Each farther apart than the one before: whatever the field's size will be in the end, the
    # first beyond the tolerance is one of them, or within a hundredth of one.
    farther: list[_Parting] = dataclasses.field(default_factory=list)


class _Parting(NamedTuple):
    distance: float
    stamp: int
    recorded: object
    replayed: object


class _Fields:
    """The fields of one type, in pairs of messages that differ and come in lots."""

    def __init__(self, kind: str, tolerance: float) -> None:
        self._kind, self._tolerance = kind, tolerance
        self._fields: dict[str, _Field] = {}

    def add(self, pairs: Sequence[tuple[bytes, bytes]]) -> None:
        """Take the next pairs."""
        kind = self._kind
        parsed, name = schema.parse(kind, interface(kind).definition), schema.short_name(kind)[0]
        sides = [columns(parsed, name, list(side)) for side in zip(*pairs, strict=True)]
        good = sides[0][1] & sides[1][1]
        if not good.all():
            raise RecordingError(f"{int((~good).sum())} messages of {kind} cannot be decoded")
        old, new = sides[0][0], sides[1][0]
        seconds = old["header.stamp.sec"].astype(np.int64)
        stamp = seconds * 1_000_000_000 + old["header.stamp.nanosec"]
        for field, before in old.items():
            if field != TIMING:
                self._take(self._fields.setdefault(field, _Field()), stamp, before, new[field])

    def _take(
        self, field: _Field, stamp: NDArray[np.int64], before: NDArray[Any], after: NDArray[Any]
    ) -> None:
        if before.dtype == object or before.shape != after.shape:
            apart = np.array([str(x) != str(y) for x, y in zip(before, after, strict=True)])
            distance = np.where(apart, math.inf, 0.0)
            field.size = math.nan
        else:
            one = before.reshape(len(stamp), -1).astype(np.float64)
            two = after.reshape(len(stamp), -1).astype(np.float64)
            either = np.isnan(one) & np.isnan(two)
            gap = np.where(either, 0.0, np.abs(one - two))
            distance = np.where(np.isnan(gap), math.inf, gap).max(axis=1)
            field.size = max(field.size, float(np.nanmax(np.abs(one), initial=0.0)))
        field.worst = max(field.worst, float(distance.max()))
        highest = np.maximum.accumulate(distance)
        record = distance > np.concatenate(([0.0], highest[:-1]))
        for k in np.flatnonzero(record):
            far = float(distance[k])
            last = field.farther[-1].distance if field.farther else 0.0
            if field.first is not None and (self._tolerance == 0.0 or far < 1.01 * last):
                continue
            found = _Parting(far, int(stamp[k]), _shown(before[k]), _shown(after[k]))
            field.first = field.first or found
            field.farther.append(found)

    def differences(self) -> list[Difference]:
        """What has been found; what is beyond the tolerance first."""
        found = []
        for name, field in self._fields.items():
            if field.first is None:
                continue
            limit = self._tolerance * max(LEAST, field.size)  # LEAST for texts, which have none
            beyond = field.worst > limit
            over = (each for each in field.farther if each.distance > limit)
            at = next(over, field.farther[-1]) if beyond else field.first
            relative = field.worst / field.size if field.size > 0.0 else math.inf
            found.append(
                Difference(
                    name, at.stamp, at.recorded, at.replayed, field.worst, relative,
                    beyond,
                )
            )  # fmt: skip
        return sorted(found, key=lambda d: (not d.beyond, d.first))


def _shown(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
