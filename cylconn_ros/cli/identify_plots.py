"""Plots of the page of an identification: law, disc, residuals, intervals by model."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.report.findings import Plot, Series, thinned

if TYPE_CHECKING:
    from cylconn_ros.identification.friction import Identification
    from cylconn_ros.identification.likelihood.kinetic import KineticFit
    from cylconn_ros.identification.likelihood.patterns import Pattern

Array = NDArray[np.float64]

NORMAL_95 = 1.96  # standard deviations of a 95 % interval
SHORT = {
    "viscous friction of the slide": "c1",
    "viscous friction of the spin": "cr1",
    "offset force": "offset",
    "difference by direction": "direction",
    "Stribeck decay": "Stribeck",
}
UNITS = {
    "coefficient": "", "static_coefficient": "", "preload": "N", "overlap": "m", "radius": "m",
    "c1": "N·s/m", "cr1": "N·m·s", "coefficient_positive": "", "coefficient_negative": "",
    "direction": "", "offset": "N", "stribeck": "", "decay": "s/m", "mass": "kg",
    "inertia": "kg·m²",
}  # fmt: skip
SYMBOLS = {
    "coefficient": "µ", "preload": "FCint", "overlap": "L", "radius": "R", "c1": "c1", "cr1": "cr1",
    "direction": "d", "offset": "offset", "stribeck": "b", "decay": "dc",
}  # fmt: skip


def traction_plot(found: Identification) -> Plot:
    """Return traction against normal force with the fitted law."""
    law, rest = found.law, found.static
    mu = found.estimates["coefficient"]
    rows = thinned([found.normal, found.traction])
    right = 1.06 * float(np.concatenate([found.normal, rest.normal]).max())
    ends = np.array([0.0, right])
    series = []
    if rest.windows:
        still = thinned([rest.normal[: rest.windows], rest.traction[: rest.windows]])
        series.append(Series("rest", "soft", "rings", rest.normal[still], rest.traction[still]))
    points = (found.normal[rows], found.traction[rows])
    series.append(Series("slip, one point per window", "blue", "points", *points))
    if mu.found:
        band = (mu.low * ends, mu.high * ends)
        series.append(Series("95 % interval of µ", "red", "band", ends, mu.value * ends, *band))
        series.append(
            Series(f"law: µ FN, µ = {mu.value:.4g}", "red", "line", ends, mu.value * ends)
        )
    else:
        label = f"best law tried, not accepted: µ = {law.coefficient:.4g}"
        series.append(Series(label, "red", "dashed", ends, law.coefficient * ends))
    for name, label in (
        ("coefficient_positive", "forward"), ("coefficient_negative", "backward"),
    ):  # fmt: skip
        e = found.estimates.get(name)
        if e is not None and e.found:
            text = f"{label}: µ = {e.value:.4g}"
            series.append(Series(text, "purple", "dashed", ends, e.value * ends))
    if len(rest.breakaways):
        at = slice(rest.windows, None)
        series.append(Series("break-away", "ink", "diamonds", rest.normal[at], rest.traction[at]))
    bending = "" if law.bending == 0.0 else f" + {law.bending:.4g}/m · Mbend"
    if bending and found.contact.changes:
        bending = (
            f" + 2/L(l) · Mbend, L = {2.0 / law.bending:.4g} m at l = {found.contact.at:.4g} m,"
        )
    note = f"FN = Fr{bending} + {law.preload:.4g} N. Viscous friction and offset are subtracted."
    if "Stribeck decay" in found.choice.terms:
        note += " Slow slip lies above the line: Stribeck."
    note += _shown(len(rows), found.windows)
    title = "Traction against normal force"
    return Plot("traction", title, "normal force FN [N]", "traction P [N]", series, note)


def _shown(count: int, total: int) -> str:
    return "" if count == total else f" {count} of {total} windows are drawn, with all extremes."


def disc_plot(found: Identification) -> Plot:
    """Return friction over its limit on the friction disc."""
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    rows = thinned([found.disc[:, 0], found.disc[:, 1]])
    series = [
        Series("window of slip", "blue", "points", found.disc[rows, 0], found.disc[rows, 1]),
        Series("friction limit", "red", "line", np.cos(turn), np.sin(turn)),
    ]
    x, y = "slide: f1 / (µ FN)", "spin: m1 / (R µ FN)"
    note = f"R = {found.law.radius:.4g} m." + _shown(len(rows), found.windows)
    return Plot("disc", "Friction disc", x, y, series, note, equal=True)


_OVER = {
    "slip rate [m/s]": ("rate", "slip rate"),
    "slide [m/s]": ("slide", "rate and direction of the slide"),
    "direction of slip [rad]": ("direction", "direction of slip on the disc"),
    "normal force [N]": ("load", "normal force"),
    "place in the slot [m]": ("place", "position in the slot"),
    "angle [rad]": ("angle", "angle of the spin"),
    "time [s]": ("time", "time"),
}


def residual_plots(found: Identification) -> list[Plot]:
    """Return the residuals over each quantity, with their group means."""
    from cylconn_ros.identification.likelihood.patterns import MATERIAL

    r = found.residuals
    limit = MATERIAL * r.traction
    plots = []
    for name, (key, title) in _OVER.items():
        patterns = [one for one in found.patterns if one.over == name]
        accepted = not any(one.rejected for one in found.patterns)
        plots.append(
            residual_plot(key, title, name, r.over[name], r.along, patterns, limit, "N", accepted)
        )
    return plots


def residual_plot(
    key: str,
    title: str,
    axis: str,
    over: Array,
    along: Array,
    patterns: list[Pattern],
    limit: float,
    unit: str,
    accepted: bool,
) -> Plot:
    """Return the residuals (n,) over one quantity (n,); ``limit`` is the least that counts.

    ``accepted``: no pattern over another quantity rejects the model either.
    """
    rows = thinned([over, along])
    ends = np.array([over.min(), over.max()])
    zero = np.zeros(2)
    band = (zero - limit, zero + limit)
    series = [
        Series("too small to count", "soft", "band", ends, zero, *band),
        Series("", "soft", "dashed", ends, zero),
        Series("one window", "blue", "points", over[rows], along[rows]),
    ]
    for one in patterns:
        colour = "red" if one.rejected else "orange" if one.component == "along" else "purple"
        kind = "means" if one.component == "along" else "open"
        bar = NORMAL_95 * one.errors
        series.append(
            Series(
                f"group mean {one.component} the motion", colour, kind, one.middles, one.means,
                one.means - bar, one.means + bar,
            )
        )  # fmt: skip
    bad = any(one.rejected for one in patterns)
    note = f"{one_line(patterns)}" if bad else ""
    if not patterns:
        mark, note = "not tested", "It hardly changes in this recording."
    else:
        mark = "pattern remains" if bad else "no pattern" if accepted else "no pattern by itself"
    note += _shown(len(rows), len(along))
    label = f"residual [{unit}]"
    good = accepted and bool(patterns)
    return Plot(f"over_{key}", f"Over {title}", axis, label, series, note, mark, bad, good)


def sentence(text: str) -> str:
    """Return ``text`` with a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:]}."


def depends(patterns: list[Pattern]) -> list[str]:
    """Say in words on what friction depends beyond the model; empty without rejected patterns."""
    names = dict.fromkeys(one.over.partition(" [")[0] for one in patterns)
    if not names:
        return []
    return [f"Friction depends on {' and '.join(names)} in a way that no term of the model has."]


def spread(value: float, low: float, high: float, unit: str) -> str:
    """Return half of an interval as a share of the value, or in its unit if it is larger."""
    half = 0.5 * (high - low)
    if half < abs(value):
        return f"± {100.0 * half / abs(value):.2g} %"
    return f"± {half:.2g} {unit}".rstrip()


def one_line(patterns: list[Pattern]) -> str:
    """Return the patterns that reject the model in words."""
    return sentence("; ".join(one.describe() for one in patterns if one.rejected))


def step_plots(found: Identification) -> list[Plot]:
    """Return the intervals of each parameter in every model from Coulomb friction to the last."""
    from cylconn_ros.identification.likelihood.law import NAMES

    steps = found.choice.steps
    labels = ["Coulomb"]
    for (earlier, _), (later, _) in itertools.pairwise(steps):
        added = [SHORT[name] for name in later if name not in earlier]
        gone = [SHORT[name] for name in earlier if name not in later]
        named = [f"+ {name}" for name in added] + [f"without {name}" for name in gone]
        labels.append(", ".join(named) or "all freed")
    plots = []
    for k, name in enumerate(NAMES):
        rows = [(at, _interval(fit, k)) for at, (_, fit) in enumerate(steps) if k in fit.free]
        e = found.estimates[name]
        if not rows:
            continue
        names = [*labels, "reported" if e.found else "withheld"]
        last = len(names) - 1
        column = np.array([value for _, value in rows])
        height = np.array([last - at for at, _ in rows], dtype=np.float64)
        series = [Series("", "blue", "means", column[:, 0], height, column[:, 1], column[:, 2])]
        if e.found:
            one = np.array([[e.value, e.low, e.high]])
            end = np.zeros(1)
            series.append(Series("", "red", "means", one[:, 0], end, one[:, 1], one[:, 2]))
        unit = f" [{UNITS[name]}]" if UNITS[name] else ""
        label = f"{SYMBOLS[name]}{unit}"
        plots.append(Plot(f"steps_{name}", label, label, "", series, names=tuple(reversed(names))))
    return plots


def _interval(fit: KineticFit, k: int) -> tuple[float, float, float]:
    """Return value and 95 % interval of parameter ``k`` of a fit, from the noise alone."""
    from cylconn_ros.identification.likelihood.law import COEFFICIENT, DECAY, OVERLAP, RADIUS

    x = float(fit.law.vector[k])
    half = float(fit.half_widths(0.05)[fit.free.index(k)])
    if k in (COEFFICIENT, RADIUS, DECAY):
        return math.exp(x), math.exp(x - half), math.exp(x + half)
    if k == OVERLAP:
        ends = [2.0 / v if v > 0.0 else math.nan for v in (x, x + half, x - half)]
        return ends[0], ends[1], ends[2]
    return x, x - half, x + half
