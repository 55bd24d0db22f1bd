"""Compare replayed outputs with the recorded ones: identical, or the first and largest differences.

Messages of a topic are paired by stamp. Recorded messages are decoded by the schema stored in the
recording, replayed ones by the installed definition, and the fields are compared by name. A field
of only one of the two schemas is reported, not compared: a recording stays comparable when a
message type gets a new field.
"""

from __future__ import annotations

import dataclasses
import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording import schema
from cylconn_ros.recording.columns import columns
from cylconn_ros.recording.message_definitions import interface

_STAMP = struct.Struct("<iI")
_MAX_PAIRS = 4096  # pairs that are decoded at once
_MAX_WAITING = 100_000  # unpaired messages of a topic
_ZERO_WRENCH = bytes(6 * 8)
LEAST_SIZE = 1e-6
"""Least size of a field, in its unit: smaller values are rounding errors (residual, offset)."""
TIMING = "computing_time"
"""The field that differs in every run; it is not compared."""

Rows = NDArray[np.uint8]


@dataclasses.dataclass(frozen=True)
class Difference:
    """A field that differs.

    Attributes
    ----------
        field: its name, ``a.b`` if nested.
        first: stamp (ns) of the first message with a difference above the tolerance; if none is
            above, of the first with any difference.
        recorded, replayed: the values in this message.
        worst: largest difference.
        relative: ``worst`` divided by the largest absolute value of the field.
        beyond: whether ``worst`` is above the tolerance.
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
    """Result for one output topic: numbers of message pairs, and the fields that differ."""

    name: str
    type: str
    same: int = 0
    different: int = 0
    only_recorded: int = 0
    only_replayed: int = 0
    differences: list[Difference] = dataclasses.field(default_factory=list)
    fields_only_recorded: tuple[str, ...] = ()
    fields_only_replayed: tuple[str, ...] = ()

    @property
    def well(self) -> bool:
        """Whether no difference is above the tolerance and no replayed message is missing."""
        return not any(d.beyond for d in self.differences) and not self.only_recorded

    @property
    def not_compared(self) -> str:
        """The fields that exist on one side only, as text; '' if there are none."""
        sides = (("recording", self.fields_only_recorded), ("replay", self.fields_only_replayed))
        return "; ".join(
            f"only in the {side}: {', '.join(names)}" for side, names in sides if names
        )


class Comparison:
    """Collect recorded and replayed messages; :meth:`result` after the last.

    Memory holds messages without a partner, and a limited number of pairs that differ.
    """

    def __init__(
        self,
        types: Mapping[str, str],
        timing: Mapping[str, slice],
        tolerance: float = 0.0,
        definitions: Mapping[str, str] | None = None,
    ) -> None:
        """Compare the topics of ``types``, which gives the message type of each.

        Args:
            timing: by topic, the bytes that are not compared.
            tolerance: greatest difference that is accepted, relative to the largest absolute value
                of the field in the messages that differ.
            definitions: by topic, the schema of the recorded messages (``ros2msg`` text); without
                one, the recorded messages are decoded by the installed definition.
        """
        self._topics = {name: Topic(name, kind) for name, kind in types.items()}
        self._timing = timing
        self._waiting: dict[str, dict[tuple[int, bool], bytes]] = {name: {} for name in types}
        self._pairs: dict[str, list[tuple[bytes, bytes]]] = {name: [] for name in types}
        self._fields = {
            name: _Fields(kind, (definitions or {}).get(name, ""), tolerance)
            for name, kind in types.items()
        }

    @property
    def topics(self) -> frozenset[str]:
        """The topics that are compared."""
        return frozenset(self._topics)

    def recorded(self, topic: str, data: bytes) -> None:
        """Add a recorded message."""
        self._add(topic, data, True)

    def replayed(self, topic: str, data: bytes) -> None:
        """Add a replayed message."""
        self._add(topic, data, False)

    def both(self, topic: str, recorded: Rows, replayed: Rows) -> None:
        """Add messages of one size as (n, bytes) uint8, recorded and replayed, in their orders."""
        old, new = _stamps(recorded), _stamps(replayed)
        if len(old) == len(new) and np.array_equal(old, new):
            every: NDArray[np.intp] = np.arange(len(old))
            first = second = every
        else:
            _, first, second = np.intersect1d(old, new, return_indices=True)
        shared = old[first]
        if (
            recorded.shape[1] != replayed.shape[1]
            or not self._fields[topic].one_schema
            or len(np.unique(old)) < len(old)
            or len(np.unique(new)) < len(new)
            or _any_waits(self._waiting[topic], shared)
        ):
            first = second = np.arange(0)
        for side, pairs, rows in ((True, first, recorded), (False, second, replayed)):
            alone = np.ones(len(rows), np.bool_)
            alone[pairs] = False
            for k in np.flatnonzero(alone):
                self._add(topic, rows[k].tobytes(), side)
        before, after = recorded[first], replayed[second]
        differs = before != after
        not_compared = self._timing.get(topic)
        if not_compared is not None:
            differs[:, not_compared] = False
        apart = np.flatnonzero(differs.any(axis=1))
        self._topics[topic].same += len(first) - len(apart)
        for k in apart:
            self._compare_fields(topic, before[k].tobytes(), after[k].tobytes())

    def _add(self, topic: str, data: bytes, is_recorded: bool) -> None:
        if len(data) < 12:
            return
        seconds, nanoseconds = _STAMP.unpack_from(data, 4)
        stamp = seconds * 1_000_000_000 + nanoseconds
        waiting = self._waiting[topic]
        other = waiting.pop((stamp, not is_recorded), None)
        if other is None:
            if len(waiting) >= _MAX_WAITING:
                self._drop(topic, next(iter(waiting)))
            waiting[stamp, is_recorded] = data
            return
        pair = (data, other) if is_recorded else (other, data)
        if self._equal(topic, *pair):
            self._topics[topic].same += 1
        else:
            self._compare_fields(topic, *pair)

    def _compare_fields(self, topic: str, old: bytes, new: bytes) -> None:
        pairs = self._pairs[topic]
        pairs.append((old, new))
        if len(pairs) >= _MAX_PAIRS:
            self._decode(topic)

    def _decode(self, topic: str) -> None:
        """Compare the collected pairs field by field."""
        pairs, found, fields = self._pairs[topic], self._topics[topic], self._fields[topic]
        different = fields.add(pairs)
        if fields.one_schema:  # the bytes differ, also if no number does: -0.0 and 0.0
            different = len(pairs)
        found.different += different
        found.same += len(pairs) - different
        pairs.clear()

    def _drop(self, topic: str, which: tuple[int, bool]) -> None:
        """Count a message without a partner."""
        data = self._waiting[topic].pop(which)
        found = self._topics[topic]
        if not which[1]:
            found.only_replayed += 1
        elif not data.endswith(_ZERO_WRENCH):  # zero wrenches after an input timeout do not count
            found.only_recorded += 1

    def _equal(self, topic: str, one: bytes, other: bytes) -> bool:
        """Whether two messages of one schema have the same bytes but for the computing time."""
        if not self._fields[topic].one_schema:
            return False
        if one == other:
            return True
        not_compared = self._timing.get(topic)
        return (
            not_compared is not None
            and len(one) == len(other)
            and one[: not_compared.start] == other[: not_compared.start]
            and one[not_compared.stop :] == other[not_compared.stop :]
        )

    def result(self) -> list[Topic]:
        """The result for every topic. Raises RecordingError if a message cannot be decoded."""
        for name, topic in self._topics.items():
            for which in list(self._waiting[name]):
                self._drop(name, which)
            if self._pairs[name]:
                self._decode(name)
            fields = self._fields[name]
            topic.differences = fields.differences()
            topic.fields_only_recorded, topic.fields_only_replayed = fields.unshared
        return list(self._topics.values())


def _stamps(rows: Rows) -> NDArray[np.int64]:
    times = np.ascontiguousarray(rows[:, 4:12])
    seconds = times.view("<i4")[:, 0].astype(np.int64)
    return np.asarray(seconds * 1_000_000_000 + times.view("<u4")[:, 1], np.int64)


def _any_waits(waiting: Mapping[tuple[int, bool], bytes], stamps: NDArray[np.int64]) -> bool:
    """Whether messages with some of the stamps have no partner yet."""
    return bool(waiting) and bool(np.isin([stamp for stamp, _ in waiting], stamps).any())


class _Pair(NamedTuple):
    """The values of a field in a pair of messages."""

    distance: float
    stamp: int
    recorded: object
    replayed: object


@dataclasses.dataclass
class _Field:
    """The differences of a field so far."""

    size: float = 0.0  # largest absolute recorded value
    worst: float = 0.0
    first: _Pair | None = None
    # Pairs with increasing difference: the first above the tolerance is among them, or within one
    # per cent of one of them, whatever the size of the field is in the end.
    increasing: list[_Pair] = dataclasses.field(default_factory=list)


class _Fields:
    """Comparison of the fields of one topic, in lots of message pairs.

    Attributes
    ----------
        one_schema: whether recorded and replayed messages have the same fields.
        unshared: fields of the recorded and of the replayed messages that the other side lacks.
    """

    def __init__(self, kind: str, definition: str, tolerance: float) -> None:
        """``definition``: schema of the recorded messages; '': the installed one."""
        self._kind, self._tolerance = kind, tolerance
        self._type_name = schema.short_name(kind)[0]
        installed = interface(kind).definition
        self._schemas = [schema.parse(kind, text) for text in (definition or installed, installed)]
        self.one_schema = self._schemas[0] == self._schemas[1]
        old, new = (tuple(_leaves(parsed, self._type_name)) for parsed in self._schemas)
        self.unshared = (
            tuple(name for name in old if name not in new),
            tuple(name for name in new if name not in old),
        )
        self._fields: dict[str, _Field] = {}

    def add(self, pairs: Sequence[tuple[bytes, bytes]]) -> int:
        """Compare pairs of messages, recorded and replayed; the number of pairs that differ."""
        sides = [
            columns(parsed, self._type_name, list(side))
            for parsed, side in zip(self._schemas, zip(*pairs, strict=True), strict=True)
        ]
        good = sides[0][1] & sides[1][1]
        if not good.all():
            raise RecordingError(f"{int((~good).sum())} messages of {self._kind} cannot be decoded")
        old, new = sides[0][0], sides[1][0]
        if not {"header.stamp.sec", "header.stamp.nanosec"} <= old.keys():
            raise RecordingError(f"the recorded definition of {self._kind} has no header.stamp")
        seconds = old["header.stamp.sec"].astype(np.int64)
        stamp = seconds * 1_000_000_000 + old["header.stamp.nanosec"]
        differs = np.zeros(len(pairs), np.bool_)
        for name, before in old.items():
            if name != TIMING and name in new:
                field = self._fields.setdefault(name, _Field())
                differs |= self._compare(field, stamp, before, new[name])
        return int(differs.sum())

    def _compare(
        self, field: _Field, stamp: NDArray[np.int64], before: NDArray[Any], after: NDArray[Any]
    ) -> NDArray[np.bool_]:
        """Compare the values of a field; (n,) whether they differ."""
        if before.dtype == object or before.shape != after.shape:
            apart = np.array([str(x) != str(y) for x, y in zip(before, after, strict=True)])
            distance = np.where(apart, math.inf, 0.0)
            field.size = math.nan
        else:
            one = before.reshape(len(stamp), -1).astype(np.float64)
            two = after.reshape(len(stamp), -1).astype(np.float64)
            both_nan = np.isnan(one) & np.isnan(two)
            difference = np.where(both_nan, 0.0, np.abs(one - two))
            distance = np.where(np.isnan(difference), math.inf, difference).max(axis=1)
            field.size = max(field.size, float(np.nanmax(np.abs(one), initial=0.0)))
        field.worst = max(field.worst, float(distance.max()))
        highest = np.maximum.accumulate(distance)
        increases = distance > np.concatenate(([0.0], highest[:-1]))
        for k in np.flatnonzero(increases):
            far = float(distance[k])
            last = field.increasing[-1].distance if field.increasing else 0.0
            if field.first is not None and (self._tolerance == 0.0 or far < 1.01 * last):
                continue
            found = _Pair(far, int(stamp[k]), _shown(before[k]), _shown(after[k]))
            field.first = field.first or found
            field.increasing.append(found)
        return distance > 0.0

    def differences(self) -> list[Difference]:
        """The fields that differ; those above the tolerance first."""
        found = []
        for name, field in self._fields.items():
            if field.first is None:
                continue
            limit = self._tolerance * max(LEAST_SIZE, field.size)  # a text has no size
            beyond = field.worst > limit
            above = (each for each in field.increasing if each.distance > limit)
            at = next(above, field.increasing[-1]) if beyond else field.first
            relative = field.worst / field.size if field.size > 0.0 else math.inf
            found.append(
                Difference(
                    name, at.stamp, at.recorded, at.replayed, field.worst, relative,
                    beyond,
                )
            )  # fmt: skip
        return sorted(found, key=lambda d: (not d.beyond, d.first))


def _leaves(parsed: schema.Schema, type_name: str, prefix: str = "") -> Iterator[str]:
    """Names of the fields of a type, ``a.b`` for nested ones."""
    for member in parsed[type_name]:
        if member.type in parsed:
            yield from _leaves(parsed, member.type, f"{prefix}{member.name}.")
        else:
            yield f"{prefix}{member.name}"


def _shown(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def agree(topics: Sequence[Topic]) -> bool:
    """Whether outputs were compared, and none diverges."""
    return any(t.same + t.different for t in topics) and all(t.well for t in topics)


def verdict(topics: Sequence[Topic], tolerance: float) -> str:
    """The result for all topics, as text."""
    if not any(topic.same + topic.different + topic.only_recorded for topic in topics):
        return "NOTHING COMPARED: the recording holds no outputs"
    if not agree(topics):
        return "OUTPUTS DIFFER"
    return f"outputs equal within tolerance {tolerance:g}" if tolerance else "outputs identical"
