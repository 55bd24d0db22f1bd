"""The interactive HTML page of a precision benchmark: one file with its data and script.

The user selects a case, points at a solver to highlight it, and at a point to read its numbers. The
plot is drawn by BokehJS, whose script is part of the page, so that it needs no network.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from cylconn_ros.bench.common.results import Report
from cylconn_ros.bench.peers.registry import SOLVERS
from cylconn_ros.bench.precision import pareto
from cylconn_ros.bench.precision.cases import CASES, Case
from cylconn_ros.bench.precision.picture import CURVES
from cylconn_ros.report.page import library

DASHES: dict[str, list[int]] = {"-": [], "--": [6, 3], ":": [2, 2]}


def page(report: Report) -> str:
    """The page as HTML."""
    text = json.dumps(data(report), allow_nan=False, separators=(",", ":"))
    text = PAGE.replace("/*DATA*/null", text.replace("</", "<\\/"))
    return text.replace("/*LIBRARY*/", library(), 1)


def data(report: Report) -> Mapping[str, Any]:
    """The data of the page, numbers with three digits."""
    found = report.findings
    shown = []
    for name in dict.fromkeys(m.case for m in found.measurements):
        case = CASES[name]
        rows: dict[str, list[list[Any]]] = {}
        for p in pareto.points(found, name):
            rows.setdefault(p.solver, []).append(
                [
                    *map(_short, (p.value, p.cost, p.error)),
                    p.failed,
                    *map(_short, (p.low, p.high)),
                ]
            )
        shown.append(
            {
                "name": name, "title": case.title, "error_of": case.error_of,
                "reaction_dependent": case.reaction_dependent, "rows": rows,
                "source": case.source + _published(case),
            }
        )  # fmt: skip
    styles = {}
    for name, solver in SOLVERS.items():
        curve = next(c for c in CURVES if c.contains(name))
        styles[name] = {
            "color": curve.color, "dash": DASHES[curve.style], "description": solver.description,
            "parameter": solver.parameter, "own": solver.kind == "own",
        }  # fmt: skip
    return {
        "cases": shown,
        "styles": styles,
        "machine": [f"{key}: {value}" for key, value in report.machine.items()],
        "command": f"{report.command}, {report.started}",
    }


def _published(case: Case) -> str:
    return f"; published: {case.published[0]}, {case.published[1]:.2g} m" if case.published else ""


def _short(value: float) -> float | None:
    return float(f"{value:.3g}") if math.isfinite(value) else None


PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Error vs. CPU time</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta http-equiv="Content-Security-Policy"
content="default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:">
<style>
:root { --page: #fff; --ink: #222; --soft: #555; --line: #ccc; --grid: #e4e4e4; --own: #0a4a7d }
@media (prefers-color-scheme: dark) { :root { --page: #1c2027; --ink: #e8eaee; --soft: #a4adba;
  --line: #343b46; --grid: #2a303a; --own: #2f7fc0 } }
body { font: 15px/1.45 system-ui, sans-serif; color: var(--ink); background: var(--page);
  margin: 1.2rem; max-width: 1250px }
h1 { font-size: 1.25rem; margin: 0 0 .4rem } p { margin: .3rem 0; color: var(--soft) }
button { font: inherit; color: inherit; background: none; cursor: pointer }
#cases button { margin: 2px; padding: .2rem .6rem; border: 1px solid var(--line);
  border-radius: 4px }
#cases button[aria-pressed=true] { background: var(--own); color: #fff; border-color: var(--own) }
#both { display: flex; flex-wrap: wrap; gap: 1rem }
#plot { flex: 1 1 640px; min-width: 0; height: 540px }
#names { flex: 0 1 300px; font-size: .86rem }
#names button { display: block; width: 100%; text-align: left; border: 0; padding: 1px 4px }
#names button[aria-pressed=false] { opacity: .35; text-decoration: line-through }
#names button:hover { background: var(--grid) }
@media (max-width: 700px) { body { margin: .7rem } #plot { flex-basis: 100%; height: 420px } }
</style></head><body>
<h1>Error vs. CPU time</h1>
<p>Both axes are logarithmic; lower left is better. Crosses at the top: failed. Point at a solver
to highlight it or at a point to read its numbers; click a solver to hide it. Drag to zoom.</p>
<div id="cases"></div><p id="about"></p>
<div id="both"><div id="plot"></div><div id="names"></div></div>
<details><summary>Machine and versions</summary><ul id="machine"></ul></details>
<script>
/*LIBRARY*/
</script>
<script>
const data = /*DATA*/null, off = new Set(), at = id => document.getElementById(id), LOWEST = 1e-16;
const colour = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const DARK = matchMedia("(prefers-color-scheme: dark)");
let shown = data.cases[0], glyphs = {}, ready;
// A solver's colour, lighter on a dark page.
function tint(name) {
  const mix = part => DARK.matches ? Math.round(.65 * part + 90) : part;
  const parts = data.styles[name].color.match(/[0-9a-f]{2}/gi).map(part => mix(parseInt(part, 16)));
  return `rgb(${parts.join(", ")})`;
}
const digits = value => value && value < 1e-3 ? value.toExponential() : value;
const height = error => Math.max(error, LOWEST);
// Ranges of the axes, in powers of ten around all points.
function ranges() {
  const costs = [], errors = [];
  for (const row of Object.values(shown.rows)) for (const [, cost, error, failed] of row) {
    if (cost) costs.push(Math.log10(cost));
    if (error !== null && !failed) errors.push(Math.log10(height(error)));
  }
  if (!errors.length) errors.push(-3);
  const range = (low, high) => new Bokeh.Range1d({ start: 10 ** low, end: 10 ** high });
  return { x: range(Math.min(...costs) - .15, Math.max(...costs) + .15),
    y: range(Math.floor(Math.min(...errors)) - .3, Math.max(...errors) + .8) };
}
// The points of a solver as columns, with the texts of its tooltip.
function columns(name, rows, y) {
  const style = data.styles[name];
  return { x: rows.map(p => p[1]), y: rows.map(y), low: rows.map(p => p[4] ?? p[1]),
    high: rows.map(p => p[5] ?? p[1]), solver: rows.map(() => name),
    setting: rows.map(p => `${style.parameter} ${p[0]}`),
    error: rows.map(p => p[3] ? `failed: ${p[3]}` : p[2] === null ? "none" : `${digits(p[2])} m`),
    time: rows.map(p => `${p[1]} ms` + (p[4] === null ? "" : ` (quartiles ${p[4]} to ${p[5]})`)),
    about: rows.map(() => style.description) };
}
function solver(figure, name, rows, top) {
  const style = data.styles[name], measured = rows.filter(p => p[1]);
  const good = measured.filter(p => !p[3] && p[2] !== null).sort((a, b) => a[1] - b[1]);
  const source = (points, y) => new Bokeh.ColumnDataSource({ data: columns(name, points, y) });
  const solved = source(good, p => height(p[2]));
  const failed = source(measured.filter(p => p[3]), () => top);
  const x = { field: "x" }, y = { field: "y" }, size = style.own ? 9 : 7, color = tint(name);
  const points = [
    figure.scatter(x, y, { source: solved, size, color }),
    figure.scatter(x, y, { source: failed, size: 9, marker: "x", color, line_width: 1.6 }),
  ];
  const lines = [
    figure.line(x, y, { source: solved, color, line_dash: style.dash,
      line_width: style.own ? 2.6 : 1.3 }),
    figure.segment({ field: "low" }, y, { field: "high" }, y,
      { source: solved, color, line_width: 2 }),
  ];
  glyphs[name] = [...points, ...lines];
  for (const glyph of glyphs[name]) glyph.setv({ hover_glyph: null, visible: !off.has(name) });
  return points;
}
function draw() {
  const { x, y } = ranges(), top = y.end / 10 ** .25;
  const figure = Bokeh.Plotting.figure({ x_range: x, y_range: y,
    x_axis_type: "log", y_axis_type: "log",
    sizing_mode: "stretch_both", tools: "box_zoom,pan,wheel_zoom,reset,save",
    active_drag: matchMedia("(pointer: coarse)").matches ? null : "box_zoom", active_scroll: null,
    x_axis_label: "CPU time per simulated second, ms", y_axis_label: "error, m" });
  figure.toolbar.logo = null;
  figure.setv({ background_fill_color: colour("--page"), border_fill_color: colour("--page"),
    outline_line_color: colour("--line") });
  for (const axis of [...figure.below, ...figure.left]) axis.setv({
    axis_line_color: colour("--line"), major_tick_line_color: colour("--line"),
    minor_tick_line_color: null,
    major_label_text_color: colour("--soft"), axis_label_text_color: colour("--soft") });
  for (const grid of figure.center) grid.grid_line_color = colour("--grid");
  glyphs = {};
  const points = Object.entries(shown.rows).flatMap(
    ([name, rows]) => solver(figure, name, rows, top));
  figure.add_tools(new Bokeh.HoverTool({ renderers: points, toggleable: false, tooltips: [
    ["solver", "@solver"], ["setting", "@setting"], ["error", "@error"],
    ["CPU time per simulated second", "@time"], ["", "@about"]] }));
  at("plot").replaceChildren();
  ready = Bokeh.Plotting.show(figure, at("plot"));
}
function highlight(name) {
  for (const [each, parts] of Object.entries(glyphs)) for (const part of parts) {
    const alpha = name && each !== name ? .12 : 1;
    part.glyph.line_alpha = alpha;
    if (part.glyph.properties.fill_alpha) part.glyph.fill_alpha = alpha;
  }
}
function choose(next) {
  shown = next;
  const mark = shown.reaction_dependent ? " (friction depends on changing reactions)" : "";
  at("about").textContent =
    `${shown.title}${mark}. Error of: ${shown.error_of}. Reference: ${shown.source}.`;
  for (const b of at("cases").children)
    b.setAttribute("aria-pressed", b.textContent === shown.title);
  at("names").replaceChildren(...Object.keys(data.styles).filter(n => shown.rows[n]).map(name => {
    const e = document.createElement("button"), dot = document.createElement("span");
    dot.textContent = "● "; dot.style.color = tint(name); e.append(dot, name);
    e.title = data.styles[name].description;
    e.setAttribute("aria-pressed", !off.has(name));
    e.onpointerenter = () => highlight(name);
    e.onpointerleave = () => highlight(null);
    e.onclick = () => {
      off.has(name) ? off.delete(name) : off.add(name);
      e.setAttribute("aria-pressed", !off.has(name));
      for (const part of glyphs[name]) part.visible = !off.has(name);
    };
    return e;
  }));
  draw();
}
for (const s of data.cases) {
  const b = document.createElement("button"); b.textContent = s.title;
  b.onclick = () => choose(s); at("cases").appendChild(b);
}
for (const line of [data.command, ...data.machine]) {
  const e = document.createElement("li"); e.textContent = line; at("machine").appendChild(e);
}
DARK.addEventListener("change", () => choose(shown));
choose(shown);
</script></body></html>
"""
