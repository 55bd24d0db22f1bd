"""Results of a benchmark as Markdown: targets first, then all measurements; and into a page."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence

from cylconn_ros.bench.common.results import Findings, Measurement, NotMeasured, Report, Target

VERDICT = {True: "met", False: "MISSED", None: "not measured"}
END = "<!-- end -->"


def text(report: Report, body: Callable[[Findings], str] | None = None) -> str:
    """A whole report as Markdown that is also readable in a terminal.

    Args:
        body: formats the measurements; by default one table per case.
    """
    found = report.findings
    parts = [provenance(report)]
    parts += [targets(found.targets)] if found.targets else []
    parts.append((body or sections)(found))
    parts += [not_measured(found.not_measured)] if found.not_measured else []
    parts.append(conditions(report))
    return "\n\n".join(parts) + "\n"


def provenance(report: Report) -> str:
    """The line above the tables: kernel's digest, date, machine and the command that made them.

    :func:`stated_kernel` reads it.
    """
    kernel = stated_kernel(report.machine.get("cylconn_ros", "")) or "unknown"
    return (
        f"Kernel {kernel}, {report.started[:10]}, {report.machine.get('processor', 'unknown')}; "
        f"made by `{report.command}`."
    )


def stated_kernel(block: str) -> str:
    """The kernel's digest that the results between two marks state; empty if they state none."""
    found = re.search(r"\bkernel ([0-9a-f]{12})\b", block, re.IGNORECASE)
    return found[1] if found else ""


def blocks(page: str) -> dict[str, str]:
    """The results in a page: text between the marks, by command."""
    pattern = rf"<!-- (cylconn bench [^>]*?) -->(.*?){re.escape(END)}"
    return {found[1]: found[2] for found in re.finditer(pattern, page, re.DOTALL)}


def targets(found: Sequence[Target]) -> str:
    """Table of the targets and the measured values."""
    rows = [
        (t.name, number(t.value, t.unit), f"≤ {number(t.limit, t.unit)}", VERDICT[t.met], t.note)
        for t in found
    ]
    return table(("target", "measured", "limit", "", "note"), rows)


def sections(found: Findings) -> str:
    """All measurements, case by case."""
    return "\n\n".join(section(name, group) for name, group in _by_case(found))


def section(case: str, found: Sequence[Measurement]) -> str:
    """The measurements of one case: one row per subject, one column per quantity.

    A number followed by its quartiles is a median.
    """
    quantities = list(dict.fromkeys(m.quantity for m in found))
    rows: dict[str, list[str]] = {}
    for m in found:
        row = rows.setdefault(m.subject + _settings(m), [""] * (len(quantities) + 1))
        row[quantities.index(m.quantity)] = _with_spread(m)
        row[-1] = m.note or row[-1]
    body = [(name, *row) for name, row in rows.items()]
    return f"**{case}**\n\n" + table(("", *quantities, "note"), body)


def not_measured(found: Sequence[NotMeasured]) -> str:
    """Table of the subjects without results, and the reasons."""
    rows = [(one.subject, one.case, one.status, one.reason) for one in found]
    return table(("not measured", "on", "", "reason"), rows)


def conditions(report: Report) -> str:
    """Command, machine, versions and settings."""
    lines = [f"{report.command}, {report.started}"]
    lines += [f"{name}: {value}" for name, value in report.machine.items()]
    lines.append("settings: " + ", ".join(f"{k} {v}" for k, v in report.settings.items()))
    return "\n".join(f"- {line}" for line in lines)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table, padded for a terminal, without its empty columns."""
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
    """Three digits and the unit; integers for counts (no unit); a dash if not finite."""
    if not math.isfinite(value):
        return "–"
    if not unit and float(value).is_integer():
        return str(int(value))
    digits = f"{value:#.3g}".rstrip(".") if 1e-2 <= abs(value) < 1e4 else f"{value:.2e}"
    digits = "0" if value == 0.0 else digits
    return digits if unit in ("", "1") else f"{digits} {unit}"


def mark(command: str) -> str:
    """The line in a page above the results of a command; ``<!-- end -->`` follows them."""
    return f"<!-- {command} -->"


def replace_results(page: str, command: str, text: str) -> str:
    """The page with new results of a command between its marks.

    Raises ValueError if the page does not have both marks once.
    """
    begin = mark(command)
    if page.count(begin) != 1 or END not in page.partition(begin)[2]:
        raise ValueError(f"needs one line {begin} and a line {END} below it")
    pattern = re.escape(begin) + r".*?" + re.escape(END)
    new = f"{begin}\n\n{text.strip()}\n\n{END}"
    return re.sub(pattern, lambda _: new, page, count=1, flags=re.DOTALL)


def _with_spread(m: Measurement) -> str:
    value = number(m.value, m.unit)
    return value if math.isnan(m.low) else f"{value} ({number(m.low, '')} – {number(m.high, '')})"


def _settings(m: Measurement) -> str:
    if not m.settings:
        return ""
    values = (f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in m.settings.items())
    return f" ({', '.join(values)})"


def _by_case(found: Findings) -> Iterable[tuple[str, list[Measurement]]]:
    for case in dict.fromkeys(m.case for m in found.measurements):
        yield case, [m for m in found.measurements if m.case == case]
