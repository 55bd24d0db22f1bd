"""Static friction: what sticking has borne, and the traction at which it gave way.

While it sticks, P/FN is at most mu_s: the greatest is a lower bound. Where rest turns into slip,
the forces of the rest before are extrapolated, in time, to the break, and P/FN there is mu_s. The
break itself is where the slip, going back from where it shows, comes to nothing.
"""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.identify.cubics import noise
from cylconn_ros.identify.intervals import Measured
from cylconn_ros.identify.kinetic import Fitted, Law, of_vector
from cylconn_ros.identify.segments import SHORTEST, Stretch, slip_rate, threshold
from cylconn_ros.identify.windows import OWN, impulses, windows

Array = NDArray[np.float64]

RISE = 0.1  # s within which slip follows rest at a break
LONGEST = 512  # intervals of rest that are extrapolated
RISING = 64  # intervals of slip by which the break is found, at most
FEWEST = 6  # at least
FAST = 4.0  # times the threshold: slip up to there finds the break
EARLY, HIDDEN = 0.25, 0.7  # of the difference between two times of a break
CHANCE = 0.05


@dataclasses.dataclass(frozen=True)
class Static:
    """What a recording tells of static friction.

    Attributes
    ----------
        ratio: (n,) P/FN in the windows of rest.
        bound: mu_s is at least this, with 95 % confidence; NaN where it never rested.
        windows: n.
        breaks: (m,) P/FN at the breaks.
        deviation: (m,) their standard deviations, of their own forces and times.
        common: standard deviation that the parameters found give to the mean of ``breaks``.
        at: (m,) times of the breaks, s.
        normal, traction: (n + m,) N, of windows and breaks, for the picture.
    """

    ratio: Array
    bound: float
    windows: int
    breaks: Array
    deviation: Array
    common: float
    at: Array
    normal: Array
    traction: Array


class Break(NamedTuple):
    """Forces where rest gave way."""

    time: float
    wrench: Array  # (6,)
    covariance: Array  # (6, 6)


def static(measured: Measured, found: list[Stretch], fitted: Fitted) -> Static:
    """Look at the stretches of rest, with the radius, L and FCint of the fit."""
    law = fitted.law
    rest = windows(measured, [s for s in found if not s.slips])
    ratio, own, by = _ratios(rest.wrench, rest.covariance, law, fitted)
    bound = float("nan")
    if len(ratio):
        from scipy.stats import norm

        deviation = np.sqrt(own + np.square(by).sum(axis=1))
        sure = ratio - norm.isf(CHANCE / len(ratio)) * deviation
        bound = max(float(sure.max()), 0.0)
    breaks = [
        b
        for before, after in pairwise(found)
        if not before.slips and after.slips
        for b in [_break(measured, before, after, law.radius)]
        if b is not None
    ]
    wrench = np.array([b.wrench for b in breaks]).reshape(-1, 6)
    covariance = np.array([b.covariance for b in breaks]).reshape(-1, 6, 6)
    at_break, own, by = _ratios(wrench, covariance, law, fitted)
    common = float(np.linalg.norm(by.mean(axis=0))) if breaks else 0.0
    both = np.vstack([rest.wrench, wrench])
    return Static(
        ratio,
        bound,
        len(rest),
        at_break,
        np.sqrt(own),
        common,
        np.array([b.time for b in breaks]),
        _normal(both, law),
        _traction(both, law),
    )


def _normal(wrench: Array, law: Law) -> Array:
    return law.normal(
        np.hypot(wrench[..., 1], wrench[..., 2]), np.hypot(wrench[..., 4], wrench[..., 5])
    )


def _traction(wrench: Array, law: Law) -> Array:
    return np.asarray(np.hypot(wrench[..., 0], wrench[..., 3] / law.radius))


def _ratio(wrench: Array, law: Law) -> Array:
    return _traction(wrench, law) / np.maximum(_normal(wrench, law), 1e-300)


def _ratios(
    wrench: Array, covariance: Array, law: Law, fitted: Fitted
) -> tuple[Array, Array, Array]:
    """P/FN (n,), its own variance (n,), and its changes by uncorrelated parameter errors (n, k)."""
    size = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    slopes = np.zeros((len(wrench), 6))
    for k in range(6):
        step = np.zeros_like(wrench)
        step[:, k] = np.maximum(size[:, k], 1e-12)
        change = _ratio(wrench + step, law) - _ratio(wrench - step, law)
        slopes[:, k] = change / (2.0 * step[:, k])
    own = np.einsum("ni,nij,nj->n", slopes, covariance, slopes)
    sizes, turned = np.linalg.eigh(fitted.covariance)
    by = np.zeros((len(wrench), len(sizes)))
    for column, direction in enumerate((turned * np.sqrt(np.maximum(sizes, 0.0))).T):
        step = np.zeros(4)
        step[list(fitted.free)] = direction
        up, down = of_vector(law.vector + step), of_vector(law.vector - step)
        by[:, column] = 0.5 * (_ratio(wrench, up) - _ratio(wrench, down))
    return _ratio(wrench, law), own, by


def _break(measured: Measured, before: Stretch, after: Stretch, radius: float) -> Break | None:
    """The forces where the rest ``before`` gave way to the slip ``after``; None where unclear."""
    gap = slice(before.last, after.first)
    if not measured.usable[gap].all() or measured.dt[gap].sum() > RISE:
        return None
    time, spread = _when(measured, after, radius)
    last = before.last
    while last > before.first and measured.time[last - 1] > time - measured.step:
        last -= 1
    size = min(last - before.first, LONGEST)
    while size >= SHORTEST:
        part = Stretch(last - size, last, False)
        ts, p, _ = impulses(measured, part)
        white = noise(ts, p)
        x = (ts - time) / (ts[-1] - ts[0])
        design = np.vander(x, 3, increasing=True)
        solve = np.linalg.pinv(design)
        rest = p - design @ (solve @ p)
        freedom = len(p) - 3
        allowed = 1.0 + 3.0 * np.sqrt(2.0 / freedom + OWN / len(p))
        smooth = np.square(rest).sum(axis=0) <= allowed * freedom * np.diag(white)
        if smooth.all() or size < 2 * SHORTEST:
            long = ts[-1] - ts[0]
            slope, bend = solve[1] / long, 2.0 * solve[2] / long**2
            forces, growth = slope @ p, bend @ p
            cov = white * (slope @ slope) + np.outer(growth, growth) * spread**2
            return Break(time, forces, cov)
        size //= 2
    return None


def _when(measured: Measured, after: Stretch, radius: float) -> tuple[float, float]:
    """When slip began, and the standard deviation.

    Slip grows as t - t0 where the traction drops at the break, as its square where the load goes on
    rising, and between them where it drops by and by; its first part is hidden in noise. Both are
    fitted to what shows first: the break is between them, nearer to the second, earlier one, and
    HIDDEN of their difference its error.
    """
    _, deviation = slip_rate(measured, radius)
    last = after.first + FEWEST
    s = measured.rates[after.first : after.last] * [1.0, radius]
    fast = np.flatnonzero(np.hypot(s[:, 0], s[:, 1]) > FAST * threshold(measured, deviation))
    last = max(last, after.first + (int(fast[0]) if len(fast) else len(s)))
    last = min(last, after.last, after.first + RISING)
    s, t = s[: last - after.first], measured.time[after.first : last]
    to = s.mean(axis=0) / np.linalg.norm(s.mean(axis=0))
    latest = float(measured.time[after.first - 1])
    begins, own = [], []
    for power in (1.0, 2.0):
        found, spread = _onset(t, s @ to, power, deviation)
        begins.append(min(max(found, latest - RISE), latest))
        own.append(spread)
    begin = begins[1] + EARLY * (begins[0] - begins[1])
    spread = float(np.hypot(HIDDEN * (begins[0] - begins[1]), np.mean(own)))
    return begin, max(spread, 0.5 * measured.step)


def _onset(t: Array, s: Array, power: float, deviation: float) -> tuple[float, float]:
    """Fit s = (a (t - t0))^power: t0 and its standard deviation."""
    y = np.sign(s) * np.abs(s) ** (1.0 / power)
    weight = np.abs(s) ** (1.0 - 1.0 / power)  # noise of y: that of s over ds/dy
    design = np.column_stack([np.ones_like(t), t - t[0]]) * weight[:, None]
    values = np.linalg.lstsq(design, y * weight, rcond=None)[0]
    rest = float(np.square(y * weight - design @ values).sum())
    if values[1] <= 0.0:
        return float(t[0]), 0.0
    noisy = max(rest / max(len(t) - 2, 1), (deviation / power) ** 2)
    cov = noisy * np.linalg.pinv(design.T @ design)
    ahead = -values[0] / values[1]
    slope = np.array([1.0, ahead]) / values[1]
    return float(t[0] + ahead), float(np.sqrt(slope @ cov @ slope))


def interval(rest: Static) -> tuple[float, float]:
    """Mean of the breaks and the half of its 95 % interval; NaN without one.

    Several breaks have the interval of their spread (Student's t), unless that of one break's error
    is wider: how slip begins is much the same in all of them. So is the parameters' error.
    """
    from scipy.stats import norm, t

    n = len(rest.breaks)
    if n == 0:
        return float("nan"), float("nan")
    normal = float(norm.isf(CHANCE / 2.0))
    half = normal * float(rest.deviation.mean())
    if n > 1:
        spread = float(t.isf(CHANCE / 2.0, n - 1)) * float(rest.breaks.std(ddof=1)) / np.sqrt(n)
        half = max(half, float(spread))
    return float(rest.breaks.mean()), float(np.hypot(half, normal * rest.common))
