"""Results for people: ratios and verdicts first, then everything measured."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

from cylconn_ros.bench.common.results import STEP, Findings, Gap, Measurement, Report, Target
from cylconn_ros.bench.convergence.orders import ERROR, ORDER, SHOWN

VERDICT = {True: "met", False: "MISSED", None: "not measured"}


def text(report: Report, body: Callable[[Findings], str] | None = None) -> str:
    """A whole report as Markdown that is also readable in a terminal.

    Args:
        body: what shows the measurements; by default a table a problem.
    """
    parts = [targets(report.findings.targets)] if report.findings.targets else []
    parts.append((body or sections)(report.findings))
    parts += [gaps(report.findings.gaps)] if report.findings.gaps else []
    parts.append(conditions(report))
    return "\n\n".join(parts) + "\n"


def targets(found: Sequence[Target]) -> str:
    """What was aimed at and what came out."""
    rows = [
        (t.name, number(t.value, t.unit), f"≤ {number(t.limit, t.unit)}", VERDICT[t.met], t.note)
        for t in found
    ]
    return table(("target", "measured", "limit", "", "note"), rows)


def sections(found: Findings) -> str:
    """Everything measured, problem by problem."""
    return "\n\n".join(section(name, group) for name, group in _by_problem(found))


def section(problem: str, found: Sequence[Measurement]) -> str:
    """Everything measured on one problem: a row a contestant, a column a quantity.

    A number with its quartiles behind it is a median.
    """
    quantities = list(dict.fromkeys(m.quantity for m in found))
    rows: dict[str, list[str]] = {}
    for m in found:
        row = rows.setdefault(m.contestant + _settings(m), [""] * (len(quantities) + 1))
        row[quantities.index(m.quantity)] = _with_spread(m)
        row[-1] = m.note or row[-1]
    body = [(name, *row) for name, row in rows.items()]
    return f"**{problem}**\n\n" + table(("", *quantities, "note"), body)


def gaps(found: Sequence[Gap]) -> str:
    """What is not in the results and why."""
    rows = [(g.contestant, g.problem, g.status, g.reason) for g in found]
    return table(("not measured", "on", "", "why"), rows)


def conditions(report: Report) -> str:
    """How and on what it was measured."""
    lines = [f"{report.command}, {report.started}"]
    lines += [f"{name}: {value}" for name, value in report.machine.items()]
    lines.append("settings: " + ", ".join(f"{k} {v}" for k, v in report.settings.items()))
    return "\n".join(f"- {line}" for line in lines)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table, padded for a terminal; columns that are empty are left out."""
    used = [k for k in range(len(head)) if any(row[k] for row in rows) or k == 0]
    cells = [[row[k].replace("|", "/") for k in used] for row in [head, *rows]]
    widths = [max(len(row[k]) for row in cells) for k in range(len(used))]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |"
        for row in cells
    ]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def number(value: float, unit: str) -> str:
    """Three digits and the unit; counts (no unit) whole; a dash where there is no number."""
    if not math.isfinite(value):
        return "–"
    if not unit and float(value).is_integer():
        return str(int(value))
    digits = f"{value:#.3g}".rstrip(".") if 1e-2 <= abs(value) < 1e4 else f"{value:.2e}"
    digits = "0" if value == 0.0 else digits
    return digits if unit in ("", "1") else f"{digits} {unit}"


def _with_spread(m: Measurement) -> str:
    value = number(m.value, m.unit)
    return value if math.isnan(m.low) else f"{value} ({number(m.low, '')} – {number(m.high, '')})"


def _settings(m: Measurement) -> str:
    if not m.settings:
        return ""
    values = (f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in m.settings.items())
    return f" ({', '.join(values)})"


def _by_problem(found: Findings) -> Iterable[tuple[str, list[Measurement]]]:
    for problem in dict.fromkeys(m.problem for m in found.measurements):
        yield problem, [m for m in found.measurements if m.problem == problem]


def orders(found: Findings) -> str:
    """Orders with the errors at one period, and costs: a row a quantity, a column a method."""
    methods = list(dict.fromkeys(m.contestant for m in found.measurements))
    rows: dict[tuple[str, str], dict[str, str]] = {}
    errors = {
        (m.problem, m.quantity.removeprefix(f"{ERROR}: "), m.contestant): m
        for m in found.measurements
        if m.settings.get("period") == SHOWN
    }
    for m in found.measurements:
        if m.quantity == STEP:
            rows.setdefault((m.problem, STEP), {})[m.contestant] = number(m.value, m.unit)
        elif m.quantity.startswith(f"{ORDER}: "):
            quantity = m.quantity.removeprefix(f"{ORDER}: ")
            error = errors[m.problem, quantity, m.contestant]
            slope = "" if math.isnan(m.value) else f"order {m.value:.1f}"
            size = f"{error.value:.0e} {error.unit}"
            text = "; ".join(filter(None, (slope, m.note, size)))
            rows.setdefault((m.problem, quantity), {})[m.contestant] = text
    body = [
        (problem, quantity, *(row.get(method, "") for method in methods))
        for (problem, quantity), row in rows.items()
    ]
    return table(("scene", "quantity", *methods), body)
