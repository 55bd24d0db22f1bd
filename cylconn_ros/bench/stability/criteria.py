"""Survival, measured from outside: from the bodies' poses and twists and the wrenches that acted.

Nobody's own opinion of its constraint or energy enters. Rotations are SciPy's; the kinematics and
the energy are written here.

Survived: everything finite; constraint (and stops) kept to 1 mm and 10 mrad after the first 0.2 s,
and after the time in which what was off at the beginning may be pulled in; kinetic energy never
more than its start and the work of gravity, plus 1 % of the most that they have been; at the end at
rest on each other, or not, as the scene demands; and no law of the method broken, where there is
somebody to ask (``laws``).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from cylconn_ros.bench.common.frames import tensor
from cylconn_ros.bench.common.timing import Array
from cylconn_ros.bench.stability.loop import Trace
from cylconn_ros.scene.scene import Body, Scene

Bools = NDArray[np.bool_]

OFFSET, ANGLE, ENERGY = 1e-3, 1e-2, 0.01  # m, rad, 1
SETTLING = 0.2  # s
SLACK = 1.5  # a pull-in may take longer than at its full speed
AT_REST = 1e-4  # m/s
LEAST_RADIUS = 0.01  # m
AS_NOTHING = 1e-3  # m/s: energy is never measured by less than this speed's
END = 0.2  # s, and at least twenty samples

Laws = Callable[[Scene, Array, Array], str]
"""The law that answers (N, NOUT) of the scene's method to states (N, 26) break; empty: none."""

RESTS, SLIDES, ANY = "rests", "slides", ""


@dataclass(frozen=True)
class Verdict:
    """What became of a run.

    Attributes
    ----------
        reason: what it failed at first in the order of the criteria; empty: survived.
        offset (m), angle (rad): worst of the constraint, where they count.
        energy: the most by which it exceeded what it may be without the 1 %, relative.
        slip: mean slip rate at the end, m/s.
    """

    reason: str
    offset: float = math.nan
    angle: float = math.nan
    energy: float = math.nan
    slip: float = math.nan

    @property
    def survived(self) -> bool:
        """Whether nothing is to be said."""
        return not self.reason


@dataclass(frozen=True)
class Seen:
    """The joint over a run: (N,) each, of node b in the axes of a.

    Attributes
    ----------
        length: m. offset: (N, 2) m. direction: (N, 3) of e1b. spin: of B on A, rad, unwrapped.
    """

    length: Array
    offset: Array
    direction: Array
    spin: Array


def judge(scene: Scene, trace: Trace, end: str = ANY, laws: Laws | None = None) -> Verdict:
    """Judge a run; ``end``: RESTS, SLIDES, or ANY; ``laws``: what judges answers of ours."""
    if trace.lost or len(trace.time) < 20:
        return Verdict(f"not finite after {trace.time[-1]:.3g} s")
    if not np.isfinite(trace.states).all():
        return Verdict(f"not finite from {_first_bad(trace.states, trace.time):.3g} s on")
    if trace.wrenches is not None and not np.isfinite(trace.wrenches).all():
        return Verdict(f"wrench not finite at {_first_bad(trace.wrenches, trace.time):.3g} s")
    seen = look(scene, trace.states)
    offset, angle = errors(scene, seen)
    counts, ready = settled(scene, trace, offset, angle)
    worst = float(offset[counts].max(initial=0.0)), float(angle[counts].max(initial=0.0))
    gained = gain(scene, trace, ready)
    slip = end_slip(scene, trace.time, seen)
    reason = _reason(*worst, gained, slip, end)
    if laws is not None and not reason and trace.outs is not None and trace.served is not None:
        reason = laws(trace.served, trace.states, trace.outs)
    return Verdict(reason, *worst, gained, slip)


def _reason(offset: float, angle: float, gained: float, slip: float, end: str) -> str:
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


def _first_bad(values: Array, time: Array) -> float:
    return float(time[int(np.argmin(np.isfinite(values).all(axis=1)))])


def look(scene: Scene, states: Array) -> Seen:
    """The joint's motion, of (N, 26) states."""
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
    return Seen(d[:, 0], d[:, 1:], relative.apply([1.0, 0.0, 0.0]), spin)


def errors(scene: Scene, seen: Seen) -> tuple[Array, Array]:
    """(N,) how far the constraint and the stops are violated, m and rad."""
    held = scene.reference.offsets == "hold"
    offset = np.linalg.norm(seen.offset - (seen.offset[0] if held else 0.0), axis=1)
    held = scene.reference.misalignment == "hold"
    target = seen.direction[0] if held else np.array([1.0, 0.0, 0.0])
    across = np.linalg.norm(np.cross(seen.direction, target), axis=1)
    angle = np.arctan2(across, seen.direction @ target)
    low, high = scene.stops.l_min, scene.stops.l_max
    if not math.isnan(low + high):
        beyond = np.maximum(low - seen.length, seen.length - high)
        offset = np.maximum(offset, beyond)
    return offset, angle


def settled(
    scene: Scene, trace: Trace, offset: Array, angle: Array
) -> tuple[Bools, list[tuple[int, int]]]:
    """Where violations count, and between which samples energy is compared.

    Whatever is off at a beginning may be pulled in first, at the speed that the scene allows.
    """
    counts = np.zeros(len(trace.time), dtype=bool)
    stretches = []
    for first, last in zip(trace.begins, [*trace.begins[1:], len(trace.time)], strict=True):
        pulling = 0.0
        for error, speed, most in (
            (offset, scene.reference.pull_in_speed, OFFSET),
            (angle, scene.reference.pull_in_rate, ANGLE),
        ):
            if error[first] > most:
                pulling = max(pulling, SLACK * float(error[first]) / speed)
        since = trace.time[first:last] - trace.time[first]
        counts[first:last] = since > SETTLING + pulling
        begin = first + int(np.searchsorted(since, SETTLING + pulling)) if pulling else first
        stretches.append((min(begin, last - 1), last))
    return counts, stretches


def gain(scene: Scene, trace: Trace, stretches: list[tuple[int, int]]) -> float:
    """The most by which kinetic energy exceeds its start plus gravity's work, relative."""
    kinetic, work = energies(scene, trace.states)
    moving = [body.mass for body in scene.bodies if body.kind in ("free", "unknown")]
    least, worst = 0.5 * min(moving) * AS_NOTHING**2, -math.inf
    most = np.maximum(np.maximum.accumulate(kinetic), least)
    for first, last in stretches:
        allowed = kinetic[first] + work[first:last] - work[first]
        scale = np.maximum(np.maximum.accumulate(allowed), most[first:last])
        worst = max(worst, float(((kinetic[first:last] - allowed) / scale).max()))
    return worst


def energies(scene: Scene, states: Array) -> tuple[Array, Array]:
    """(N,) kinetic energy of both bodies, and gravity's work since some zero, J."""
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
    kinetic = kinetic + 0.5 * np.einsum("ni,ij,nj->n", spin, tensor(body), spin)
    return kinetic, body.mass * (own[:, :3] + arm) @ gravity


def end_slip(scene: Scene, time: Array, seen: Seen) -> float:
    """Slip rate at the end: between the mean places of two halves, so that shaking is none.

    Spin counts at the effective radius, but at 1 cm where that is less; m/s.
    """
    radius = max(scene.friction.radius, LEAST_RADIUS)
    first = max(min(int(np.searchsorted(time, time[-1] - END)), len(time) - 20), 0)
    middle = (first + len(time)) // 2
    way = []
    for place in (seen.length, radius * seen.spin):
        way.append(float(place[middle:].mean() - place[first:middle].mean()))
    return math.hypot(*way) / float(time[middle:].mean() - time[first:middle].mean())
