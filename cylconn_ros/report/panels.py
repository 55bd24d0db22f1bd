"""Panels of a report: their curves, computed from the fields of ConnectorState."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.report.stored import Stored

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class States:
    """States of a run, with the friction parameters that the plots need."""

    fields: Mapping[str, Array]  # of ConnectorState, (n,) or (n, k)
    radius: float = math.nan  # R, m; NaN: friction is not modelled
    preload: float = math.nan  # FCint, N; NaN: unknown
    stored: Stored | None = None  # energy of springs and compliant stops; None: there are none

    def __call__(self, name: str, component: int | None = None) -> Array:
        """Return a field, or one component of it, as floats (n,)."""
        values = np.asarray(self.fields[name], dtype=np.float64)
        return values if component is None else values[:, component]

    @property
    def stored_energy(self) -> Array:
        """Energy (n,) in springs and compliant stops, J."""
        if self.stored is None:
            return np.zeros(len(self("length")))
        return self.stored(self.fields)

    @property
    def preload_force(self) -> Array:
        """FCint (n,), N: of the parameters, else FN minus the other contributions."""
        if math.isfinite(self.preload):
            return np.full(len(self("normal_force")), self.preload)
        return self("normal_force") - self("radial_force") - self("bending_force")


@dataclass(frozen=True)
class Curve:
    """One curve of a panel.

    Attributes
    ----------
        label: in the legend.
        colour: a name in page.css.
        values: (n,) values to draw, in the panel's unit.
        style: line, thin, dashed, or area (filled down to the previous curve).
        always: drawn even if it is zero throughout and another curve of the panel is not.
        reading: (n,) values of the legend if they differ from the drawn ones (stacked areas).
    """

    label: str
    colour: str
    values: Callable[[States], Array]
    style: str = "line"
    always: bool = False
    reading: Callable[[States], Array] | None = None


@dataclass(frozen=True)
class Panel:
    """Curves over time with one unit."""

    key: str
    title: str
    unit: str
    curves: tuple[Curve, ...]
    log: bool = False
    zero: bool = False  # the axis includes zero


def _field(name: str, component: int | None = None, factor: float = 1.0) -> Any:
    return lambda s: factor * s(name, component)


def _magnitude(name: str, factor: float = 1.0) -> Any:
    return lambda s: np.abs(factor * s(name))


def _stacked(count: int) -> Any:
    """Return the sum of the first ``count`` of radial force, bending force and preload."""

    def values(s: States) -> Array:
        parts = [s("radial_force"), s("bending_force"), s.preload_force][:count]
        return np.asarray(np.sum(parts, axis=0))

    return values


def _contributions(kind: str, total: str) -> tuple[Curve, ...]:
    names = ("friction", "reaction", "actuation", "elastic", "viscous")
    colours = ("orange", "red", "purple", "green", "sky")
    curves = [
        Curve(name, colour, _field(f"{kind}_{name}"))
        for name, colour in zip(names, colours, strict=True)
    ]
    return (*curves, Curve("total", "ink", _field(total, 0), "dashed"))


TURN = 2.0 * math.pi
ROUNDING = 1e-12
"""Values up to this, in the unit of a plot or beside the greatest force or moment, are rounding."""

PANELS = (
    Panel("slide", "Slide u₁", "m", (Curve("u₁", "blue", _field("displacement"), always=True),)),
    Panel(
        "spin",
        "Spin uᵣ₁",
        "turns",
        (Curve("uᵣ₁", "blue", _field("rotation", factor=1.0 / TURN), always=True),),
    ),
    Panel(
        "speed",
        "Slip velocity",
        "m/s",
        (
            Curve("slide v₁", "blue", _field("velocity", 0), always=True),
            Curve(
                "spin R ω₁", "orange", lambda s: s.radius * s("angular_velocity", 0), always=True
            ),
        ),
        zero=True,
    ),
    Panel("rate", "Spin rate ω₁", "rad/s", (Curve("ω₁", "orange", _field("angular_velocity", 0)),)),
    Panel(
        "normal",
        "Normal force contributions",
        "N",
        (
            Curve("radial Fr", "blue", _stacked(1), "area", reading=_field("radial_force")),
            Curve("bending 2M/L", "sky", _stacked(2), "area", reading=_field("bending_force")),
            Curve("preload", "purple", _stacked(3), "area", reading=lambda s: s.preload_force),
            Curve("FN", "ink", _field("normal_force")),
        ),
        zero=True,
    ),
    Panel(
        "contact",
        "Overlap and middle of the contact",
        "m",
        (
            Curve("overlap L", "blue", _field("overlap")),
            Curve("middle from node b", "orange", _field("contact_centre")),
        ),
        zero=True,
    ),
    Panel(
        "friction",
        "Friction and friction limit",
        "N",
        (
            Curve("limit µ FN", "red", _field("friction_limit"), "area"),
            Curve("traction P", "ink", _field("traction")),
        ),
        zero=True,
    ),
    Panel(
        "coefficient",
        "Friction coefficient",
        "1",
        (Curve("µ", "green", _field("friction_coefficient")),),
    ),
    Panel("f1", "Force along the slot f₁", "N", _contributions("force", "force"), zero=True),
    Panel("m1", "Moment about the slot m₁", "N m", _contributions("moment", "moment"), zero=True),
    Panel(
        "across",
        "Force across the slot",
        "N",
        (Curve("f₂", "blue", _field("force", 1)), Curve("f₃", "orange", _field("force", 2))),
        zero=True,
    ),
    Panel(
        "bending",
        "Moment across the slot",
        "N m",
        (Curve("m₂", "blue", _field("moment", 1)), Curve("m₃", "orange", _field("moment", 2))),
        zero=True,
    ),
    Panel(
        "violation",
        "Constraint violation",
        "mm, mrad",
        (
            Curve("offset [mm]", "blue", _magnitude("offset_violation", 1e3), "thin"),
            Curve("misalignment [mrad]", "orange", _magnitude("angular_violation", 1e3), "thin"),
        ),
        log=True,
    ),
    Panel(
        "rates",
        "Constraint violation, rates",
        "mm/s, mrad/s",
        (
            Curve("offset [mm/s]", "blue", _magnitude("velocity_violation", 1e3), "thin"),
            Curve("misalignment [mrad/s]", "orange", _magnitude("spin_violation", 1e3), "thin"),
        ),
        log=True,
    ),
    Panel(
        "stored",
        "Energy in springs and compliant stops",
        "J",
        (Curve("stored", "green", lambda s: s.stored_energy, "area"),),
        zero=True,
    ),
    Panel(
        "energy",
        "Energy through the connector",
        "J",
        (
            Curve("exchanged", "green", _magnitude("energy_exchanged")),
            Curve("|passivity balance|", "purple", _magnitude("passivity_balance"), "dashed"),
        ),
        log=True,
    ),
    Panel(
        "residual",
        "Residual of the step equations",
        "1",
        (Curve("max", "red", _magnitude("residual"), "thin"),),
        log=True,
    ),
    Panel(
        "computing",
        "Computing time",
        "µs",
        (Curve("per sample", "sky", _magnitude("computing_time", 1e6), "thin"),),
        log=True,
    ),
)


def visible_panels(
    radius: float,
    has_data: Callable[[Curve], bool],
    is_zero: Callable[[Curve, float], bool],
    constant: Collection[str],
    greatest: Mapping[str, float],
) -> tuple[list[Panel], list[str]]:
    """Return the panels with their non-zero curves, and the titles of the panels that are all zero.

    Args:
        radius: R of the states, m; NaN: friction is not modelled.
        has_data: whether a curve has finite values and is to be drawn beside others.
        is_zero: whether a curve is within a magnitude throughout; a panel of such curves is
            omitted. On logarithmic scales that is 0, else ROUNDING.
        greatest: greatest magnitude by unit, of forces and moments.
        constant: panels of values that are constant: they are among the parameters, and omitted.
    """
    panels, empty = [], []
    for panel in PANELS:
        if panel.key == ("rate" if math.isfinite(radius) else ""):
            continue  # the slip velocity shows the spin
        least = 0.0 if panel.log else ROUNDING * max(1.0, greatest.get(panel.unit, 0.0))
        curves = tuple(
            curve
            for curve in panel.curves
            if has_data(curve) and (curve.always or not is_zero(curve, least))
        )
        if panel.key in constant:
            continue
        if panel.key == "speed" and len(curves) == 1:
            panel = replace(panel, title="Velocity along the slot")
        if [curve.label for curve in curves] == ["total"] or all(is_zero(c, least) for c in curves):
            curves = ()
        if curves:
            panels.append(replace(panel, curves=curves))
        else:
            empty.append(panel.title)
    return panels, empty
