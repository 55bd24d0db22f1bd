"""Identification of recordings: from paths and a scene to estimates with intervals."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import IdentifyError
from cylconn_ros.identification.effort import AxisEstimate, AxisRecording, estimate_axis
from cylconn_ros.identification.forces.drives import (
    JOINT_STATE,
    PRESSED,
    commanded_preload,
    known_drive,
)
from cylconn_ros.identification.forces.long_recordings import (
    MOST_SAMPLES,
    collect_bounded,
    joined,
)
from cylconn_ros.identification.forces.pose_twists import (
    BANDWIDTH,
    has_no_twists,
    twists_from_poses,
)
from cylconn_ros.identification.friction import PARAMETERS, Identification, estimate_friction
from cylconn_ros.identification.inertia import UNKNOWN
from cylconn_ros.identification.load_lag import Part
from cylconn_ros.recording.run import Run, read_run
from cylconn_ros.recording.samples import lacks_twists, synchronized_samples
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]


def identify(
    recording: Path | str | Run,
    scene: Scene | None = None,
    *,
    known: Mapping[str, float | None] | None = None,
    remap: Mapping[str, str] | None = None,
    connector: str = "",
    drive: str = "",
    others: Sequence[Path | str | Run] = (),
    unknown: Sequence[str] = (),
    bandwidth: float | None = None,
) -> Identification:
    """Estimate the friction of a joint from a recorded motion.

    Args:
        recording: a rosbag2 directory or file, or a run from ``read_run``, with pose and twist of
            every moving body, and their loads if there are any.
        scene: inertias and nodes of the bodies; its friction parameters are the start of the
            search. Default: the parameters stored in the recording.
        known: parameters not to be estimated: ``preload`` (N), ``overlap`` (m) or ``radius`` (m)
            with its value, or None for that of the scene.
        remap: topics of the recording by input name, e.g. ``{"body_b/odom": "/drawer/odom"}``.
        connector: the one to select of a recording of several connectors.
        drive: topic of the effort of a motor (JointState or WrenchStamped), which is subtracted.
            Efforts commanded on ``~/command`` are subtracted in any case.
        others: further recordings of the same joint, with the same parameters and topics; all are
            fitted together.
        unknown: ``mass`` and ``inertia`` (about the slot) of the free body if they are estimated
            too, from recorded loads or efforts along the slot; those of the scene are the start.
        bandwidth: take the twists from the poses, by a smoother of this bandwidth, Hz. Default: the
            recorded twists; if there are none, or all are zero, those of the poses at 50 Hz.

    Returns
    -------
        Estimates of ``coefficient``, ``preload``, ``overlap``, ``radius`` and
        ``static_coefficient`` with 95 % intervals. A parameter that the motion does not excite is
        held at its value in the scene; its ``note`` states the reason. The method is described in
        docs/how_to/identify.md. Of a recording of more than 262144 samples, stretches are used that
        are spread over all of it, so that memory is bounded.

    Raises
    ------
        IdentifyError: the motion does not determine the coefficient
            (IndeterminateError), a command imposed a motion, no
            scene is known, or ``known`` has an invalid name or no value.
        RecordingError: the recording cannot be read.
        SceneError: an inertia is unknown.
        ImportError: scipy is not installed.

    Example::

        run = cr.read_run("bag")
        scene = cr.Scene.from_parameters(run.parameters)
        estimate = cr.identify(run, scene, known={"overlap": None})
        estimate["coefficient"].value, estimate["coefficient"].low, estimate["coefficient"].high
    """
    runs = [_opened(one, connector) for one in (recording, *others)]
    if scene is None:
        scene = _stored_scene(runs[0])
    values = {name: _value(scene, name, value) for name, value in (known or {}).items()}
    for name in unknown:
        if name not in UNKNOWN:
            raise IdentifyError(f"unknown: {name!r} is not one of {', '.join(UNKNOWN)}")
    read = _read(runs, scene, remap, drive, bandwidth)
    if read.remarks:
        scene = dataclasses.replace(scene, period=0.0)  # that of the smoother's groups
    samples, acting = _together(read.parts, scene)
    coarse = _together(read.coarse, scene) if len(read.coarse) == len(runs) else None
    result = estimate_friction(scene, samples, values, acting, unknown, coarse)
    if read.left_out:
        result.skipped["in stretches of a long recording that were left out"] = read.left_out
    return dataclasses.replace(result, remarks=(*dict.fromkeys(read.remarks), *result.remarks))


class Read(NamedTuple):
    """Samples of several recordings.

    Attributes
    ----------
        parts: of each recording. coarse: at half of the bandwidth, if twists are those of poses.
        left_out: number of samples. remarks: on the twists.
    """

    parts: list[Part]
    coarse: list[Part]
    left_out: int
    remarks: list[str]


def _read(
    runs: Sequence[Run],
    scene: Scene,
    remap: Mapping[str, str] | None,
    drive: str,
    bandwidth: float | None,
) -> Read:
    """Read the samples and drives; see ``identify`` for the arguments."""
    from_poses = bandwidth is not None or any(lacks_twists(run, remap) for run in runs)
    parts, coarse, left_out, remarks = [], [], 0, []
    for run in runs:
        samples, left = collect_bounded(
            synchronized_samples(run, scene, remap, twists=not from_poses),
            MOST_SAMPLES // len(runs),
        )
        acting = known_drive(run, samples, drive)
        pressed = commanded_preload(run, samples, scene.friction.preload)
        if pressed is not None:
            acting = np.column_stack([_or_constant(acting, len(samples), scene), pressed])
        left_out += left
        if from_poses or has_no_twists(samples):
            wanted = bandwidth or BANDWIDTH
            smoothed = twists_from_poses(samples, wanted, acting)
            less = twists_from_poses(samples, 0.5 * wanted, acting)
            coarse.append((less.samples, less.drive))
            samples, acting = smoothed.samples, smoothed.drive
            remarks.append(smoothed.describe())
        parts.append((samples, acting))
    return Read(parts, coarse, left_out, remarks)


def _opened(recording: Path | str | Run, connector: str) -> Run:
    if isinstance(recording, Run):
        return recording.select(connector) if connector else recording
    return read_run(recording, connector)


def _together(parts: Sequence[Part], scene: Scene) -> Part:
    """Join recordings; the drive is that of the scene where none was recorded."""
    samples = joined([part for part, _ in parts])
    if all(drive is None for _, drive in parts):
        return samples, None
    drives = [_or_constant(one, len(part), scene) for part, one in parts]
    width = max(one.shape[1] for one in drives)
    if width > PRESSED:  # a preload was commanded in one of them
        constant = scene.friction.preload
        drives = [
            one if one.shape[1] == width else np.column_stack([one, np.full(len(one), constant)])
            for one in drives
        ]
    return samples, np.concatenate(drives)


def _or_constant(drive: Array | None, samples: int, scene: Scene) -> Array:
    """Return the drive (n, 2), or the constant imposed forces of the scene if it is None."""
    if drive is not None:
        return drive
    command = scene.command
    return np.tile(np.nan_to_num([command.slide.force, command.spin.force]), (samples, 1))


def identify_axis(
    recordings: Sequence[Path | str | Run], topic: str, joint: str = ""
) -> AxisEstimate:
    """Estimate inertia and friction of one axis from recorded positions and drive efforts.

    Args:
        recordings: of the same axis, fitted together.
        topic: sensor_msgs/JointState with position and effort.
        joint: name in the messages; default: the only one.

    Raises IdentifyError if the topic has no such joint, no efforts, or its motion does not separate
    the parameters; RecordingError if a recording cannot be read.
    """
    return estimate_axis([_axis(_opened(one, ""), topic, joint) for one in recordings])


def _axis(run: Run, topic: str, joint: str) -> AxisRecording:
    kind = run.types.get(topic)
    if kind != JOINT_STATE:
        raise IdentifyError(f"axis = {topic}: must be a topic of type {JOINT_STATE}, is {kind}")
    table = run.table(topic)
    names = [str(name) for name in table["name"][0]] if len(table) else []
    if not joint and len(names) == 1:
        joint = names[0]
    if joint not in names:
        raise IdentifyError(
            f"{topic}: joint {joint!r} is not one of {', '.join(names) or 'none'}; give TOPIC:JOINT"
        )
    at = names.index(joint)
    position, effort = table["position"], table["effort"]
    if position.shape[1:] != (len(names),) or effort.shape[1:] != (len(names),):
        raise IdentifyError(
            f"{topic}: an axis needs position and effort of every joint in every message; "
            f"there are {position.shape[1:]} positions and {effort.shape[1:]} efforts, "
            f"{len(names)} joints"
        )
    stamps, first = np.unique(table.stamp, return_index=True)
    time = np.asarray((stamps - stamps[:1]) * 1e-9, dtype=np.float64)
    return AxisRecording(time, position[first, at], effort[first, at])


def _stored_scene(run: Run) -> Scene:
    if not run.parameters:
        raise IdentifyError(
            "no parameters were stored with the recording; give inertia, nodes and friction as a "
            "scene (with --params FILE)"
        )
    return Scene.from_parameters(run.parameters)


def _value(scene: Scene, name: str, value: float | None) -> float:
    """Return the value of a known parameter, by default that of the scene."""
    if name not in PARAMETERS:
        raise IdentifyError(f"known: {name!r} is not one of {', '.join(PARAMETERS)}")
    if value is not None:
        return value
    found = float(getattr(scene.friction, name))
    if math.isnan(found):
        raise IdentifyError(f"known {name}: the parameters have no value; give {name}=VALUE")
    return found
