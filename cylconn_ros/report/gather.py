"""From a recorded run to what a report shows of it: states in order of time, poses, geometry."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.run import STAMP, Run
from cylconn_ros.report.panels import States

Array = npt.NDArray[Any]
_POSES = {"geometry_msgs/msg/PoseStamped": "pose", "nav_msgs/msg/Odometry": "pose.pose"}
_GAP = 5.0  # median periods without a sample


@dataclass(frozen=True)
class Geometry:
    """What the 3-D view needs beside the states (m; quaternions x y z w; world axes)."""

    origin: Array  # (n, 3) node a, or (1, 3) where body A is fixed or its pose unknown
    axes: Array  # (n, 4) or (1, 4) orientation of node a, its x axis the slot
    centre: Array | None  # (n, 3) mass centre of body B
    radius: float
    overlap: float
    stops: tuple[float, float]  # l_min, l_max; NaN where there is none
    up: tuple[float, float, float]


@dataclass(frozen=True)
class Gathered:
    """Samples of a run in order of time; their states stay in the file until they are asked for.

    Attributes
    ----------
        time: (n,) s since the first sample. start_ns: its stamp.
        gaps: (n,) bool, samples are missing before this one.
        pieces: gives the states, one lot after the other; only some fields, if they are named.
        geometry_at: what the 3-D view needs at some of the samples, by their numbers.
        radius: of the states. methods: that answered. undecodable: states left out as such.
        notes: what has to be said of the run.
    """

    time: Array
    start_ns: int
    gaps: Array
    pieces: Callable[[Collection[str] | None], Iterator[States]]
    geometry_at: Callable[[Array], Geometry]
    radius: float = math.nan
    methods: tuple[str, ...] = ()
    undecodable: int = 0
    notes: list[str] = field(default_factory=list)


def gather(run: Run, start: float = -math.inf, end: float = math.inf) -> Gathered:
    """Collect the samples of a run between ``start`` and ``end``, in s since its first sample.

    Raises RecordingError where the run has no states, or none in between.
    """
    topic = run.state_topic
    undecodable, methods = 0, dict[str, None]()
    stamps: list[npt.NDArray[np.int64]] = [np.zeros(0, np.int64)]
    for piece in run.pieces(topic, only=(*STAMP, "method")):
        undecodable += piece.undecodable
        if len(piece):
            stamps.append(piece.stamp)
            methods |= dict.fromkeys(piece["method"])
    stamp = np.concatenate(stamps)
    if not len(stamp):
        raise RecordingError(f"{run.path}: no state was recorded")
    notes = [f"The recording is not whole: {run.incomplete}."] if run.incomplete else []
    if undecodable:
        notes.append(f"Left out, as they could not be decoded: states {undecodable}.")
    rows, time = _in_order(stamp, notes)
    within = (time >= start) & (time <= end)
    if not within.any():
        raise RecordingError(
            f"{run.path}: no sample between {start:g} and {end:g} s; it has 0 to {time[-1]:.6g} s"
        )
    if not within.all():
        shown = time[within]
        notes.append(f"Only {shown[0]:.6g} to {shown[-1]:.6g} s of {time[-1]:.6g} s.")
    rows, time = rows[within], time[within]
    step = np.diff(time, prepend=time[0])
    gaps = step > _GAP * max(float(np.median(step[1:])) if len(step) > 1 else 0.0, 1e-9)
    if gaps.any():
        notes.append(
            f"Gaps without samples: {int(gaps.sum())}, {step[gaps].sum():.6g} s in all; "
            "curves are interrupted there."
        )
    stamp = stamp[rows]
    radius, preload = _number(run, "friction.radius"), _number(run, "friction.preload")

    def pieces(only: Collection[str] | None = None) -> Iterator[States]:
        at = 0
        for piece in run.pieces(topic, only=only):
            begin, stop = np.searchsorted(rows, (at, at + len(piece)))
            taken = rows[begin:stop] - at
            at += len(piece)
            if len(taken):
                fields = {n: v[taken] for n, v in piece.columns.items() if v.dtype != object}
                yield States(fields, radius, preload)

    def geometry_at(which: Array) -> Geometry:
        return _geometry(run, radius, stamp[which])

    if run.parameters.get("body_a.kind", "") != "fixed" and _pose_topic(run, "body_a") is None:
        notes.append("The pose of body A was not recorded: the 3-D view shows it at rest.")
    return Gathered(
        time, int(stamp[0]), gaps, pieces, geometry_at, radius, tuple(methods), undecodable, notes
    )


def _in_order(stamp: Array, notes: list[str]) -> tuple[Array, Array]:
    """Rows whose stamps go up, and their times; the others are counted."""
    latest = np.maximum.accumulate(stamp)
    rows = np.flatnonzero(np.concatenate(([True], stamp[1:] > latest[:-1])))
    left = len(stamp) - len(rows)
    if left:
        notes.append(f"Left out, as their stamps repeat or go back: samples {left}.")
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
        up=(up[0], up[1], up[2]),
    )


def _pose_topic(run: Run, body: str) -> str | None:
    """Topic of a body's poses.

    Found by its name; where topics were renamed, the only one with poses is that of the only body
    that moves.
    """
    moving = [b for b in ("body_a", "body_b") if run.parameters.get(f"{b}.kind") != "fixed"]
    topics = [t for t, kind in run.types.items() if kind in _POSES and run.counts[t]]
    named = [t for t in topics if f"/{body}/" in f"/{t}"]
    found = named if named else (topics if moving == [body] else [])
    return found[0] if len(found) == 1 else None


def _pose(run: Run, body: str, stamp: Array) -> Array | None:
    """Pose of a body at each stamp, (n, 7), from the message nearest in time; None if unknown."""
    topic = _pose_topic(run, body)
    if topic is None:
        return None
    prefix = _POSES[run.types[topic]]
    names = [f"{prefix}.position.{c}" for c in "xyz"]
    names += [f"{prefix}.orientation.{c}" for c in "xyzw"]
    stamps = [piece.stamp for piece in run.pieces(topic, only=STAMP) if len(piece)]
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
    for piece in run.pieces(topic, only=names):
        begin, stop = np.searchsorted(wanted, (at, at + len(piece)))
        taken = wanted[begin:stop] - at
        at += len(piece)
        for k, name in enumerate(names if len(taken) else ()):
            poses[begin:stop, k] = piece[name][taken]
    return poses[where]


def rotate(q: Array, vector: Array) -> Array:
    """Turn ``vector`` (3,) by each quaternion of q (n, 4), x y z w; (n, 3)."""
    u, w = q[:, :3], q[:, 3:]
    twice = 2.0 * np.cross(u, vector)
    return np.asarray(vector + w * twice + np.cross(u, twice))


def multiply(q: Array, p: Array) -> Array:
    """The rotation ``p`` (4,) followed by each of q (n, 4); (n, 4)."""
    u, w = q[:, :3], q[:, 3:]
    vector = w * p[:3] + p[3] * u + np.cross(u, p[:3])
    return np.concatenate([vector, w * p[3] - (u @ p[:3])[:, None]], axis=1)
