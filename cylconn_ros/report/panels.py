"""Which plots a report has: every panel, its curves, and how they follow from ConnectorState."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class States:
    """States of a run, and what their scene says about friction."""

    fields: Mapping[str, Array]  # of ConnectorState, (n,) or (n, k)
    radius: float = math.nan  # m, R; NaN: no friction modelled
    preload: float = math.nan  # N, FCint; NaN: unknown

    def __call__(self, name: str, component: int | None = None) -> Array:
        """A field, or one component of it, as floats (n,)."""
        values = np.asarray(self.fields[name], dtype=np.float64)
        return values if component is None else values[:, component]

    @property
    def pressed_by_preload(self) -> Array:
        """FCint (n,): of the parameters, else what is left of FN."""
        if math.isfinite(self.preload):
            return np.full(len(self("normal_force")), self.preload)
        return self("normal_force") - self("radial_force") - self("bending_force")


@dataclass(frozen=True)
class Curve:
    """One line of a panel.

    ``style``: line, thin, dashed, or area, which is filled down to the curve before it.
    """

    label: str
    colour: str  # a name in page.css
    values: Callable[[States], Array]  # (n,), in the panel's unit
    style: str = "line"
    always: bool = False  # shown although it is zero throughout
    shows: Callable[[States], Array] | None = None  # what its label reads, where that is not drawn


@dataclass(frozen=True)
class Panel:
    """Curves over time with one unit."""

    key: str
    title: str
    unit: str
    curves: tuple[Curve, ...]
    log: bool = False
    zero: bool = False  # zero is always in sight


def _field(name: str, component: int | None = None, factor: float = 1.0) -> Any:
    return lambda s: factor * s(name, component)


def _size(name: str, factor: float = 1.0) -> Any:
    return lambda s: np.abs(factor * s(name))


def _pressed(parts: int) -> Any:
    """Sum of the first parts of the contact force: radial, bending, preload."""

    def values(s: States) -> Array:
        found = [s("radial_force"), s("bending_force"), s.pressed_by_preload][:parts]
        return np.asarray(np.sum(found, axis=0))

    return values


def _parts(kind: str, total: str) -> tuple[Curve, ...]:
    names = ("friction", "reaction", "actuation", "elastic", "viscous")
    colours = ("orange", "red", "purple", "green", "sky")
    curves = [
        Curve(name, colour, _field(f"{kind}_{name}"))
        for name, colour in zip(names, colours, strict=True)
    ]
    return (*curves, Curve("total", "ink", _field(total, 0), "dashed"))


TURN = 2.0 * math.pi
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
        "Normal force: what presses",
        "N",
        (
            Curve("radial Fr", "blue", _pressed(1), "area", shows=_field("radial_force")),
            Curve("bending 2M/L", "sky", _pressed(2), "area", shows=_field("bending_force")),
            Curve("preload", "purple", _pressed(3), "area", shows=lambda s: s.pressed_by_preload),
            Curve("FN", "ink", _field("normal_force")),
        ),
        zero=True,
    ),
    Panel(
        "friction",
        "Friction against its limit",
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
    Panel("f1", "Force along the slot f₁", "N", _parts("force", "force"), zero=True),
    Panel("m1", "Moment about the slot m₁", "N m", _parts("moment", "moment"), zero=True),
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
            Curve("offset [mm]", "blue", _size("offset_violation", 1e3), "thin"),
            Curve("misalignment [mrad]", "orange", _size("angular_violation", 1e3), "thin"),
        ),
        log=True,
    ),
    Panel(
        "rates",
        "Violation of the rates",
        "mm/s, mrad/s",
        (
            Curve("offset [mm/s]", "blue", _size("velocity_violation", 1e3), "thin"),
            Curve("misalignment [mrad/s]", "orange", _size("spin_violation", 1e3), "thin"),
        ),
        log=True,
    ),
    Panel(
        "energy",
        "Energy through the connector",
        "J",
        (
            Curve("exchanged", "green", _size("energy_exchanged")),
            Curve("|passivity balance|", "purple", _size("passivity_balance"), "dashed"),
        ),
        log=True,
    ),
    Panel(
        "residual",
        "Residual of the step's equations",
        "1",
        (Curve("worst", "red", _size("residual"), "thin"),),
        log=True,
    ),
    Panel(
        "computing",
        "Computing time",
        "µs",
        (Curve("a sample", "sky", _size("computing_time", 1e6), "thin"),),
        log=True,
    ),
)


def chosen(
    radius: float, tells: Callable[[Curve], bool], constant: bool
) -> tuple[list[Panel], list[str]]:
    """Panels and curves that have something to show, and the titles of those that have not.

    A curve that is zero throughout is left out, a panel with none left too.

    Args:
        radius: of the states. tells: whether a curve is not zero throughout, nor without values.
        constant: whether the coefficient of friction never changes.
    """
    panels, empty = [], []
    for panel in PANELS:
        if panel.key == ("rate" if math.isfinite(radius) else ""):
            continue  # the spin is in the slip velocity
        curves = tuple(curve for curve in panel.curves if tells(curve))
        if panel.key == "coefficient" and constant:
            continue  # said among the parameters
        if panel.key == "speed" and len(curves) == 1:
            panel = replace(panel, title="Speed in the slot")
        if [curve.label for curve in curves] == ["total"]:
            curves = ()
        if curves:
            panels.append(replace(panel, curves=curves))
        else:
            empty.append(panel.title)
    return panels, empty
