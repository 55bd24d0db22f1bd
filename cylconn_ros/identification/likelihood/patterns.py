"""Tests whether the residuals of a law show a pattern over rate, direction, load, place or time.

The windows are sorted by each quantity and divided into groups of equal size. If the law holds, the
mean residuals of the groups differ by noise only (one-way analysis of variance). A pattern counts
if it is significant, all tests taken together, and exceeds MATERIAL of the traction.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.identification.likelihood.contact_loads import Calibrated
from cylconn_ros.identification.likelihood.kinetic import (
    KineticFit,
    factors,
    friction_of,
)
from cylconn_ros.identification.likelihood.law import slip

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
    errors: Array  # (groups,) standard errors of the means, N
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


class Residuals(NamedTuple):
    """Residual friction of n windows, and the quantities over which it is tested."""

    along: Array  # (n,) along the slip, N
    across: Array  # (n,) across it, N
    over: dict[str, Array]  # (n,) by quantity, with its unit
    traction: float  # median, N


def quantities(data: Calibrated, fitted: KineticFit) -> dict[str, Array]:
    """Return the quantities (n,) over which residuals are tested."""
    w, law = data.windows, fitted.law
    size, cos, sin = slip(w.rates, law.radius)
    return {
        "slip rate [m/s]": size,
        "slide [m/s]": w.rates[:, 0],
        "direction of slip [rad]": np.arctan2(sin, cos),
        "normal force [N]": data.normal(law.bending, law.preload),
        "place in the slot [m]": w.places[:, 0],
        "angle [rad]": w.places[:, 1],
        "time [s]": w.time,
    }


def residuals_of(data: Calibrated, fitted: KineticFit) -> Residuals:
    """Return the residuals of a fit in newtons; moments are divided by R."""
    law = fitted.law
    force = (data.force - friction_of(data, law)) / [1.0, law.radius]
    _, cos, sin = slip(data.windows.rates, law.radius)
    return Residuals(
        cos * force[:, 0] + sin * force[:, 1],
        cos * force[:, 1] - sin * force[:, 0],
        quantities(data, fitted),
        float(np.median(np.hypot(data.force[:, 0], data.force[:, 1] / law.radius))),
    )


def find_patterns(data: Calibrated, fitted: KineticFit, found: Residuals) -> list[Pattern]:
    """Test the residuals of a fit; the patterns in the order of their significance."""
    across = float(np.abs(data.windows.rates[:, 1]).max()) * fitted.law.radius
    forces = {"along": found.along}
    if across > 0.05 * float(np.abs(data.windows.rates[:, 0]).max()):
        forces["across"] = found.across
    weights = np.linalg.norm(factors(data, fitted.law)[0], axis=2)
    return group_tests(
        forces, fitted.residuals, weights, found.over, found.traction, len(fitted.free)
    )


def group_tests(
    forces: Mapping[str, Array],
    residuals: Array,
    weights: Array,
    over: Mapping[str, Array],
    limit: float,
    used: int,
) -> list[Pattern]:
    """Test whether residuals depend on a quantity.

    Args:
        forces: (n,) residual forces by component, N.
        residuals: (n, components) the same over their deviations.
        weights: (n, components) inverse deviations.
        over: (n,) values by quantity; one that does not change is not tested.
        limit: traction of which MATERIAL counts, N.
        used: number of fitted parameters.

    Returns the patterns in the order of their significance; none of too few residuals.
    """
    groups = min(GROUPS, len(residuals) // MIN_GROUP)
    if groups < 2:
        return []
    values = {
        name: value
        for name, value in over.items()
        if np.ptp(value) > MIN_SPREAD * max(float(np.abs(value).mean()), 1e-9)
    }
    found = []
    for row, (component, force) in enumerate(forces.items()):
        for name, value in values.items():
            parts = np.array_split(np.argsort(value, kind="stable"), groups)
            p = _probability([residuals[part, row] for part in parts], used)
            square = np.square(weights[:, row])
            means = np.array([np.average(force[part], weights=square[part]) for part in parts])
            errors = np.array(
                [
                    np.sqrt(np.average(np.square(force[part] - mean), weights=square[part]))
                    / np.sqrt(len(part))
                    for part, mean in zip(parts, means, strict=True)
                ]
            )
            big = float(np.abs(means).max()) > MATERIAL * limit
            tests = len(forces) * len(values)
            middles = np.array([value[part].mean() for part in parts])
            rejected = big and p < ALARM / tests
            found.append(Pattern(name, component, middles, means, errors, p, rejected))
    return sorted(found, key=lambda one: one.p)


def unexplained_spread(data: Calibrated, fitted: KineticFit) -> str:
    """Say by how much residuals without a pattern exceed the noise; empty if they do not.

    The intervals include such a spread only if the noise of neighbouring samples, from which the
    loads are calibrated, is the whole noise.
    """
    law = fitted.law
    e = (data.force - friction_of(data, law)) / [1.0, law.radius]
    usual = float(np.median(np.hypot(data.force[:, 0], data.force[:, 1] / law.radius)))
    share = float(np.sqrt(np.median(np.square(e).sum(axis=1)))) / max(usual, 1e-300)
    if fitted.misfit < MAX_MISFIT or share < MAX_SPREAD:
        return ""
    return (
        f"residuals are {100.0 * share:.0f} % of the traction and {np.sqrt(fitted.misfit):.1f} "
        f"times the noise that neighbouring samples show (expected 1, at most "
        f"{np.sqrt(MAX_MISFIT):.1f}): either twists are smoothed, or friction varies in a way that "
        "no term describes; record unfiltered twists or take them from the poses (--bandwidth 50), "
        "and repeat the motion to see whether the residuals repeat"
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
