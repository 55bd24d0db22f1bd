"""The whole motion of a scene in its own coordinates: the simulation without a wrench, to tolerance.

No period, no held wrench: what the equations say, with every event located. It is the reference
for runs of plant and connector, and an independent way to compute a scene.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.packing import pack
from cylconn_ros.connector.parameters import SceneError, show
from cylconn_ros.connector.scene import Scene
from cylconn_ros.core import layout, model
from cylconn_ros.core.observe import observe
from cylconn_ros.methods import minimal_place as place
from cylconn_ros.methods.minimal_forces import instant
from cylconn_ros.methods.minimal_integrate import integrate
from cylconn_ros.methods.minimal_motion import INTEGRALS, LOG
from cylconn_ros.methods.minimal_start import start

Array = NDArray[np.float64]

KINDS = ("", "rests", "reverses", "breaks away", "jams", "impact", "releases", "locks")
MOST_EVENTS = 10000


@dataclass(frozen=True)
class Event:
    """What happened: ``kind`` is one of KINDS; ``restitution`` of an impact as it acted."""

    time: float
    kind: str
    length: float
    angle: float
    restitution: float


@dataclass(frozen=True)
class Solution:
    """A motion at times ``time`` (N,), s.

    Attributes
    ----------
        states: (N, 26) poses and twists of both bodies, as in a sample (core/layout.py).
        length, angle, velocity, angular_velocity: (N,) of slide and spin; m, rad, m/s, rad/s.
        forces: (N, 6) f1 f2 f3 m1 m2 m3 on B at node b, axes of a (of e1b where misaligned).
        friction: (N, 2) f1f, m1f. reaction: (N, 2) of stops and locks in f1, m1.
        normal_force, traction, limit: (N,) FN, P and what P may be, N.
        slip: (N,) accumulated slip, m. regime: (N,) FRICTIONLESS, STICK or SLIP.
        integrals: (N, 6) of |s|, FN, f1f, m1f, f1, m1 over time, impulses of events included.
        events: what happened, in order.
        evaluations: how often the equations of motion were evaluated.
    """

    time: Array
    states: Array
    length: Array
    angle: Array
    velocity: Array
    angular_velocity: Array
    forces: Array
    friction: Array
    reaction: Array
    normal_force: Array
    traction: Array
    limit: Array
    slip: Array
    regime: NDArray[np.int64]
    integrals: Array
    events: tuple[Event, ...]
    evaluations: int

    @property
    def stop_time(self) -> float:
        """When it came to rest to stay, s; inf: it did not."""
        for event in reversed(self.events):
            if event.kind in ("rests", "jams"):
                return event.time
            if event.kind in ("breaks away", "reverses"):
                break
        return math.inf


def solve(
    scene: Scene,
    duration: float | None = None,
    rtol: float = 1e-12,
    times: Sequence[float] | Array | None = None,
    most_steps: int = 1_000_000,
) -> Solution:
    """Solve ``scene`` from the plant's initial state.

    Args:
        duration: s; the scene's own by default.
        rtol: tolerance of a step, relative and, a tenth of it, absolute in SI units.
        times: ascending, from 0 to ``duration``, at which to report; by default start and end.

    The initial state is projected onto the constraint. Raises :class:`SceneError` where inertia is
    unknown or a motion is imposed, ValueError for unusable times, RuntimeError after ``most_steps``
    steps between two times.
    """
    _check(scene)
    duration = scene.plant.duration if duration is None else duration
    wanted = np.array([0.0, duration] if times is None else times, dtype=np.float64)
    if not np.all(np.isfinite(wanted)) or wanted[0] < 0.0 or np.any(np.diff(wanted) < 0.0):
        raise ValueError(f"times = {show(wanted.tolist())}: must be finite, ascending and >= 0")
    par, joint, y = initial(scene)
    n = len(y) - INTEGRALS
    log = np.zeros((MOST_EVENTS, LOG))
    t, locked, stuck, count, evaluations = 0.0, False, False, 0, 0
    step = 0.1 * max(wanted[-1], 1e-9)
    rows = []
    for end in wanted:
        ran = integrate(par, joint, y, t, end, rtol, step, locked, stuck, log, count, most_steps)
        if not ran.complete:
            raise RuntimeError(f"stopped at t = {ran.t:.9g} s after {most_steps} steps")
        evaluations += ran.evaluations
        count, locked, stuck, t = ran.events, ran.state.locked, ran.state.stuck, end
        rows.append(_row(par, joint, t, y, n, ran.state))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    events = tuple(Event(r[0], KINDS[int(r[1])], r[2], r[3], r[4]) for r in log[:count].tolist())
    return Solution(wanted, *columns, events, evaluations)


def initial(scene: Scene) -> tuple[Array, Array, Array]:
    """The scene's parameters, what its coordinates are counted from, and where they start."""
    par, mem = pack(scene), np.zeros(model.NMEM)
    sample = np.zeros(layout.NSAMPLE)
    sample[layout.MOTION] = [
        *scene.initial_pose(0), *scene.initial_twist(0),
        *scene.initial_pose(1), *scene.initial_twist(1),
    ]  # fmt: skip
    sample[layout.LOADS] = [*scene.plant.body_a.load, *scene.plant.body_b.load]
    observed = observe(par, mem, sample, np.zeros(layout.NOUT))
    joint = np.zeros(place.NJOINT)
    free = scene.body_a.kind == scene.body_b.kind == "free"
    y = np.zeros((17 if free else 4) + INTEGRALS)
    start(par, mem, sample, observed, False, joint, y)
    return par, joint, y


def _check(scene: Scene) -> None:
    for name, body in zip(("body_a", "body_b"), scene.bodies, strict=True):
        if body.kind == "unknown":
            raise SceneError(f"{name}.kind = 'unknown': its inertia must be known to move it")
    for name in ("slide", "spin"):
        imposed = getattr(scene.command, name)
        for quantity in ("position", "velocity"):
            value = getattr(imposed, quantity)
            if not math.isnan(value):
                raise SceneError(
                    f"command.{name}.{quantity} = {show(value)}: imposed motion is served live only"
                )


def _row(par: Array, joint: Array, t: float, y: Array, n: int, state: object) -> tuple:
    """One row of every column of a Solution."""
    i = instant(par, joint, t, y, state.stuck, state.sides)
    states = []
    for m, at in ((i.place.a, model.BODY_A), (i.place.b, model.BODY_B)):
        body = model.body(par, at)
        from_origin = _turned(m.orientation, body.com)
        position = np.subtract(m.com, from_origin)
        velocity = np.subtract(m.velocity, np.cross(m.spin, from_origin))
        states += [*position, *m.orientation, *velocity, *m.spin]
    f, m, c = *i.total, i.constraint
    on = model.law(par).on
    regime = layout.FRICTIONLESS if not on else layout.STICK if state.stuck else layout.SLIP
    return (
        states, *y[:4], [f, c[0], c[1], m, c[2], c[3]], i.friction, i.reaction, i.normal,
        i.traction, i.limit, y[n], regime, y[n:].copy(),
    )  # fmt: skip


def _turned(q: tuple[float, ...], a: tuple[float, ...]) -> Array:
    from cylconn_ros.core.vectors import matrix, out_of

    return np.array(out_of(matrix(q), a))
