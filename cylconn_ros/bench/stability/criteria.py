"""Survival criteria, evaluated from the bodies' poses and twists and the wrenches that acted.

A solver's own constraint error and energy are not used. Rotations are SciPy's; the kinematics and
the energy are implemented here, independently of the connector.

A run has survived if

- every state and wrench is finite;
- constraint and stops are kept to 1 mm and 10 mrad after the first 0.2 s, and after the time in
  which an initial violation may be pulled in;
- kinetic energy never exceeds its initial value plus the work of gravity by more than 1 % of the
  largest value of either so far;
- the bodies are at rest relative to each other at the end, or not, as the scene requires;
- no law of the method is violated (:mod:`cylconn_ros.laws`), if its outputs are known.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from cylconn_ros.bench.common.frames import inertia_tensor
from cylconn_ros.bench.common.timing import Array
from cylconn_ros.bench.stability.loop import Trace
from cylconn_ros.scene.scene import Body, Scene

Bools = NDArray[np.bool_]

OFFSET, ANGLE, ENERGY = 1e-3, 1e-2, 0.01  # m, rad, 1
TRANSIENT = 0.2  # s
PULL_IN_MARGIN = 1.5  # a pull-in may take longer than at its full speed
AT_REST = 1e-4  # m/s
MIN_RADIUS = 0.01  # m
SCALE_SPEED = 1e-3  # m/s: its kinetic energy is the smallest scale of energy
END = 0.2  # s in which the final slip rate is taken; at least twenty samples

Laws = Callable[[Scene, Array, Array], str]
"""First law of the scene's method that outputs (N, NOUT) to states (N, 26) violate; empty: none."""

RESTS, SLIDES, ANY = "rests", "slides", ""


@dataclass(frozen=True)
class Verdict:
    """Result of a run.

    Attributes
    ----------
        failure: the first criterion that is not met, in the order above; empty: survived.
        offset (m), angle (rad): worst constraint violation in the evaluation windows.
        energy: greatest excess of kinetic energy, relative (:func:`energy_gain`).
        slip: mean slip rate at the end, m/s.
    """

    failure: str
    offset: float = math.nan
    angle: float = math.nan
    energy: float = math.nan
    slip: float = math.nan

    @property
    def survived(self) -> bool:
        """Whether all criteria are met."""
        return not self.failure


@dataclass(frozen=True)
class JointMotion:
    """Motion of the joint: (N,) each, of node b in the axes of node a.

    Attributes
    ----------
        length: m. offset: (N, 2) m. direction: (N, 3) of e1b. spin: of B on A, rad, unwrapped.
    """

    length: Array
    offset: Array
    direction: Array
    spin: Array


def evaluate(scene: Scene, trace: Trace, end: str = ANY, laws: Laws | None = None) -> Verdict:
    """Evaluate the criteria for a run.

    ``end``: RESTS, SLIDES or ANY. ``laws``: checks the outputs of a Connector, if given.
    """
    if trace.diverged or len(trace.time) < 20:
        return Verdict(f"not finite after {trace.time[-1]:.3g} s")
    if not np.isfinite(trace.states).all():
        return Verdict(f"not finite from {_first_not_finite(trace.states, trace.time):.3g} s on")
    if trace.wrenches is not None and not np.isfinite(trace.wrenches).all():
        return Verdict(
            f"wrench not finite at {_first_not_finite(trace.wrenches, trace.time):.3g} s"
        )
    motion = joint_motion(scene, trace.states)
    offset, angle = errors(scene, motion)
    counts, windows = evaluation_windows(scene, trace, offset, angle)
    worst = float(offset[counts].max(initial=0.0)), float(angle[counts].max(initial=0.0))
    gained = energy_gain(scene, trace, windows)
    slip = final_slip_rate(scene, trace.time, motion)
    failure = _first_failure(*worst, gained, slip, end)
    if laws is not None and not failure and trace.outs is not None:
        assert trace.solver_scene is not None
        failure = laws(trace.solver_scene, trace.states, trace.outs)
    return Verdict(failure, *worst, gained, slip)


def _first_failure(offset: float, angle: float, gained: float, slip: float, end: str) -> str:
    if offset > OFFSET:
        return f"offset {1e3 * offset:.3g} mm"
    if angle > ANGLE:
        return f"angle {1e3 * angle:.3g} mrad"
    if gained > ENERGY:
        return f"energy +{100 * gained:.3g} %"
    if end == RESTS and slip > AT_REST:
        return f"does not rest: {1e3 * slip:.2g} mm/s"
    if end == SLIDES and slip <= AT_REST:
        return "rests and should slide"
    return ""


def _first_not_finite(values: Array, time: Array) -> float:
    return float(time[int(np.argmin(np.isfinite(values).all(axis=1)))])


def joint_motion(scene: Scene, states: Array) -> JointMotion:
    """Motion of the joint for (N, 26) states."""
    turn_a, turn_b = (Rotation.from_quat(states[:, at + 3 : at + 7]) for at in (0, 13))
    axes = turn_a * Rotation.from_quat(scene.node_a.orientation)
    xa = states[:, 0:3] + turn_a.apply(scene.node_a.position)
    xb = states[:, 13:16] + turn_b.apply(scene.node_b.position)
    d = axes.apply(xb - xa, inverse=True)
    if scene.node_b.orientation:
        in_b = Rotation.from_quat(scene.node_b.orientation)
    else:
        in_b = turn_b[0].inv() * axes[0]
    relative = axes.inv() * turn_b * in_b
    q = relative.as_quat()
    spin = np.unwrap(2.0 * np.arctan2(q[:, 0], q[:, 3]))
    return JointMotion(d[:, 0], d[:, 1:], relative.apply([1.0, 0.0, 0.0]), spin)


def errors(scene: Scene, motion: JointMotion) -> tuple[Array, Array]:
    """(N,) violation of the constraint and the stops, m and rad."""
    held = scene.reference.offsets == "hold"
    offset = np.linalg.norm(motion.offset - (motion.offset[0] if held else 0.0), axis=1)
    held = scene.reference.misalignment == "hold"
    target = motion.direction[0] if held else np.array([1.0, 0.0, 0.0])
    across = np.linalg.norm(np.cross(motion.direction, target), axis=1)
    angle = np.arctan2(across, motion.direction @ target)
    low, high = scene.stops.l_min, scene.stops.l_max
    if not math.isnan(low + high):
        beyond = np.maximum(low - motion.length, motion.length - high)
        offset = np.maximum(offset, beyond)
    return offset, angle


def evaluation_windows(
    scene: Scene, trace: Trace, offset: Array, angle: Array
) -> tuple[Bools, list[tuple[int, int]]]:
    """(N,) whether violations count, and the intervals of samples in which energy is compared.

    After a start, an initial violation may first be pulled in at the speed that the scene allows.
    """
    counts = np.zeros(len(trace.time), dtype=bool)
    windows = []
    for first, last in zip(trace.starts, [*trace.starts[1:], len(trace.time)], strict=True):
        pulling = 0.0
        for error, speed, most in (
            (offset, scene.reference.pull_in_speed, OFFSET),
            (angle, scene.reference.pull_in_rate, ANGLE),
        ):
            if error[first] > most:
                pulling = max(pulling, PULL_IN_MARGIN * float(error[first]) / speed)
        since = trace.time[first:last] - trace.time[first]
        counts[first:last] = since > TRANSIENT + pulling
        begin = first + int(np.searchsorted(since, TRANSIENT + pulling)) if pulling else first
        windows.append((min(begin, last - 1), last))
    return counts, windows


def energy_gain(scene: Scene, trace: Trace, windows: list[tuple[int, int]]) -> float:
    """Greatest excess of kinetic energy over its initial value plus the work of gravity.

    Relative to the largest value of either so far.
    """
    kinetic, work = energies(scene, trace.states)
    moving = [body.mass for body in scene.bodies if body.kind in ("free", "unknown")]
    least, worst = 0.5 * min(moving) * SCALE_SPEED**2, -math.inf
    most = np.maximum(np.maximum.accumulate(kinetic), least)
    for first, last in windows:
        allowed = kinetic[first] + work[first:last] - work[first]
        scale = np.maximum(np.maximum.accumulate(allowed), most[first:last])
        worst = max(worst, float(((kinetic[first:last] - allowed) / scale).max()))
    return worst


def energies(scene: Scene, states: Array) -> tuple[Array, Array]:
    """(N,) kinetic energy of both bodies, and work of gravity up to a constant, J."""
    kinetic: Array = np.zeros(len(states))
    work: Array = np.zeros(len(states))
    for body, at in ((scene.body_a, 0), (scene.body_b, 13)):
        if body.kind in ("free", "unknown"):
            t, g = _body(body, np.array(scene.gravity), states[:, at : at + 13])
            kinetic, work = kinetic + t, work + g
    return kinetic, work


def _body(body: Body, gravity: Array, own: Array) -> tuple[Array, Array]:
    turn = Rotation.from_quat(own[:, 3:7])
    arm = turn.apply(body.com)
    velocity = own[:, 7:10] + np.cross(own[:, 10:13], arm)
    spin = turn.apply(own[:, 10:13], inverse=True)
    kinetic = 0.5 * body.mass * np.sum(velocity**2, axis=1)
    kinetic = kinetic + 0.5 * np.einsum("ni,ij,nj->n", spin, inertia_tensor(body), spin)
    return kinetic, body.mass * (own[:, :3] + arm) @ gravity


def final_slip_rate(scene: Scene, time: Array, motion: JointMotion) -> float:
    """Slip rate at the end, m/s, from the mean positions of two halves: vibration does not count.

    The effective radius, but at least 1 cm, converts spin to a velocity.
    """
    radius = max(scene.friction.radius, MIN_RADIUS)
    first = max(min(int(np.searchsorted(time, time[-1] - END)), len(time) - 20), 0)
    middle = (first + len(time)) // 2
    distances = []
    for position in (motion.length, radius * motion.spin):
        distances.append(float(position[middle:].mean() - position[first:middle].mean()))
    return math.hypot(*distances) / float(time[middle:].mean() - time[first:middle].mean())
