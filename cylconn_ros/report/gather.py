"""Data of a run for a report: states in order of time, poses, geometry of the 3-D view."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.run import Run
from cylconn_ros.recording.table import STAMP
from cylconn_ros.recording.unstamped import preload_topic
from cylconn_ros.report.panels import States
from cylconn_ros.report.stored import stored_energy
from cylconn_ros.scene.inputs import INPUTS

Array = npt.NDArray[Any]
_POSES = {kind.type: kind.pose_fields for kind in INPUTS if kind.pose_fields[0]}
_GAP = 5.0  # median periods without a sample, above which curves are interrupted


@dataclass(frozen=True)
class Geometry:
    """Geometry of the 3-D view (m; quaternions x y z w; world axes)."""

    origin: Array  # (n, 3) node a; (1, 3) if body A is fixed or its pose is unknown
    axes: Array  # (n, 4) or (1, 4) orientation of node a, whose x axis is the slot
    centre: Array | None  # (n, 3) mass centre of body B
    radius: float
    overlap: float
    stops: tuple[float, float]  # l_min, l_max; NaN: none
    angle_stops: tuple[float, float]  # theta_min, theta_max, rad; NaN: none
    up: tuple[float, float, float]


@dataclass(frozen=True)
class RunData:
    """Samples of a run in order of time; the states are read from the file on demand.

    Attributes
    ----------
        time: (n,) s since the first sample. start_ns: stamp of the first sample.
        gaps: (n,) bool, samples are missing before this one.
        read_states: yields the states block by block, with the given fields or (None) all.
        geometry_at: returns the geometry at the samples with the given numbers.
        radius: R of the states, m. methods: that computed them.
        undecodable: number of states that could not be decoded.
        notes: remarks for the reader of the report.
    """

    time: Array
    start_ns: int
    gaps: Array
    read_states: Callable[[Collection[str] | None], Iterator[States]]
    geometry_at: Callable[[Array], Geometry]
    radius: float = math.nan
    methods: tuple[str, ...] = ()
    undecodable: int = 0
    notes: list[str] = field(default_factory=list)


def gather(run: Run, start: float = -math.inf, end: float = math.inf) -> RunData:
    """Collect the samples of a run between ``start`` and ``end``, s since the first sample.

    Raises RecordingError if the run has no states, or none in this range.
    """
    topic = run.state_topic
    undecodable, methods = 0, dict[str, None]()
    stamps: list[npt.NDArray[np.int64]] = [np.zeros(0, np.int64)]
    for block in run.read_blocks(topic, fields=(*STAMP, "method")):
        undecodable += block.undecodable
        if len(block):
            stamps.append(block.stamp)
            methods |= dict.fromkeys(block["method"])
    stamp = np.concatenate(stamps)
    if not len(stamp):
        raise RecordingError(f"{run.path}: no state was recorded")
    notes = [f"The recording is incomplete: {run.incomplete}."] if run.incomplete else []
    if undecodable:
        notes.append(f"Skipped: {undecodable} states that cannot be decoded.")
    rows, time = _in_order(stamp, notes)
    within = (time >= start) & (time <= end)
    if not within.any():
        raise RecordingError(
            f"{run.path}: no sample between {start:g} and {end:g} s; it has 0 to {time[-1]:.6g} s"
        )
    if not within.all():
        shown = time[within]
        notes.append(f"Shown: {shown[0]:.6g} to {shown[-1]:.6g} s of {time[-1]:.6g} s.")
    rows, time = rows[within], time[within]
    step = np.diff(time, prepend=time[0])
    gaps = step > _GAP * max(float(np.median(step[1:])) if len(step) > 1 else 0.0, 1e-9)
    if gaps.any():
        notes.append(
            f"Gaps without samples: {int(gaps.sum())}, {step[gaps].sum():.6g} s in total; "
            "curves are interrupted there."
        )
    stamp = stamp[rows]
    radius = _number(run, "friction.radius")
    preload = math.nan if preload_topic(run) else _number(run, "friction.preload")
    stored = stored_energy(run.parameters)
    # of recordings from before these fields, when they could not change
    unrecorded = {"overlap": _number(run, "friction.overlap", 0.0), "contact_centre": 0.0}

    def read_states(fields: Collection[str] | None = None) -> Iterator[States]:
        at = 0
        for block in run.read_blocks(topic, fields=fields):
            begin, stop = np.searchsorted(rows, (at, at + len(block)))
            inside = rows[begin:stop] - at
            at += len(block)
            if len(inside):
                columns = {n: v[inside] for n, v in block.columns.items() if v.dtype != object}
                for name, value in unrecorded.items():
                    if fields is None or name in fields:
                        columns.setdefault(name, np.full(len(inside), value))
                yield States(columns, radius, preload, stored)

    def geometry_at(which: Array) -> Geometry:
        return _geometry(run, radius, stamp[which])

    if run.parameters.get("body_a.kind", "") != "fixed" and _pose_topic(run, "body_a") is None:
        notes.append("The pose of body A was not recorded: the 3-D view shows it at rest.")
    return RunData(
        time,
        int(stamp[0]),
        gaps,
        read_states,
        geometry_at,
        radius,
        tuple(methods),
        undecodable,
        notes,
    )


def _in_order(stamp: Array, notes: list[str]) -> tuple[Array, Array]:
    """Return the rows with ascending stamps and their times; note the number of the others."""
    latest = np.maximum.accumulate(stamp)
    rows = np.flatnonzero(np.concatenate(([True], stamp[1:] > latest[:-1])))
    skipped = len(stamp) - len(rows)
    if skipped:
        notes.append(f"Skipped: duplicate or non-monotonic stamps (samples: {skipped}).")
    return rows, (stamp[rows] - stamp[rows[0]]) * 1e-9


def _number(run: Run, name: str, default: float = math.nan) -> float:
    value = run.parameters.get(name, default)
    return float(value) if isinstance(value, int | float) else default


def _vector(run: Run, name: str, default: tuple[float, ...]) -> Array:
    value = run.parameters.get(name) or default
    return np.array(value if len(value) == len(default) else default, dtype=np.float64)


def _geometry(run: Run, radius: float, stamp: Array) -> Geometry:
    identity = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    pose_a = _pose(run, "body_a", stamp)
    if pose_a is None:
        pose_a = _vector(run, "body_a.pose", identity)[None, :]
    at = _vector(run, "node_a.position", (0.0, 0.0, 0.0))
    turned = _vector(run, "node_a.orientation", (0.0, 0.0, 0.0, 1.0))
    gravity = _vector(run, "gravity", (0.0, 0.0, -9.81))
    weight = float(np.linalg.norm(gravity))
    up = (-gravity / weight).tolist() if weight > 0.0 else [0.0, 0.0, 1.0]
    pose_b = _pose(run, "body_b", stamp)
    centre = None
    if pose_b is not None:
        com = _vector(run, "body_b.com", (0.0, 0.0, 0.0))
        centre = pose_b[:, :3] + rotate(pose_b[:, 3:], com)
    radius = radius if radius > 0.0 else 0.02
    overlap = _number(run, "friction.overlap", 0.0)
    return Geometry(
        origin=pose_a[:, :3] + rotate(pose_a[:, 3:], at),
        axes=multiply(pose_a[:, 3:], turned),
        centre=centre,
        radius=radius,
        overlap=overlap if overlap > 0.0 else 4.0 * radius,
        stops=(_number(run, "stops.l_min"), _number(run, "stops.l_max")),
        angle_stops=(_number(run, "stops.theta_min"), _number(run, "stops.theta_max")),
        up=(up[0], up[1], up[2]),
    )


def _pose_topic(run: Run, body: str) -> str | None:
    """Return the topic of a body's poses, or None.

    Known if the recording states the connector's topics, as for a body that connectors share; else
    found by its name. If no topic has such a name and only one body moves, it is the only topic
    with poses.
    """
    stated = [run.names.get(f"{body}/{kind}") for kind in ("pose", "odom")]
    known = [t for t in stated if t and run.types.get(t) in _POSES and run.counts[t]]
    if known:
        return known[0]
    moving = [b for b in ("body_a", "body_b") if run.parameters.get(f"{b}.kind") != "fixed"]
    topics = [t for t, kind in run.types.items() if kind in _POSES and run.counts[t]]
    named = [t for t in topics if f"/{body}/" in f"/{t}"]
    found = named if named else (topics if moving == [body] else [])
    return found[0] if len(found) == 1 else None


def _pose(run: Run, body: str, stamp: Array) -> Array | None:
    """Return the pose of a body at each stamp (n, 7), from the nearest message; None if unknown."""
    topic = _pose_topic(run, body)
    if topic is None:
        return None
    position, orientation = _POSES[run.types[topic]]
    names = [f"{position}.{c}" for c in "xyz"] + [f"{orientation}.{c}" for c in "xyzw"]
    stamps = [block.stamp for block in run.read_blocks(topic, fields=STAMP) if len(block)]
    if not stamps:
        return None
    known = np.concatenate(stamps)
    order = np.argsort(known, kind="stable")
    known = known[order]
    after = np.clip(np.searchsorted(known, stamp), 1, max(len(known) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(known) - 1)
    nearer = np.where(stamp - known[before] <= known[after] - stamp, before, after)
    wanted, where = np.unique(order[nearer], return_inverse=True)
    poses, at = np.empty((len(wanted), 7)), 0
    for block in run.read_blocks(topic, fields=names):
        begin, stop = np.searchsorted(wanted, (at, at + len(block)))
        inside = wanted[begin:stop] - at
        at += len(block)
        for k, name in enumerate(names if len(inside) else ()):
            poses[begin:stop, k] = block[name][inside]
    return poses[where]


def rotate(q: Array, vector: Array) -> Array:
    """Rotate ``vector`` (3,) by each quaternion of q (n, 4), x y z w; return (n, 3)."""
    u, w = q[:, :3], q[:, 3:]
    twice = 2.0 * np.cross(u, vector)
    return np.asarray(vector + w * twice + np.cross(u, twice))


def multiply(q: Array, p: Array) -> Array:
    """Return the quaternion products q p (n, 4): rotation ``p`` (4,), then each of q (n, 4)."""
    u, w = q[:, :3], q[:, 3:]
    vector = w * p[:3] + p[3] * u + np.cross(u, p[:3])
    return np.concatenate([vector, w * p[3] - (u @ p[:3])[:, None]], axis=1)
