"""Time between the stamps of loads or efforts and their action, by what a wrong one leaves behind.

A load is held from its sample to the next one, as a simulator applies it. The samples of a sensor
act half a period later on average, and clocks or filters shift loads further. With e the residuals
of the fitted law and D their change if every load is replaced by the next one, the load acts d
periods after its stamp if e + d D is smallest, beside all terms of friction. The same of the effort
of a drive, which is shifted by that time.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.identification.forces.intervals import Intervals, measure_intervals
from cylconn_ros.identification.likelihood import sandwich
from cylconn_ros.identification.likelihood.kinetic import (
    KineticFit,
    factors,
    slopes_of,
    weighted_residuals,
)
from cylconn_ros.identification.likelihood.law import (
    DIRECTION,
    OFFSET,
    VISCOUS,
    VISCOUS_SPIN,
    slip,
)
from cylconn_ros.identification.slips import Prepared
from cylconn_ros.recording.samples import SampleArrays

Array = NDArray[np.float64]

SIGNIFICANT = 4.0  # standard deviations of a lag that counts
MATERIAL = 0.01  # of the traction: least effect that counts
SENSOR = (0.25, 0.75)  # periods: samples of a load that changes between them
MOST_SHIFT = 3.0  # periods by which an effort is shifted
LEAST_SHIFT = 0.25
TERMS = (VISCOUS, VISCOUS_SPIN, DIRECTION, OFFSET)


INTERPOLATED = (
    "loads are samples of what changes in between (they act half a period after their stamps): "
    "interpolated instead of held"
)


class LoadLag(NamedTuple):
    """Time by which loads act after their stamps."""

    periods: float
    deviation: float  # of ``periods``
    effect: float  # of the lag, relative to the traction
    step: float  # period, s
    averaged: bool  # the loads are means already
    what: str = "loads act"

    @property
    def certain(self) -> bool:
        """Whether it differs from zero significantly."""
        return abs(self.periods) > SIGNIFICANT * self.deviation

    @property
    def sampled(self) -> bool:
        """Whether loads are samples of what changes in between, instead of held values."""
        return self.certain and not self.averaged and SENSOR[0] < self.periods < SENSOR[1]

    @property
    def counts(self) -> bool:
        """Whether it is large enough to change the estimates, and no matter of interpolation."""
        return self.certain and not self.sampled and self.effect > MATERIAL

    def describe(self) -> str:
        """Say what was seen, what is expected and what to do."""
        way = "after" if self.periods > 0.0 else "before"
        size, spread = 1e3 * self.step * np.array([abs(self.periods), 1.96 * self.deviation])
        expected = "0" if self.averaged else f"0 to {1e3 * self.step * SENSOR[1]:.2g} ms"
        return (
            f"{self.what} {size:.3g} ± {spread:.2g} ms {way} their stamps, against the motion "
            f"(expected: {expected}); stamp forces and motion with one clock, and filter neither "
            "or both"
        )


Part = tuple[SampleArrays, Array | None]
"""Samples of a recording and its drive."""


class Retimed(NamedTuple):
    """Loads and drive at the times at which they act; no remark if these are their stamps."""

    samples: SampleArrays
    drive: Array | None
    shift: float  # of the drive, periods
    remark: str = ""

    def coarse(self, given: Part | None) -> Part | None:
        """Return the same motion at half of the bandwidth, its drive shifted too."""
        if given is None or given[1] is None or self.shift == 0.0:
            return given
        return given[0], shifted(given[0], given[1], 0.5 * self.shift)


def retimed(
    measured: Intervals,
    samples: SampleArrays,
    drive: Array | None,
    prepared: Prepared,
    fitted: KineticFit,
) -> tuple[Retimed, LoadLag]:
    """Interpolate loads that are samples and shift an effort; also the lag of the loads."""
    lag = load_lag(measured, samples, drive, prepared, fitted)
    if lag.sampled:
        return Retimed(interpolated(samples), drive, 0.0, INTERPOLATED), lag
    if drive is None:
        return Retimed(samples, drive, 0.0), lag
    late = drive_lag(measured, samples, drive, prepared, fitted)
    size = abs(late.periods)
    if not late.certain or late.effect < MATERIAL or not LEAST_SHIFT < size < MOST_SHIFT:
        return Retimed(samples, drive, 0.0), late if late.certain and size > MOST_SHIFT else lag
    remark = (
        f"the effort of the drive acts {1e3 * late.periods * late.step:+.3g} ms after its stamps"
    )
    moved = shifted(samples, drive, late.periods)
    return Retimed(samples, moved, late.periods, f"{remark}: shifted by this time"), lag


def load_lag(
    measured: Intervals,
    samples: SampleArrays,
    drive: Array | None,
    prepared: Prepared,
    fitted: KineticFit,
) -> LoadLag:
    """Estimate the lag; ``measured``: the forces of ``samples`` with ``drive``."""
    rows = samples.samples.copy()
    loads = rows[:, layout.LOADS]
    change = np.diff(loads, axis=0)
    change[samples.restarted[1:]] = 0.0
    if not change.any():
        return LoadLag(0.0, np.inf, 0.0, measured.step, samples.averaged)
    loads[:-1] += change
    later = SampleArrays(
        samples.stamps, samples.h, samples.restarted, rows, averaged=samples.averaged
    )
    moved = measure_intervals(measured.scene, later, drive).wrench - measured.wrench
    return _lag(moved, samples.averaged, measured, prepared, fitted)


def drive_lag(
    measured: Intervals,
    samples: SampleArrays,
    drive: Array,
    prepared: Prepared,
    fitted: KineticFit,
) -> LoadLag:
    """Estimate the lag of an effort."""
    moved = np.zeros_like(measured.wrench)
    moved[:, [0, 3]] = (drive - shifted(samples, drive, 1.0))[:, :2]
    if not moved.any():
        return LoadLag(0.0, np.inf, 0.0, measured.step, True)
    found = _lag(moved, True, measured, prepared, fitted)
    return found._replace(what="the efforts of the drive act")


def shifted(samples: SampleArrays, drive: Array, periods: float) -> Array:
    """Return the drive as it is ``periods`` later, interpolated within each history.

    Not a commanded preload, its third column.
    """
    found, number = drive.copy(), np.arange(len(drive), dtype=np.float64)
    edges = [*np.flatnonzero(np.r_[True, samples.restarted[1:]]).tolist(), len(drive)]
    for first, last in itertools.pairwise(edges):
        rows = slice(first, last)
        for k in range(2):
            found[rows, k] = np.interp(number[rows] + periods, number[rows], drive[rows, k])
    return found


def _lag(
    moved: Array, averaged: bool, measured: Intervals, prepared: Prepared, fitted: KineticFit
) -> LoadLag:
    """Estimate the multiple of the change ``moved`` (intervals, 6) that describes the residuals."""
    none = LoadLag(0.0, np.inf, 0.0, measured.step, averaged)
    effect = _effect(np.nan_to_num(moved), measured, prepared, fitted)
    data, law = prepared.data, fitted.law
    inverse, _ = factors(data, law)
    free = sorted({*fitted.free, *TERMS})
    slopes = slopes_of(data, law, free)
    columns: Sequence[Array] = [-slopes, effect[:, :, None]]
    j = np.einsum("nij,njk->nik", inverse, np.concatenate(columns, axis=2))
    scale = np.sqrt(np.square(j).sum(axis=(0, 1)))
    kept = scale > 1e-9 * scale.max()
    if not kept[-1]:
        return none
    j = j[:, :, kept] / scale[kept]
    r = weighted_residuals(data, law, inverse)
    step = np.linalg.lstsq(j.reshape(-1, j.shape[2]), -r.ravel(), rcond=1e-8)[0]
    bread = np.linalg.pinv(np.einsum("nia,nib->ab", j, j), rcond=1e-12)
    spread = np.sqrt(sandwich.covariance(j, r + j @ step, bread)[-1, -1])
    periods = float(step[-1] / scale[-1])
    usual = float(np.median(np.hypot(data.force[:, 0], data.force[:, 1] / law.radius)))
    size = float(np.sqrt(np.square(effect / [1.0, law.radius]).sum(axis=1).mean()))
    return none._replace(
        periods=periods,
        deviation=float(spread / scale[-1]),
        effect=abs(periods) * size / max(usual, 1e-300),
    )


def _effect(moved: Array, measured: Intervals, prepared: Prepared, fitted: KineticFit) -> Array:
    """Return the changes (n, 2) of the residuals in the windows if the wrenches change by these."""
    w, law = prepared.data.windows, fitted.law
    middle = measured.time - 0.5 * measured.dt
    there = np.stack([np.interp(w.time, middle, column) for column in moved.T], axis=1)
    there = w.contact.about_middle(there, w.places[:, 0])
    _, cos, sin = slip(w.rates, law.radius)
    loads = np.einsum("nlc,nc->nl", prepared.loads.gradient, there)
    normal = loads[:, 0] + prepared.data.bending(law.bending) * loads[:, 1]
    along = np.stack([cos, law.radius * sin], axis=1)
    return np.asarray(there[:, [0, 3]] + (law.ratio(w.rates) * normal)[:, None] * along)


def interpolated(samples: SampleArrays) -> SampleArrays:
    """Return the samples with loads that change linearly from one to the next."""
    rows = samples.samples.copy()
    change = np.diff(samples.samples[:, layout.LOADS], axis=0)
    change[samples.restarted[1:]] = 0.0
    rows[:, layout.LOADS][:-1] += 0.5 * change
    return SampleArrays(samples.stamps, samples.h, samples.restarted, rows, averaged=True)
