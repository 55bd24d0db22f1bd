"""Radial force and bending moment of windows, without the bias by noise, and their calibration.

Noise n increases absolute values, on average to |F + n| = |F| + var_t/(2 |F|), with var_t its
variance across F; this bias is subtracted.

A load that carries noise weakens the friction that is regressed on it. The loads of a recording
have a mean and a covariance T beyond their noise N; the load expected given the measured one x is
``m + T (T + N)^-1 (x - m)``, and friction regressed on it is unbiased (regression calibration). So
a load that does not change beyond its noise explains nothing, whatever the noise looks like. The
mean depends on the slip, the other cause of friction in the law: a motion that is slow where the
load is small has too much of it there otherwise, which the slow windows show as less friction.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.identification.forces.windows import Windows
from cylconn_ros.identification.likelihood import windows_kernel
from cylconn_ros.identification.likelihood.law import slip

Array = NDArray[np.float64]

MIN_SIGNAL_TO_NOISE = 9.0  # mean square of a force over that of its noise
BEYOND = 3.0  # standard deviations by which a mean square must exceed that of the noise
MIN_DEVIATIONS = 3.0  # standard deviations by which a force must differ from zero
WINDOWS_EACH = 8  # for each parameter of the mean load at a slip; fewer: one mean
SLOW = 0.25  # of the median slip rate: below it the mean load changes most with the rate


@dataclasses.dataclass(frozen=True)
class ContactLoads:
    """Radial force and bending moment of n windows, without the bias by noise.

    Attributes
    ----------
        radial, moment: (n,) N, N.m.
        gradient: (n, 2, 6) derivatives of both with respect to the wrench.
        signal_to_noise: mean square of each over that of its noise.
    """

    radial: Array
    moment: Array
    gradient: Array
    signal_to_noise: tuple[float, float]

    @classmethod
    def of(cls, w: Windows) -> ContactLoads:
        """Compute the loads of windows."""
        gradient = np.zeros((len(w), 2, 6))
        values, ratios = [], []
        for row, at in enumerate((slice(1, 3), slice(4, 6))):
            vector, cov = w.wrench[:, at], w.covariance[:, at, at]
            size = np.maximum(np.linalg.norm(vector, axis=1), 1e-300)
            u = vector / size[:, None]
            total = np.trace(cov, axis1=1, axis2=2)
            across = total - np.einsum("ni,nij,nj->n", u, cov, u)
            square, white = float(np.square(size).mean()), max(float(total.mean()), 1e-300)
            ratios.append(square / white)
            if ratios[-1] >= MIN_SIGNAL_TO_NOISE:
                values.append(np.sqrt(np.maximum(size**2 - across, 0.0)))
                gradient[:, row, at] = u
            else:  # dominated by noise: only its mean square is significant
                significant = square - white > BEYOND * white / np.sqrt(len(w))
                values.append(np.full(len(w), np.sqrt(square - white) if significant else 0.0))
        return cls(values[0], values[1], gradient, (ratios[0], ratios[1]))


@dataclasses.dataclass(frozen=True)
class Calibrated:
    """Data of a fit: what is known of n windows before the friction law is.

    Attributes
    ----------
        windows: the windows.
        loads: (n, 2) Fr and Mbend expected given the measured ones; N, N.m. Fr includes a commanded
            preload, which presses as it does and is known.
        force: (n, 2) f1f and m1f without what their noise shares with that of the loads.
        own: (n, 2, 2) covariance of ``force``.
        rest: (n, 2, 2) covariance of ``loads``. shared: (n, 2, 2) of ``loads`` and ``force``.
    """

    windows: Windows
    loads: Array
    force: Array
    own: Array
    rest: Array
    shared: Array

    def __len__(self) -> int:
        return len(self.force)

    @classmethod
    def of(cls, w: Windows, loads: ContactLoads, radius: float) -> Calibrated:
        """Calibrate the loads of windows; ``radius`` R, m, with which a spin counts as slip."""
        x = np.stack([loads.radial, loads.moment], axis=1)
        across = loads.gradient @ w.covariance  # (n, 2, 6)
        noise = across @ loads.gradient.transpose(0, 2, 1)
        both = across[:, :, [0, 3]]  # (n, load, force)
        mean, true, unit = _moments(x, noise, _columns(w.rates, radius))
        inverse = np.linalg.inv((true + noise) / np.outer(unit, unit) + 1e-15 * np.eye(2))
        inverse /= np.outer(unit, unit)
        gain = true @ inverse  # (n, 2, 2)
        off = x - mean
        back = both.transpose(0, 2, 1) @ inverse  # (n, force, load)
        wrench = w.wrench[:, [0, 3]] - np.einsum("nij,nj->ni", back, off)
        own = w.covariance[:, [[0], [3]], [0, 3]] - back @ both
        return cls(
            windows=w,
            loads=mean + np.einsum("nij,nj->ni", gain, off) + w.pressed[:, None] * [1.0, 0.0],
            force=wrench,
            own=own,
            rest=true - gain @ true,
            shared=gain @ both,
        )

    def bending(self, first: float) -> Array:
        """Return 2/L (n,), 1/m, if it is ``first`` at the slide at which the overlap is L0."""
        return self.windows.contact.bending(first, self.windows.places[:, 0])

    def bendings(self, first: float) -> tuple[Array, Array]:
        """Return 2/L (n,) and its derivatives (n,) by ``first``."""
        slope = self.windows.contact.slope(first, self.windows.places[:, 0])
        return self.bending(first), slope

    def normal(self, bending: float, preload: float) -> Array:
        """Return FN (n,), N, of a law with ``bending`` 2/L0; not its absolute value."""
        return np.asarray(self.loads[:, 0] + self.bending(bending) * self.loads[:, 1] + preload)

    @functools.cached_property
    def table(self) -> Array:
        """The windows as a table (n, COLUMNS) of windows_kernel.py."""
        w, found = self.windows, np.empty((len(self), windows_kernel.COLUMNS))
        upper = ([0, 0, 1], [0, 1, 1])
        for at, part in (
            (windows_kernel.V, w.rates), (windows_kernel.FR, self.loads),
            (windows_kernel.F1, self.force), (windows_kernel.OWN, self.own[:, upper[0], upper[1]]),
            (windows_kernel.REST, self.rest[:, upper[0], upper[1]]),
            (windows_kernel.SHARED, self.shared.reshape(-1, 4)),
            (windows_kernel.NOISE, w.rate_noise), (windows_kernel.PLACE, w.places[:, :1]),
        ):  # fmt: skip
            found[:, at : at + part.shape[1]] = part
        return found

    @functools.cached_property
    def sizes(self) -> tuple[float, float, float, float]:
        """Mean Fr and Mbend, and root mean squares of the rates."""
        radial, moment = self.loads.mean(axis=0)
        slide, spin = np.sqrt(np.square(self.windows.rates).mean(axis=0))
        return float(radial), float(moment), float(slide), float(spin)

    def take(self, rows: NDArray) -> Calibrated:
        """Return the windows ``rows`` (indices or a mask)."""
        names = ("loads", "force", "own", "rest", "shared")
        parts = {name: getattr(self, name)[rows] for name in names}
        return dataclasses.replace(self, windows=self.windows.take(rows), **parts)


def _columns(rates: Array, radius: float) -> Array:
    """Return the functions (n, k) of the slip in which mean loads are linear.

    They are functions of its direction and of its rate, which change most where it is slow.
    """
    size, cos, sin = slip(rates, radius)
    slow = size / (size + SLOW * float(np.median(size)) + 1e-300)
    columns = [np.ones(len(rates)), slow, slow * slow, cos, sin, cos * cos]
    if len(rates) < WINDOWS_EACH * len(columns):
        columns = columns[:1]
    return np.stack(columns, axis=1)


def _moments(x: Array, noise: Array, design: Array) -> tuple[Array, Array, Array]:
    """Return the means (n, 2) of loads, their covariance (2, 2) beyond noise, and units (2,).

    ``noise`` (n, 2, 2) differs between windows: 125 times in force from the longest to the shortest
    ones of a recording. Each window has the weight of the inverse of its variance, else a few short
    ones decide.
    """
    # Scaled, since a force and a moment differ in size and unit.
    unit = np.maximum(np.sqrt(x.var(axis=0)), 1e-12 * np.abs(x).max())
    unit = np.where(unit > 0.0, unit, 1.0)  # loads that do not press are zero
    scaled, white = x / unit, noise / np.outer(unit, unit)
    own = np.diagonal(white, axis1=1, axis2=2)
    weights = 1.0 / np.where(own > 0.0, own, 1.0)
    for _ in range(2):  # at first as if the loads did not change
        root = np.sqrt(weights / weights.mean(axis=0))
        mean = np.empty_like(x)
        for k in range(2):
            by = root[:, k : k + 1]
            mean[:, k] = design @ (
                np.linalg.pinv(by * design, rcond=1e-6) @ (by[:, 0] * scaled[:, k])
            )
        rest = root * (scaled - mean)
        total = rest.T @ rest / (len(x) - design.shape[1])
        usual = (root[:, :, None] * white * root[:, None, :]).mean(axis=0)
        sizes, axes = np.linalg.eigh(total - usual)
        # A variance that may be that of the noise is none.
        least = BEYOND * np.sqrt(2.0 / len(x)) * np.einsum("ik,ij,jk->k", axes, usual, axes)
        sizes = np.where(sizes > least, sizes, 0.0)
        true = (axes * sizes) @ axes.T
        variance = np.diag(true) + own
        weights = 1.0 / np.where(variance > 0.0, variance, 1.0)
    return mean * unit, true * np.outer(unit, unit), unit


def well_above_noise(w: Windows, loads: ContactLoads) -> NDArray[np.bool_]:
    """Return the windows (n,) whose radial force and bending moment are well above their noise.

    Near zero the mean of |F + n| is not |F| + var_t/(2 |F|). The test uses the neighbours of a
    window, so that its own noise does not select it. A force that is dominated by noise throughout
    is not tested.
    """
    good = np.ones(len(w), dtype=np.bool_)
    near = np.abs(np.arange(len(w))[:, None] + [-1, 1])
    near = np.where(near < len(w), near, 2 * len(w) - 2 - near)  # at an end: one neighbour twice
    for at, ratio in (
        (slice(1, 3), loads.signal_to_noise[0]),
        (slice(4, 6), loads.signal_to_noise[1]),
    ):
        if ratio >= MIN_SIGNAL_TO_NOISE:
            neighbours = w.wrench[near, at].mean(axis=1)
            variance = 0.5 * np.trace(w.covariance[:, at, at], axis1=1, axis2=2)
            good &= np.square(neighbours).sum(axis=1) > MIN_DEVIATIONS**2 * variance
    return good
