"""Recorded messages without a stamp: they act from the next processed sample on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.recording.run import Run

FLOAT64 = "std_msgs/msg/Float64"
STATE = "cylconn_ros/msg/ConnectorState"
_MOTION = ("body_b/pose", "body_b/odom")
JOINT_STATE = "sensor_msgs/msg/JointState"


def in_force(
    run: Run, log_times: Sequence[int], stamps: NDArray[np.int64]
) -> NDArray[np.intp] | None:
    """Return which of the messages is in force at each sample: its index, -1 before the first.

    Args:
        run: the recording. A message acts on the first sample whose state, or in a recording
            without states the motion of body B, was recorded after it.
        log_times: of the messages, ns, ascending.
        stamps: (n,) of the samples, ns.

    None if neither was recorded.
    """
    after = next(
        (t for t, kind in run.types.items() if kind == STATE and run.counts[t]),
        next((t for t in run.types if t.endswith(_MOTION) and run.counts[t]), None),
    )
    if after is None:
        return None
    table = run.table(after)
    at = np.searchsorted(table.log_time, log_times)
    first = np.r_[table.stamp, np.iinfo(np.int64).max][at]  # the first sample that knows of it
    return np.searchsorted(first, stamps, side="right") - 1


def preload_topic(run: Run) -> str | None:
    """The topic on which the preload was commanded; None if it was not."""
    for topic, kind in run.types.items():
        if kind == FLOAT64 and topic.rsplit("/", 1)[-1] == "preload" and run.counts[topic]:
            return topic
    return None


def command_topic(run: Run) -> str | None:
    """The topic on which motion or force of slide and spin was commanded; None if none was."""
    names = {run.names.get("~/command"), f"{run.metadata.get('node', '/connector')}/command"}
    found = (t for t in run.types if t in names and run.counts[t])
    topic = next(found, None)
    return topic if topic and run.types[topic] == JOINT_STATE else None


def preloads(run: Run) -> tuple[NDArray[np.int64], NDArray[np.float64]] | None:
    """Log times (ns) and values (N) of the preloads that the connector followed; None if none."""
    topic = preload_topic(run)
    if topic is None:
        return None
    table = run.table(topic)
    values = np.asarray(table["data"], dtype=np.float64)
    followed = np.isfinite(values)
    return table.log_time[followed], values[followed]
