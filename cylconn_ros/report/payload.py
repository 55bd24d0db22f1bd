"""Data of a page: arrays packed into one compressed text, and a header with their places."""

from __future__ import annotations

import base64
import math
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.connector import enums
from cylconn_ros.report import decimate
from cylconn_ros.report.gather import Geometry, RunData
from cylconn_ros.report.panels import PANELS, Curve, Panel, States, visible_panels

Array = npt.NDArray[Any]

WHOLE = 40_000
"""Greatest number of samples for which the page contains every sample."""
BUCKETS = 8_000
"""Buckets of a longer run, with the smallest and the largest value of each."""
PATH_BUCKETS = 2_500
"""Buckets of whole samples, up to nine from each, for trajectories and the 3-D view."""

EVENTS = {
    "regime": enums.REGIMES,
    "stop": tuple(f"stop {name}" for name in enums.STOPS),
    "lock": tuple(f"{name} locked" for name in enums.LOCKS),
    "status": enums.STATUS,
    "flags": enums.FLAGS,
}
"""Names of the bits of ConnectorState, lowest first; for regime and status, of their values."""


_CONSTANTS = {
    "coefficient": ("friction_coefficient",),
    "contact": ("overlap", "contact_centre"),
}
"""Panels that are omitted if their fields are constant: they are among the parameters."""


class Packer:
    """Concatenates arrays to bytes, and returns the place of each."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def pack(self, values: Array, kind: str = "f4") -> list[Any]:
        """Append an array; return [kind, offset in bytes, number of values]."""
        with np.errstate(over="ignore"):  # beyond single precision: inf, drawn blank
            data = np.ascontiguousarray(values).astype("<" + kind)
        raw = data.tobytes()
        raw += bytes(-len(raw) % 8)
        place = [kind, self._size, int(data.size)]
        self._parts.append(raw)
        self._size += len(raw)
        return place

    def text(self) -> str:
        """Return all arrays, compressed (zlib), as base64."""
        return base64.b64encode(zlib.compress(b"".join(self._parts), 6)).decode("ascii")


def build_payload(found: RunData, buckets: int = BUCKETS) -> tuple[dict[str, Any], str]:
    """Build the header and the packed data of a page; reads the states twice.

    ``buckets``: their number for a run of more than WHOLE samples. Adds a note about fields with
    values that are not finite.
    """
    packer = Packer()
    count = len(found.time)
    whole = count <= WHOLE
    first = decimate.bucket_starts(count, count if whole else buckets)
    last = np.append(first[1:], count) - 1
    reduced = _Reduction(first, count)
    for states in found.read_states(None):
        reduced.add(states)
    if reduced.not_finite:
        fields = len(reduced.not_finite)
        found.notes.append(f"Fields with values that are not finite (drawn blank): {fields}.")
    panels, empty = visible_panels(
        found.radius, reduced.has_data, reduced.is_zero, reduced.constant, reduced.greatest
    )
    head = {
        "samples": count,
        "whole": whole,
        "bucket": -(-count // len(first)),
        "time": packer.pack(found.time[first], "f8"),
        "until": packer.pack(found.time[last], "f8"),
        "gap": packer.pack(decimate.bitwise_or(found.gaps.astype(np.uint8), first), "u1"),
        "panels": [_panel(packer, panel, reduced, whole) for panel in panels],
        "empty": empty,
        "events": {
            name: {"bits": packer.pack(reduced.events[name].bits, "u4"), "names": names}
            for name, names in EVENTS.items()
        },
    }
    rows = first
    if not whole:
        path = decimate.bucket_starts(count, PATH_BUCKETS)
        rows = decimate.extreme_rows(reduced.plane, path, count)
    geometry = found.geometry_at(rows)
    head["path"] = _path(packer, found, rows, geometry)
    head["geometry"] = _geometry(geometry)
    head["radius"] = found.radius if found.radius > 0.0 else None
    return head, packer.text()


class _Reduction:
    """Reduction of the states, which are added block by block.

    Attributes
    ----------
        curves: extremes per bucket, of the drawn values (False) and the readings (True).
        events: bits per bucket: regimes, stops, locks, refusals and flags.
        plane: (4, n) force, moment, slide and spin in the plane of the friction disc.
        not_finite: fields with values that are not finite.
    """

    def __init__(self, first: Array, count: int) -> None:
        self.curves: dict[tuple[Curve, bool], decimate.RunningExtremes] = {}
        for panel in PANELS:
            for curve in panel.curves:
                self.curves[curve, False] = decimate.RunningExtremes(first)
                if curve.reading:
                    self.curves[curve, True] = decimate.RunningExtremes(first)
        self.events = {name: decimate.RunningBitwiseOr(first) for name in EVENTS}
        self.plane = np.empty((4, count))
        self.not_finite: set[str] = set()
        self._at = 0
        self._range = {
            name: (math.inf, -math.inf) for names in _CONSTANTS.values() for name in names
        }

    def add(self, states: States) -> None:
        """Add the next states."""
        count = len(states("regime"))
        for (curve, is_reading), extremes in self.curves.items():
            extremes.add((curve.reading if is_reading and curve.reading else curve.values)(states))
        for name, bits in _bits(states).items():
            self.events[name].add(bits)
        self.plane[:, self._at : self._at + count] = plane(states)
        self.not_finite |= {n for n, v in states.fields.items() if not np.isfinite(v).all()}
        solved = states("status") == 0.0
        for name, (low, high) in self._range.items():
            values = states(name)[solved]
            values = values[np.isfinite(values)]
            if len(values):
                self._range[name] = min(low, float(values.min())), max(high, float(values.max()))
        self._at += count

    @property
    def greatest(self) -> dict[str, float]:
        """Greatest finite magnitude of forces and moments, by the unit of their panels."""
        found = {"N": 0.0, "N m": 0.0}
        for panel in PANELS:
            if panel.unit in found:
                for curve in panel.curves:
                    extremes = self.curves[curve, False]
                    for values in (extremes.low, extremes.high):
                        finite = np.abs(values[np.isfinite(values)])
                        found[panel.unit] = max(found[panel.unit], float(finite.max(initial=0.0)))
        return found

    @property
    def constant(self) -> set[str]:
        """Panels whose values are constant, except in refused samples."""
        return {
            key
            for key, names in _CONSTANTS.items()
            if all(_is_constant(*self._range[name]) for name in names)
        }

    def has_data(self, curve: Curve) -> bool:
        """Return whether a curve has finite values and is to be drawn."""
        found = self.curves[curve, curve.reading is not None]
        return bool(np.isfinite(found.low).any()) and (curve.always or not self.is_zero(curve))

    def is_zero(self, curve: Curve, least: float = 0.0) -> bool:
        """Return whether a curve is within ``least`` throughout, except where it is not finite."""
        found = self.curves[curve, curve.reading is not None]
        finite = np.isfinite(found.low)
        return bool(((found.low[finite] >= -least) & (found.high[finite] <= least)).all())


def _is_constant(low: float, high: float) -> bool:
    return low > high or high - low <= 1e-9 * max(abs(low), abs(high))


def _panel(packer: Packer, panel: Panel, reduced: _Reduction, whole: bool) -> dict[str, Any]:
    def pack(found: decimate.RunningExtremes) -> list[Any]:
        return [packer.pack(found.low)] + ([] if whole else [packer.pack(found.high)])

    def curve(one: Curve) -> dict[str, Any]:
        return {
            "label": one.label,
            "colour": one.colour,
            "style": one.style,
            "drawn": pack(reduced.curves[one, False]),
            "reading": pack(reduced.curves[one, True]) if one.reading else None,
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
    """Return the bits of each sample for the groups of EVENTS."""
    count = len(states("regime"))

    def field(name: str) -> Array:
        return np.asarray(states.fields.get(name, np.zeros(count))).astype(np.int64)

    status = field("status")
    return {
        "regime": np.where(status > 0, 0, 1 << np.clip(field("regime"), 0, 30)),
        "stop": field("stop"),
        "lock": field("lock"),
        "status": np.where(status > 0, 1 << np.clip(status - 1, 0, 30), 0),
        "flags": field("flags"),
    }


def plane(states: States) -> list[Array]:
    """Return force, moment over R, slide, spin times R: friction disc and slip trajectory."""
    radius = states.radius if states.radius > 0.0 else 1.0
    return [
        states("force_friction"),
        states("moment_friction") / radius,
        states("displacement"),
        states("rotation") * radius,
    ]


_PATH = (
    "force_friction", "moment_friction", "displacement", "rotation", "friction_limit", "length",
    "offset", "angle", "regime", "force", "overlap", "contact_centre",
)  # fmt: skip


def _path(packer: Packer, found: RunData, rows: Array, geometry: Geometry) -> dict[str, Any]:
    """Pack the samples ``rows`` for the friction disc, the slip trajectory and the 3-D view."""
    taken: list[dict[str, Array]] = []
    at = 0
    for states in found.read_states(_PATH):
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
            "turned": states("rotation") - states("angle"),
            "regime": np.asarray(states.fields["regime"]),
            "force": np.asarray(states.fields["force"], float),
            "overlap": np.where(states("overlap") > 0.0, states("overlap"), geometry.overlap),
            "middle": states("contact_centre"),
        }
        taken.append({name: values[which] for name, values in columns.items()})
    joined = {name: np.concatenate([part[name] for part in taken]) for name in taken[0]}
    kinds = {"regime": "u1"}
    head = {name: packer.pack(values, kinds.get(name, "f4")) for name, values in joined.items()}
    head["time"] = packer.pack(found.time[rows], "f8")
    for name, values in (
        ("origin", geometry.origin),
        ("axes", geometry.axes),
        ("centre", geometry.centre),
    ):
        if values is not None:
            head[name] = packer.pack(values)
    return head


def _geometry(geometry: Geometry) -> dict[str, Any]:
    return {
        "radius": geometry.radius,
        "overlap": geometry.overlap,
        "stops": [stop if np.isfinite(stop) else None for stop in geometry.stops],
        "angle_stops": [stop if np.isfinite(stop) else None for stop in geometry.angle_stops],
        "up": list(geometry.up),
    }
