"""Forces at the middles of windows: slopes of cubics in time, fitted to the measured impulses.

A wrench from differences of noisy twists is mostly noise, and the normal force is made of absolute
values, which turn noise into force. So impulses p(t) are fitted first, with a cubic over each
window of W intervals, by least squares: its slope at the middle has the noise 75 V / (W^3 h^2)
instead of 2 V / h^2. Windows share no measurement, so their errors are independent.

W is as large as the motion allows: the largest for which, in a stretch, what the cubics leave is
the noise that the shortest show; and two fifths of that, which makes what the cubic misses, W^4, a
small part of the noise.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.identify.cubics import TERMS, cut, fits, noise
from cylconn_ros.identify.intervals import Measured
from cylconn_ros.identify.segments import Stretch, chunks

Array = NDArray[np.float64]

SIZES = (6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024)
FEWEST = 24  # windows of a recording, if it is long enough
SHARE = 0.4  # of the largest windows in which a cubic leaves nothing but noise
TEST = 3.0  # standard deviations
OWN = 4.7  # over the number of samples: relative variance of the noise's own estimate
KINK = 8.0  # times the usual misfit, and more than a hundredth of the force: no smooth motion


@dataclasses.dataclass(frozen=True)
class Windows:
    """Forces and motion at the middles of windows.

    Attributes
    ----------
        time: (n,) s.
        wrench: (n, 6) f1f f2 f3 m1f m2 m3; N, N.m.
        covariance: (n, 6, 6) of ``wrench``.
        rates: (n, 2) slide m/s, spin rad/s.
        ends: (n, 2, 2) the same at the windows' two ends.
        rate_noise: (n, 2) their standard deviations.
        stretch: (n,) number of the stretch.
        intervals: (n,) how many intervals each stands for.
        kinks: windows left out because the motion in them is not smooth.
    """

    time: Array
    wrench: Array
    covariance: Array
    rates: Array
    ends: Array
    rate_noise: Array
    stretch: NDArray[np.intp]
    intervals: NDArray[np.intp]
    kinks: int

    def __len__(self) -> int:
        return len(self.time)

    def take(self, rows: NDArray) -> Windows:
        """Some of the windows."""
        names = [f.name for f in dataclasses.fields(self) if f.name != "kinks"]
        return dataclasses.replace(self, **{name: getattr(self, name)[rows] for name in names})


def windows(measured: Measured, found: list[Stretch]) -> Windows:
    """Cut stretches into windows and give the forces in them."""
    parts = []
    greatest = max(sum(stretch.size for stretch in found) // FEWEST - 1, SIZES[0])
    for number, stretch in enumerate(found):
        for chunk in chunks(stretch):
            parts.append(_of_chunk(measured, chunk, number, greatest))
    return _joined(parts)


def _joined(parts: list[Windows]) -> Windows:
    if not parts:
        none = np.zeros(0)
        index = np.zeros(0, dtype=np.intp)
        pairs, ends, cov = np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros((0, 6, 6))
        return Windows(none, np.zeros((0, 6)), cov, pairs, ends, pairs, index, index, 0)
    names = [f.name for f in dataclasses.fields(Windows) if f.name != "kinks"]
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return Windows(**columns, kinks=sum(part.kinks for part in parts))


def impulses(measured: Measured, chunk: Stretch) -> tuple[Array, Array, Array]:
    """Times, impulses and rates at the ends of a chunk's intervals: (n + 1,), (n + 1, 6 and 2)."""
    rows = slice(chunk.first, chunk.last)
    dt = measured.dt[rows]
    steps = np.vstack([np.zeros(6), measured.wrench[rows] * dt[:, None]])
    begin = max(chunk.first - 1, 0)
    rates = np.vstack([measured.rates[begin : begin + 1], measured.rates[rows]])
    time = measured.time[chunk.first] - dt[0] + np.r_[0.0, np.cumsum(dt)]
    return time, np.cumsum(steps, axis=0), rates


def _of_chunk(measured: Measured, chunk: Stretch, number: int, greatest: int) -> Windows:
    time, p, rates = impulses(measured, chunk)
    white, rate_white = noise(time, p), noise(time, rates)
    w = _size(time, p, np.diag(white), greatest)
    rows = cut(len(p), w)
    fit, inside = fits(time[rows]), p[rows]  # (windows, w + 1, 6)
    rest = fit.rest(inside)
    misfit = np.square(rest).sum(axis=1)
    usual = np.maximum(np.median(misfit, axis=0), (w + 1 - TERMS) * np.diag(white))
    smooth = (misfit <= KINK * usual + _negligible(inside)).all(axis=1)
    n = int(smooth.sum())
    gain = np.square(fit.slope).sum(axis=1)
    spread = np.sqrt(np.square(fit.value).sum(axis=1)[:, None] * np.diag(rate_white))
    return Windows(
        time=fit.middle[smooth],
        wrench=np.einsum("wk,wkc->wc", fit.slope, inside)[smooth],
        covariance=(gain[:, None, None] * white)[smooth],
        rates=np.einsum("wk,wkc->wc", fit.value, rates[rows])[smooth],
        ends=(fit.design[:, [0, -1]] @ (fit.solve @ rates[rows]))[smooth],
        rate_noise=spread[smooth],
        stretch=np.full(n, number, dtype=np.intp),
        intervals=np.full(n, w, dtype=np.intp),
        kinks=len(rows) - n,
    )


def _negligible(inside: Array) -> Array:
    """(windows, 6) misfits that a hundredth of the mean force or moment would make."""
    count, points, _ = inside.shape
    change = np.abs(inside[:, -1] - inside[:, 0]).reshape(count, 2, 3).max(axis=2)
    return np.repeat(points * (1e-2 * change) ** 2, 3, axis=1)


def _size(time: Array, p: Array, variance: Array, greatest: int) -> int:
    """The intervals of a window: as many as the motion allows, ``greatest`` at most."""
    n = len(p)
    greatest = min(greatest, max(n // 4 - 1, SIZES[0]))
    chosen = SIZES[0]
    for w in SIZES:
        if w + 1 > n or SHARE * w > greatest:
            break
        rows = cut(n, w)
        rest = fits(time[rows]).rest(p[rows])
        freedom = len(rows) * (w + 1 - TERMS)
        ratio = np.square(rest).sum(axis=(0, 1)) / np.where(variance > 0.0, freedom * variance, 1.0)
        if (ratio > 1.0 + TEST * np.sqrt(2.0 / freedom + OWN / n)).any():
            break
        chosen = w
    return min(max(int(SHARE * chosen), SIZES[0]), greatest)
