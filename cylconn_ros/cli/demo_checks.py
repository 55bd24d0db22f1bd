"""Checks of the recorded demo: reference solution, bounds of the laws, counts of samples."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from cylconn_ros.cli import scenes
from cylconn_ros.cli.checks import Check, against, below, equal
from cylconn_ros.connector.summary import summarise
from cylconn_ros.recording.run import Run
from cylconn_ros.reference import Reference, slide_and_spin
from cylconn_ros.scene.inputs import INPUTS
from cylconn_ros.scene.scene import Scene

# Errors allowed for a method of second order at 1 ms; they scale with the square of the period.
_ERROR_AT_1MS = {"distance": 1e-4, "turns": 1e-4, "stop_time": 1e-4}  # m, 1, s
_POSES = tuple(f"/{kind.topic}" for kind in INPUTS if kind.pose_fields[0])  # topics
_WORST_OFFSET = 1e-6  # m
_WORST_MISALIGNMENT = 1e-5  # rad
_WORST_RESIDUAL = 1e-12  # attainable in double precision


def reference(scene: Scene) -> Reference:
    """Solve the scene up to its last sample, independently of the connector's methods."""
    return slide_and_spin(scene, duration=(scenes.steps(scene) - 1) * scene.period)


def check_run(run: Run, scene: Scene, expected: Reference) -> list[Check]:
    """Compare a recorded run with its reference solution and the expected counts."""
    state = run.state
    steps = scenes.steps(scene)
    if not len(state):
        return [equal("samples processed", 0, steps)]
    found = summarise(state.time, state.columns)
    allowed = {name: size * (scene.period / 1e-3) ** 2 for name, size in _ERROR_AT_1MS.items()}
    lines = [Check("method", ", ".join(dict.fromkeys(state["method"])))]
    if math.isfinite(expected.stop_time):
        lines.append(
            against("stop time", found.stop_time, expected.stop_time, allowed["stop_time"], "s")
        )
    misalignment = found.worst_misalignment * 1e3
    lines += [
        against("distance", found.distance, expected.distance, allowed["distance"], "m"),
        against("turns", found.turns, expected.turns, allowed["turns"], ""),
        below("constraint, offset", found.worst_offset * 1e3, _WORST_OFFSET * 1e3, "mm"),
        below("constraint, angle", misalignment, _WORST_MISALIGNMENT * 1e3, "mrad"),
        below("residual of the laws", found.worst_residual, _WORST_RESIDUAL, ""),
        equal("samples processed", len(_processed(run)), steps),
        equal("samples lost", _lost(run), 0),
        equal("samples refused", found.refused, 0),
        *_recording(run),
        *_times(run),
    ]
    return lines


def _processed(run: Run) -> np.ndarray:
    """Stamps (ns) of the samples with a state and both wrenches."""
    stamps = np.unique(run.state.stamp)
    for topic in run.types:
        if topic.endswith("/wrench"):
            stamps = np.intersect1d(stamps, _stamps(run, topic))
    return stamps


def _lost(run: Run) -> int:
    """Number of samples with recorded motion and without complete outputs."""
    motion = [_stamps(run, topic) for topic in run.types if topic.endswith(_POSES)]
    return int(np.setdiff1d(np.concatenate(motion), _processed(run)).size)


def _stamps(run: Run, topic: str) -> np.ndarray:
    table = run.table(topic)
    return table.stamp if len(table) else np.empty(0, dtype=np.int64)


def _recording(run: Run) -> list[Check]:
    complete = run.incomplete is None
    messages = f"{sum(run.counts.values())} messages"
    return [Check("recording", messages if complete else str(run.incomplete), "complete", complete)]


def _times(run: Run) -> list[Check]:
    """Time per sample: computation in the connector, and between two outputs over ROS."""
    computing = run.state["computing_time"] * 1e6
    between = np.diff(run.state.log_time) * 1e-3
    lines = []
    for name, times in (("connector", computing), ("round trip", between)):
        if len(times):
            median, late = np.median(times), np.quantile(times, 0.99)
            text = f"{median:.0f} µs median, {late:.0f} µs 99 %"
            lines.append(Check(f"time per sample, {name}", text))
    return lines


def draw(run: Run, scene: Scene, expected: Reference, path: Path) -> Path:
    """Draw the run with its reference solution."""
    from cylconn_ros.report.picture import ReferenceCurves, draw_run, save_run

    state = run.state
    curves = ReferenceCurves(expected.t, expected.l, expected.alpha, expected.normal_force)
    figure = draw_run(
        state.time,
        state.columns,
        "A sleeve slides and spins down a shaft until friction stops it",
        f"method {state['method'][0]}, period {scene.period * 1e3:g} ms, "
        "plant and connector as two processes over ROS 2",
        curves,
        summarise(state.time, state.columns).stop_time,
    )
    save_run(figure, path)
    return path
