"""The picture of a precision benchmark: error vs. CPU time, one panel per case, failures on top.

A curve is the Pareto front of a group of solvers; the interactive page shows every solver.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cylconn_ros.bench.common.results import Findings
from cylconn_ros.bench.precision import pareto
from cylconn_ros.bench.precision.cases import CASES, Case
from cylconn_ros.bench.precision.pareto import Point
from cylconn_ros.methods.traits import SOLVERS, TRAITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LOWEST = 1e-15  # m: smaller errors are drawn here
HIGHEST = 2.0  # m: failures are drawn above
INK, SOFT = "#222222", "#8A8A8A"


@dataclass(frozen=True)
class Curve:
    """Solvers that are drawn as one curve, selected by the start and end of their names.

    ``exact``: by their whole names.
    """

    label: str
    starts: tuple[str, ...]
    color: str
    width: float = 1.3
    style: str = "-"
    ends: str = ""
    exact: bool = False

    def contains(self, name: str) -> bool:
        """Whether a solver belongs to this curve."""
        if self.exact:
            return name in self.starts
        return name.startswith(self.starts) and name.endswith(self.ends)


def _methods(label: str, color: str, width: float, style: str, **traits: bool) -> Curve:
    """The curve of the package's closed-loop methods with these traits."""
    names = [
        name for name in SOLVERS
        if all(getattr(TRAITS[name], trait) == value for trait, value in traits.items())
    ]  # fmt: skip
    return Curve(label or ", ".join(names), tuple(names), color, width, style, exact=True)


CURVES = (
    Curve("MuJoCo, constant", ("MuJoCo",), "#E69F00", style=":", ends="constant"),
    Curve("MuJoCo, calibrated", ("MuJoCo",), "#E69F00", style="--", ends="calibrated"),
    Curve("MuJoCo, loop", ("MuJoCo",), "#E69F00", ends="loop"),
    Curve("MuJoCo, our friction", ("MuJoCo with this package's friction",), "#7A4FB5", exact=True),
    Curve("Drake", ("Drake",), "#009E73"),
    Curve("PyBullet", ("PyBullet",), "#D55E00"),
    Curve("Pinocchio", ("Pinocchio",), "#CC79A7"),
    Curve("Exudyn", ("Exudyn",), "#8C6D1F"),
    Curve("SciPy, reduced eqs.", ("SciPy",), "#555555"),
    _methods("penalty, aug. Lagr.", "#8FB7D6", 1.1, "--", uses_gains=True),
    _methods("", "#8FB7D6", 1.1, "-", uses_gains=False, second_order=False),
    _methods("", "#2E8BC8", 2.4, "-", uses_gains=False, second_order=True),
    Curve("minimal", ("minimal",), "#1F5F99", 1.6, exact=True),
    Curve("tolerance", ("tolerance parameter",), "#04243F", 2.8, exact=True),
)
_STYLE: dict[Any, Any] = {
    "font.size": 8.5,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "svg.fonttype": "none",
    "svg.hashsalt": "cylconn_ros",
}


TITLE = (
    "Error of the whole motion vs. CPU time; lower left is better.  × failed.  "
    "◆ friction depends on changing reactions.\n"
    "Curve: Pareto front of a group of solvers; bars: quartiles of CPU time; "
    "loop: friction limit from the last step's reaction.  Dotted: a published result, without time."
)


def draw(found: Findings, files: Sequence[Path]) -> None:
    """Draw every case of ``found`` into PNG or SVG files, by their suffix."""
    import matplotlib as mpl
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    names = list(dict.fromkeys(m.case for m in found.measurements))
    columns = min(3 if len(names) <= 12 else 4, len(names))
    rows = math.ceil(len(names) / columns)
    with mpl.rc_context(_STYLE):
        figure = Figure(
            figsize=(4.7 * columns, 3.15 * rows + 0.75),
            layout=ConstrainedLayoutEngine(hspace=0.06, wspace=0.03),
        )
        axes = figure.subplots(rows, columns, squeeze=False)
        for panel, name in zip(axes.flat, names, strict=False):
            _panel(panel, CASES[name], pareto.points(found, name))
        for panel in list(axes.flat)[len(names) :]:
            panel.set_axis_off()
        for panel in axes[-1]:
            panel.set_xlabel("CPU time per simulated second, ms")
        for row in axes:
            row[0].set_ylabel("error, m")
        figure.suptitle(TITLE, x=0.01, ha="left", fontsize=10.5, color=INK)
        for file in files:
            metadata = {"Date": None} if file.suffix == ".svg" else None
            figure.savefig(file, dpi=110, metadata=metadata)


def _panel(axes: Axes, case: Case, points: Sequence[Point]) -> None:
    """One case: labelled curves, and crosses for failed points."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(LOWEST / 3.0, HIGHEST * 30.0)
    axes.set_title(
        case.title + (" ◆" if case.reaction_dependent else ""), loc="left", fontsize=9.5, color=INK
    )
    axes.text(
        1.0, 1.025, case.error_of, transform=axes.transAxes, ha="right", fontsize=7.5, color=SOFT
    )
    axes.grid(True, color="#E6E6E6", linewidth=0.5)
    costs = [p.cost for p in points if math.isfinite(p.cost) and p.cost > 0.0]
    low, high = min(costs, default=1e-3), max(costs, default=1.0)
    axes.set_xlim(low / 1.6, high * (high / low) ** 0.42)
    axes.set_yticks([10.0**k for k in range(-15, 1, 3)])
    axes.minorticks_off()
    axes.axhspan(HIGHEST, HIGHEST * 30.0, color="#F5F0F0", linewidth=0.0)
    axes.text(low / 1.5, HIGHEST * 8.0, "failed", fontsize=7, color=SOFT, va="center")
    if case.published:
        name, error = case.published
        axes.axhline(error, color=INK, linewidth=0.8, linestyle=(0, (1, 2)), zorder=1.0)
        axes.text(
            low / 1.5, error * 1.5, f"published: {name}", fontsize=6.5, color=INK, va="bottom"
        )
    labels = []
    for k, curve in enumerate(CURVES):
        own = [p for p in points if curve.contains(p.solver)]
        best = pareto.front(own)
        failures = [p.cost for p in own if p.failed and math.isfinite(p.cost)]
        level = HIGHEST * (1.8 + 24.0 * ((k * 5) % len(CURVES)) / len(CURVES))
        axes.plot(
            failures, [level] * len(failures), "x", color=curve.color, markersize=3.6, mew=0.9
        )
        if not best:
            continue
        x, y = [p.cost for p in best], [max(p.error, LOWEST) for p in best]
        axes.plot(
            x, y, curve.style, color=curve.color, linewidth=curve.width, marker="o",
            markersize=1.6 + 0.7 * curve.width, markeredgewidth=0.0, zorder=2.0 + curve.width,
        )  # fmt: skip
        for p, height in zip(best, y, strict=True):
            axes.plot([p.low, p.high], [height] * 2, color=curve.color, linewidth=0.9)
        labels.append((x[-1], y[-1], curve))
    _label(axes, labels)


def _label(axes: Axes, labels: Sequence[tuple[float, float, Curve]]) -> None:
    """Labels at the right, as near to the ends of their curves as possible without overlap."""
    spacing = 0.95  # decades
    lowest, highest = math.log10(LOWEST), math.log10(HIGHEST) - 0.2
    ends = sorted((math.log10(y), k) for k, (_, y, _) in enumerate(labels))
    heights: list[float] = []
    for y, _ in ends:
        heights.append(max(y, heights[-1] + spacing if heights else lowest))
    over = max(0.0, heights[-1] - highest) if heights else 0.0
    for j in reversed(range(len(heights))):
        limit = highest if j == len(heights) - 1 else heights[j + 1] - spacing
        heights[j] = min(heights[j], limit) if over else heights[j]
    right = axes.get_xlim()[1]
    left = right / (right / axes.get_xlim()[0]) ** 0.27
    for (_, k), height in zip(ends, heights, strict=True):
        x, y, curve = labels[k]
        at = 10.0**height
        axes.plot(
            [x, left * 0.93], [y, at], color=curve.color, linewidth=0.4, alpha=0.55, zorder=1.5
        )
        axes.text(
            left, at, curve.label, fontsize=7.2, color=curve.color, va="center",
            fontweight="bold" if curve.width > 2.0 else "normal",
        )  # fmt: skip
