"""What a change of parameters does to a run: end, stop time and greatest forces side by side."""

from __future__ import annotations

import math

from cylconn_ros.connector.summary import GREATEST, RunSummary

_WIDTH = 26


def table(names: tuple[str, str], before: RunSummary, after: RunSummary) -> list[str]:
    """Return lines that compare two runs; ``names`` of the two columns."""
    rows = [
        ("slide at the end", before.distance, after.distance, "m"),
        ("spin at the end", before.turns, after.turns, "turns"),
        ("at rest from", before.stop_time, after.stop_time, "s"),
    ]
    rows += [
        (f"greatest {name.replace('_', ' ')}", before.greatest[name], after.greatest[name], unit)
        for name, unit in GREATEST.items()
        if name in before.greatest and name in after.greatest
    ]
    lines = [f"{'':<{_WIDTH}}{names[0]:>16}{names[1]:>16}{'change':>16}"]
    for name, old, new, unit in rows:
        texts = [_number(old), _number(new), _change(old, new)]
        lines.append(f"{name:<{_WIDTH}}" + "".join(f"{text:>16}" for text in texts) + f"  {unit}")
    return lines


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.6g}"


def _change(old: float, new: float) -> str:
    if math.isnan(old) or math.isnan(new):
        return "-"
    same = math.isclose(new, old, rel_tol=1e-9, abs_tol=1e-12)  # rounding is no change
    return "none" if same else f"{new - old:+.4g}"
