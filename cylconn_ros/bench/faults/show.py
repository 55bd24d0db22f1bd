"""The faults as tables: what was expected and seen, and the library with and without latency."""

from __future__ import annotations

import math

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
        ]
    )


def processes(found: Findings) -> str:
    """A row a fault: expected, seen, met or not."""
    rows = []
    for m in found.measurements:
        if m.problem == measure.PROCESSES and m.quantity == measure.MET:
            wrong = str(m.settings["wrong"])
            verdict = VERDICT[m.value == 1.0] + (f": {wrong}" if wrong else "")
            rows.append((m.contestant, str(m.settings["expected"]), m.note, verdict))
    return table(("fault", "expected", "seen", ""), rows)


def library(found: Findings) -> str:
    """A row a fault: runs that stay bounded with the latency told, measured, not told."""
    values: dict[str, dict[tuple[str, str], tuple[float, str]]] = {}
    for m in found.measurements:
        if m.problem == measure.LIBRARY_RUNS:
            told = str(m.settings["latency"])
            values.setdefault(m.contestant, {})[told, m.quantity] = (m.value, m.unit)
    head = ["fault"]
    for told in (sweep.TOLD, sweep.MEASURED):
        head += [f"{told}: bounded", "offset", "angle", "energy", "passive"]
    head += [f"{sweep.NOT_TOLD}: bounded", "offset", "angle", "energy"]
    rows = [[fault, *_cells(cells)] for fault, cells in values.items()]
    return table(head, rows)


def _cells(cells: dict[tuple[str, str], tuple[float, str]]) -> list[str]:
    row = []
    for told in (sweep.TOLD, sweep.MEASURED, sweep.NOT_TOLD):
        names = ["bounded", "offset", "angle", "energy", "passive"]
        if told == sweep.NOT_TOLD:
            names.remove("passive")
        if (told, "runs") not in cells:
            row += [""] * len(names)
            continue
        of = cells[told, "runs"][0]
        for name in names:
            value, unit = cells[told, name]
            if name in ("bounded", "passive"):
                row.append(f"{value:.0f} of {of:.0f}")
            elif name == "energy":
                row.append(_share(value))
            else:
                row.append(_milli(value, unit))
    return row


def _share(value: float) -> str:
    """A share of what the scene has."""
    return f"+{100.0 * max(value, 0.0):.2g} %" if _sane(value) else "∞"


def _milli(value: float, unit: str) -> str:
    return number(1e3 * value, f"m{unit}") if _sane(value) else "∞"


def _sane(value: float) -> bool:
    return math.isfinite(value) and abs(value) < 1e6
