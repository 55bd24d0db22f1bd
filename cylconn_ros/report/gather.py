"""From a recorded run to what a report shows of it: states in order of time, poses, geometry."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.recording.errors import RecordingError
from cylconn_ros.recording.reader import Run, Table
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
    """Samples of a run in order of time."""

    time: Array  # (n,) s since the first sample
    start_ns: int  # stamp of the first sample
    states: States
    geometry: Geometry
    gaps: Array  # (n,) bool: samples are missing before this one
    notes: list[str] = field(default_factory=list)


def gather(run: Run, start: float = -math.inf, end: float = math.inf) -> Gathered:
    """Collect the samples of a run between ``start`` and ``end``, in s since its first sample.

    Raises RecordingError where the run has no states, or none in between.
    """
    table = run.state
    if not len(table):
        raise RecordingError(f"{run.path}: no state was recorded")
    notes = [f"The recording is not whole: {run.incomplete}."] if run.incomplete else []
    if table.undecodable:
        notes.append(f"Left out, as they could not be decoded: states {table.undecodable}.")
    rows, time = _in_order(table, notes)
    within = (time >= start) & (time <= end)
    if not within.any():
        raise RecordingError(
            f"{run.path}: no sample between {start:g} and {end:g} s; it has 0 to {time[-1]:.6g} s"
        )
    rows, time = rows[within], time[within]
    if len(time) < len(within):
        notes.append(f"Only {time[0]:.6g} to {time[-1]:.6g} s of {table.time.max():.6g} s.")
    # Of a long run without gaps in the order: views, not a second copy.
    whole = int(rows[-1] - rows[0]) + 1 == len(rows)
    taken = slice(int(rows[0]), int(rows[-1]) + 1) if whole else rows
    fields = {
        name: values[taken] for name, values in table.columns.items() if values.dtype != object
    }
    bad = sum(
        not bool(np.isfinite(v).all(axis=tuple(range(1, v.ndim))).all()) for v in fields.values()
    )
    if bad:
        notes.append(f"Fields with values that are not finite, left blank there: {bad}.")
    states = States(fields, _number(run, "friction.radius"), _number(run, "friction.preload"))
    step = np.diff(time, prepend=time[0])
    gaps = step > _GAP * max(float(np.median(step[1:])) if len(step) > 1 else 0.0, 1e-9)
    if gaps.any():
        notes.append(
            f"Gaps without samples: {int(gaps.sum())}, {step[gaps].sum():.6g} s in all; "
            "curves are interrupted there."
        )
    stamp = table.stamp[rows]
    geometry = _geometry(run, states, stamp, notes)
    return Gathered(time, int(stamp[0]), states, geometry, gaps, notes)


def _in_order(table: Table, notes: list[str]) -> tuple[Array, Array]:
    """Rows whose stamps go up, and their times; the others are counted."""
    stamp = table.stamp
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


def _geometry(run: Run, states: States, stamp: Array, notes: list[str]) -> Geometry:
    identity = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    pose_a = _pose(run, "body_a", stamp)
    if pose_a is None:
        pose_a = _vector(run, "body_a.pose", identity)[None, :]
        if run.parameters.get("body_a.kind", "") != "fixed":
            notes.append("The pose of body A was not recorded: the 3-D view shows it at rest.")
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
    radius = states.radius if states.radius > 0.0 else 0.02
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


def _pose(run: Run, body: str, stamp: Array) -> Array | None:
    """Pose of a body at each stamp, (n, 7), from the message nearest in time; None if unknown.

    Found by the topic's name; where topics were renamed, the only one with poses is that of the
    only body that moves.
    """
    moving = [b for b in ("body_a", "body_b") if run.parameters.get(f"{b}.kind") != "fixed"]
    topics = [topic for topic, kind in run.types.items() if kind in _POSES]
    named = [t for t in topics if f"/{body}/" in f"/{t}"]
    found = named if named else (topics if moving == [body] else [])
    if len(found) != 1:
        return None
    table = run.table(found[0])
    if not len(table):
        return None
    prefix = _POSES[table.type]
    names = [f"{prefix}.position.{c}" for c in "xyz"]
    names += [f"{prefix}.orientation.{c}" for c in "xyzw"]
    order = np.argsort(table.stamp, kind="stable")
    known = table.stamp[order]
    after = np.clip(np.searchsorted(known, stamp), 1, max(len(known) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(known) - 1)
    nearer = np.where(stamp - known[before] <= known[after] - stamp, before, after)
    return np.stack([np.asarray(table[name], float)[order][nearer] for name in names], axis=1)


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
