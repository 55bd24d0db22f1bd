"""The samples in a recorded run: its inputs, put together by the node's own matching.

Messages go in as they were recorded, loads before poses before twists of the same moment.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.matching import SampleMatcher
from cylconn_ros.connector.scene import Scene
from cylconn_ros.core import layout
from cylconn_ros.recording.reader import Run, Table

Array = NDArray[np.float64]

_BODIES = ("body_a", "body_b")


class Sampled(NamedTuple):
    """A complete sample of a run."""

    stamp: int  # ns
    h: float  # s since the sample before; 0 for the first of a history
    restarted: bool  # a new history begins
    sample: Array  # (NSAMPLE,)


def vectors(table: Table, names: tuple[str, ...], axes: str = "xyz") -> Array:
    """Stack the columns of vectors: (n, 3) for each of ``names``."""
    return np.column_stack([table[f"{name}.{axis}"] for name in names for axis in axes])


def _pose(table: Table, prefix: str) -> Array:
    position = vectors(table, (f"{prefix}position",))
    return np.hstack([position, vectors(table, (f"{prefix}orientation",), "xyzw")])


def matched(run: Run, scene: Scene, names: Mapping[str, str] | None = None) -> Iterator[Sampled]:
    """The samples of a run as the node's own matching makes them, in the order of the recording.

    ``names`` says where a run has another topic for one of ours: ``{"body_b/pose": "/arm/pose"}``.
    Raises RecordingError for a topic named that is not there, or one of inputs without columns.
    """
    matcher = SampleMatcher(scene)
    messages: list[tuple[int, int, int, Any]] = []  # log time, rank, number, call
    loads = 0
    for body, name in enumerate(_BODIES):
        for rank, kind in enumerate(("load", "pose", "twist", "odom")):
            ours = f"{name}/{kind}"
            topic = (names or {}).get(ours)
            if topic is None:
                topic = next((t for t in run.types if t.endswith(ours)), None)
            if topic is None:
                continue
            loads += kind == "load"  # also where none came: then there was none
            if topic in run.counts and not run.counts[topic]:
                continue
            table = run.table(topic)
            messages += _calls(matcher, body, kind, rank, table)
    if not loads:  # simulate knows its loads from the scene
        matcher.sample[layout.LOADS] = (*scene.plant.body_a.load, *scene.plant.body_b.load)
    messages.sort(key=lambda message: message[:3])
    for *_, call in messages:
        found = call()
        if found is not None and not found.repeated:
            yield Sampled(found.stamp, found.h, found.restarted, matcher.sample.copy())


def _calls(
    matcher: SampleMatcher, body: int, kind: str, rank: int, table: Table
) -> list[tuple[int, int, int, Any]]:
    """The messages of one topic as calls of the matcher."""
    frames, stamps = table["header.frame_id"], table.stamp
    calls: list[Any] = []
    if kind == "odom":
        poses = _pose(table, "pose.pose.")
        twists = vectors(table, ("twist.twist.linear", "twist.twist.angular"))
        children = table["child_frame_id"]
        calls = [
            lambda k=k: matcher.odometry(
                body,
                int(stamps[k]),
                (str(frames[k]), str(children[k])),
                poses[k].tolist(),
                twists[k].tolist(),
            )
            for k in range(len(table))
        ]
    elif kind == "load":
        wrenches = vectors(table, ("wrench.force", "wrench.torque"))
        calls = [
            lambda k=k: matcher.load(body, str(frames[k]), wrenches[k].tolist())
            for k in range(len(table))
        ]
    else:
        if kind == "pose":
            rows = _pose(table, "pose.")
        else:
            rows = vectors(table, ("twist.linear", "twist.angular"))
        take = matcher.pose if kind == "pose" else matcher.twist
        calls = [
            lambda k=k: take(body, int(stamps[k]), str(frames[k]), rows[k].tolist())
            for k in range(len(table))
        ]
    return [(int(table.log_time[k]), rank, k, call) for k, call in enumerate(calls)]
