"""Forces at the middles of windows: slopes of cubics in time, fitted to the measured impulses.

A wrench from differences of noisy twists is dominated by noise, and the normal force contains
absolute values, which turn noise into force. So a cubic is fitted to the impulses p(t) over each
window of W intervals, by least squares. Its slope at the middle is the force, with the noise
variance 75 V / (W^3 h^2) instead of 2 V / h^2. Windows share no measurement, so their errors are
independent.

W is two fifths of the largest window for which, within a segment, the residuals of the cubics do
not exceed the noise that the shortest windows show. The truncation error of a cubic grows with W^4
and is then a small part of the noise.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.identification.forces.contact import CONSTANT, Contact, pressing
from cylconn_ros.identification.forces.cubics import (
    TERMS,
    fit_cubics,
    noise_covariance,
    window_rows,
)
from cylconn_ros.identification.forces.intervals import Intervals
from cylconn_ros.identification.forces.segments import Segment, split_segment

Array = NDArray[np.float64]

SIZES = (6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024)
MIN_WINDOWS = 24  # windows of a recording, if it is long enough
SHARE = 0.4  # of the largest window size for which the residuals are noise
TEST_DEVIATIONS = 3.0  # standard deviations of the test of the residuals
NOISE_VARIANCE_ERROR = 4.7  # relative variance of the estimated noise, times the number of samples
MISFIT_LIMIT = 8.0  # times the usual misfit; a window above it, and above 1 % of the force, is
# rejected, since the motion in it is not smooth


@dataclasses.dataclass(frozen=True)
class Windows:
    """Forces and motion at the middles of n windows.

    Attributes
    ----------
        time: (n,) s.
        wrench: (n, 6) f1f f2 f3 m1f m2 m3, moments about the middle of the contact; N, N.m. What
            ``friction.inputs`` leaves out is zero.
        covariance: (n, 6, 6) of ``wrench``.
        rates: (n, 2) slide m/s, spin rad/s.
        places: (n, 2) slide m, angle rad.
        ends: (n, 2, 2) the rates at both ends of the window.
        rate_noise: (n, 2) standard deviations of ``rates``.
        segment: (n,) index of the segment.
        intervals: (n,) number of intervals in the window.
        pressed: (n,) commanded preload, N; 0 if none is commanded.
        rejected: number of windows rejected because the motion in them is not smooth.
        contact: of shaft and sleeve, how it changes with the slide.
    """

    time: Array
    wrench: Array
    covariance: Array
    rates: Array
    places: Array
    ends: Array
    rate_noise: Array
    segment: NDArray[np.intp]
    intervals: NDArray[np.intp]
    pressed: Array
    rejected: int
    contact: Contact = CONSTANT

    def __len__(self) -> int:
        return len(self.time)

    def take(self, rows: NDArray) -> Windows:
        """Return the windows ``rows`` (indices or a mask)."""
        return dataclasses.replace(self, **{name: getattr(self, name)[rows] for name in _ARRAYS})


_ARRAYS = tuple(
    field.name for field in dataclasses.fields(Windows) if field.name not in ("rejected", "contact")
)


def cut_windows(measured: Intervals, segments: list[Segment]) -> Windows:
    """Cut segments into windows, and return the forces and rates in them."""
    parts = []
    largest = max(sum(segment.size for segment in segments) // MIN_WINDOWS - 1, SIZES[0])
    for number, segment in enumerate(segments):
        for part in split_segment(segment):
            parts.append(_windows_of(measured, part, number, largest))
    found, contact = _concatenate(parts), measured.contact
    lengths = found.places[:, 0]
    wrench, covariance = pressing(
        measured.scene.friction.inputs,
        contact.about_middle(found.wrench, lengths),
        contact.covariance(found.covariance, lengths),
    )
    return dataclasses.replace(found, wrench=wrench, covariance=covariance, contact=contact)


def _concatenate(parts: list[Windows]) -> Windows:
    if not parts:
        none = np.zeros(0)
        index = np.zeros(0, dtype=np.intp)
        pairs, ends, cov = np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, 6, 6))
        return Windows(
            none, np.zeros((0, 6)), cov, pairs, pairs, ends, pairs, index, index, none, 0
        )
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS}
    return Windows(**columns, rejected=sum(part.rejected for part in parts))


def impulses(measured: Intervals, segment: Segment) -> tuple[Array, Array, Array]:
    """Return times (n + 1,), impulses (n + 1, 6) and rates (n + 1, 2) at the interval ends."""
    rows = slice(segment.first, segment.last)
    dt = measured.dt[rows]
    steps = np.vstack([np.zeros(6), measured.wrench[rows] * dt[:, None]])
    begin = max(segment.first - 1, 0)
    rates = np.vstack([measured.rates[begin : begin + 1], measured.rates[rows]])
    time = measured.time[segment.first] - dt[0] + np.r_[0.0, np.cumsum(dt)]
    return time, np.cumsum(steps, axis=0), rates


def _windows_of(measured: Intervals, segment: Segment, number: int, largest: int) -> Windows:
    time, p, rates = impulses(measured, segment)
    white, rate_white = noise_covariance(time, p), noise_covariance(time, rates)
    w = _window_size(time, p, np.diag(white), largest)
    rows = window_rows(len(p), w)
    fit, inside = fit_cubics(time[rows]), p[rows]  # (windows, w + 1, 6)
    rest = fit.residuals(inside)
    misfit = np.square(rest).sum(axis=1)
    usual = np.maximum(np.median(misfit, axis=0), (w + 1 - TERMS) * np.diag(white))
    smooth = (misfit <= MISFIT_LIMIT * usual + _negligible(inside)).all(axis=1)
    n = int(smooth.sum())
    part = slice(segment.first, segment.last)
    pressed = np.r_[0.0, np.cumsum(measured.pressed[part] * measured.dt[part])]
    gain = np.square(fit.slope).sum(axis=1)
    spread = np.sqrt(np.square(fit.value).sum(axis=1)[:, None] * np.diag(rate_white))
    return Windows(
        time=fit.middle[smooth],
        wrench=np.einsum("wk,wkc->wc", fit.slope, inside)[smooth],
        covariance=(gain[:, None, None] * white)[smooth],
        rates=np.einsum("wk,wkc->wc", fit.value, rates[rows])[smooth],
        places=measured.places[segment.first + rows[:, w // 2] - 1][smooth],
        ends=(fit.design[:, [0, -1]] @ (fit.solve @ rates[rows]))[smooth],
        rate_noise=spread[smooth],
        segment=np.full(n, number, dtype=np.intp),
        intervals=np.full(n, w, dtype=np.intp),
        pressed=np.einsum("wk,wk->w", fit.slope, pressed[rows])[smooth],
        rejected=len(rows) - n,
    )


def _negligible(inside: Array) -> Array:
    """Return the misfits (windows, 6) that 1 % of the mean force or moment would cause."""
    count, points, _ = inside.shape
    change = np.abs(inside[:, -1] - inside[:, 0]).reshape(count, 2, 3).max(axis=2)
    return np.repeat(points * (1e-2 * change) ** 2, 3, axis=1)


def _window_size(time: Array, p: Array, variance: Array, largest: int) -> int:
    """Return the intervals of a window: as many as the motion permits, up to ``largest``."""
    n = len(p)
    largest = min(largest, max(n // 4 - 1, SIZES[0]))
    chosen = SIZES[0]
    for w in SIZES:
        if w + 1 > n or SHARE * w > largest:
            break
        rows = window_rows(n, w)
        rest = fit_cubics(time[rows]).residuals(p[rows])
        freedom = len(rows) * (w + 1 - TERMS)
        ratio = np.square(rest).sum(axis=(0, 1)) / np.where(variance > 0.0, freedom * variance, 1.0)
        spread = np.sqrt(2.0 / freedom + NOISE_VARIANCE_ERROR / n)
        if (ratio > 1.0 + TEST_DEVIATIONS * spread).any():
            break
        chosen = w
    return min(max(int(SHARE * chosen), SIZES[0]), largest)
