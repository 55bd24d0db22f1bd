"""The whole motion of a scene in its own coordinates: a simulation without a wrench, to tolerance.

No period, no held wrench: what the equations say, with every event located. It is the reference
for runs of plant and connector, and an independent way to compute a scene.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import friction, layout, model
from cylconn_ros.errors import SceneError
from cylconn_ros.methods.minimal import coordinates, dense_output
from cylconn_ros.methods.minimal.derivatives import INTEGRALS
from cylconn_ros.methods.minimal.events import LOG_WIDTH
from cylconn_ros.methods.minimal.initial import tolerance_of
from cylconn_ros.scene import over_time
from cylconn_ros.scene.initial import check_start
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene
from cylconn_ros.scene.schema import show

Array = NDArray[np.float64]

KINDS = ("", "rests", "reverses", "breaks away", "jams", "impact", "releases", "locks")
MOST_EVENTS = 2000  # kept of a solution
STEPS_OF_A_CYCLE = 256.0  # at least, of a sine over time


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
        time: (N,) s. rows: (N, WIDTH) as methods/minimal/dense_output.py lays them out.
        events: what happened, in order, the first 2000 of it; happened: how often something did.
        coarse: from when on it does not keep to the tolerance, s; inf: it does everywhere.
        evaluations: how often the equations of motion were evaluated.
    """

    time: Array
    rows: Array
    events: tuple[Event, ...]
    happened: int
    coarse: float
    evaluations: int

    @property
    def states(self) -> Array:
        """(N, 26) poses and twists of both bodies, as in a sample (core/layout.py)."""
        return self.rows[:, : dense_output.COORDINATES]

    @property
    def length(self) -> Array:
        """(N,) position in the slot, m."""
        return self.rows[:, dense_output.COORDINATES]

    @property
    def angle(self) -> Array:
        """(N,) rad."""
        return self.rows[:, dense_output.COORDINATES + 1]

    @property
    def velocity(self) -> Array:
        """(N,) of the slide, m/s."""
        return self.rows[:, dense_output.COORDINATES + 2]

    @property
    def angular_velocity(self) -> Array:
        """(N,) of the spin, rad/s."""
        return self.rows[:, dense_output.COORDINATES + 3]

    @property
    def forces(self) -> Array:
        """(N, 6) f1 f2 f3 m1 m2 m3 on B at node b, axes of a (moments: those of N)."""
        return self.rows[:, dense_output.FORCES : dense_output.FRICTION]

    @property
    def friction(self) -> Array:
        """(N, 2) f1f, m1f."""
        return self.rows[:, dense_output.FRICTION : dense_output.REACTION]

    @property
    def reaction(self) -> Array:
        """(N, 2) of stops and locks in f1, m1."""
        return self.rows[:, dense_output.REACTION : dense_output.NORMAL]

    @property
    def normal_force(self) -> Array:
        """(N,) FN."""
        return self.rows[:, dense_output.NORMAL]

    @property
    def traction(self) -> Array:
        """(N,) P."""
        return self.rows[:, dense_output.TRACTION]

    @property
    def limit(self) -> Array:
        """(N,) what P may be."""
        return self.rows[:, dense_output.LIMIT]

    @property
    def regime(self) -> Array:
        """(N,) FRICTIONLESS, STICK or SLIP."""
        return self.rows[:, dense_output.REGIME]

    @property
    def integrals(self) -> Array:
        """(N, 6) of |s|, FN, f1f, m1f, f1, m1 over time, with the impulses of events."""
        return self.rows[:, dense_output.INTEGRALS :]

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
    rtol: float | None = None,
    times: Sequence[float] | NDArray[np.floating[Any]] | None = None,
    most_steps: int = 100_000,
) -> Solution:
    """Solve ``scene`` from the plant's initial state.

    Args:
        duration: s; the scene's own by default.
        rtol: tolerance of a step, relative and, a tenth of it, absolute in SI units; by default
            the scene's, or 1e-12 if it states none.
        times: ascending, from 0 to ``duration``, at which to report; by default start and end.
        most_steps: between two times. From half of them on, steps are only as fine as it takes to
            come to an end, and ``coarse`` says from when on.

    The initial state is projected onto the constraint and imposed motions. Raises
    :class:`SceneError` where inertia is unknown, ValueError for unusable times, RuntimeError where
    an imposed motion cannot go on (it jams), or the end is not reached after all.
    """
    _check(scene)
    duration = scene.plant.duration if duration is None else duration
    wanted = np.array([0.0, duration] if times is None else times, dtype=np.float64)
    ascending = wanted[0] >= 0.0 and bool((wanted[1:] >= wanted[:-1]).all())
    if not (ascending and wanted[-1] < math.inf):
        raise ValueError(f"times = {show(wanted.tolist())}: must be finite, ascending and >= 0")
    par, joint, y = initial(scene)
    rtol = tolerance_of(par) if rtol is None else rtol

    log = np.zeros((MOST_EVENTS, LOG_WIDTH))
    reached, kinks, factors = smooth_pieces(scene, wanted)
    rows: Array = np.zeros((len(reached), dense_output.WIDTH))
    ran = dense_output.trajectory(
        par, joint, y, reached, rtol, 0.1 * wanted[-1] + 1e-9, rows, log, most_steps, kinks, factors
    )
    if len(reached) != len(wanted):
        rows = rows[np.searchsorted(reached, wanted)]
    if ran.blocked:
        raise RuntimeError(f"an imposed motion jams at t = {ran.t:.9g} s: no force moves it on")
    if not ran.complete:
        raise RuntimeError(f"stopped at t = {ran.t:.9g} s after {most_steps} steps")
    events = tuple(
        Event(time, KINDS[int(kind)], length, angle, restitution)
        for time, kind, length, angle, restitution in log[: ran.events].tolist()
    )
    return Solution(wanted, rows, events, ran.events, ran.coarse, ran.evaluations)


def initial(scene: Scene) -> tuple[Array, Array, Array]:
    """The scene's parameters, what its coordinates are counted from, and where they start."""
    par, sample = pack(scene), np.zeros(layout.NSAMPLE)
    sample[layout.MOTION] = [
        *scene.initial_pose(0), *scene.initial_twist(0),
        *scene.initial_pose(1), *scene.initial_twist(1),
    ]  # fmt: skip
    sample[layout.LOADS] = [*scene.plant.body_a.load, *scene.plant.body_b.load]
    free = scene.body_a.kind == scene.body_b.kind == "free"
    joint, y = np.zeros(coordinates.NJOINT), np.zeros((17 if free else 4) + INTEGRALS)
    if over_time.changes(scene):
        _change_over_time(scene, par, joint)
    dense_output.initial_coordinates(par, sample, joint, y)
    return par, joint, y


def _change_over_time(scene: Scene, par: Array, joint: Array) -> None:
    """Write what changes over time to ``joint``, as it is from 0 on."""
    joint[coordinates.OVER_TIME] = 1.0
    base = joint[coordinates.BASE : coordinates.PIECES]
    base[:12] = [*scene.plant.body_a.load, *scene.plant.body_b.load]
    base[12] = par[model.FRICTION + friction.PRELOAD]
    base[13:] = par[model.COMMAND : model.COMMAND + 6]
    factors = over_time.amplitudes(scene).values()
    joint[coordinates.PIECES : coordinates.IMPOSED_ACCELERATION] = np.ravel(
        [each.pieces()[0] for each in factors]
    )
    fastest = max((each.frequency for each in factors if not math.isnan(each.frequency)), default=0)
    if fastest > 0.0:
        joint[coordinates.LONGEST_STEP] = 1.0 / (STEPS_OF_A_CYCLE * fastest)


def smooth_pieces(scene: Scene, wanted: Array) -> tuple[Array, Array, Array]:
    """Times to integrate to: ``wanted`` and kinks over time; numbers of the kinks; factors."""
    factors = [each.pieces() for each in over_time.amplitudes(scene).values()]
    kinks = sorted({piece.start for pieces in factors for piece in pieces[1:]})
    kinks = [t for t in kinks if t < wanted[-1]]
    rows = [
        np.ravel([next(p for p in reversed(pieces) if p.start <= t) for pieces in factors])
        for t in kinks
    ]
    if not kinks:
        return wanted, np.zeros(0), np.zeros((0, 30))
    reached = np.union1d(wanted, kinks)
    return reached, np.searchsorted(reached, kinks).astype(np.float64), np.array(rows)


def _check(scene: Scene) -> None:
    for name, body in zip(("body_a", "body_b"), scene.bodies, strict=True):
        if body.kind == "unknown":
            raise SceneError(f"{name}.kind = 'unknown': its inertia must be known to move it")
    check_start(scene)
