"""Page of an archive: how many recordings passed, what is wrong with the others, what changed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cylconn_ros.report.findings import Findings, Plot, Section, Series, Table
from cylconn_ros.report.page import Fact, render_findings
from cylconn_ros.study.archive.bags import BAG, SIZE
from cylconn_ros.study.archive.compare import Change
from cylconn_ros.study.archive.tasks import unit_of
from cylconn_ros.study.chunk import ERROR, FAILED, STATUS
from cylconn_ros.study.dataset import Dataset
from cylconn_ros.study.shown import without_rounding

_LISTED = 200  # recordings and changes that are listed
_PLOTS = 6


def archive_page(dataset: Dataset, changed: Sequence[Change] | None, new: Sequence[str]) -> str:
    """Return the HTML page. ``changed``, ``new``: against an earlier result; None: not compared."""
    rows = dataset.table().to_pylist()
    description = dataset.description
    failed = [row for row in rows if row[STATUS] == FAILED]
    bad = [row for row in rows if row[STATUS] != FAILED and not row["passed"]]
    good = len(rows) - len(failed) - len(bad)
    sections = []
    if changed is not None:
        sections.append(_changes(changed, new))
    if failed or bad:
        sections.append(_problems([*failed, *bad]))
    sections.append(_values(rows, description["outputs"]))
    verdict, state = f"{good} of {len(rows)} recordings passed", "good"
    if failed or bad:
        state = "bad" if not good else "fair"
    reasons = []
    if changed:
        bags = len({one.bag for one in changed})
        verdict, state = f"Outputs of {bags} recordings changed; {verdict}", "bad"
    elif changed is not None:
        reasons.append("No output changed against the earlier result.")
    if failed:
        reasons.append(f"{len(failed)} recordings could not be worked through.")
    if bad:
        reasons.append(f"{len(bad)} recordings did not pass.")
    if len(rows) < description["rows"]:
        reasons.append(f"{len(rows)} of {description['rows']} recordings are done so far.")
    facts = [
        Fact("recordings", str(len(rows)), f"{sum(row[SIZE] for row in rows) * 1e-6:.4g} MB"),
        Fact("passed", str(good)),
        Fact("did not pass", str(len(bad)), bad=bool(bad)),
        Fact("failed", str(len(failed)), bad=bool(failed)),
        Fact("samples", f"{sum(row['samples'] or 0 for row in rows):,}".replace(",", " ")),
    ]
    sources = [
        ("dataset", dataset.address),
        ("command", f"cylconn {description['kind']}"),
        ("options", description["options"]),
        ("made by", f"cylconn_ros {description['version']}"),
    ]
    title = f"{description['kind'].capitalize()} of {len(rows)} recordings"
    found = Findings(verdict, state, reasons or ["Every recording passed."], sections)
    return render_findings(title, found, facts, sources, "those stored in each recording")


def _changes(changed: Sequence[Change], new: Sequence[str]) -> Section:
    items = [str(one) for one in changed[:_LISTED]]
    items += [f"and {len(changed) - _LISTED} more"] if len(changed) > _LISTED else []
    items += [f"{bag}: new" for bag in new[:_LISTED]]
    text = "" if items else "None."
    return Section("changes", "Changes against the earlier result", text, items)


def _problems(rows: Sequence[Mapping[str, Any]]) -> Section:
    table = [
        [row[BAG], "failed" if row[STATUS] == FAILED else "did not pass", _why(row)]
        for row in rows[:_LISTED]
    ]
    counts = Counter(_why(row) for row in rows)
    items = [f"{count} recordings: {why}" for why, count in counts.most_common(5) if count > 1]
    rest = f"The first {_LISTED} of {len(rows)}." if len(rows) > _LISTED else ""
    head = ("recording", "result", "why")
    return Section("problems", "Recordings that did not pass", rest, items, Table(head, table))


def _why(row: Mapping[str, Any]) -> str:
    return str(row[ERROR] or row["problem"])


def _values(rows: Sequence[Mapping[str, Any]], outputs: Sequence[str]) -> Section:
    """Distribution of the numbers over the recordings, and the widest as plots."""
    table: list[list[str]] = []
    plots: list[Plot] = []
    for name in outputs:
        values = np.array(
            [
                float(row[name])
                for row in rows
                if isinstance(row[name], int | float) and not isinstance(row[name], bool)
            ]
        )
        values = without_rounding(name, values[np.isfinite(values)])
        if not len(values):
            continue
        unit = unit_of(name)
        low, middle, high = np.percentile(values, [5, 50, 95])
        table.append(
            [name, str(len(values)), f"{middle:.5g}", f"{low:.5g} … {high:.5g}",
             f"{values.min():.5g} … {values.max():.5g}", unit]
        )  # fmt: skip
        if values.min() < values.max() and len(plots) < _PLOTS:
            order, counts = np.unique(values, return_counts=True)
            share = np.r_[0.0, np.cumsum(counts) / len(values)]
            plot = [Series("recordings", "blue", "steps", np.r_[order[:1], order], share)]
            axis = f"{name}, {unit}" if unit else name
            plots.append(Plot(f"v{len(plots)}", name, axis, "share of the recordings", plot))
    head = ("quantity", "recordings", "median", "90 % within", "all within", "unit")
    text = "Plots show the share of the recordings whose value is at most that on the x axis."
    return Section("values", "Values", text, table=Table(head, table), plots=plots)
