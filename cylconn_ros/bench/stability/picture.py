"""The stability map as Markdown tables and as a heat map."""

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

TITLE = "Hardest grade survived: all grades (blue) to none (red)"
NOT_MEASURED = "–"
HEADINGS = {"physical": "Physical conditions", "channel": "Faulty channel"}


@dataclass(frozen=True)
class Mark:
    """Text and colour of a cell.

    Attributes
    ----------
        text: the hardest grade survived, then easier ones that were not survived.
        share: of the grades survived; NaN: not measured.
        failure: the easiest grade that was not survived, and its first failed criterion.
    """

    text: str
    share: float
    failure: str = ""


class Map:
    """The stability map.

    Attributes
    ----------
        rows: conditions. columns: names of solvers. marks: by row and column.
        grades: measured grades, by row.
    """

    def __init__(self, found: Findings) -> None:
        results: dict[tuple[str, str], dict[str, str]] = {}
        for m in found.measurements:
            if m.quantity == SURVIVED:
                grades = results.setdefault((m.case, m.subject), {})
                grades[str(m.settings["grade"])] = m.note
        missing = [one.subject for one in found.not_measured]
        self.columns = list(dict.fromkeys([*(name for _, name in results), *missing]))
        self.grades = {name: grades for (name, _), grades in results.items()}
        self.rows = [c for c in conditions() if any((c.name, s) in results for s in self.columns)]
        self.marks = {
            (row.name, solver): _mark(row, results.get((row.name, solver), {}))
            for row in self.rows
            for solver in self.columns
        }

    def line(self, row: Condition) -> list[Mark]:
        """Marks of a row."""
        return [self.marks[row.name, solver] for solver in self.columns]


def _mark(row: Condition, grades: dict[str, str]) -> Mark:
    """``grades``: failed criterion of each grade; empty: survived."""
    if not grades:
        return Mark(NOT_MEASURED, float("nan"))
    survived = [grade for grade, failure in grades.items() if not failure]
    failed = {grade: failure for grade, failure in grades.items() if failure}
    failures = [f"{grade}: {failure}" for grade, failure in failed.items()]
    first = failures[0] if failures else ""
    share = len(survived) / len(grades)
    if not row.series:
        return Mark(f"{len(survived)} of {len(grades)}", share, "; ".join(failures))
    if not survived:
        return Mark("none", share, first)
    order = list(grades)
    easier = [grade for grade in order[: order.index(survived[-1])] if grade in failed]
    text = survived[-1] + (f" (not {', '.join(easier)})" if easier else "")
    return Mark(text if failed else f"**{text}**", share, first)


def body(found: Findings) -> str:
    """Two Markdown tables: hardest grade survived, and first failure."""
    stability_map = Map(found)
    head = ("", "grades", *stability_map.columns)
    survived, failed = [], []
    for row in stability_map.rows:
        line = stability_map.line(row)
        grades = ", ".join(stability_map.grades[row.name])
        survived.append((row.name, grades, *(mark.text for mark in line)))
        failed.append((row.name, *(mark.failure for mark in line)))
    return "\n\n".join(
        (
            "**Conditions survived**",
            summary(stability_map),
            "**Hardest grade survived** (bold: all grades)",
            table(head, survived),
            "**First failure**",
            table(("", *stability_map.columns), [row for row in failed if any(row[1:])]),
        )
    )


def summary(stability_map: Map) -> str:
    """Table of the conditions that each solver survives in all grades, in some, and in none."""
    rows = []
    for column in stability_map.columns:
        marks = [(row, stability_map.marks[row.name, column]) for row in stability_map.rows]
        measured = [(row, mark) for row, mark in marks if mark.share == mark.share]
        failed = [f"{row.name}: {mark.failure}" for row, mark in measured if mark.share == 0.0]
        counts = [
            sum(mark.share == 1.0 for _, mark in measured),
            sum(0.0 < mark.share < 1.0 for _, mark in measured), len(failed), len(measured),
        ]  # fmt: skip
        rows.append((column, *map(str, counts), "; ".join(failed)))
    head = ("", "all grades", "some", "none", "of conditions", "none of")
    return table(head, rows)


def draw(found: Findings, title: str = TITLE) -> Figure:
    """Draw the heat map. Raises ImportError without matplotlib."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    stability_map = Map(found)
    lines = list(_lines(stability_map.rows))
    style: Any = {"svg.fonttype": "none", "svg.hashsalt": "cylconn_ros", "font.size": 9.0}
    with mpl.rc_context(style):
        width, height = 3.2 + 1.08 * len(stability_map.columns), 1.5 + 0.30 * len(lines)
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.add_subplot()
        _cells(axes, stability_map, lines)
        _labels(axes, stability_map, lines)
        figure.suptitle(title, x=0.01, ha="left", fontsize=12)
    return figure


def _lines(rows: Sequence[Condition]) -> Iterable[Condition | str]:
    """Rows with a heading before each kind of condition."""
    kind = ""
    for row in rows:
        if row.kind != kind:
            kind = row.kind
            yield HEADINGS[kind]
        yield row


def _cells(axes: Axes, stability_map: Map, lines: Sequence[Condition | str]) -> None:
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.patches import Rectangle

    # Okabe and Ito's vermilion over white to blue: distinct with any colour vision.
    colours = LinearSegmentedColormap.from_list("survival", ["#D55E00", "#F4E4C8", "#0072B2"])
    for y, line in enumerate(lines):
        if isinstance(line, str):
            continue
        for x, mark in enumerate(stability_map.line(line)):
            measured = mark.share == mark.share
            colour = colours(mark.share) if measured else "#F0F0F0"
            axes.add_patch(Rectangle((x + 0.02, y + 0.04), 0.96, 0.92, color=colour, lw=0))
            ink = "white" if mark.share in (0.0, 1.0) else "#222222"
            small = 7.0 if len(mark.text) > 12 else 8.5
            text = mark.text.strip("*")
            axes.text(
                x + 0.5, y + 0.52, text, ha="center", va="center", fontsize=small,
                color=ink if measured else "#909090",
            )  # fmt: skip


def _labels(axes: Axes, stability_map: Map, lines: Sequence[Condition | str]) -> None:
    axes.set_xlim(0, len(stability_map.columns))
    axes.set_ylim(len(lines), 0)
    axes.xaxis.tick_top()
    names = [name.replace("_", "_\n").replace(" ", "\n", 1) for name in stability_map.columns]
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
    """Write the picture to each path, whose suffix determines the format (.png or .svg)."""
    figure = draw(found)
    for path in paths:
        metadata = {"Date": None} if path.suffix == ".svg" else {"Software": None}
        figure.savefig(path, dpi=130, metadata=metadata)
