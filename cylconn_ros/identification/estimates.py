"""Estimates of friction parameters with intervals, and what a result says in words."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.identification import static
from cylconn_ros.identification.forces.contact import Contact
from cylconn_ros.identification.forces.intervals import Intervals
from cylconn_ros.identification.likelihood.excitation import BASE
from cylconn_ros.identification.likelihood.kinetic import KineticFit
from cylconn_ros.identification.likelihood.law import (
    COEFFICIENT,
    DECAY,
    DIRECTION,
    NAMES,
    VISCOUS,
)
from cylconn_ros.identification.likelihood.patterns import Pattern
from cylconn_ros.identification.likelihood.selection import TERMS, Choice

Array = NDArray[np.float64]

SIGNIFICANCE = 0.05
UNITS = dict(zip(NAMES, ("1", "N", "m", "m", "N.s/m", "N.m.s", "1", "N", "1", "s/m"), strict=True))


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A friction parameter: estimated with a 95 % interval, assumed, or unavailable; SI units.

    Attributes
    ----------
        name: as below ``friction`` in a scene.
        value: NaN if unavailable.
        low, high: ends of the 95 % interval; NaN if the parameter was not estimated.
        unit: ``1`` for a coefficient.
        note: why it was not estimated, or a remark.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str
    note: str

    def __post_init__(self) -> None:
        for name in ("value", "low", "high"):  # Python floats also for NumPy scalars
            object.__setattr__(self, name, float(getattr(self, name)))

    @property
    def found(self) -> bool:
        """Whether the parameter was estimated."""
        return bool(np.isfinite(self.low))


def estimates_of(
    fitted: KineticFit,
    coarse: Array,
    choice: Choice,
    known: Mapping[str, float],
    measured: Intervals,
) -> list[Estimate]:
    """Return the estimates of a fit with 95 % intervals.

    ``coarse`` (k,) is the change of the fitted vector with every second sample removed. c1 and cr1
    include the damping of the scene.
    """
    law, x = fitted.law, fitted.law.vector
    spread = fitted.half_widths(SIGNIFICANCE)
    # An error of second order in the period h is a third of the change from h to 2 h; doubled as a
    # safety margin.
    half = np.sqrt(spread**2 + (coarse * 2.0 / 3.0) ** 2 + fitted.systematic**2)
    term_of = {k: name for name, at in TERMS.items() for k in at}
    found = []
    for k, name in enumerate(NAMES):
        if k not in fitted.free:
            if k in BASE:
                value = {"preload": law.preload, "radius": law.radius}.get(
                    name, 2.0 / law.bending if law.bending > 0.0 else 0.0
                )
                note = "assumed, as given" if name in known else choice.held[name]
            else:
                value, note = 0.0, choice.left_out[term_of[k]]
                value = np.nan if k == DECAY else value
            found.append(Estimate(name, value, np.nan, np.nan, UNITS[name], note))
            continue
        width = half[fitted.free.index(k)]
        low, high = x[k] - width, x[k] + width
        note = ""
        if k in term_of and (other := choice.alternatives.get(term_of[k])):
            note = f"or else: {other}; this motion cannot tell which"
        if name == "overlap":
            found.append(_overlap(x[k], low, high, measured.contact))
        elif name in ("coefficient", "radius", "decay"):
            value, low, high = np.exp(x[k]), np.exp(low), np.exp(high)
            found.append(Estimate(name, value, low, high, UNITS[name], note))
        else:
            shift = 0.0
            if k in (VISCOUS, VISCOUS + 1):
                shift = float(getattr(measured.scene.damping, name))
            found.append(Estimate(name, x[k] + shift, low + shift, high + shift, UNITS[name], note))
    found += _by_direction(fitted, half)
    return found


def _by_direction(fitted: KineticFit, half: Array) -> list[Estimate]:
    """Return the coefficients of either direction if they differ."""
    if DIRECTION not in fitted.free or COEFFICIENT not in fitted.free:
        return []
    law = fitted.law
    i, j = fitted.free.index(COEFFICIENT), fitted.free.index(DIRECTION)
    sizes = np.sqrt(np.diag(fitted.covariance))
    found = []
    for name, sign in (("coefficient_positive", 1.0), ("coefficient_negative", -1.0)):
        share = 1.0 + sign * law.direction
        slope = np.zeros(len(fitted.free))
        slope[i], slope[j] = law.coefficient * share, sign * law.coefficient
        wider = np.max(half / np.maximum(sizes, 1e-300))
        width = float(wider * np.sqrt(slope @ fitted.covariance @ slope))
        value = law.coefficient * share
        found.append(Estimate(name, value, value - width, value + width, "1", ""))
    return found


def withheld(e: Estimate, reason: str) -> Estimate:
    """Return the estimate without its numbers."""
    if not e.found:
        return e
    return Estimate(e.name, np.nan, np.nan, np.nan, e.unit, reason)


def verdict(choice: Choice, patterns: Sequence[Pattern], doubts: Sequence[str]) -> list[str]:
    """Say in sentences whether to believe the numbers, and why."""
    if doubts:
        return [f"do not use: {doubt}" for doubt in doubts]
    rejected = [one for one in patterns if one.rejected]
    names = ", ".join(("Coulomb", *choice.terms))
    if rejected:
        lines = [f"do not use: no model of friction here describes the recording ({names} tried)"]
        return lines + [one.describe() for one in rejected[:3]]
    lines = [f"holds: {names}; no pattern remains over rate, direction, load, place and time"]
    lines += [
        f"not decided: {name} or {other}, which this motion cannot tell apart"
        for name, other in choice.alternatives.items()
    ]
    return lines


def _overlap(bending: float, low: float, high: float, contact: Contact) -> Estimate:
    """Convert 2/L to L; if the interval of 2/L contains zero, L has no upper bound."""
    if high <= 0.0:
        note = "the traction decreases with bending: the law does not apply"
        return Estimate("overlap", np.nan, np.nan, np.nan, "m", note)
    value = 2.0 / bending if bending > 0.0 else np.inf
    upper = 2.0 / low if low > 0.0 else np.inf
    note = "" if low > 0.0 else "the effect of bending may be zero"
    if not note and contact.sigma != 0.0:
        note = f"at the slide {contact.at:.4g} m"
    return Estimate("overlap", value, 2.0 / high, upper, "m", note)


def static_estimate(rest: static.StaticFriction) -> Estimate:
    """Return the static coefficient by the break-aways."""
    value, half = static.breakaway_interval(rest)
    bound = "" if not np.isfinite(rest.bound) else f"; at least {rest.bound:.4g} at rest"
    if not len(rest.breakaways):
        reason = "no rest" if not rest.windows else "no slip after rest"
        return Estimate(
            "static_coefficient", np.nan, np.nan, np.nan, "1", f"no break-away: {reason}{bound}"
        )
    count = len(rest.breakaways)
    note = f"of {count} break-away{'s' if count > 1 else ''}{bound}"
    return Estimate("static_coefficient", value, value - half, value + half, "1", note)
