"""The headline of a precision benchmark: own error over the best simulator's at equal CPU time.

One row per scene. The simulators' points are those of their Pareto front (:mod:`pareto`); at each,
the own error is the least one that costs no more. The mark is the worst of these ratios, the line
reaches to the best one. Drawn as a picture, and printed as a table.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cylconn_ros.bench.common import report
from cylconn_ros.bench.common.results import Findings
from cylconn_ros.bench.precision import pareto, text
from cylconn_ros.bench.precision.cases import CASES
from cylconn_ros.bench.precision.pareto import LIMIT_REACTION_DEPENDENT, Point

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LIVE = "impulse"  # the method of one wrench per sample
SMALLEST, LARGEST = 1e-12, 40.0  # ratios beyond are drawn here


@dataclass(frozen=True)
class Row:
    """A scene.

    Attributes
    ----------
        case: its name. worst, best: greatest and least ratio over the simulators' front; NaN if no
        simulator has a solution. live: the greatest ratio of the method impulse alone. against: the
        simulator's point of the greatest ratio. limit: of the target. dominated: number of peers'
        points that dominate own ones.
    """

    case: str
    worst: float
    best: float
    live: float
    against: Point | None
    limit: float
    dominated: int

    @property
    def met(self) -> bool:
        """Whether the target is met; also if there is no simulator to compare with."""
        return not self.worst > self.limit


def rows(found: Findings) -> list[Row]:
    """All scenes, the smallest ratio first."""
    names = dict.fromkeys(m.case for m in found.measurements)
    return sorted((_row(found, name) for name in names), key=_order)


def _order(row: Row) -> tuple[bool, float]:
    return math.isnan(row.worst), row.worst


def _row(found: Findings, case: str) -> Row:
    least, every = pareto.rounding(case), pareto.points(found, case)
    own = pareto.front((p for p in every if pareto.kind(p) == "own"), least)
    live = pareto.front((p for p in every if p.solver == LIVE), least)
    simulators = [p for p in every if pareto.kind(p) == "simulator"]
    worst, against, _ = pareto.worst_ratio(own, simulators, least)
    ratios = [pareto.ratio_at_equal_cost(own, p, least) for p in pareto.front(simulators)]
    peers = pareto.front(p for p in every if pareto.kind(p) != "own")
    return Row(
        case, worst, min((r for r in ratios if not math.isnan(r)), default=math.nan),
        pareto.worst_ratio(live, simulators, least)[0], against,
        LIMIT_REACTION_DEPENDENT if CASES[case].reaction_dependent else 1.0,
        len(pareto.dominating(own, peers, least)),
    )  # fmt: skip


def story(found: Sequence[Row]) -> str:
    """What the rows say, in one sentence."""
    compared = [row for row in found if not math.isnan(row.worst)]
    changing = [row for row in compared if row.limit < 1.0]
    smaller = sum(row.worst <= 1.0 for row in compared)
    hundredth = sum(row.met for row in changing)
    return (
        f"not larger on {smaller} of {len(compared)} scenes, at most a hundredth on {hundredth} of "
        f"{len(changing)} whose friction depends on changing reactions (◆)"
    )


def body(found: Findings) -> str:
    """The tables of the benchmark; first the headline."""
    return f"{table(rows(found))}\n\n{text.body(found)}"


def table(found: Sequence[Row]) -> str:
    """The headline as Markdown: a sentence and one line per scene."""
    dominated = [row.case for row in found if row.dominated]
    lines = [
        (
            f"`{row.case}`" + (" ◆" if row.limit < 1.0 else ""),
            f"{row.worst:#.3g}", f"{row.best:#.3g}",
            f"{row.live:#.3g}",
            f"{row.against.solver} at {row.against.value:g}" if row.against else "",
            str(row.dominated or ""),
        )
        for row in found
    ]  # fmt: skip
    head = (
        "scene", "worst ratio", "best ratio", f"`{LIVE}` alone, worst", "worst against",
        "peers' points that dominate ours",
    )  # fmt: skip
    points = "No point of another solver dominates a point of our front."
    if dominated:
        points = f"Points of other solvers dominate points of our front on {', '.join(dominated)}."
    return (
        f"**Our error at equal CPU time over the best simulator's**: {story(found)}. {points}\n\n"
        + report.table(head, lines)
    )


# --- the picture ---


@dataclass(frozen=True)
class _Palette:
    page: str
    ink: str
    soft: str
    line: str
    own: str
    live: str
    missed: str
    good: str


LIGHT = _Palette("#FFFFFF", "#1F2328", "#59636E", "#D8DDE3", "#0A4A7D", "#2E8BC8", "#C4500A",
                 "#EAF3FA")  # fmt: skip
DARK = _Palette("#0D1117", "#E6EDF3", "#9198A1", "#30363D", "#79B8F2", "#4C8DC4", "#F0883E",
                "#12202E")  # fmt: skip


def save(found: Findings, folder: Path) -> list[Path]:
    """Draw ``headline`` and ``headline_dark`` (PNG and SVG) into a folder; return the files."""
    files = []
    for name, palette in (("headline", LIGHT), ("headline_dark", DARK)):
        files += [folder / f"{name}.{end}" for end in ("png", "svg")]
        draw(rows(found), files[-2:], palette)
    return files


def draw(found: Sequence[Row], files: Sequence[Path], palette: _Palette = LIGHT) -> None:
    """Draw the rows into PNG or SVG files, by their suffix.

    Raises ImportError without matplotlib.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    style: dict[Any, Any] = {
        "font.size": 10.0, "svg.fonttype": "none", "svg.hashsalt": "cylconn_ros",
        "text.color": palette.ink, "axes.edgecolor": palette.line, "xtick.color": palette.soft,
        "figure.facecolor": palette.page, "axes.facecolor": palette.page,
    }  # fmt: skip
    with mpl.rc_context(style):
        figure = Figure(figsize=(9.0, _height(len(found))))
        axes = figure.add_axes(_place(len(found)))
        _marks(axes, found, palette)
        _words(axes, found, palette)
        _texts(figure, found, palette)
        for file in files:
            metadata = {"Date": None} if file.suffix == ".svg" else None
            figure.savefig(file, dpi=150, metadata=metadata)


def _height(n: int) -> float:
    """Height of the picture of n scenes, inches."""
    return 1.42 + 0.31 * n


def _place(n: int) -> tuple[float, float, float, float]:
    return 0.205, 0.56 / _height(n), 0.52, 0.31 * n / _height(n)


def _marks(axes: Axes, found: Sequence[Row], palette: _Palette) -> None:
    axes.set_xscale("log")
    axes.set_xlim(SMALLEST / 3.0, 1e2)
    axes.set_ylim(len(found) - 0.5, -0.5)
    axes.axvspan(SMALLEST / 3.0, 1.0, color=palette.good, lw=0.0, zorder=0)
    axes.axvline(1.0, color=palette.ink, lw=1.2, zorder=1)
    axes.axvline(LIMIT_REACTION_DEPENDENT, color=palette.ink, lw=1.0, ls=(0, (4, 3)), zorder=1)
    for y, row in enumerate(found):
        axes.axhline(y, color=palette.line, lw=0.5, zorder=0.5)
        if math.isnan(row.worst):
            continue
        colour = palette.own if row.met else palette.missed
        x = max(row.worst, SMALLEST)
        axes.plot([max(row.best, SMALLEST), x], [y, y], color=colour, lw=2.2, alpha=0.35, zorder=2)
        if not math.isnan(row.live):
            far = row.live > LARGEST
            axes.plot(LARGEST if far else max(row.live, SMALLEST), y, ">" if far else "o", ms=6.0,
                      mfc=palette.page, mec=palette.live, mew=1.4, zorder=3)  # fmt: skip
        axes.plot(x, y, "D" if row.limit < 1.0 else "o", color=colour, ms=7.5, zorder=4)


def _words(axes: Axes, found: Sequence[Row], palette: _Palette) -> None:
    axes.set_yticks([])
    axes.set_xticks([10.0**k for k in range(-12, 3, 2)])
    axes.minorticks_off()
    axes.tick_params(axis="x", length=0, labelsize=8.5)
    for spine in axes.spines.values():
        spine.set_visible(False)
    beside = axes.get_yaxis_transform()
    for y, row in enumerate(found):
        title = row.case.replace("_", " ") + (" ◆" if row.limit < 1.0 else "")
        axes.text(-0.02, y, title, transform=beside, ha="right", va="center", fontsize=9.5)
        axes.text(1.02, y, _in_words(row), transform=beside, va="center", fontsize=9.0,
                  color=palette.ink if row.met else palette.missed)  # fmt: skip
    top = axes.get_xaxis_transform()
    for x, label in ((1.0, "equal"), (LIMIT_REACTION_DEPENDENT, "target ◆")):
        axes.text(x, 1.01, label, transform=top, ha="center", va="bottom", fontsize=8.5,
                  color=palette.soft)  # fmt: skip


def _texts(figure: Figure, found: Sequence[Row], palette: _Palette) -> None:
    """Heading, sentence and legend."""
    inch, sentence = 1.0 / _height(len(found)), story(found)
    heading = "Error at equal CPU time: ours over the best simulator's"
    figure.text(0.012, 0.985, heading, fontsize=13.5, weight="bold", va="top")
    figure.text(
        0.012, 0.985 - 0.30 * inch, f"{sentence[0].upper()}{sentence[1:]}.", fontsize=9.5,
        va="top", color=palette.soft,
    )  # fmt: skip
    legend = (
        "left is better · filled: our best method at the worst point of the simulators' front, "
        f"line: to the best one · open: {LIVE} alone (one wrench per sample)"
    )
    figure.text(0.012, 0.10 * inch, legend, fontsize=8.5, color=palette.soft)


def _in_words(row: Row) -> str:
    if row.against is None:
        return "no simulator has a solution"
    against = row.against.solver.split(",")[0]
    if max(row.against.error, 0.0) <= pareto.rounding(row.case) and row.worst >= 0.5:
        return f"both exact ({against})"
    if row.worst > 1.0:
        return f"{_times(row.worst)} larger than {against}"
    return f"{_times(1.0 / row.worst)} smaller than {against}"


def _times(factor: float) -> str:
    if factor < 10.0:
        return f"{factor:.1f}×"
    if factor < 1e6:
        digits = 10 ** (len(str(int(factor))) - 2)
        return f"{round(factor / digits) * digits:,}×".replace(",", " ")
    return f"10{str(int(math.log10(factor))).translate(str.maketrans('0123456789', '⁰¹²³⁴⁵⁶⁷⁸⁹'))}×"
