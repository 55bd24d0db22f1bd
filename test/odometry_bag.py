"""A bag of other software: odometry of the demo's sleeve in body axes, written by rosbags."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scenes import bundled

from cylconn_ros.core import layout
from cylconn_ros.simulation.simulate import simulate

STEPS = 200


def odometry_bag(
    path: Path, uneven: bool, steps: int = STEPS, storage: StoragePlugin = StoragePlugin.SQLITE3
) -> None:
    """Record odometry of the demo's sleeve on /robot/sleeve, and strings on another topic.

    ``uneven``: with jittered log times and without a tenth of the samples.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    run = simulate(bundled("demo"), samples=steps)
    rng = np.random.default_rng(1)
    with Writer(path, version=9, storage_plugin=storage) as writer:
        name = "nav_msgs/msg/Odometry"
        sent = writer.add_connection("/robot/sleeve", name, typestore=store)
        other = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
        for k, state in enumerate(run.states):
            if uneven and rng.random() < 0.1:
                continue
            stamp = round(run.time[k] * 1e9)
            x, v = state[layout.B_POSE : layout.B_TWIST], state[layout.B_TWIST :]
            message = _odometry(types, stamp, x, v)
            log = stamp + (int(rng.integers(0, 400_000)) if uneven else 0)
            writer.write(sent, log, store.serialize_cdr(message, name))
            text = types["std_msgs/msg/String"](data="hello")
            writer.write(other, log, store.serialize_cdr(text, "std_msgs/msg/String"))


def _odometry(types: Any, stamp: int, x: np.ndarray, v: np.ndarray) -> Any:
    def make(name: str, *values: Any) -> Any:
        return types[f"geometry_msgs/msg/{name}"](*values)

    header = types["std_msgs/msg/Header"](
        types["builtin_interfaces/msg/Time"](*divmod(stamp, 1_000_000_000)), "world"
    )
    turn = _axes(x[3:7])
    pose = make("Pose", make("Point", *x[:3]), make("Quaternion", *x[3:7]))
    linear, angular = turn.T @ v[:3], turn.T @ v[3:6]
    twist = make("Twist", make("Vector3", *linear), make("Vector3", *angular))
    none = np.zeros(36)
    return types["nav_msgs/msg/Odometry"](
        header, "sleeve", make("PoseWithCovariance", pose, none),
        make("TwistWithCovariance", twist, none),
    )  # fmt: skip


def _axes(q: np.ndarray) -> np.ndarray:
    x, y, z, w = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
