"""``cylconn identify --axis``: mass and friction of one axis from its positions and efforts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cylconn_ros.cli.identify_page import WORDS
from cylconn_ros.cli.identify_plots import depends, residual_plot, sentence, spread
from cylconn_ros.cli.page_file import write_page
from cylconn_ros.errors import CommandError, IdentifyError
from cylconn_ros.recording.run import read_run
from cylconn_ros.report.findings import Findings, Plot, Section, Series, Table, thinned
from cylconn_ros.report.page import Fact

if TYPE_CHECKING:
    from cylconn_ros.identification.effort import AxisEstimate

_TITLES = {"mass": "M", "c1": "c1", "preload_friction": "mu FN0", "offset": "offset"}
_MEANINGS = {
    "mass": "M: mass (of a spin: inertia, kg·m²)",
    "c1": "c1: viscous friction",
    "preload_friction": "µ FN0: Coulomb friction",
    "offset": "offset: constant force that resists positive motion",
}
_ADVICE = {
    "mass": "for M: reverse and accelerate more often and harder",
    "c1": "for c1: move at several constant rates that differ by a factor of 5 or more",
    "preload_friction": "for µ FN0: move slowly in both directions",
    "offset": "for the offset: move as often forward as backward, for longer",
}
_WITHHELD = "not determined: the interval is wider than half of the value"
_ONE_NUMBER = "friction is one number: without reactions mu, FCint, L and R are not told apart"
_FORCE = (
    "a constant force that was not recorded (gravity, a cable) is part of the offset: no motion "
    "tells them apart"
)


def axis_report(
    axis: str, recordings: Sequence[list[Path] | Path], output: Path | None, page: Path | None
) -> int:
    """Estimate and report; 1 if a value is withheld."""
    from cylconn_ros.identification.effort import NAMES
    from cylconn_ros.identification.recording import identify_axis

    topic, _, joint = axis.partition(":")
    try:
        found = identify_axis([read_run(one) for one in recordings], topic, joint)
    except IdentifyError as error:
        raise CommandError(f"{_name(recordings[0])}: {error}") from None
    if output is not None:
        text = json.dumps(_as_json(found), indent=2, ensure_ascii=False)
        if str(output) == "-":
            print(text)
        else:
            try:
                output.write_text(text + "\n", encoding="utf-8")
            except OSError as error:
                raise CommandError(f"{output}: {error.strerror or error}") from None
    if page is not None:
        sources = [("recording", ", ".join(map(_name, recordings))), ("axis", axis)]
        title = f"{_name(recordings[0])}, {joint or topic}"
        write_page(page, title, axis_findings(found), _facts(found), sources, "")
    if str(output) != "-":
        print("\n".join(_table(found)))
        if page is not None:
            print(f"report      {page}")
        read = (
            f"open {page} in a browser" if page is not None else "see why with --report FILE.html"
        )
        print(f"\nnext: {read}")
    return 0 if all(found.determined(name) for name in NAMES) else 1


def _name(recording: list[Path] | Path) -> str:
    paths = recording if isinstance(recording, list) else [recording]
    return " ".join(path.name for path in paths)


def _withheld(found: AxisEstimate) -> str:
    return _WITHHELD if found.accepted else "the model is rejected: a residual pattern remains"


def _verdict(found: AxisEstimate) -> list[str]:
    """Say in sentences whether to believe the values."""
    from cylconn_ros.identification.effort import NAMES

    if not found.accepted:
        lines = ["do not use: inertia, viscous and Coulomb friction and offset do not describe it"]
        return lines + [one.describe() for one in found.patterns if one.rejected]
    lines = ["holds: no pattern remains over rate, direction, position and time"]
    lines += [f"not determined: {_TITLES[n]}" for n in NAMES if not found.determined(n)]
    return lines


def _table(found: AxisEstimate) -> list[str]:
    from cylconn_ros.identification.effort import NAMES, UNITS

    lines = [
        f"windows     {found.windows}",
        f"residual    {found.residual:.3g} N, root mean square of the effort of a window",
        f"delay       {1e3 * found.delay:.3g} ms of the effort against the position",
        "",
        f"{'parameter':<12}{'estimate':>11}  {'95 % interval':<26}unit",
    ]
    for name, unit in zip(NAMES, UNITS, strict=True):
        value, low, high = found[name]
        if found.determined(name):
            between = f"{low:.5g} … {high:.5g}"
            lines.append(f"{_TITLES[name]:<12}{value:>11.5g}  {between:<26}{unit}")
        else:
            lines.append(f"{_TITLES[name]:<12}{'-':>11}  {'-':<26}{unit:<6}{_withheld(found)}")
    lines += ["", *(f"verdict     {line}" for line in _verdict(found))]
    lines += [f"next        {_ADVICE[name]}" for name in NAMES if not found.determined(name)]
    lines += ["", _ONE_NUMBER, _FORCE, "of a spin: M in kg.m^2, forces in N.m"]
    return lines


def _as_json(found: AxisEstimate) -> dict[str, Any]:
    from cylconn_ros.identification.effort import NAMES, UNITS

    estimates = {}
    for name, unit in zip(NAMES, UNITS, strict=True):
        value, low, high = found[name]
        good = found.determined(name)
        estimates[name] = {
            "estimated": good,
            "value": value if good else None,
            "interval_95": [low, high] if good else None,
            "unit": unit,
            "note": "" if good else _withheld(found),
        }
    return {
        "estimates": estimates,
        "accepted": found.accepted,
        "verdict": _verdict(found),
        "windows": found.windows,
        "residual": found.residual,
        "delay": found.delay,
    }


def _facts(found: AxisEstimate) -> list[Fact]:
    from cylconn_ros.identification.effort import NAMES

    rates = np.abs(found.moving.design[:, 1])
    values = [
        Fact(_TITLES[name].replace("mu", "µ"), f"{found[name][0]:.5g}")
        if found.determined(name)
        else Fact(_TITLES[name].replace("mu", "µ"), "withheld", bad=True)
        for name in NAMES
    ]
    return [
        *values,
        Fact("windows", str(found.windows), "of motion in one direction"),
        Fact("rate", f"{rates.min():.3g} to {rates.max():.3g}", "m/s or rad/s"),
        Fact("residual", f"{found.residual:.3g}", "N or N·m, of a window"),
        Fact("delay", f"{1e3 * found.delay:.3g} ms", "of the effort"),
    ]


def axis_findings(found: AxisEstimate) -> Findings:
    """Return what the page says of an axis."""
    from cylconn_ros.identification.effort import NAMES, UNITS
    from cylconn_ros.identification.likelihood.patterns import MATERIAL

    rows = []
    for name, unit in zip(NAMES, UNITS, strict=True):
        value, low, high = found[name]
        good = found.determined(name)
        unit = unit.replace(".", "·")
        known = spread(value, low, high, unit)
        shown = (f"{value:.5g} {unit}", f"{low:.5g} … {high:.5g} {unit}", known)
        withheld = ("–", "–", "withheld")
        rows.append([_MEANINGS[name], *(shown if good else withheld)])
        rows[-1].append("measured" if good else _withheld(found))
    weak = frozenset(k for k, name in enumerate(NAMES) if not found.determined(name))
    head = ("parameter", "value", "95 % interval", "how well known", "remark")
    limit = MATERIAL * abs(found["preload_friction"][0])
    w, r = found.moving, found.residuals
    patterns = {one.over: [one] for one in found.patterns}
    residuals = [
        residual_plot(
            key, title, axis, values, r, patterns.get(axis, []), limit, "N or N·m", found.accepted
        )
        for key, title, axis, values in (
            ("rate", "rate and direction", "rate [m/s or rad/s]", w.design[:, 1]),
            ("place", "position", "position [m or rad]", w.position),
            ("time", "time", "time [s]", w.time),
        )
    ]
    verdict, state, reasons = _page_verdict(found)
    advice = [_ADVICE[name] for name in NAMES if not found.determined(name)]
    if not found.accepted:
        advice = ["Repeat the motion at other rates and places, and compare the pattern."]
    return Findings(
        verdict,
        state,
        reasons,
        [
            Section("estimates", "Estimates", table=Table(head, rows, weak)),
            Section("law", "Friction and the fitted law", _LAW, plots=[_law_plot(found)]),
            Section("residuals", "What the model leaves over", _RESIDUALS, plots=residuals),
            Section("steps", "Intervals before and after adding terms", plots=_steps(found)),
            Section("next", "What to record next", items=advice or [_ENOUGH]),
            Section("words", "Words", items=[WORDS[k] for k in (0, 1, 2, 4)]),
        ],
    )


_LAW = (
    "Effort without the part that accelerates the mass. The load across the slot is not in the "
    "recording: there is no plot over the normal force and no friction disc."
)
_RESIDUALS = (
    "Measured effort minus that of the model. If the model holds, the group means (with 95 % bars) "
    "scatter about zero whatever they are sorted by. A mean outside of the grey band that noise "
    "does not explain is a pattern, and no values are given."
)
_ENOUGH = (
    "For this axis nothing. For µ, FCint, L and R record poses and twists under several loads "
    "across the slot, with mass and inertia known."
)


def _page_verdict(found: AxisEstimate) -> tuple[str, str, list[str]]:
    from cylconn_ros.identification.effort import NAMES

    limits = [sentence(_ONE_NUMBER.replace("mu", "µ")), sentence(_FORCE)]
    if not found.accepted:
        reasons = [sentence(line.removeprefix("do not use: ")) for line in _verdict(found)]
        reasons[1:1] = depends([one for one in found.patterns if one.rejected])
        reasons.append("The values are withheld: a number would look precise and be wrong.")
        return "Do not use: there are no values", "bad", reasons
    good = [name for name in NAMES if found.determined(name)]
    reasons = [
        f"Inertia, viscous and Coulomb friction and offset describe all {found.windows} windows of "
        f"motion to {found.residual:.2g} N (N·m of a spin), and no pattern remains over rate, "
        "direction, position and time.",
        "Each interval contains the true value in about 95 of 100 recordings like this one, if the "
        "recorded effort is the force on the axis (drive constant).",
        *limits,
    ]
    if len(good) == len(NAMES):
        return "Use these values", "good", reasons
    missing = ", ".join(_TITLES[n].replace("mu", "µ") for n in NAMES if n not in good)
    reasons.insert(1, f"Not determined by this recording: {missing}.")
    if not good:
        return "Do not use: there are no values", "bad", reasons
    return f"Use these values; withheld: {missing}", "fair", reasons


def _law_plot(found: AxisEstimate) -> Plot:
    w = found.moving
    rate, friction = w.design[:, 1], w.effort - found.value[0] * w.design[:, 0]
    _, c1, coulomb, offset = found.value
    rows = thinned([rate, friction])
    series = [Series("window of motion", "blue", "points", rate[rows], friction[rows])]
    kind = "line" if found.accepted else "dashed"
    for sign in (-1.0, 1.0):
        ends = np.array([0.0, sign * max(float((sign * rate).max()), 0.0)])
        label = "" if sign < 0.0 else "law" if found.accepted else "law tried, not accepted"
        series.append(Series(label, "red", kind, ends, c1 * ends + sign * coulomb + offset))
    title, x, y = "Friction over rate", "rate [m/s or rad/s]", "friction [N or N·m]"
    return Plot("friction", title, x, y, series)


def _steps(found: AxisEstimate) -> list[Plot]:
    """Return the intervals of each parameter with one more term at a time."""
    from cylconn_ros.identification.effort import NAMES, UNITS

    names = ["inertia and Coulomb", "+ viscous", "+ offset"]
    plots = []
    for name, unit in zip(NAMES, UNITS, strict=True):
        rows = [
            (at, values[terms.index(name)])
            for at, (terms, values) in enumerate(found.steps)
            if name in terms
        ]
        height = np.array([len(names) - 1 - at for at, _ in rows], dtype=np.float64)
        column = np.array([values for _, values in rows])
        one = Series("", "blue", "means", column[:, 0], height, column[:, 1], column[:, 2])
        label = f"{_TITLES[name].replace('mu', 'µ')} [{unit.replace('.', '·')}]"
        plots.append(Plot(f"steps_{name}", label, label, "", [one], names=tuple(reversed(names))))
    return plots
