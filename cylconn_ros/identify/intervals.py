"""Forces and motion of a joint, interval by interval, out of the samples of a recording.

The method ``observe`` gives the wrench on body B at node b, axes of a, that the motion over each
interval has had. Springs, dampers and a constant imposed force are taken off, so that the rest of
(f1, m1) is friction. Multiplied by the interval and summed, the wrench is an impulse p(t), in which
the noise of a measured twist stands once and not, as in the wrench, as a difference.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections import Counter
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.errors import IdentifyError
from cylconn_ros.recording.samples import Sampled, Samples
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

F1, F2, F3, M1, M2, M3 = range(6)
STOP_REACH = 2.0  # periods ahead of a stop from which on its force may act
_BLOCK = 2048  # samples observed in one call
_KEPT = [
    layout.STATE_INDEX[name] + k
    for name, width in (
        ("force", 3), ("moment", 3), ("force_elastic", 1), ("force_viscous", 1),
        ("moment_elastic", 1), ("moment_viscous", 1), ("velocity", 1), ("angular_velocity", 1),
        ("length", 1), ("angle", 1),
    )
    for k in range(width)
] + [layout.STATUS]  # fmt: skip
GAP = 4.5  # of the usual interval: a longer one hides what happened in it


@dataclasses.dataclass(frozen=True)
class Measured:
    """A recording as friction sees it; row k is the interval that ends with sample k.

    Attributes
    ----------
        scene: the parameters in force.
        time: (n,) end of the interval, s since the first sample.
        dt: (n,) its length, s.
        wrench: (n, 6) f1 f2 f3 m1 m2 m3 on B at node b, axes of a: friction and constraint; N, N.m.
        rates: (n, 2) slide m/s and spin rad/s at its end.
        usable: (n,) whether the wrench is that of friction and constraint alone.
        left_out: why the others are not, and how many intervals each.
    """

    scene: Scene
    time: Array
    dt: Array
    wrench: Array
    rates: Array
    usable: Mask
    left_out: Counter[str]

    @property
    def step(self) -> float:
        """The usual interval, s."""
        return float(np.median(self.dt))


def measure(scene: Scene, samples: Iterable[Sampled]) -> Measured:
    """Observe the samples of a recording, with the parameters of ``scene``.

    Raises IdentifyError where there are too few samples, or friction cannot be told from what else
    acts along the slot; SceneError where no inertia is known.
    """
    _check(scene)
    samples = Samples.of(samples)
    if len(samples) < 2:
        raise IdentifyError(
            f"{len(samples)} complete samples: a motion is needed (pose and twist of every moving "
            "body, with the same stamps)"
        )
    usual = float(np.median(samples.since[1:]))
    connector = Connector(
        dataclasses.replace(
            scene, method="observe", latency=0, tolerance=0.0, period=scene.period or usual
        )
    )
    begins = samples.restarted.copy()
    begins[0] = True
    since = np.where(begins, 0.0, samples.since)
    out = np.empty((len(samples), len(_KEPT)))
    edges = [*np.flatnonzero(begins).tolist(), len(samples)]
    room = np.empty((_BLOCK, layout.NOUT))
    for begin, end in itertools.pairwise(edges):
        connector.reset()
        for at in range(begin, end, _BLOCK):
            some = slice(at, min(at + _BLOCK, end))
            numbers = np.ascontiguousarray(samples.numbers[some])
            found = connector.run_each(numbers, since[some], room[: len(numbers)])
            out[some] = found[:, _KEPT]
    time: Array = np.asarray((samples.stamps - samples.stamps[0]) * 1e-9, dtype=np.float64)
    return _measured(scene, out, samples.since, time, begins)


def _check(scene: Scene) -> None:
    for name in ("slide", "spin"):
        imposed = getattr(scene.command, name)
        if np.isfinite(imposed.position) or np.isfinite(imposed.velocity):
            raise IdentifyError(
                f"command.{name}: imposes a motion; its drive's force and friction cannot be told "
                "apart"
            )
    if scene.friction.table is not None:
        raise IdentifyError(
            "friction.table: one coefficient is estimated, the recording's parameters hold a table "
            "(give others with --params)"
        )


def _measured(scene: Scene, out: Array, dt: Array, time: Array, begins: Mask) -> Measured:
    wrench = np.hstack([_of(out, "force", 3), _of(out, "moment", 3)])
    parts = (("force", F1, scene.command.slide.force), ("moment", M1, scene.command.spin.force))
    for name, at, imposed in parts:
        for part in ("elastic", "viscous"):
            wrench[:, at] -= _of(out, f"{name}_{part}", 1)[:, 0]
        wrench[:, at] -= imposed if np.isfinite(imposed) else 0.0
    rates = np.hstack([_of(out, "velocity", 1), _of(out, "angular_velocity", 1)])
    refused = out[:, _KEPT.index(layout.STATUS)] != layout.OK
    refused[1:] |= refused[:-1].copy()
    usual = np.median(dt[~begins]) if not begins.all() else 0.0
    reasons = (
        ("first of a history", begins),
        ("next to a sample that cannot be used", refused),
        ("longer than the others (samples lost)", dt > GAP * usual),
        ("at a stop or lock", _bounded(scene, out, rates, dt)),
    )
    finite: Mask = np.asarray(np.isfinite(wrench).all(axis=1))
    usable = finite.copy()
    left_out: Counter[str] = Counter()
    for why, rows in reasons:
        left_out[why] = int((rows & usable).sum())
        usable &= ~rows
    left_out["not finite"] = int((~finite).sum())
    return Measured(scene, time, dt, wrench, rates, usable, +left_out)


def _of(out: Array, name: str, width: int) -> Array:
    at = _KEPT.index(layout.STATE_INDEX[name])
    return out[:, at : at + width]


def _bounded(scene: Scene, out: Array, rates: Array, dt: Array) -> Mask:
    """Intervals in which a stop or a lock may have acted."""
    found = np.zeros(len(out), dtype=np.bool_)
    stops = scene.stops
    bounds = (
        ("length", 0, stops.l_min, stops.l_max),
        ("angle", 1, stops.theta_min, stops.theta_max),
    )
    for name, k, low, high in bounds:
        place, reach = _of(out, name, 1)[:, 0], STOP_REACH * np.abs(rates[:, k]) * dt
        reach[1:] = np.maximum(reach[1:], reach[:-1].copy())
        for bound, side in ((low, 1.0), (high, -1.0)):
            if np.isfinite(bound):
                found |= side * (place - bound) <= reach
    if scene.lock.component != "none" and np.isfinite(scene.lock.position):
        k = ("slide", "spin").index(scene.lock.component)
        place = _of(out, ("length", "angle")[k], 1)[:, 0] - scene.lock.position
        closed = np.abs(place) <= STOP_REACH * np.abs(rates[:, k]) * dt
        found |= np.maximum.accumulate(closed)
    return found
