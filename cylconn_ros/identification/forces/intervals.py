"""Forces and motion of a joint per sample interval, by inverse dynamics of recorded samples.

The method ``observe`` computes the wrench on body B at node b, axes of a, that caused the motion
over each interval. Springs, dampers and a constant imposed force are subtracted, so that (f1, m1)
is friction. The cumulative sum of wrench times interval is an impulse p(t); it contains the noise
of a measured twist itself, while the wrench contains its difference.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections import Counter
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.connector import Connector
from cylconn_ros.connector.usable import MotionCheck
from cylconn_ros.core import layout
from cylconn_ros.errors import IdentifyError, IndeterminateError
from cylconn_ros.identification.forces.contact import CONSTANT, Contact, contact_of
from cylconn_ros.identification.forces.drives import PRESSED, without_drive
from cylconn_ros.recording.samples import RecordedSample, SampleArrays
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

F1, F2, F3, M1, M2, M3 = range(6)
STOP_REACH = 2.0  # periods before a stop is reached within which its force may act
_BLOCK = 2048  # samples per compiled call
_COLUMNS = [
    layout.STATE_INDEX[name] + k
    for name, width in (
        ("force", 3), ("moment", 3), ("force_elastic", 1), ("force_viscous", 1),
        ("moment_elastic", 1), ("moment_viscous", 1), ("velocity", 1), ("angular_velocity", 1),
        ("length", 1), ("angle", 1),
    )
    for k in range(width)
] + [layout.STATUS]  # fmt: skip
LOST_SAMPLES = 4.5  # times the usual interval; a longer one means that samples were lost


@dataclasses.dataclass(frozen=True)
class Intervals:
    """Motion and forces of the n intervals of a recording; interval k ends with sample k.

    Attributes
    ----------
        scene: the parameters in force.
        time: (n,) end of the interval, s since the first sample.
        dt: (n,) length of the interval, s.
        wrench: (n, 6) f1 f2 f3 m1 m2 m3 on B at node b, axes of a: friction and constraint; N, N.m.
        rates: (n, 2) slide m/s and spin rad/s at the end of the interval.
        places: (n, 2) slide m and angle rad at the end of the interval.
        usable: (n,) bool, the wrench contains friction and constraint only.
        skipped: number of unusable intervals by reason.
        pressed: (n,) commanded preload over the interval, N; 0 if none is commanded.
        problem: why all of them are worth nothing: the motion leaves the joint; else empty.
        contact: of shaft and sleeve, how it changes with the slide.
    """

    scene: Scene
    time: Array
    dt: Array
    wrench: Array
    rates: Array
    places: Array
    usable: Mask
    pressed: Array
    skipped: Counter[str]
    problem: str = ""
    contact: Contact = CONSTANT

    @property
    def step(self) -> float:
        """Median interval, s."""
        return float(np.median(self.dt))


def measure_intervals(
    scene: Scene, samples: Iterable[RecordedSample], drive: Array | None = None
) -> Intervals:
    """Compute the forces in the samples of a recording, with the parameters of ``scene``.

    ``drive`` (n, 2) is the force and moment of a known drive over the interval that ends with each
    sample, by default that of the scene; a third column is the commanded preload.

    Raises IndeterminateError if there are fewer than two samples or all are refused, IdentifyError
    if friction cannot be separated from other forces along the slot, SceneError if an inertia is
    unknown.
    """
    _check_separable(scene)
    samples = SampleArrays.collect(samples)
    if len(samples) < 2:
        raise IndeterminateError(
            f"{len(samples)} complete samples: a motion is needed (pose and twist of every moving "
            "body, with the same stamps)"
        )
    usual = float(np.median(samples.h[1:]))
    connector = Connector(
        dataclasses.replace(
            scene,
            method="observe",
            constraint="connector",
            latency=0,
            tolerance=0.0,
            period=scene.period or usual,
        )
    )
    begins = samples.restarted.copy()
    begins[0] = True
    h = np.where(begins, 0.0, samples.h)
    out = np.empty((len(samples), len(_COLUMNS)))
    edges = [*np.flatnonzero(begins).tolist(), len(samples)]
    loads = _loads(samples, usual)
    buffer = np.empty((_BLOCK, layout.NOUT))
    check = MotionCheck()
    for begin, end in itertools.pairwise(edges):
        connector.reset()
        for at in range(begin, end, _BLOCK):
            rows = slice(at, min(at + _BLOCK, end))
            block = samples.samples[rows].copy()
            block[:, layout.LOADS] = loads[rows]
            found = connector.run(block, h[rows], buffer[: len(block)])
            out[rows] = found[:, _COLUMNS]
            check.add(found)
    if not check.solved:
        raise IndeterminateError(check.problem())
    time: Array = np.asarray((samples.stamps - samples.stamps[0]) * 1e-9, dtype=np.float64)
    measured = _intervals(scene, out, samples.h, time, begins, drive)
    return dataclasses.replace(measured, problem=check.problem())


def _loads(samples: SampleArrays, usual: float) -> Array:
    """Return the loads (n, 12) in force over the interval that begins with each sample.

    Those of the sample, in force until the next one. If samples were lost in between, their loads
    are those interpolated: the mean over n periods is (n - 1)/(2 n) of the way to the next load.
    """
    loads: Array = samples.samples[:, layout.LOADS].copy()
    if samples.averaged:
        return loads
    periods = np.maximum(samples.h[1:] / usual, 1.0)
    share = 0.5 * (1.0 - 1.0 / periods)
    share[samples.restarted[1:]] = 0.0
    loads[:-1] += share[:, None] * np.diff(samples.samples[:, layout.LOADS], axis=0)
    return loads


def with_mean_loads(samples: SampleArrays) -> SampleArrays:
    """Return the samples with the mean loads over the interval that begins with each."""
    rows = samples.samples.copy()
    rows[:, layout.LOADS] = _loads(samples, float(np.median(samples.h[1:])))
    return SampleArrays(samples.stamps, samples.h, samples.restarted, rows, averaged=True)


def _check_separable(scene: Scene) -> None:
    for name in ("slide", "spin"):
        imposed = getattr(scene.command, name)
        if np.isfinite(imposed.position) or np.isfinite(imposed.velocity):
            raise IdentifyError(
                f"command.{name}: imposes a motion; friction cannot be separated from the force "
                "of its drive"
            )
    if scene.friction.table is not None:
        raise IdentifyError(
            "friction.table: a single coefficient is estimated, but the parameters have a table "
            "(use others: --params)"
        )


def _intervals(
    scene: Scene, out: Array, dt: Array, time: Array, begins: Mask, drive: Array | None
) -> Intervals:
    wrench = np.hstack([_column(out, "force", 3), _column(out, "moment", 3)])
    for name, at in (("force", F1), ("moment", M1)):
        for part in ("elastic", "viscous"):
            wrench[:, at] -= _column(out, f"{name}_{part}", 1)[:, 0]
    wrench = without_drive(scene, wrench, drive)
    rates = np.hstack([_column(out, "velocity", 1), _column(out, "angular_velocity", 1)])
    places = np.hstack([_column(out, "length", 1), _column(out, "angle", 1)])
    refused = out[:, _COLUMNS.index(layout.STATUS)] != layout.OK
    refused[1:] |= refused[:-1].copy()
    usual = np.median(dt[~begins]) if not begins.all() else 0.0
    reasons = (
        ("first sample", begins),
        ("next to a refused sample", refused),
        ("samples lost", dt > LOST_SAMPLES * usual),
        ("at a stop or lock", _near_bounds(scene, out, rates, dt)),
    )
    finite: Mask = np.asarray(np.isfinite(wrench).all(axis=1))
    usable = finite.copy()
    skipped: Counter[str] = Counter()
    for reason, rows in reasons:
        skipped[reason] = int((rows & usable).sum())
        usable &= ~rows
    skipped["not finite"] = int((~finite).sum())
    contact = contact_of(scene, float(places[0, 0]))
    pressed: Array = np.zeros(len(out))
    if drive is not None and drive.shape[1] > PRESSED and "preload" in scene.friction.inputs:
        pressed = drive[:, PRESSED]
    return Intervals(
        scene, time, dt, wrench, rates, places, usable, pressed, +skipped, contact=contact
    )


def _column(out: Array, name: str, width: int) -> Array:
    at = _COLUMNS.index(layout.STATE_INDEX[name])
    return out[:, at : at + width]


def _near_bounds(scene: Scene, out: Array, rates: Array, dt: Array) -> Mask:
    """Return the intervals in which a stop or a lock may have acted."""
    found = np.zeros(len(out), dtype=np.bool_)
    stops = scene.stops
    bounds = (
        ("length", 0, stops.l_min, stops.l_max),
        ("angle", 1, stops.theta_min, stops.theta_max),
    )
    for name, k, low, high in bounds:
        place, reach = _column(out, name, 1)[:, 0], STOP_REACH * np.abs(rates[:, k]) * dt
        reach[1:] = np.maximum(reach[1:], reach[:-1].copy())
        for bound, side in ((low, 1.0), (high, -1.0)):
            if np.isfinite(bound):
                found |= side * (place - bound) <= reach
    if scene.lock.component != "none" and np.isfinite(scene.lock.position):
        k = ("slide", "spin").index(scene.lock.component)
        place = _column(out, ("length", "angle")[k], 1)[:, 0] - scene.lock.position
        closed = np.abs(place) <= STOP_REACH * np.abs(rates[:, k]) * dt
        found |= np.maximum.accumulate(closed)
    return found
