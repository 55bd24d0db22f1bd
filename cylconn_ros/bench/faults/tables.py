"""Markdown tables of the fault injection benchmark: real processes, and library scenes."""

from __future__ import annotations

import math
from collections import Counter

from cylconn_ros.bench.common.report import VERDICT, number, table
from cylconn_ros.bench.common.results import Findings
from cylconn_ros.bench.faults import measure, sweep


def body(found: Findings) -> str:
    """Both tables."""
    return "\n\n".join(
        [
            f"**{measure.PROCESSES.capitalize()}**",
            processes(found),
            f"**{measure.LIBRARY_RUNS.capitalize()}, in process**",
            library(found),
            f"**{measure.FREE_RUNNING.capitalize()}, in process**",
            free_running(found),
        ]
    )


def processes(found: Findings) -> str:
    """One row per fault: expected, observed, met or not."""
    rows = []
    for m in found.measurements:
        if m.case == measure.PROCESSES and m.quantity == measure.MET:
            failures = str(m.settings["failures"])
            verdict = VERDICT[m.value == 1.0] + (f": {failures}" if failures else "")
            rows.append((m.subject, str(m.settings["expected"]), m.note, verdict))
    return table(("fault", "expected", "observed", ""), rows)


def library(found: Findings) -> str:
    """One row per fault: bounded runs and worst values with ``latency`` set, measured, not set."""
    values: dict[str, dict[tuple[str, str], tuple[float, str]]] = {}
    for m in found.measurements:
        if m.case == measure.LIBRARY_RUNS:
            latency = str(m.settings["latency"])
            values.setdefault(m.subject, {})[latency, m.quantity] = (m.value, m.unit)
    head = ["fault"]
    for latency in (sweep.SET, sweep.MEASURED):
        head += [f"latency {latency}: bounded", "offset", "angle", "energy", "passive"]
    head += [f"latency {sweep.NOT_SET}: bounded", "offset", "angle", "energy"]
    rows = [[fault, *_cells(cells)] for fault, cells in values.items()]
    return table(head, rows)


def free_running(found: Findings) -> str:
    """One row per rate, lag and kind: runs that survived on either plant, and what they reached."""
    values: dict[tuple[float, str], dict[str, dict[str, tuple[float, str]]]] = {}
    for m in found.measurements:
        if m.case == measure.FREE_RUNNING:
            row = values.setdefault((float(m.settings["rate"]), m.subject), {})
            row.setdefault(str(m.settings["integration"]), {})[m.quantity] = (m.value, m.unit)
    integrations = list(dict.fromkeys(name for row in values.values() for name in row))
    head = ["rate", "lag in samples"]
    for name in integrations:
        head += [f"{name}: survived", "median offset", "90 %", "greatest", "greatest angle"]
    rows = []
    for (rate, lag), row in values.items():
        cells = [f"{rate:g} Hz", lag]
        for name in integrations:
            got = row[name]
            cells.append(f"{got['survived'][0]:.0f} of {got['runs'][0]:.0f}")
            of = ("offset", "nine tenths", "greatest offset", "angle")
            cells += [_milli(*got[quantity]) for quantity in of]
        rows.append(cells)
    return table(head, rows)


def matrix(found: Findings, case: str) -> str:
    """Runs that survived by rate and lag, of all kinds of lag, exact and semi-implicit plant."""
    counts: dict[tuple[float, str], dict[str, list[float]]] = {}
    for m in found.measurements:
        if m.case == case and m.quantity in ("survived", "runs"):
            lag = m.subject.split()[0]
            for column in (lag, "all"):
                of = counts.setdefault((float(m.settings["rate"]), column), {})
                pair = of.setdefault(str(m.settings["integration"]), [0.0, 0.0])
                pair[m.quantity == "runs"] += m.value
    columns = list(dict.fromkeys(column for _, column in counts))
    columns.append(columns.pop(columns.index("all"))) if columns else None
    rows = [
        [f"{rate:g} Hz"]
        + [
            " / ".join(f"{fine:.0f}" for fine, _ in of.values())
            + f" of {max(runs for _, runs in of.values()):.0f}"
            for of in (counts[rate, column] for column in columns)
        ]
        for rate in dict.fromkeys(rate for rate, _ in counts)
    ]
    return table(["rate", *columns], rows)


def failed(found: Findings) -> str:
    """Runs that did not survive, by scene and rate, and what they exceeded."""
    counts: dict[str, Counter[float]] = {}
    reasons: dict[str, Counter[str]] = {}
    rates: dict[float, None] = {}
    for m in found.measurements:
        if m.case == measure.ONE_BY_ONE:
            rate, scene = float(m.settings["rate"]), m.subject.split(":")[0]
            rates[rate] = None
            if m.value != 1.0:
                counts.setdefault(scene, Counter())[rate] += 1
                reasons.setdefault(scene, Counter()).update(m.note.split(" and "))
    rows = [
        [
            scene,
            *(str(of[rate] or "") for rate in rates),
            ", ".join(f"{reason} {n}" for reason, n in reasons[scene].most_common()),
        ]
        for scene, of in sorted(counts.items(), key=lambda one: -one[1].total())
    ]
    return table(["scene", *(f"{rate:g} Hz" for rate in rates), "exceeded"], rows)


def all_free_running(found: Findings) -> str:
    """The free-running plant: summaries, scenes with failures, and every cell."""
    measured = {m.case for m in found.measurements}
    cases = [case for case in (measure.FREE_RUNNING, measure.TUMBLING) if case in measured]
    parts = {f"{case.capitalize()}: survived": matrix(found, case) for case in cases}
    if any(m.case == measure.ONE_BY_ONE and m.value != 1.0 for m in found.measurements):
        parts["Runs that did not survive"] = failed(found)
    parts[f"{measure.FREE_RUNNING.capitalize()}: offset and angle reached"] = free_running(found)
    return "\n\n".join(f"**{title}**\n\n{text}" for title, text in parts.items())


def _cells(cells: dict[tuple[str, str], tuple[float, str]]) -> list[str]:
    row = []
    for latency in (sweep.SET, sweep.MEASURED, sweep.NOT_SET):
        names = ["bounded", "offset", "angle", "energy", "passive"]
        if latency == sweep.NOT_SET:
            names.remove("passive")
        if (latency, "runs") not in cells:
            row += [""] * len(names)
            continue
        runs = cells[latency, "runs"][0]
        for name in names:
            value, unit = cells[latency, name]
            if name in ("bounded", "passive"):
                row.append(f"{value:.0f} of {runs:.0f}")
            elif name == "energy":
                row.append(_percent(value))
            else:
                row.append(_milli(value, unit))
    return row


def _percent(value: float) -> str:
    """Excess of energy relative to the energy scale, in percent."""
    return f"+{100.0 * max(value, 0.0):.2g} %" if _bounded(value) else "∞"


def _milli(value: float, unit: str) -> str:
    return number(1e3 * value, f"m{unit}") if _bounded(value) else "∞"


def _bounded(value: float) -> bool:
    return math.isfinite(value) and abs(value) < 1e6
