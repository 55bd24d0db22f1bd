"""Commands of a recorded run: preload and imposed motion or force in force at each sample."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.over_time import OverTime
from cylconn_ros.laws.parameters import Parameters
from cylconn_ros.messages.commands import joint_command
from cylconn_ros.recording.run import Run
from cylconn_ros.recording.unstamped import command_topic, in_force, preloads
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]


class Commanded(NamedTuple):
    """What a recorded run commanded: of n samples.

    preload: (n,) FCint in force, N; None: that of the scene.
    imposed: (n, 2, 3) position, velocity and force of slide and spin; None: those of the scene.
    most: (n, 2) greatest force of an imposed motion.
    begins: (n, 2) whether a motion or force begins with the sample.
    """

    preload: Array | None
    imposed: Array | None
    most: Array
    begins: NDArray[np.bool_]


def commanded(run: Run, scene: Scene, stamps: Sequence[int]) -> Commanded:
    """The commands in force at the samples with these stamps, ns."""
    at = np.array(stamps, dtype=np.int64)
    none = np.zeros((len(at), 2))
    imposed = _imposed(run, scene, at)
    if imposed is None:
        return Commanded(_preload(run, scene, at), None, none, none.astype(np.bool_))
    return Commanded(_preload(run, scene, at), *imposed)


def of_scene(scene: Scene, n: int) -> Commanded:
    """What a scene with amplitudes commands of its first n samples."""
    changing = OverTime(scene)
    present = [
        {**joint_command.in_scene(scene.command), **_impositions(changing, k)} for k in range(n)
    ]
    limits = [getattr(scene.command, name).max_force for name in joint_command.COMPONENTS]
    named = [name for name in joint_command.COMPONENTS if name in changing.commands(0)]
    rows = np.array([_row(each, limits, named) for each in present])
    preload = None
    if changing.preload(0) is not None and scene.friction.presses("preload"):
        preload = np.array([changing.preload(k) for k in range(n)])
    return Commanded(preload, rows[:, :, :3], rows[:, :, 3], rows[:, :, 4] != 0.0)


def _impositions(changing: OverTime, k: int) -> dict[str, joint_command.Imposition]:
    found = changing.commands(k)
    return {name: joint_command.Imposition(*numbers) for name, numbers in found.items()}


def with_commands(p: Parameters, given: Commanded, rows: slice) -> Parameters:
    """The parameters of some rows with their commands in place of those of the scene."""
    found = p
    if given.preload is not None:
        found = dataclasses.replace(found, preload=given.preload[rows])
    if given.imposed is not None:
        drive = np.stack([given.most[rows], p.drive[:, :, 1]], axis=2)
        found = dataclasses.replace(
            found, command=given.imposed[rows], drive=drive, begins=given.begins[rows]
        )
    return found


def _preload(run: Run, scene: Scene, stamps: NDArray[np.int64]) -> Array | None:
    found = preloads(run)
    if found is None or not scene.friction.on or not scene.friction.presses("preload"):
        return None
    times, values = found
    row = in_force(run, times.tolist(), stamps)
    return None if row is None else np.r_[values, scene.friction.preload][row]


def _imposed(
    run: Run, scene: Scene, stamps: NDArray[np.int64]
) -> tuple[Array, Array, NDArray[np.bool_]] | None:
    """Numbers of each component, row by row; a message changes the components that it names."""
    topic = command_topic(run)
    if topic is None:
        return None
    present = joint_command.in_scene(scene.command)
    limits = [getattr(scene.command, name).max_force for name in joint_command.COMPONENTS]
    times, rows = [], [_row(present, limits, ())]
    for log_time, _, data in run.raw(topic):
        try:
            new = joint_command.read_message(data, scene)
        except ValueError:
            continue
        present = {**present, **new}
        times.append(log_time)
        rows.append(_row(present, limits, tuple(new)))
    row = in_force(run, times, stamps)
    if row is None or not times:
        return None
    numbers = np.array(rows)[row + 1]  # (n, 2, 5)
    changed = np.diff(row, prepend=-1) != 0
    begins = (numbers[:, :, 4] != 0.0) & changed[:, None]
    return numbers[:, :, :3], numbers[:, :, 3], np.asarray(begins)


def _row(
    present: dict[str, joint_command.Imposition], limits: Sequence[float], named: Sequence[str]
) -> list[list[float]]:
    """Position, velocity, force, greatest force of slide and spin; whether it was ``named``."""
    return [
        [
            *present[name][:3],
            most if math.isnan(present[name].max_force) else present[name].max_force,
            float(name in named),
        ]
        for name, most in zip(joint_command.COMPONENTS, limits, strict=True)
    ]
