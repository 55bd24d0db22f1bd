"""Content of a page of findings: verdict, sections of text, tables and plots; and its data."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.report import decimate
from cylconn_ros.report.payload import Packer

Array = npt.NDArray[Any]

BUCKETS = 500
"""Buckets of consecutive points, of more than which a plot keeps the extremes."""


@dataclass(frozen=True)
class Series:
    """Points, lines or intervals of a plot.

    Attributes
    ----------
        label: in the legend; empty: not in it.
        colour: a name in page.css.
        kind: points, rings, diamonds, line, dashed, steps (each y holds until the next x), band
            (between low and high), means (points with bars from low to high), or open (the same
            with open points).
        x, y: (n,) in the units of the axes.
        low, high: (n,) ends of bars or of a band; in a plot with names, along x.
    """

    label: str
    colour: str
    kind: str
    x: Array
    y: Array
    low: Array | None = None
    high: Array | None = None


@dataclass(frozen=True)
class Plot:
    """One plot.

    Attributes
    ----------
        key: unique name. title, x, y: texts of heading and axes.
        series: drawn in this order.
        note: text below the heading.
        mark: what was found in it, shown beside the heading; ``bad``: it is a problem, ``good``:
            it is none.
        names: of the whole numbers on the y axis, from 0 on.
        equal: the same scale on both axes.
    """

    key: str
    title: str
    x: str
    y: str
    series: Sequence[Series]
    note: str = ""
    mark: str = ""
    bad: bool = False
    good: bool = False
    names: Sequence[str] = ()
    equal: bool = False


@dataclass(frozen=True)
class Table:
    """A table; ``weak`` are the numbers of rows that are not results."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    weak: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Section:
    """A heading with sentences, a list, a table and plots."""

    key: str
    title: str
    text: str = ""
    items: Sequence[str] = ()
    table: Table | None = None
    plots: Sequence[Plot] = ()


@dataclass(frozen=True)
class Findings:
    """What a page says.

    Attributes
    ----------
        verdict: one sentence. state: good, fair or bad. reasons: sentences that explain it.
        sections: in the order of the page.
    """

    verdict: str
    state: str
    reasons: Sequence[str]
    sections: Sequence[Section] = field(default_factory=list)


def thinned(columns: Sequence[Array], buckets: int = BUCKETS) -> npt.NDArray[np.intp]:
    """Return the rows (m,) of points that are drawn: all, or those with the extremes of buckets.

    ``columns`` (n,) are those whose extremes are kept.
    """
    count = len(columns[0])
    if count <= buckets * (2 * len(columns) + 1):
        return np.arange(count, dtype=np.intp)
    return decimate.extreme_rows(columns, decimate.bucket_starts(count, buckets), count)


def build(found: Findings) -> tuple[dict[str, Any], str]:
    """Build the header and the packed data of a page."""
    packer = Packer()

    def series(one: Series) -> dict[str, Any]:
        columns = {"x": one.x, "y": one.y, "low": one.low, "high": one.high}
        packed = {k: packer.pack(v) for k, v in columns.items() if v is not None}
        return {"label": one.label, "colour": one.colour, "kind": one.kind, "columns": packed}

    plots = [
        {
            "section": section.key,
            "key": plot.key,
            "title": plot.title,
            "labels": [plot.x, plot.y],
            "note": plot.note,
            "mark": plot.mark,
            "bad": plot.bad,
            "good": plot.good,
            "names": list(plot.names),
            "equal": plot.equal,
            "series": [series(one) for one in plot.series],
        }
        for section in found.sections
        for plot in section.plots
    ]
    return {"plots": plots}, packer.text()


_SIGNS = {"good": "✓", "fair": "!", "bad": "✗"}


def verdict_html(found: Findings) -> str:
    """Return the verdict as HTML; its state is a sign and a colour."""
    items = "\n".join(f"<li>{html.escape(one)}</li>" for one in found.reasons)
    return (
        f'<section class="verdict {found.state}" id="verdict">\n'
        f'<h2><i aria-hidden="true">{_SIGNS[found.state]}</i>{html.escape(found.verdict)}</h2>\n'
        f"<ul>\n{items}\n</ul>\n</section>"
    )


def section_html(section: Section) -> str:
    """Return a section as HTML, with an empty place for its plots."""
    parts = [
        f'<section class="findings" id="{section.key}">',
        f"<h2>{html.escape(section.title)}</h2>",
    ]
    if section.text:
        parts.append(f"<p>{html.escape(section.text)}</p>")
    if section.items:
        parts += ["<ul>", *(f"<li>{html.escape(one)}</li>" for one in section.items), "</ul>"]
    if section.table is not None:
        parts.append(_table_html(section.table))
    if section.plots:
        parts.append('<div class="plots"></div>')
    return "\n".join([*parts, "</section>"])


def _table_html(table: Table) -> str:
    """Return a table whose cells carry their column's name, for narrow windows."""
    heads = [html.escape(one) for one in table.head]
    rows = [
        f"<tr{' class=weak' if k in table.weak else ''}>"
        + "".join(
            f'<td data-label="{head}">{html.escape(cell)}</td>'
            for head, cell in zip(heads, row, strict=True)
        )
        + "</tr>"
        for k, row in enumerate(table.rows)
    ]
    head = "".join(f"<th>{one}</th>" for one in heads)
    return "\n".join(
        ["<table>", f"<thead><tr>{head}</tr></thead><tbody>", *rows, "</tbody></table>"]
    )
