"""The map as a table and as a picture."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cylconn_ros.bench.common.report import table
from cylconn_ros.bench.common.results import Findings
from cylconn_ros.bench.stability.conditions import Condition, conditions
from cylconn_ros.bench.stability.measure import SURVIVED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TITLE = "The hardest grade survived: of every one (blue) to none (red)"
NOTHING = "–"
HEADINGS = {"physical": "In process: only wrenches go out", "channel": "On the way"}


@dataclass(frozen=True)
class Mark:
    """A cell as it is shown.

    Attributes
    ----------
        text: the hardest grade survived; behind it, easier ones that were not.
        share: of the grades survived; NaN: not tried.
        failure: the easiest grade that was not survived, and what of.
    """

    text: str
    share: float
    failure: str = ""


class Map:
    """All marks, by row and column; the grades that were tried, by row."""

    def __init__(self, found: Findings) -> None:
        results: dict[tuple[str, str], dict[str, str]] = {}
        for m in found.measurements:
            if m.quantity == SURVIVED:
                grades = results.setdefault((m.problem, m.contestant), {})
                grades[str(m.settings["grade"])] = m.note
        gaps = [(name, g.contestant) for g in found.gaps for name in g.problem.split("; ")]
        seen = dict.fromkeys([*(c for _, c in results), *(c for _, c in gaps)])
        self.columns = list(seen)
        self.grades = {name: grades for (name, _), grades in results.items()}
        self.rows = [c for c in conditions() if any((c.name, who) in results for who in seen)]
        self.marks = {
            (row.name, who): _mark(row, results.get((row.name, who), {}))
            for row in self.rows
            for who in self.columns
        }

    def line(self, row: Condition) -> list[Mark]:
        """One row."""
        return [self.marks[row.name, who] for who in self.columns]


def _mark(row: Condition, grades: dict[str, str]) -> Mark:
    """``grades``: what each was not survived of; empty: survived."""
    if not grades:
        return Mark(NOTHING, float("nan"))
    survived = [grade for grade, reason in grades.items() if not reason]
    lost = {grade: reason for grade, reason in grades.items() if reason}
    failure = next((f"{grade}: {reason}" for grade, reason in lost.items()), "")
    share = len(survived) / len(grades)
    if not row.series:
        text = f"{len(survived)} of {len(grades)}"
        return Mark(text, share, "; ".join(f"{grade}: {reason}" for grade, reason in lost.items()))
    if not survived:
        return Mark("none", share, failure)
    order = list(grades)
    easier = [grade for grade in order[: order.index(survived[-1])] if grade in lost]
    text = survived[-1] + (f" (not {', '.join(easier)})" if easier else "")
    return Mark(text if lost else f"**{text}**", share, failure)


def body(found: Findings) -> str:
    """Both tables in Markdown: the hardest grade survived; what the first failure was."""
    shown = Map(found)
    head = ("", "grades", *shown.columns)
    survived, failed = [], []
    for row in shown.rows:
        line = shown.line(row)
        grades = ", ".join(shown.grades[row.name])
        survived.append((row.name, grades, *(mark.text for mark in line)))
        failed.append((row.name, *(mark.failure for mark in line)))
    return "\n\n".join(
        (
            "**The hardest grade survived** (bold: all of them)",
            table(head, survived),
            "**The first failure**",
            table(("", *shown.columns), [row for row in failed if any(row[1:])]),
        )
    )


def draw(found: Findings, title: str = TITLE) -> Figure:
    """The heat map. Raises ImportError without matplotlib."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = Map(found)
    lines = list(_lines(shown.rows))
    style: Any = {"svg.fonttype": "none", "svg.hashsalt": "cylconn_ros", "font.size": 9.0}
    with mpl.rc_context(style):
        width, height = 3.2 + 1.08 * len(shown.columns), 1.5 + 0.30 * len(lines)
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.add_subplot()
        _cells(axes, shown, lines)
        _labels(axes, shown, lines)
        figure.suptitle(title, x=0.01, ha="left", fontsize=12)
    return figure


def _lines(rows: Sequence[Condition]) -> Iterable[Condition | str]:
    """Rows with a heading before each kind."""
    kind = ""
    for row in rows:
        if row.kind != kind:
            kind = row.kind
            yield HEADINGS[kind]
        yield row


def _cells(axes: Axes, shown: Map, lines: Sequence[Condition | str]) -> None:
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.patches import Rectangle

    # From Okabe and Ito's vermilion over white to blue: told apart with any colour vision.
    colours = LinearSegmentedColormap.from_list("survival", ["#D55E00", "#F4E4C8", "#0072B2"])
    for y, line in enumerate(lines):
        if isinstance(line, str):
            continue
        for x, mark in enumerate(shown.line(line)):
            tried = mark.share == mark.share
            colour = colours(mark.share) if tried else "#F0F0F0"
            axes.add_patch(Rectangle((x + 0.02, y + 0.04), 0.96, 0.92, color=colour, lw=0))
            ink = "white" if mark.share in (0.0, 1.0) else "#222222"
            small = 7.0 if len(mark.text) > 12 else 8.5
            text = mark.text.strip("*")
            axes.text(
                x + 0.5, y + 0.52, text, ha="center", va="center", fontsize=small,
                color=ink if tried else "#909090",
            )  # fmt: skip


def _labels(axes: Axes, shown: Map, lines: Sequence[Condition | str]) -> None:
    axes.set_xlim(0, len(shown.columns))
    axes.set_ylim(len(lines), 0)
    axes.xaxis.tick_top()
    names = [name.replace("_", "_\n").replace(" ", "\n", 1) for name in shown.columns]
    axes.set_xticks([x + 0.5 for x in range(len(names))], names)
    places = [y + 0.5 for y, line in enumerate(lines) if not isinstance(line, str)]
    axes.set_yticks(places, [line.name for line in lines if not isinstance(line, str)])
    for y, line in enumerate(lines):
        if isinstance(line, str):
            axes.text(0.02, y + 0.62, line, va="center", weight="bold", color="#222222")
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)


def save(found: Findings, paths: Sequence[Path]) -> None:
    """Write the picture; the ending says the format, .png or .svg."""
    figure = draw(found)
    for path in paths:
        metadata = {"Date": None} if path.suffix == ".svg" else {"Software": None}
        figure.savefig(path, dpi=130, metadata=metadata)
