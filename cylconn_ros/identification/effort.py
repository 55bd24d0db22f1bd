"""Identification of one axis from positions and a known drive effort: inertia and friction.

    effort = M q'' + Fv q' + Fc sign(q') + offset

Friction of one axis that is neither weighed nor loaded across is a single number Fc = mu FN0.
Positions are not differentiated: the equation is multiplied by test functions w(t) that vanish with
two derivatives at the ends of a window, and integrated by parts,

    int w effort = M int w'' q - Fv int w' q + Fc int w sign(q') + offset int w

(modulating functions, Shinbrot 1957). Windows overlap by half; the intervals use the covariance of
the scores of neighbouring windows. The delay of the effort against the position is estimated.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.errors import IdentifyError
from cylconn_ros.identification.likelihood.patterns import Pattern, group_tests

Array = NDArray[np.float64]

NAMES = ("mass", "c1", "preload_friction", "offset")
UNITS = ("kg", "N.s/m", "N", "N")
WINDOW = 0.2  # s, usual length of a test function
MIN_WINDOWS = 20
STEPS = ((0, 2), (0, 1, 2), (0, 1, 2, 3))  # parameters, with one more term at a time
LAGS = 4  # windows whose scores may depend on each other
POWER = 4  # of the test function (1 - x^2)^4
SMOOTH = 8  # samples over which the sign of the rate is taken
MAX_HALF_WIDTH = 0.5  # of a value, for the offset of Fc; a parameter known worse is withheld


@dataclasses.dataclass(frozen=True)
class AxisRecording:
    """Positions and efforts of an axis.

    Attributes
    ----------
        time: (n,) s, ascending.
        position: (n,) m or rad.
        effort: (n,) N or N.m, in force from its time until the next one.
    """

    time: Array
    position: Array
    effort: Array


class AxisWindows(NamedTuple):
    """Means of n windows in which the axis moves in one direction.

    ``alone`` marks windows that share no sample with each other.
    """

    design: Array  # (n, 4) acceleration, rate, direction, 1
    effort: Array  # (n,) N or N.m
    time: Array  # (n,) s
    position: Array  # (n,) m or rad
    alone: NDArray[np.bool_]  # (n,)


@dataclasses.dataclass(frozen=True)
class AxisEstimate:
    """Estimates of an axis.

    Attributes
    ----------
        value, low, high: (4,) in the order of NAMES, with 95 % intervals.
        windows: number of windows.
        residual: root of the mean square of the residual effort of a window.
        delay: of the effort against the position, s.
        moving: the windows.
        residuals: (windows,) residual effort, N or N.m.
        patterns: residuals over rate, position and time, most significant first.
        steps: terms and the value, low, high (k, 3) of their parameters in the order of NAMES, from
            inertia and Coulomb friction alone to the whole model.
    """

    value: Array
    low: Array
    high: Array
    windows: int
    residual: float
    delay: float
    moving: AxisWindows = dataclasses.field(repr=False)
    residuals: Array = dataclasses.field(repr=False)
    patterns: tuple[Pattern, ...] = dataclasses.field(repr=False)
    steps: tuple[tuple[tuple[str, ...], Array], ...] = dataclasses.field(repr=False)

    @property
    def accepted(self) -> bool:
        """Whether no residual pattern rejects the model."""
        return not any(one.rejected for one in self.patterns)

    def __getitem__(self, name: str) -> tuple[float, float, float]:
        """Return value and interval of a parameter."""
        k = NAMES.index(name)
        return float(self.value[k]), float(self.low[k]), float(self.high[k])

    def determined(self, name: str) -> bool:
        """Whether the model holds and the interval is narrow enough for the value to be of use."""
        value, low, high = self[name]
        size = abs(self["preload_friction"][0]) if name == "offset" else abs(value)
        return self.accepted and 0.5 * (high - low) <= MAX_HALF_WIDTH * size


def estimate_axis(
    recordings: Sequence[AxisRecording], window: float = WINDOW, delay: float | None = None
) -> AxisEstimate:
    """Estimate inertia and friction of an axis from one or several recordings together.

    Args:
        recordings: of the same axis; position and effort, the rate is not needed.
        window: length of a test function, s; the bandwidth of the estimate is about its inverse.
        delay: of the effort against the position, s; None: estimated.

    The values hold if the residuals show no pattern (``accepted``).

    Raises IdentifyError if there are too few windows of motion or they do not separate the
    parameters.
    """
    if delay is None:
        step = float(np.median(np.concatenate([np.diff(one.time) for one in recordings])))
        delays = step * np.linspace(-3.0, 3.0, 7)
        costs = [_spread(_windows(recordings, window, d)) for d in delays]
        k = int(np.clip(np.argmin(costs), 1, len(costs) - 2))
        curve = np.polyfit(delays[k - 1 : k + 2] / step, np.array(costs[k - 1 : k + 2]), 2)
        best = -curve[1] / (2.0 * curve[0]) * step if curve[0] > 0.0 else delays[k]
        delay = float(np.clip(best, delays[0], delays[-1]))
    moving = _windows(recordings, window, float(delay))
    steps = tuple((tuple(NAMES[k] for k in columns), _fit(moving, columns)[0]) for columns in STEPS)
    last, residuals = _fit(moving, STEPS[-1])
    return AxisEstimate(
        value=last[:, 0],
        low=last[:, 1],
        high=last[:, 2],
        windows=len(moving.effort),
        residual=float(np.sqrt(np.square(residuals).mean())),
        delay=float(delay),
        moving=moving,
        residuals=residuals,
        patterns=tuple(_patterns(moving, residuals, abs(float(last[2, 0])))),
        steps=steps,
    )


def _patterns(moving: AxisWindows, residuals: Array, friction: float) -> list[Pattern]:
    """Test the residuals of windows that share no sample.

    Not over the acceleration: an unrecorded force accelerates the axis, so that it is not
    independent of the residual.
    """
    r = residuals[moving.alone]
    over = {
        "rate [m/s or rad/s]": moving.design[:, 1],
        "position [m or rad]": moving.position,
        "time [s]": moving.time,
    }
    spread = max(float(np.sqrt(np.square(r).mean())), 1e-300)
    return group_tests(
        {"along": r},
        (r / spread)[:, None],
        np.full((len(r), 1), 1.0 / spread),
        {name: value[moving.alone] for name, value in over.items()},
        friction,
        len(NAMES),
    )


def _spread(moving: AxisWindows) -> float:
    """Return the mean square of the residual effort with all terms."""
    return float(np.square(_solve(moving.design, moving.effort)[1]).mean())


def _solve(design: Array, effort: Array) -> tuple[Array, Array, Array, Array]:
    """Return the least squares values, residuals, scaled design (n, k) and its scales (k,).

    Raises IdentifyError for too few windows, or if they do not separate the parameters.
    """
    if len(effort) < MIN_WINDOWS:
        raise IdentifyError(
            f"{len(effort)} windows of motion in one direction: at least {MIN_WINDOWS} are needed "
            "to identify an axis from its effort"
        )
    scale = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    j = design / scale
    if np.linalg.cond(j) > 1e4:
        raise IdentifyError(
            "the motion does not separate inertia, viscous and Coulomb friction and offset: it "
            "needs both directions, several rates and accelerations"
        )
    x = np.linalg.lstsq(j, effort, rcond=None)[0]
    return x / scale, effort - j @ x, j, scale


def _fit(moving: AxisWindows, columns: Sequence[int]) -> tuple[Array, Array]:
    """Fit the parameters ``columns``; return their values and intervals (k, 3), and residuals."""
    from scipy.stats import t

    x, r, j, scale = _solve(moving.design[:, list(columns)], moving.effort)
    bread = np.linalg.inv(j.T @ j)
    leverage = np.einsum("ni,ij,nj->n", j, bread, j)
    scores = j * (r / np.maximum(1.0 - leverage, 1e-3))[:, None]
    meat = scores.T @ scores
    for lag in range(1, LAGS):
        cross = scores[lag:].T @ scores[:-lag]
        meat += (1.0 - lag / LAGS) * (cross + cross.T)
    covariance = bread @ meat @ bread
    # The scores of a parameter that few windows determine estimate their spread badly: at least as
    # wide as with the same spread in all windows, neighbours correlated as they are.
    near = max(float(r[1:] @ r[:-1]) / max(float(r @ r), 1e-300), 0.0)
    least = float(r @ r) / max(len(r) - len(x), 1) * (1.0 + 2.0 * near) * np.diag(bread)
    wider = np.sqrt(np.maximum(least / np.maximum(np.diag(covariance), 1e-300), 1.0))
    deviation = np.sqrt(np.diag(covariance)) * wider / scale
    half = float(t.isf(0.025, max(len(r) // 2 - len(x), 1))) * deviation
    return np.stack([x, x - half, x + half], axis=1), r


def _windows(recordings: Sequence[AxisRecording], window: float, delay: float) -> AxisWindows:
    """Return the windows of all recordings; their times follow each other."""
    parts, end = [], 0.0
    for one in recordings:
        part = _windows_of(one, window, delay)
        parts.append(part._replace(time=part.time + end))
        end += float(one.time[-1]) if len(one.time) else 0.0
    return AxisWindows(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _windows_of(one: AxisRecording, window: float, delay: float) -> AxisWindows:
    """Return the windows of a recording."""
    step = float(np.median(np.diff(one.time)))
    points = max(int(window / step) + 1, 16)
    count = max((len(one.time) - points) // (points // 2) + 1, 0)
    rows = np.arange(count)[:, None] * (points // 2) + np.arange(points)
    if not count:
        none = np.zeros(0)
        return AxisWindows(np.zeros((0, 4)), none, none, none, np.zeros(0, dtype=np.bool_))
    t = one.time[rows]
    middle, half = 0.5 * (t[:, :1] + t[:, -1:]), 0.5 * (t[:, -1:] - t[:, :1])
    x = (t - middle) / half
    base = 1.0 - x * x
    w = base**POWER
    w1 = -2.0 * POWER * x * base ** (POWER - 1) / half
    w2 = (
        -2.0 * POWER * base ** (POWER - 1) + 4.0 * POWER * (POWER - 1) * x * x * base ** (POWER - 2)
    ) / half**2
    dt = np.gradient(t, axis=1)
    q = one.position[rows] - one.position[rows[:, :1]]
    sign = _direction(one)[rows]
    held = 0.5 * step  # an effort in force until the next sample acts half a period later
    effort = np.interp(t - delay, one.time + held, one.effort)
    total = (w * dt).sum(axis=1)
    columns = [(w2 * q * dt), (-w1 * q * dt), (w * sign * dt), (w * dt)]
    design = np.stack([c.sum(axis=1) for c in columns], axis=1) / total[:, None]
    moving = np.abs(sign).min(axis=1) > 0.5
    place = one.position[rows[:, points // 2]]
    found = AxisWindows(
        design,
        (w * effort * dt).sum(axis=1) / total,
        middle[:, 0],
        place,
        np.arange(count) % 2 == 0,
    )
    return AxisWindows(*(column[moving] for column in found))


def _direction(one: AxisRecording) -> Array:
    """Return the sign (n,) of the rate; 0 where the position hardly changes."""
    change = np.zeros(len(one.position))
    change[SMOOTH:-SMOOTH] = one.position[2 * SMOOTH :] - one.position[: -2 * SMOOTH]
    steps = np.diff(np.unique(np.round(one.position, 12)))
    quantum = float(steps.min()) if len(steps) else 0.0
    return np.asarray(np.where(np.abs(change) > 4.0 * quantum, np.sign(change), 0.0))
