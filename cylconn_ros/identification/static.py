"""Static friction: a lower bound from rest, and the friction ratio P/FN at each break-away.

At rest P/FN is at most mu_s, so its maximum is a lower bound. If slip follows rest, the forces at
rest are extrapolated to the time of the break-away, and P/FN there is mu_s. That time is found by
extrapolating the slip rate back to zero.
"""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.identification.forces.contact import Contact, pressing
from cylconn_ros.identification.forces.cubics import noise_covariance
from cylconn_ros.identification.forces.intervals import Intervals
from cylconn_ros.identification.forces.segments import (
    MIN_SEGMENT,
    Segment,
    slip_rate,
    slip_threshold,
)
from cylconn_ros.identification.forces.windows import NOISE_VARIANCE_ERROR, cut_windows, impulses
from cylconn_ros.identification.likelihood.kinetic import KineticFit
from cylconn_ros.identification.likelihood.law import FrictionLaw, law_from_vector

Array = NDArray[np.float64]

MAX_BREAKAWAY_TIME = 0.1  # s, between rest and slip
MAX_REST = 512  # intervals of rest that are extrapolated
MAX_ONSET = 64  # greatest number of slip intervals that determine the time of a break-away
MIN_ONSET = 6  # least number
FAST = 4.0  # times the slip threshold; the onset ends at this slip rate
# Of the difference between two estimates of the time: offset of the result, standard deviation.
ONSET_OFFSET, ONSET_DEVIATION = 0.25, 0.7
SIGNIFICANCE = 0.05


@dataclasses.dataclass(frozen=True)
class StaticFriction:
    """Static friction of a recording with n windows at rest and m break-aways.

    Attributes
    ----------
        ratio: (n,) P/FN in the windows at rest.
        bound: lower bound of mu_s with 95 % confidence; NaN if the joint never rested.
        windows: n.
        breakaways: (m,) P/FN at the break-aways.
        deviation: (m,) standard deviations of ``breakaways`` by their own forces and times.
        common: standard deviation of the mean of ``breakaways`` by the fitted parameters.
        times: (m,) of the break-aways, s.
        normal, traction: (n + m,) N, of windows and break-aways.
    """

    ratio: Array
    bound: float
    windows: int
    breakaways: Array
    deviation: Array
    common: float
    times: Array
    normal: Array
    traction: Array


class Breakaway(NamedTuple):
    """Forces at a break-away, about node b."""

    time: float
    wrench: Array  # (6,)
    covariance: Array  # (6, 6)
    length: float  # slide, m
    pressed: float  # commanded preload, N


class Forces(NamedTuple):
    """Forces about the middle of the contact at n times."""

    wrench: Array  # (n, 6)
    covariance: Array  # (n, 6, 6)
    contact: Contact
    lengths: Array  # (n,) slide, m
    pressed: Array  # (n,) commanded preload, N


def estimate_static(
    measured: Intervals, segments: list[Segment], fitted: KineticFit
) -> StaticFriction:
    """Evaluate the rest segments and the break-aways with R, L and FCint of the kinetic fit."""
    law = fitted.law
    rest = cut_windows(measured, [s for s in segments if not s.slips])
    contact = measured.contact
    resting = Forces(rest.wrench, rest.covariance, contact, rest.places[:, 0], rest.pressed)
    ratio, own, shared = _ratios(resting, fitted)
    bound = float("nan")
    if len(ratio):
        from scipy.stats import norm

        deviation = np.sqrt(own + np.square(shared).sum(axis=1))
        lower = ratio - norm.isf(SIGNIFICANCE / len(ratio)) * deviation  # Bonferroni
        bound = max(float(lower.max()), 0.0)
    breakaways = [
        b
        for before, after in pairwise(segments)
        if not before.slips and after.slips
        for b in [_breakaway(measured, before, after, law.radius)]
        if b is not None
    ]
    wrench = np.array([b.wrench for b in breakaways]).reshape(-1, 6)
    covariance = np.array([b.covariance for b in breakaways]).reshape(-1, 6, 6)
    lengths = np.array([b.length for b in breakaways])
    about = contact.about_middle(wrench, lengths), contact.covariance(covariance, lengths)
    leaving = Forces(
        *pressing(measured.scene.friction.inputs, *about), contact, lengths,
        np.array([b.pressed for b in breakaways]),
    )  # fmt: skip
    at_breakaway, own, shared = _ratios(leaving, fitted)
    common = float(np.linalg.norm(shared.mean(axis=0))) if breakaways else 0.0
    both = [resting, leaving]
    return StaticFriction(
        ratio,
        bound,
        len(rest),
        at_breakaway,
        np.sqrt(own),
        common,
        np.array([b.time for b in breakaways]),
        np.concatenate([_normal(one, law) for one in both]),
        np.concatenate([_traction(one, law) for one in both]),
    )


def _normal(forces: Forces, law: FrictionLaw) -> Array:
    w = forces.wrench
    bending = forces.contact.bending(law.bending, forces.lengths)
    radial = np.hypot(w[:, 1], w[:, 2]) + forces.pressed
    return law.normal(radial, np.hypot(w[:, 4], w[:, 5]), bending)


def _traction(forces: Forces, law: FrictionLaw) -> Array:
    w = forces.wrench
    return np.asarray(np.hypot(w[:, 0] + law.offset, w[:, 3] / law.radius))


def _ratio(forces: Forces, law: FrictionLaw) -> Array:
    return _traction(forces, law) / np.maximum(_normal(forces, law), 1e-300)


def _ratios(forces: Forces, fitted: KineticFit) -> tuple[Array, Array, Array]:
    """Evaluate P/FN and its errors.

    Returns
    -------
        P/FN (n,), its variance by the noise of the forces (n,), and its changes (n, k) by k
        uncorrelated parameter errors of one standard deviation each.
    """
    law, wrench, covariance = fitted.law, forces.wrench, forces.covariance
    size = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    slopes = np.zeros((len(wrench), 6))
    for k in range(6):
        step = np.zeros_like(wrench)
        step[:, k] = np.maximum(size[:, k], 1e-12)
        up, down = (forces._replace(wrench=wrench + sign * step) for sign in (1.0, -1.0))
        slopes[:, k] = (_ratio(up, law) - _ratio(down, law)) / (2.0 * step[:, k])
    own = np.einsum("ni,nij,nj->n", slopes, covariance, slopes)
    sizes, vectors = np.linalg.eigh(fitted.covariance)
    shared = np.zeros((len(wrench), len(sizes)))
    for column, direction in enumerate((vectors * np.sqrt(np.maximum(sizes, 0.0))).T):
        step = np.zeros(len(law.vector))
        step[list(fitted.free)] = direction
        more, less = law_from_vector(law.vector + step), law_from_vector(law.vector - step)
        shared[:, column] = 0.5 * (_ratio(forces, more) - _ratio(forces, less))
    return _ratio(forces, law), own, shared


def _breakaway(
    measured: Intervals, before: Segment, after: Segment, radius: float
) -> Breakaway | None:
    """Return the forces at the transition from rest to slip; None if it cannot be evaluated."""
    between = slice(before.last, after.first)
    if not measured.usable[between].all() or measured.dt[between].sum() > MAX_BREAKAWAY_TIME:
        return None
    time, spread = _breakaway_time(measured, after, radius)
    last = before.last
    while last > before.first and measured.time[last - 1] > time - measured.step:
        last -= 1
    size = min(last - before.first, MAX_REST)
    while size >= MIN_SEGMENT:
        part = Segment(last - size, last, False)
        ts, p, _ = impulses(measured, part)
        white = noise_covariance(ts, p)
        x = (ts - time) / (ts[-1] - ts[0])
        design = np.vander(x, 3, increasing=True)
        solve = np.linalg.pinv(design)
        rest = p - design @ (solve @ p)
        freedom = len(p) - 3
        allowed = 1.0 + 3.0 * np.sqrt(2.0 / freedom + NOISE_VARIANCE_ERROR / len(p))
        smooth = np.square(rest).sum(axis=0) <= allowed * freedom * np.diag(white)
        if smooth.all() or size < 2 * MIN_SEGMENT:
            duration = ts[-1] - ts[0]
            slope, curvature = solve[1] / duration, 2.0 * solve[2] / duration**2
            forces, rates = slope @ p, curvature @ p
            cov = white * (slope @ slope) + np.outer(rates, rates) * spread**2
            return Breakaway(
                time, forces, cov, float(measured.places[last - 1, 0]),
                float(measured.pressed[last - 1]),
            )  # fmt: skip
        size //= 2
    return None


def _breakaway_time(measured: Intervals, after: Segment, radius: float) -> tuple[float, float]:
    """Return the time at which slip began, and its standard deviation, s.

    After the break-away at t0 the slip rate grows as t - t0 if the traction drops at once, and as
    its square if the traction stays and the load continues to rise; other cases lie between them.
    Noise hides the first part. Both powers are fitted to the first visible part. The result is at
    ONSET_OFFSET of the difference from the second, earlier time to the first one, with
    ONSET_DEVIATION of the difference as its standard deviation.
    """
    _, deviation = slip_rate(measured, radius)
    last = after.first + MIN_ONSET
    s = measured.rates[after.first : after.last] * [1.0, radius]
    fast = np.flatnonzero(np.hypot(s[:, 0], s[:, 1]) > FAST * slip_threshold(measured, deviation))
    last = max(last, after.first + (int(fast[0]) if len(fast) else len(s)))
    last = min(last, after.last, after.first + MAX_ONSET)
    s, t = s[: last - after.first], measured.time[after.first : last]
    along = s.mean(axis=0) / np.linalg.norm(s.mean(axis=0))
    latest = float(measured.time[after.first - 1])
    begins, own = [], []
    for power in (1.0, 2.0):
        found, spread = _onset(t, s @ along, power, deviation)
        begins.append(min(max(found, latest - MAX_BREAKAWAY_TIME), latest))
        own.append(spread)
    begin = begins[1] + ONSET_OFFSET * (begins[0] - begins[1])
    spread = float(np.hypot(ONSET_DEVIATION * (begins[0] - begins[1]), np.mean(own)))
    return begin, max(spread, 0.5 * measured.step)


def _onset(t: Array, s: Array, power: float, deviation: float) -> tuple[float, float]:
    """Fit s = (a (t - t0))^power; return t0 and its standard deviation."""
    y = np.sign(s) * np.abs(s) ** (1.0 / power)
    weight = np.abs(s) ** (1.0 - 1.0 / power)  # noise of y = noise of s / (ds/dy)
    design = np.column_stack([np.ones_like(t), t - t[0]]) * weight[:, None]
    values = np.linalg.lstsq(design, y * weight, rcond=None)[0]
    rest = float(np.square(y * weight - design @ values).sum())
    if values[1] <= 0.0:
        return float(t[0]), 0.0
    variance = max(rest / max(len(t) - 2, 1), (deviation / power) ** 2)
    cov = variance * np.linalg.pinv(design.T @ design)
    offset = -values[0] / values[1]
    slope = np.array([1.0, offset]) / values[1]
    return float(t[0] + offset), float(np.sqrt(slope @ cov @ slope))


def breakaway_interval(rest: StaticFriction) -> tuple[float, float]:
    """Return the mean of the break-aways and half of its 95 % interval; NaN without break-aways.

    The interval is that of the spread of the break-aways (Student's t), or that of the error of a
    single one if wider, since slip begins similarly in all of them and their errors are not
    independent. The error by the fitted parameters is common to all and added in squares.
    """
    from scipy.stats import norm, t

    n = len(rest.breakaways)
    if n == 0:
        return float("nan"), float("nan")
    normal = float(norm.isf(SIGNIFICANCE / 2.0))
    half = normal * float(rest.deviation.mean())
    if n > 1:
        spread = (
            float(t.isf(SIGNIFICANCE / 2.0, n - 1))
            * float(rest.breakaways.std(ddof=1))
            / np.sqrt(n)
        )
        half = max(half, float(spread))
    return float(rest.breakaways.mean()), float(np.hypot(half, normal * rest.common))
