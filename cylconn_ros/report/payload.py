"""The numbers in a page: arrays packed one behind the other, and a head that says where."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.report import decimate
from cylconn_ros.report.gather import Gathered, Geometry
from cylconn_ros.report.panels import Curve, Panel, States, chosen

Array = npt.NDArray[Any]

WHOLE = 40_000
"""Up to so many samples each one is in the page."""
BUCKETS = 8_000
"""Beyond that, so many buckets, with the smallest and the largest value of each."""
PATH_BUCKETS = 2_500
"""And so many of whole samples, up to nine of each, for the planes and the 3-D view."""

REGIMES = ("frictionless", "stick", "slip")
STOPS = ("stop l min", "stop l max", "stop angle min", "stop angle max")
LOCKS = ("slide locked", "spin locked")
STATUS = ("not finite", "bad quaternion", "no period")
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
    "integration",
)
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
    """Build the head and the packed numbers of a page.

    ``buckets`` is how many are made of a run of more than WHOLE samples.
    """
    packer = Packer()
    count = len(found.time)
    whole = count <= WHOLE
    first = decimate.starts(count, count if whole else buckets)
    last = np.append(first[1:], count) - 1
    panels, empty = chosen(found.states)
    head = {
        "samples": count,
        "whole": whole,
        "bucket": -(-count // len(first)),
        "time": packer.put(found.time[first], "f8"),
        "until": packer.put(found.time[last], "f8"),
        "gap": packer.put(decimate.union(found.gaps.astype(np.uint8), first), "u1"),
        "panels": [_panel(packer, panel, found.states, first, whole) for panel in panels],
        "empty": empty,
        "events": _events(packer, found.states, first),
        "path": _path(packer, found, whole),
        "geometry": _geometry(found.geometry),
        "radius": found.states.radius if found.states.radius > 0.0 else None,
    }
    return head, packer.text()


def _panel(
    packer: Packer, panel: Panel, states: States, first: Array, whole: bool
) -> dict[str, Any]:
    def put(values: Array) -> list[Any]:
        if whole:
            return [packer.put(np.where(np.isfinite(values), values, np.nan))]
        return [packer.put(extreme) for extreme in decimate.extremes(values, first)]

    def curve(one: Curve) -> dict[str, Any]:
        return {
            "label": one.label,
            "colour": one.colour,
            "style": one.style,
            "drawn": put(one.values(states)),
            "shown": put(one.shows(states)) if one.shows else None,
        }

    return {
        "key": panel.key,
        "title": panel.title,
        "unit": panel.unit,
        "log": panel.log,
        "zero": panel.zero,
        "curves": [curve(one) for one in panel.curves],
    }


def _events(packer: Packer, states: States, first: Array) -> dict[str, Any]:
    """Bits of what was on in each bucket: regimes, stops, locks, refusals and flags."""

    def field(name: str) -> Array:
        count = len(states("regime"))
        return np.asarray(states.fields.get(name, np.zeros(count))).astype(np.int64)

    status = field("status")
    groups = {
        "regime": (1 << np.clip(field("regime"), 0, 30), REGIMES),
        "stop": (field("stop"), STOPS),
        "lock": (field("lock"), LOCKS),
        "status": (np.where(status > 0, 1 << np.clip(status - 1, 0, 30), 0), STATUS),
        "flags": (field("flags"), FLAGS),
    }
    return {
        name: {"bits": packer.put(decimate.union(bits, first), "u4"), "names": names}
        for name, (bits, names) in groups.items()
    }


def _path(packer: Packer, found: Gathered, whole: bool) -> dict[str, Any]:
    """Whole samples for the disc, the path of the slip and the 3-D view."""
    states, geometry = found.states, found.geometry
    radius = states.radius if states.radius > 0.0 else 1.0
    plane = [
        states("force_friction"),
        states("moment_friction") / radius,
        states("displacement"),
        states("rotation") * radius,
    ]
    count = len(found.time)
    first = decimate.starts(count, count if whole else PATH_BUCKETS)
    rows = first if whole else decimate.telling_rows(plane, first, count)
    offset = np.asarray(states.fields["offset"], float)
    columns = {
        "f1": plane[0],
        "m1": plane[1],
        "u1": plane[2],
        "ur1": plane[3],
        "limit": states("friction_limit"),
        "length": states("length"),
        "y": offset[:, 0],
        "z": offset[:, 1],
        "angle": np.remainder(states("angle"), 2.0 * np.pi),
    }
    head = {name: packer.put(values[rows]) for name, values in columns.items()}
    head["time"] = packer.put(found.time[rows], "f8")
    head["regime"] = packer.put(np.asarray(states.fields["regime"])[rows], "u1")
    head["force"] = packer.put(np.asarray(states.fields["force"], float)[rows])
    for name, values in (
        ("origin", geometry.origin),
        ("axes", geometry.axes),
        ("centre", geometry.centre),
    ):
        if values is not None:
            head[name] = packer.put(values[rows] if len(values) > 1 else values)
    return head


def _geometry(geometry: Geometry) -> dict[str, Any]:
    return {
        "radius": geometry.radius,
        "overlap": geometry.overlap,
        "stops": [stop if np.isfinite(stop) else None for stop in geometry.stops],
        "up": list(geometry.up),
    }
