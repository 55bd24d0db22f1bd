"""Known drives of a recording: the force that a drive exerted on slide and spin, by sample.

Commands with an effort on ``~/command`` act from the next processed sample on, as in the node.
Efforts on another topic (sensor_msgs/JointState with joints slide and spin, or a WrenchStamped in
the axes of node a, whose force.x and torque.x count) are interpolated by their stamps. A preload
commanded on ``~/preload`` is known as well and acts as commands do.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import IdentifyError
from cylconn_ros.messages.cdr_decoder import read_joint_state
from cylconn_ros.messages.commands import joint_command
from cylconn_ros.recording.run import Run
from cylconn_ros.recording.samples import SampleArrays
from cylconn_ros.recording.unstamped import in_force, preloads
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

PRESSED = 2  # column of a drive: the commanded preload
JOINT_STATE, WRENCH = "sensor_msgs/msg/JointState", "geometry_msgs/msg/WrenchStamped"


def known_drive(run: Run, samples: SampleArrays, topic: str = "") -> Array | None:
    """Return the drive's force and moment (n, 2) over the interval that ends with each sample.

    None if nothing drove the joint. Raises IdentifyError if a command imposed a motion, whose force
    is not recorded, or ``topic`` has no efforts.
    """
    total: Array | None = None
    for name, kind in run.types.items():
        if name.rsplit("/", 1)[-1] == "command" and kind == JOINT_STATE and run.counts[name]:
            part = _commanded(run, samples, name)
            total = part if total is None else total + part
    if topic:
        part = _measured(run, samples, topic)
        total = part if total is None else total + part
    return total


def commanded_preload(run: Run, samples: SampleArrays, before: float) -> Array | None:
    """Return the commanded preload (n,), N, over the interval that ends with each sample.

    ``before``: that of the parameters, in force until the first command. None if none is recorded.
    """
    found = preloads(run)
    if found is None:
        return None
    times, values = found
    row = in_force(run, times.tolist(), samples.stamps)
    if row is None:
        return None
    acting = np.r_[values, before][row]  # row -1: no command yet
    return np.r_[acting[:1], acting[:-1]]


def _commanded(run: Run, samples: SampleArrays, topic: str) -> Array:
    """Return the efforts of commands."""
    force = np.zeros((len(samples), 2))
    current = dict.fromkeys(joint_command.COMPONENTS, 0.0)
    changes: list[tuple[int, list[float]]] = []
    for log_time, _, data in run.raw(topic):
        try:
            given = joint_command.read(read_joint_state(data))
        except joint_command.JointCommandError:
            continue  # no part of an invalid command took effect
        for name, imposed in given.items():
            if np.isfinite(imposed.position) or np.isfinite(imposed.velocity):
                raise IdentifyError(
                    f"a command on {topic} imposed a motion on {name} ({imposed}); the force of "
                    "that drive is not recorded, so friction cannot be separated from it; cut the "
                    "recording, or record the effort and give its topic as drive"
                )
            current[name] = imposed.force if np.isfinite(imposed.force) else 0.0
        changes.append((log_time, [current[n] for n in joint_command.COMPONENTS]))
    row = in_force(run, [time for time, _ in changes], samples.stamps)
    if row is None or not changes:
        return force
    values = np.vstack([np.array([v for _, v in changes]), np.zeros(2)])  # row -1: no command yet
    acting = values[row]
    force[1:] = acting[:-1]
    return force


def _measured(run: Run, samples: SampleArrays, topic: str) -> Array:
    """Return the efforts on a topic."""
    kind = run.types.get(topic)
    if kind not in (JOINT_STATE, WRENCH):
        raise IdentifyError(
            f"drive = {topic}: must be a recorded topic of type {JOINT_STATE} or {WRENCH}, "
            f"is {kind}"
        )
    table = run.table(topic)
    if kind == WRENCH:
        columns = [table["wrench.force.x"], table["wrench.torque.x"]]
    else:
        names = [str(name) for name in table["name"][0]]
        missing = [n for n in names if n not in joint_command.COMPONENTS]
        if missing:
            raise IdentifyError(f"{topic}: joint {missing[0]!r}: must be slide or spin")
        columns = [
            table["effort"][:, names.index(name)] if name in names else np.zeros(len(table))
            for name in joint_command.COMPONENTS
        ]
    order = np.argsort(table.stamp, kind="stable")
    middle = samples.stamps - 0.5e9 * samples.h
    return np.stack([np.interp(middle, table.stamp[order], c[order]) for c in columns], axis=1)


def without_drive(scene: Scene, wrench: Array, drive: Array | None) -> Array:
    """Subtract a known drive, or else the constant imposed forces of the scene, from f1 and m1."""
    found = wrench.copy()
    if drive is not None:
        found[:, [0, 3]] -= drive[:, :PRESSED]
        return found
    for at, imposed in ((0, scene.command.slide.force), (3, scene.command.spin.force)):
        found[:, at] -= imposed if np.isfinite(imposed) else 0.0
    return found
