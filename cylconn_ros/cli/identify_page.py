"""Page of an identification: whether to believe the values, intervals, residuals and advice."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cylconn_ros.cli.identify_plots import (
    UNITS,
    depends,
    disc_plot,
    residual_plots,
    sentence,
    spread,
    step_plots,
    traction_plot,
)
from cylconn_ros.report.findings import Findings, Section, Table
from cylconn_ros.report.page import Fact

if TYPE_CHECKING:
    from cylconn_ros.identification.friction import Estimate, Identification

MEANINGS = {
    "coefficient": ("µ", "kinetic friction coefficient"),
    "static_coefficient": ("µ static", "friction coefficient at break-away"),
    "preload": ("FCint", "preload, the normal force without any load"),
    "overlap": ("L", "overlap length, the arm of the bending moment"),
    "radius": ("R", "radius at which the spin is resisted"),
    "c1": ("c1", "viscous friction of the slide"),
    "cr1": ("cr1", "viscous friction of the spin"),
    "coefficient_positive": ("µ forward", "coefficient of a positive slide"),
    "coefficient_negative": ("µ backward", "coefficient of a negative slide"),
    "direction": ("d", "half of the difference of µ between the directions, over their mean"),
    "offset": ("offset", "constant force that resists a positive slide"),
    "stribeck": ("b", "Stribeck, (µ static - µ)/µ"),
    "decay": ("dc", "Stribeck, decay with the slip rate"),
    "mass": ("m", "mass of the free body"),
    "inertia": ("I", "inertia of the free body about the slot"),
}
BASE = ("coefficient", "static_coefficient", "preload", "overlap", "radius")
_LEAST_NOISE = 1e-7  # m/s; below, the sample period limits the accuracy and not a sensor
_HOW = "Each interval contains the true value in about 95 of 100 recordings like this one"


def friction_findings(found: Identification, advice: Sequence[str]) -> Findings:
    """Return what the page says of an identification with reactions."""
    plots = [traction_plot(found), disc_plot(found)]
    residuals = residual_plots(found)
    sections = [
        Section("estimates", "Estimates", _estimates_text(found), table=_estimates(found)),
        Section("terms", "Terms of the model", _TERMS, table=_terms(found)),
        Section("law", "Friction and the fitted law", _LAW, plots=plots),
        Section("residuals", "What the model leaves over", _RESIDUALS, plots=residuals),
        Section(
            "steps", "Intervals before and after adding terms", _STEPS, plots=step_plots(found)
        ),
        Section("next", "What to record next", items=advice or [_ENOUGH]),
        Section("words", "Words", items=WORDS),
    ]
    verdict, state, reasons = _verdict(found)
    return Findings(verdict, state, reasons, sections)


_TERMS = (
    "Coulomb friction is always in. Another term enters only if the recording demands it; each one "
    "that is out has its reason."
)
_LAW = (
    "Each point is a window of slip. If the law holds, traction grows in proportion to the normal "
    "force, and friction lies on the unit circle."
)
_RESIDUALS = (
    "Measured friction minus that of the model. If the model holds, the group means (with 95 % "
    "bars) scatter about zero whatever they are sorted by. A mean outside of the grey band that "
    "noise does not explain is a pattern: friction then depends on that quantity in a way that the "
    "model does not have, and no values are given."
)
_BEFORE = "Intervals before and after adding terms"
_STEPS = (
    "The model begins with Coulomb friction; one term after the other is added. A value that moves "
    "by more than its interval when a term enters was wrong before. These intervals show noise "
    "alone; the last row is the reported one, which includes the error of the sample period."
)
WORDS = (
    "95 % interval: of 100 such recordings, about 95 have an interval with the true value in it.",
    "Window: a short piece of the recording whose samples are taken together, so that noise "
    "averages out; one point in the plots.",
    "Residual: what is measured minus what the model says. Noise scatters about zero; a pattern "
    "does not.",
    "Traction: friction of slide and spin together, the spin's moment divided by R. Normal force: "
    "what presses shaft and sleeve together.",
    "Withheld: the recording does not support a value, so none is given.",
)
_ENOUGH = (
    "Nothing: every parameter of the model is determined. A repetition at another load or rate "
    "would confirm the model."
)


def _verdict(found: Identification) -> tuple[str, str, list[str]]:
    """Return the verdict in a sentence, its state and the reasons."""
    said = found.verdict()
    if not found.accepted:
        reasons = [sentence(line.removeprefix("do not use: ")) for line in said]
        reasons[1:1] = depends([one for one in found.patterns if one.rejected])
        if found.noise > _LEAST_NOISE:
            times = f"{math.sqrt(found.misfit):.1f}"
            reasons.append(f"What is left over is {times} times the noise of the sensors.")
        reasons.append(
            "The values are withheld: a number would look precise and be wrong. The plots show the "
            "best model that was tried."
        )
        return "Do not use: there are no values", "bad", reasons
    noise = (
        f"What is left over is {math.sqrt(found.misfit):.2f} times the noise of the sensors (1: "
        "all of it is noise)"
        if found.noise > _LEAST_NOISE
        else "The recording has no noise"
    )
    names = ", ".join(("Coulomb friction", *found.choice.terms))
    reasons = [
        f"The model ({names}) describes all {found.windows} windows of slip. {noise}, and no "
        "pattern remains over rate, direction, load, place and time.",
        f"{_HOW}, if {given(found)} in the parameters are right.",
    ]
    state, verdict = "good", "Use these values"
    if found.choice.alternatives:
        state = "fair"
        pairs = [f"{name} or {other}" for name, other in found.choice.alternatives.items()]
        verdict = f"Use these values, but not decided: {'; '.join(pairs)}"
        reasons.append(
            "This motion cannot tell them apart: their sum is right at this load only. See what to "
            "record next."
        )
    held = [MEANINGS[name][0] for name in BASE if name in found.choice.held]
    if held:
        reasons.append(
            f"Not determined by this recording, and taken as given: {', '.join(held)}. The other "
            "values hold if these are right."
        )
    if found.misfit > 2.0 and found.noise > _LEAST_NOISE:
        reasons.append("The intervals include that the windows scatter by more than their noise.")
    return verdict, state, reasons + [sentence(one) for one in found.remarks]


def _estimates_text(found: Identification) -> str:
    known = f"Taken as known: {given(found)} of the parameters."
    if not found.accepted:
        return f"Withheld; see the verdict. {known}"
    return f"Values in brackets are assumed and not measured here. {known}"


def given(found: Identification) -> str:
    """Return what is taken from the parameters and not estimated."""
    names = [name for name in ("mass", "inertia") if name not in found.estimates]
    return " and ".join(filter(None, [", ".join(names), "nodes"]))


def _estimates(found: Identification) -> Table:
    from cylconn_ros.identification.likelihood.law import NAMES

    rows: list[list[str]] = []
    weak: set[int] = set()
    free = {NAMES[k] for k in found.choice.fitted.free}
    withheld = set() if found.accepted else free
    for name, (symbol, meaning) in MEANINGS.items():
        e = found.estimates.get(name)
        if e is None or not (name in (*BASE, "mass", "inertia") or e.found or name in free):
            continue
        if not e.found:
            weak.add(len(rows))
        known, remark = ("withheld", "see the verdict") if name in withheld else ("", "")
        value, interval, width = _value(e)
        remark = remark or e.note or ("measured" if e.found else "")
        rows.append([f"{symbol}: {meaning}", value, interval, known or width, remark])
    head = ("parameter", "value", "95 % interval", "how well known", "remark")
    return Table(head, rows, frozenset(weak))


def _value(e: Estimate) -> tuple[str, str, str]:
    unit = UNITS[e.name]
    if not e.found:
        value = f"({e.value:.5g} {unit})".replace(" )", ")") if math.isfinite(e.value) else "–"
        return value, "–", "assumed" if math.isfinite(e.value) else "not known"
    known = spread(e.value, e.low, e.high, unit)
    between = f"{e.low:.5g} … {e.high:.5g}"
    return f"{e.value:.5g} {unit}".rstrip(), f"{between} {unit}".rstrip(), known


def _terms(found: Identification) -> Table:
    from cylconn_ros.identification.likelihood.law import NAMES
    from cylconn_ros.identification.likelihood.selection import TERMS

    into = "in" if found.accepted else "tried"
    rows: list[list[str]] = [["Coulomb friction", into, "always"]]
    for name in found.choice.terms:
        reason = "demanded by the data" if found.accepted else "improves the fit, not enough"
        if found.accepted:
            parts = [(MEANINGS[NAMES[k]][0], *_value(found[NAMES[k]])) for k in TERMS[name]]
            reason += ": " + ", ".join(f"{part[0]} = {part[2]}" for part in parts)
        if other := found.choice.alternatives.get(name):
            reason = f"or else: {other}; this motion cannot tell which"
        rows.append([name, into, reason])
    weak = set(range(len(rows), len(rows) + len(found.choice.left_out)))
    rows += [[name, "left out", why] for name, why in found.choice.left_out.items()]
    return Table(("term", "model", "reason"), rows, frozenset(weak))


def friction_facts(found: Identification) -> list[Fact]:
    """Return the summary of an identification with reactions."""
    mu = found.estimates["coefficient"]
    interval = f"95 %: {mu.low:.4g} to {mu.high:.4g}"
    first = (
        Fact("µ", f"{mu.value:.4g}", interval)
        if mu.found
        else Fact("µ", "withheld", "see the verdict", bad=True)
    )
    noise = (
        Fact("noise", f"{1e3 * found.noise:.3g} mm/s", "of the slip velocity")
        if found.noise > _LEAST_NOISE
        else Fact("noise", "none")
    )
    return [
        first,
        Fact("samples", f"{found.samples:,}".replace(",", " "), f"over {found.duration:.6g} s"),
        Fact("slip", f"{found.windows} windows", f"of {found.slip_intervals} intervals"),
        Fact("rest", f"{found.rest_windows} windows", f"of {found.rest_intervals} intervals"),
        Fact("normal force", f"{np.median(found.normal):.4g} N", _range(found.normal, "N")),
        Fact("slip rate", _range(found.residuals.over["slip rate [m/s]"], "m/s")),
        noise,
    ]


def _range(values: np.ndarray, unit: str) -> str:
    return f"{values.min():.3g} to {values.max():.3g} {unit}"


def nothing_found(reason: str) -> Findings:
    """Return what the page says of a recording that determines nothing."""
    items = [
        "Slide (and, for R, turn at the same time) to and fro under several loads for seconds."
    ]
    return Findings(
        "No values: this recording does not determine what was asked",
        "bad",
        [sentence(reason)],
        [Section("next", "What to record next", items=items)],
    )
