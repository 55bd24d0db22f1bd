"""Friction identification of a recording: from a path and a scene to estimates with intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

from cylconn_ros.errors import IdentifyError
from cylconn_ros.identification.friction import PARAMETERS, Identification, estimate_friction
from cylconn_ros.recording.run import Run, read_run
from cylconn_ros.recording.samples import synchronized_samples
from cylconn_ros.scene.scene import Scene


def identify(
    recording: Path | str | Run,
    scene: Scene | None = None,
    *,
    known: Mapping[str, float | None] | None = None,
    remap: Mapping[str, str] | None = None,
    connector: str = "",
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

    Returns
    -------
        Estimates of ``coefficient``, ``preload``, ``overlap``, ``radius`` and
        ``static_coefficient`` with 95 % intervals. A parameter that the motion does not excite is
        held at its value in the scene; its ``note`` states the reason. The method is described in
        docs/how_to/identify.md.

    Raises
    ------
        IdentifyError: the motion does not determine the coefficient (IndeterminateError), a drive
            moved the joint, no scene is known, or ``known`` has an invalid name or no value.
        RecordingError: the recording cannot be read.
        SceneError: an inertia is unknown.
        ImportError: scipy is not installed.

    Example::

        run = cr.read_run("bag")
        scene = cr.Scene.from_parameters(run.parameters)
        estimate = cr.identify(run, scene, known={"overlap": None})
        estimate["coefficient"].value, estimate["coefficient"].low, estimate["coefficient"].high
    """
    if isinstance(recording, Run):
        run = recording.select(connector) if connector else recording
    else:
        run = read_run(recording, connector)
    if scene is None:
        scene = _stored_scene(run)
    values = {name: _value(scene, name, value) for name, value in (known or {}).items()}
    _refuse_drives(run)
    return estimate_friction(scene, synchronized_samples(run, scene, remap), values)


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


def _refuse_drives(run: Run) -> None:
    """Raise IdentifyError if a drive moved the joint: its force is not separable from friction."""
    for topic, kind in run.types.items():
        name = topic.rsplit("/", 1)[-1]
        if name == "command" and kind == "sensor_msgs/msg/JointState" and run.counts[topic]:
            raise IdentifyError(
                f"{run.counts[topic]} commands on {topic} drove slide or spin; "
                "friction cannot be separated from the force of the drive"
            )
