"""Page of a sweep: how the outputs are distributed, what moves them, and where the joint jams."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.report.findings import Findings, Plot, Section, Series, Table
from cylconn_ros.report.page import Fact, render_findings
from cylconn_ros.scene.parameter_file import parameters_of
from cylconn_ros.study.chunk import ERROR, OK, ROW, STATUS
from cylconn_ros.study.dataset import Dataset
from cylconn_ros.study.sensitivity import Sensitivity, bins_of, sensitivities
from cylconn_ros.study.shown import without_rounding

if TYPE_CHECKING:
    import pyarrow

Array = NDArray[np.float64]

_DRAWN = 4000  # points of a plot
_SCATTERS = 6
_SHOWN_ERRORS = 8
_EXPLAINED = (
    "Share of an output's variance that one parameter explains alone (first-order Sobol index), "
    "with the sign of its rank correlation. Shares that add up to less than 100 % leave room for "
    "what parameters do together."
)


def sweep_page(dataset: Dataset) -> str:
    """Return the HTML page of a sweep. Raises StudyError if no row is written."""
    table, names = dataset.table(), dataset.description["columns"]
    good = np.asarray(table[STATUS]) == OK
    computed = table.filter(good)  # outputs of the other rows are null
    inputs = {name: _column(computed, name) for name in names}
    outputs = {
        name: _column(computed, name)
        for name in dataset.description["outputs"]
        if str(table[name].type) in ("double", "int64", "bool")
    }
    whole = _of_all(outputs)
    explained = {**outputs, **{key: v for key, v in whole.items() if key == "jam"}}
    found = [s for s in sensitivities(inputs, _numbers(explained)) if s.share > 0.0]
    sections = [
        Section("outputs", "Outputs", _OUTPUTS, table=_distribution(outputs)),
        Section(
            "sensitivity", "What moves the outputs", _EXPLAINED, table=_shares(found, names),
            plots=_scatters(found, inputs, _numbers(explained)),
        ),
        *_jam_map(whole, inputs, found),
        *_failures(table),
    ]  # fmt: skip
    verdict, state, reasons = _verdict(dataset, len(table), good, whole)
    facts = _facts(dataset, len(table), good, whole)
    description = dataset.description
    sources = [
        ("dataset", dataset.address),
        ("varied", ", ".join(names)),
        ("simulated time", f"{_duration(description)} s"),
        ("made by", f"cylconn_ros {description['version']}"),
    ]
    findings = Findings(verdict, state, reasons, sections)
    title = f"Sweep of {_plural(len(names), 'parameter')}"
    return render_findings(title, findings, facts, sources, description["scene"])


_OUTPUTS = (
    "Values over all runs that did not fail. A stop time is counted where the run ends at rest."
)


def _of_all(outputs: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Jam, stop time and usability of a run: of its connector, or of several together.

    A run jams if one of them does; it is at rest when all are.
    """
    merged: Mapping[str, np.ufunc] = {
        "jam": np.logical_or, "usable": np.logical_and, "stop_time": np.maximum,
    }  # fmt: skip
    found = {}
    for name, merge in merged.items():
        columns = [v for key, v in outputs.items() if key == name or key.endswith(f".{name}")]
        if columns:
            found[name] = merge.reduce(columns)
    return found


def _duration(description: Mapping[str, Any]) -> str:
    """Simulated time as text: that of the sweep, or of the scene."""
    if description["duration"] is None:
        parameters = parameters_of(description["scene"])
        given = [value for name, value in parameters.items() if name.endswith("plant.duration")]
        return f"{given[0]:g}"
    return f"{description['duration']:g}"


def _plural(count: int, noun: str) -> str:
    return f"{count:,} {noun}{'' if count == 1 else 's'}".replace(",", " ")


def _column(table: pyarrow.Table, name: str) -> NDArray[Any]:
    return np.asarray(table[name].to_numpy())


def _numbers(outputs: Mapping[str, NDArray[Any]]) -> dict[str, Array]:
    return {name: np.asarray(values, np.float64) for name, values in outputs.items()}


def _interval(hits: int, count: int) -> tuple[float, float]:
    """95 % interval of a probability after Wilson (1927)."""
    z, n = 1.959964, max(count, 1)
    middle = (hits + z * z / 2.0) / (n + z * z)
    half = z / (n + z * z) * math.sqrt(hits * (n - hits) / n + z * z / 4.0)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def _percent(value: float) -> str:
    return f"{100.0 * value:.3g} %"


def _verdict(
    dataset: Dataset, count: int, good: NDArray[Any], outputs: Mapping[str, NDArray[Any]]
) -> tuple[str, str, list[str]]:
    """Sentence, state and reasons."""
    failed = count - int(good.sum())
    reasons = []
    if count < dataset.description["rows"]:
        reasons.append(f"{count} of {dataset.description['rows']} rows are computed so far.")
    if failed:
        reasons.append(f"{_plural(failed, 'row')} failed; they count in no value of this page.")
    if failed == count:
        return "No run succeeded", "bad", reasons
    if "usable" in outputs and not outputs["usable"].all():
        off = int((~outputs["usable"].astype(bool)).sum())
        reasons.append(f"{_plural(off, 'run')} left the joint (output usable): do not trust them.")
    state = "fair" if reasons else "good"
    if "jam" not in outputs:
        return f"{_plural(count - failed, 'run')} computed", state, reasons
    jams, runs = int(outputs["jam"].sum()), count - failed
    low, high = _interval(jams, runs)
    reasons.append(
        f"95 % interval of the probability of a jam: {_percent(low)} to {_percent(high)}."
    )
    return f"{_percent(jams / runs)} of {_plural(runs, 'run')} jam", state, reasons


def _facts(
    dataset: Dataset, count: int, good: NDArray[Any], outputs: Mapping[str, NDArray[Any]]
) -> list[Fact]:
    failed = count - int(good.sum())
    facts = [
        Fact("rows", f"{count:,}".replace(",", " "), f"of {dataset.description['rows']}"),
        Fact("failed", str(failed), bad=failed > 0),
    ]
    if "jam" in outputs:
        facts.append(Fact("jams", str(int(outputs["jam"].sum()))))
    if "stop_time" in outputs:
        stops = outputs["stop_time"][np.isfinite(outputs["stop_time"])]
        text = f"median {np.median(stops):.4g} s" if len(stops) else ""
        facts.append(Fact("end at rest", str(len(stops)), text))
    return facts


def _distribution(outputs: Mapping[str, NDArray[Any]]) -> Table:
    rows, weak = [], set()
    for name, values in outputs.items():
        if values.dtype == np.bool_:
            low, high = _interval(int(values.sum()), len(values))
            text = f"true in {int(values.sum())} ({_percent(float(np.mean(values)))})"
            rows.append([name, str(len(values)), text, "", "", f"{low:.4g} … {high:.4g}"])
            continue
        finite = without_rounding(name, np.asarray(values[np.isfinite(values)], np.float64))
        if not len(finite):
            weak.add(len(rows))
            rows.append([name, "0", "–", "–", "–", "–"])
            continue
        low, middle, high = np.percentile(finite, [5, 50, 95])
        rows.append(
            [
                name, str(len(finite)), f"{middle:.5g}", f"{finite.mean():.5g}",
                f"{finite.min():.5g} … {finite.max():.5g}", f"{low:.5g} … {high:.5g}",
            ]
        )  # fmt: skip
    head = (
        "output",
        "runs",
        "median",
        "mean",
        "all within",
        "90 % within (of a share: 95 % interval)",
    )
    return Table(head, rows, frozenset(weak))


def _shares(found: Sequence[Sensitivity], parameters: Sequence[str]) -> Table:
    """Shares of the parameters, an output a row."""
    cells: dict[str, dict[str, str]] = {}
    for one in found:
        sign = "" if math.isnan(one.rank) else "+" if one.rank > 0.0 else "−"
        text = f"{sign} {_percent(one.share)}" if one.share >= 0.005 else "–"
        cells.setdefault(one.output, {})[one.parameter] = text.strip()
    rows = [[name, *(row.get(p, "–") for p in parameters)] for name, row in cells.items()]
    return Table(("output", *parameters), rows)


def _scatters(
    found: Sequence[Sensitivity], inputs: Mapping[str, NDArray[Any]], outputs: Mapping[str, Array]
) -> list[Plot]:
    """The largest shares as plots, one an output: points and the means of bins."""
    plots: list[Plot] = []
    seen: set[str] = set()
    for one in sorted(found, key=lambda s: -s.share):
        if one.output in seen or inputs[one.parameter].dtype == object or one.output == "jam":
            continue
        seen.add(one.output)
        x = np.asarray(inputs[one.parameter], np.float64)
        y = outputs[one.output]
        good = np.isfinite(y)
        x, y = x[good], y[good]
        step = max(1, len(x) // _DRAWN)
        series = [
            Series("run", "blue", "points", x[::step], y[::step]),
            Series("mean", "red", "line", *_means(x, y)),
        ]
        note = f"{one.parameter} explains {_percent(one.share)} of the variance."
        note += f" One run in {step} is drawn." if step > 1 else ""
        title = f"{one.output} against {one.parameter}"
        plots.append(Plot(f"s{len(plots)}", title, one.parameter, one.output, series, note))
        if len(plots) == _SCATTERS:
            break
    return plots


def _means(x: Array, y: Array) -> tuple[Array, Array]:
    """Means of both columns over bins of the first, in its order."""
    which = bins_of(x)
    counts = np.bincount(which)
    used = counts > 0
    means = [np.bincount(which, values)[used] / counts[used] for values in (x, y)]
    order = np.argsort(means[0])
    return means[0][order], means[1][order]


def _jam_map(
    outputs: Mapping[str, NDArray[Any]],
    inputs: Mapping[str, NDArray[Any]],
    found: Sequence[Sensitivity],
) -> list[Section]:
    """Where the joint jams, over the two parameters that explain most of it."""
    if "jam" not in outputs:
        return []
    jam = outputs["jam"].astype(bool)
    if not jam.any() or jam.all():
        text = "No run jams." if not jam.any() else "Every run jams."
        return [Section("jam", "Jam map", text)]
    shares = {s.parameter: s.share for s in found if s.output == "jam"}
    names = [name for name in inputs if inputs[name].dtype != object]
    names.sort(key=lambda name: -shares.get(name, 0.0))
    text = "Runs that jam, over the parameters that explain most of it."
    plots = []
    if len(names) > 1:
        x, y = (np.asarray(inputs[name], np.float64) for name in names[:2])
        step = max(1, len(x) // _DRAWN)
        rows = np.arange(len(x)) % step == 0
        series = [
            Series("no jam", "blue", "points", x[rows & ~jam], y[rows & ~jam]),
            Series("jam", "red", "rings", x[rows & jam], y[rows & jam]),
        ]
        note = f"One run in {step} is drawn." if step > 1 else ""
        plots.append(Plot("jam", "Jam map", names[0], names[1], series, note))
    for name in names[:2]:
        x = np.asarray(inputs[name], np.float64)
        which = bins_of(x)
        counts, hits = np.bincount(which), np.bincount(which, jam)
        used = counts > 0
        middle = (np.bincount(which, x)[used]) / counts[used]
        ends = [_interval(int(h), int(n)) for h, n in zip(hits[used], counts[used], strict=True)]
        order = np.argsort(middle)
        low, high = np.array(ends).T
        series = [
            Series(
                "probability of a jam, 95 % interval", "red", "means", middle[order],
                (hits[used] / counts[used])[order], low[order], high[order],
            )
        ]  # fmt: skip
        title = f"Probability of a jam against {name}"
        plots.append(Plot(f"p{len(plots)}", title, name, "probability", series))
    return [Section("jam", "Jam map", text, plots=plots)]


def _failures(table: pyarrow.Table) -> list[Section]:
    """The most frequent errors, each with its first row."""
    errors = table[ERROR].to_pylist()
    rows = table[ROW].to_pylist()
    first: dict[str, int] = {}
    for row, error in zip(rows, errors, strict=True):
        if error:
            first.setdefault(error, row)
    if not first:
        return []
    counts = Counter(error for error in errors if error)
    items = [
        f"{_plural(count, 'row')}, first {first[error]}: {error}"
        for error, count in counts.most_common(_SHOWN_ERRORS)
    ]
    rest = len(first) - len(items)
    items += [f"and {rest} other errors"] if rest else []
    return [Section("failures", "Failed rows", items=items)]
