"""The numbers in a page: arrays packed one behind the other, and a head that says where."""

from __future__ import annotations

import base64
import math
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.connector import enums
from cylconn_ros.report import decimate
from cylconn_ros.report.gather import Gathered, Geometry
from cylconn_ros.report.panels import PANELS, Curve, Panel, States, chosen

Array = npt.NDArray[Any]

WHOLE = 40_000
"""Up to so many samples each one is in the page."""
BUCKETS = 8_000
"""Beyond that, so many buckets, with the smallest and the largest value of each."""
PATH_BUCKETS = 2_500
"""And so many of whole samples, up to nine of each, for the planes and the 3-D view."""

EVENTS = {
    "regime": enums.REGIMES,
    "stop": tuple(f"stop {name}" for name in enums.STOPS),
    "lock": tuple(f"{name} locked" for name in enums.LOCKS),
    "status": enums.STATUS,
    "flags": enums.FLAGS,
}
"""Names of the bits of ConnectorState, lowest first; of regime and status, of the values."""


class Packer:
    """Arrays to bytes; what is put in is given back as its place."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def put(self, values: Array, kind: str = "f4") -> list[Any]:
        """Append an array; returns [kind, offset in bytes, number of values]."""
        with np.errstate(over="ignore"):  # beyond single precision: blank, as what is not finite
            data = np.ascontiguousarray(values).astype("<" + kind)
        raw = data.tobytes()
        raw += bytes(-len(raw) % 8)
        place = [kind, self._size, int(data.size)]
        self._parts.append(raw)
        self._size += len(raw)
        return place

    def text(self) -> str:
        """Everything, compressed (zlib) and as base64."""
        return base64.b64encode(zlib.compress(b"".join(self._parts), 6)).decode("ascii")


def build(found: Gathered, buckets: int = BUCKETS) -> tuple[dict[str, Any], str]:
    """Build the head and the packed numbers of a page, reading the states twice.

    ``buckets`` is how many are made of a run of more than WHOLE samples. Adds to the notes where
    values are not finite.
    """
    packer = Packer()
    count = len(found.time)
    whole = count <= WHOLE
    first = decimate.starts(count, count if whole else buckets)
    last = np.append(first[1:], count) - 1
    seen = _Seen(first, count)
    for states in found.pieces(None):
        seen.add(states)
    if seen.blank:
        fields = len(seen.blank)
        found.notes.append(f"Fields with values that are not finite, left blank there: {fields}.")
    panels, empty = chosen(found.radius, seen.tells, seen.constant)
    head = {
        "samples": count,
        "whole": whole,
        "bucket": -(-count // len(first)),
        "time": packer.put(found.time[first], "f8"),
        "until": packer.put(found.time[last], "f8"),
        "gap": packer.put(decimate.union(found.gaps.astype(np.uint8), first), "u1"),
        "panels": [_panel(packer, panel, seen, whole) for panel in panels],
        "empty": empty,
        "events": {
            name: {"bits": packer.put(seen.events[name].bits, "u4"), "names": names}
            for name, names in EVENTS.items()
        },
    }
    rows = first
    if not whole:
        path = decimate.starts(count, PATH_BUCKETS)
        rows = decimate.telling_rows(seen.plane, path, count)
    geometry = found.geometry_at(rows)
    head["path"] = _path(packer, found, rows, geometry)
    head["geometry"] = _geometry(geometry)
    head["radius"] = found.radius if found.radius > 0.0 else None
    return head, packer.text()


class _Seen:
    """What is kept of all states, which come piece by piece.

    Attributes
    ----------
        events: bits of what was on in each bucket: regimes, stops, locks, refusals and flags.
        plane: (4, n) force, moment, slide and spin in the plane of the disc.
        blank: fields with values that are not finite.
        constant: whether the coefficient of friction never changes, but for refused samples.
    """

    def __init__(self, first: Array, count: int) -> None:
        self.curves: dict[tuple[Curve, bool], decimate.Extremes] = {}
        for panel in PANELS:
            for curve in panel.curves:
                self.curves[curve, False] = decimate.Extremes(first)
                if curve.shows:
                    self.curves[curve, True] = decimate.Extremes(first)
        self.events = {name: decimate.Union(first) for name in EVENTS}
        self.plane = np.empty((4, count))
        self.blank: set[str] = set()
        self._at = 0
        self._coefficient = (math.inf, -math.inf)

    def add(self, states: States) -> None:
        """Take the next states."""
        count = len(states("regime"))
        for (curve, shown), extremes in self.curves.items():
            extremes.add((curve.shows if shown and curve.shows else curve.values)(states))
        for name, bits in _bits(states).items():
            self.events[name].add(bits)
        self.plane[:, self._at : self._at + count] = plane(states)
        self.blank |= {n for n, v in states.fields.items() if not np.isfinite(v).all()}
        mu = states("friction_coefficient")[states("status") == 0.0]
        mu = mu[np.isfinite(mu)]
        if len(mu):
            low, high = self._coefficient
            self._coefficient = min(low, float(mu.min())), max(high, float(mu.max()))
        self._at += count

    @property
    def constant(self) -> bool:
        low, high = self._coefficient
        return low > high or high - low <= 1e-9 * max(abs(low), abs(high))

    def tells(self, curve: Curve) -> bool:
        """Whether a curve has something to show."""
        found = self.curves[curve, curve.shows is not None]
        finite = np.isfinite(found.low)
        zero = (found.low[finite] == 0.0) & (found.high[finite] == 0.0)
        return bool(finite.any()) and (curve.always or not zero.all())


def _panel(packer: Packer, panel: Panel, seen: _Seen, whole: bool) -> dict[str, Any]:
    def put(found: decimate.Extremes) -> list[Any]:
        return [packer.put(found.low)] + ([] if whole else [packer.put(found.high)])

    def curve(one: Curve) -> dict[str, Any]:
        return {
            "label": one.label,
            "colour": one.colour,
            "style": one.style,
            "drawn": put(seen.curves[one, False]),
            "shown": put(seen.curves[one, True]) if one.shows else None,
        }

    return {
        "key": panel.key,
        "title": panel.title,
        "unit": panel.unit,
        "log": panel.log,
        "zero": panel.zero,
        "curves": [curve(one) for one in panel.curves],
    }


def _bits(states: States) -> dict[str, Array]:
    """Bits of what was on at each sample, in the order of EVENTS."""
    count = len(states("regime"))

    def field(name: str) -> Array:
        return np.asarray(states.fields.get(name, np.zeros(count))).astype(np.int64)

    status = field("status")
    return {
        "regime": 1 << np.clip(field("regime"), 0, 30),
        "stop": field("stop"),
        "lock": field("lock"),
        "status": np.where(status > 0, 1 << np.clip(status - 1, 0, 30), 0),
        "flags": field("flags"),
    }


def plane(states: States) -> list[Array]:
    """Force, moment over R, slide and spin times R: what the disc and the slip path show."""
    radius = states.radius if states.radius > 0.0 else 1.0
    return [
        states("force_friction"),
        states("moment_friction") / radius,
        states("displacement"),
        states("rotation") * radius,
    ]


_PATH = (
    "force_friction", "moment_friction", "displacement", "rotation", "friction_limit", "length",
    "offset", "angle", "regime", "force",
)  # fmt: skip


def _path(packer: Packer, found: Gathered, rows: Array, geometry: Geometry) -> dict[str, Any]:
    """Whole samples for the disc, the path of the slip and the 3-D view: those of ``rows``."""
    taken: list[dict[str, Array]] = []
    at = 0
    for states in found.pieces(_PATH):
        count = len(states("regime"))
        begin, end = np.searchsorted(rows, (at, at + count))
        which = rows[begin:end] - at
        at += count
        columns = dict(zip(("f1", "m1", "u1", "ur1"), plane(states), strict=True))
        offset = np.asarray(states.fields["offset"], float)
        columns |= {
            "limit": states("friction_limit"),
            "length": states("length"),
            "y": offset[:, 0],
            "z": offset[:, 1],
            "angle": np.remainder(states("angle"), 2.0 * np.pi),
            "regime": np.asarray(states.fields["regime"]),
            "force": np.asarray(states.fields["force"], float),
        }
        taken.append({name: values[which] for name, values in columns.items()})
    joined = {name: np.concatenate([part[name] for part in taken]) for name in taken[0]}
    kinds = {"regime": "u1"}
    head = {name: packer.put(values, kinds.get(name, "f4")) for name, values in joined.items()}
    head["time"] = packer.put(found.time[rows], "f8")
    for name, values in (
        ("origin", geometry.origin),
        ("axes", geometry.axes),
        ("centre", geometry.centre),
    ):
        if values is not None:
            head[name] = packer.put(values)
    return head


def _geometry(geometry: Geometry) -> dict[str, Any]:
    return {
        "radius": geometry.radius,
        "overlap": geometry.overlap,
        "stops": [stop if np.isfinite(stop) else None for stop in geometry.stops],
        "up": list(geometry.up),
    }
