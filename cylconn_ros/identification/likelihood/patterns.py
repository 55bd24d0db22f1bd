"""Tests whether the residuals of a law show a pattern over rate, direction, load, place or time.

The windows are sorted by each quantity and divided into groups of equal size. If the law holds, the
mean residuals of the groups differ by noise only (one-way analysis of variance). A pattern counts
if it is significant, all tests taken together, and exceeds MATERIAL of the traction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.identification.likelihood.contact_loads import Calibrated
from cylconn_ros.identification.likelihood.kinetic import KineticFit, factors
from cylconn_ros.identification.likelihood.law import friction, slip

Array = NDArray[np.float64]

GROUPS = 8
MIN_GROUP = 5  # windows
ALARM = 1e-3  # probability that a law that holds is rejected
MATERIAL = 0.01  # of the median traction: smallest pattern that counts
MAX_MISFIT = 2.5  # mean squared residual over that of the noise
MAX_SPREAD = 0.05  # of the median traction: residuals that the misfit may exceed
MIN_SPREAD = 1e-3  # of a quantity, relative; below it does not change


class Pattern(NamedTuple):
    """Mean residuals of the groups of windows by one quantity."""

    over: str  # quantity, with its unit
    component: str  # "along" or "across" the slip
    middles: Array  # (groups,) mean of the quantity
    means: Array  # (groups,) mean residual, N
    p: float  # probability of such means if the law holds
    rejected: bool

    def describe(self) -> str:
        """Say where the residual is largest."""
        k = int(np.abs(self.means).argmax())
        return (
            f"residual {self.component} the slip over {self.over}: {self.means[k]:+.3g} N near "
            f"{self.middles[k]:.3g}, {self.means.min():.3g} to {self.means.max():.3g} N in all "
            f"(p = {self.p:.1g})"
        )


def quantities(data: Calibrated, fitted: KineticFit) -> dict[str, Array]:
    """Return the quantities (n,) over which residuals are tested."""
    w, law = data.windows, fitted.law
    size, cos, sin = slip(w.rates, law.radius)
    return {
        "slip rate [m/s]": size,
        "slide [m/s]": w.rates[:, 0],
        "direction of slip [rad]": np.arctan2(sin, cos),
        "normal force [N]": data.loads @ [1.0, law.bending] + law.preload,
        "place in the slot [m]": w.places[:, 0],
        "angle [rad]": w.places[:, 1],
        "time [s]": w.time,
    }


def find_patterns(data: Calibrated, fitted: KineticFit) -> list[Pattern]:
    """Test the residuals of a fit; the patterns in the order of their significance."""
    n = len(data)
    groups = min(GROUPS, n // MIN_GROUP)
    if groups < 2:
        return []
    law, r = fitted.law, fitted.residuals
    force = (data.force - friction(law, data.windows.rates, data.loads)) / [1.0, law.radius]
    _, cos, sin = slip(data.windows.rates, law.radius)
    turned = np.stack(
        [cos * force[:, 0] + sin * force[:, 1], cos * force[:, 1] - sin * force[:, 0]]
    )
    limit = float(np.median(np.hypot(data.force[:, 0], data.force[:, 1] / law.radius)))
    values = {
        name: value
        for name, value in quantities(data, fitted).items()
        if np.ptp(value) > MIN_SPREAD * max(float(np.abs(value).mean()), 1e-9)
    }
    across = float(np.abs(data.windows.rates[:, 1]).max()) * law.radius
    components = ["along"]
    if across > 0.05 * float(np.abs(data.windows.rates[:, 0]).max()):
        components.append("across")
    found = []
    weights = factors(data, law)[0]
    for row, component in enumerate(components):
        weight = np.linalg.norm(weights[:, row], axis=1)
        for name, value in values.items():
            parts = np.array_split(np.argsort(value, kind="stable"), groups)
            p = _probability([r[part, row] for part in parts], len(fitted.free))
            means = np.array(
                [np.average(turned[row, part], weights=weight[part] ** 2) for part in parts]
            )
            big = float(np.abs(means).max()) > MATERIAL * limit
            tests = len(components) * len(values)
            middles = np.array([value[part].mean() for part in parts])
            found.append(Pattern(name, component, middles, means, p, big and p < ALARM / tests))
    return sorted(found, key=lambda one: one.p)


def unexplained_spread(data: Calibrated, fitted: KineticFit) -> str:
    """Say by how much residuals without a pattern exceed the noise; empty if they do not.

    The intervals include such a spread only if the noise of neighbouring samples, from which the
    loads are calibrated, is the whole noise.
    """
    law = fitted.law
    e = (data.force - friction(law, data.windows.rates, data.loads)) / [1.0, law.radius]
    usual = float(np.median(np.hypot(data.force[:, 0], data.force[:, 1] / law.radius)))
    share = float(np.sqrt(np.median(np.square(e).sum(axis=1)))) / max(usual, 1e-300)
    if fitted.misfit < MAX_MISFIT or share < MAX_SPREAD:
        return ""
    return (
        f"residuals are {100.0 * share:.0f} % of the traction and {np.sqrt(fitted.misfit):.1f} "
        f"times the noise that neighbouring samples show (expected 1, at most "
        f"{np.sqrt(MAX_MISFIT):.1f}): either twists are smoothed, or friction varies in a way that "
        "no term describes; record unfiltered twists, and repeat the motion to see whether the "
        "residuals repeat"
    )


def _probability(groups: list[Array], used: int) -> float:
    """Return the probability of means of ``groups`` that differ from zero as much as these."""
    from scipy.stats import f

    sizes = np.array([len(g) for g in groups])
    means = np.array([g.mean() for g in groups])
    within = sum(float(np.square(g - g.mean()).sum()) for g in groups)
    freedom = max(int(sizes.sum()) - len(groups) - used, 2)
    between = float((sizes * means**2).sum()) / len(groups)
    return float(f.sf(between / max(within / freedom, 1e-300), len(groups), freedom))
