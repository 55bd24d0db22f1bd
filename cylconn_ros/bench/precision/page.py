"""The interactive HTML page of a precision benchmark: one file with its data and script.

The user selects a case, points at a solver to highlight it, and at a point to read its numbers. The
page needs no network and no library.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from cylconn_ros.bench.common.results import Report
from cylconn_ros.bench.peers.registry import SOLVERS
from cylconn_ros.bench.precision import pareto
from cylconn_ros.bench.precision.cases import CASES
from cylconn_ros.bench.precision.picture import CURVES

DASHES = {"-": "", "--": "6 3", ":": "2 2"}


def page(report: Report) -> str:
    """The page as HTML."""
    text = json.dumps(data(report), allow_nan=False, separators=(",", ":"))
    return PAGE.replace("/*DATA*/null", text.replace("</", "<\\/"))


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
                "reaction_dependent": case.reaction_dependent, "source": case.source, "rows": rows,
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


def _short(value: float) -> float | None:
    return float(f"{value:.3g}") if math.isfinite(value) else None


PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Error vs. CPU time</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
body { font: 15px/1.45 system-ui, sans-serif; color: #222; margin: 1.2rem; max-width: 1150px }
h1 { font-size: 1.25rem; margin: 0 0 .4rem } p { margin: .3rem 0; color: #555 }
#cases button { font: inherit; margin: 2px; padding: .2rem .6rem; border: 1px solid #ccc;
  background: #fff; border-radius: 4px; cursor: pointer }
#cases button[aria-pressed=true] { background: #0A4A7D; color: #fff; border-color: #0A4A7D }
#both { display: flex; flex-wrap: wrap; gap: 1rem } #plot { flex: 1 1 640px }
#names { flex: 0 1 300px; font-size: .86rem } #names div { cursor: pointer; padding: 1px 4px }
#names div.off { opacity: .35; text-decoration: line-through }
#names div:hover { background: #f0f4f8 } svg text { font: 12px system-ui, sans-serif; fill: #555 }
#tip { min-height: 2.9em; color: #222 }
</style></head><body>
<h1>Error vs. CPU time</h1>
<p>Both axes are logarithmic; lower left is better. Crosses at the top: failed. Point at a solver
to highlight it or at a point to read its numbers; click a solver to hide it.</p>
<div id="cases"></div><p id="about"></p>
<div id="both"><svg id="plot" viewBox="0 0 760 520" role="img"
aria-label="error vs. CPU time"></svg><div id="names"></div></div>
<p id="tip"></p><details><summary>Machine and versions</summary><ul id="machine"></ul></details>
<script>
const data = /*DATA*/null, off = new Set(), NS = "http://www.w3.org/2000/svg";
const at = id => document.getElementById(id), box = { l: 70, r: 745, t: 50, b: 470 };
let shown = data.cases[0], alone = null;
function add(parent, name, attributes, text) {
  const e = document.createElementNS(NS, name);
  for (const k in attributes) e.setAttribute(k, attributes[k]);
  if (text !== undefined) e.textContent = text;
  parent.appendChild(e); return e;
}
const log = Math.log10, LOWEST = 1e-16;
function scales() {
  const costs = [], errors = [];
  for (const row of Object.values(shown.rows)) for (const [, c, e, failed] of row) {
    if (c) costs.push(log(c));
    if (e !== null && !failed) errors.push(log(Math.max(e, LOWEST)));
  }
  const x0 = Math.min(...costs) - .15, x1 = Math.max(...costs) + .15;
  const y0 = Math.floor(Math.min(...errors)) - .3, y1 = Math.max(...errors) + .4;
  return { x: v => box.l + (log(v) - x0) / (x1 - x0) * (box.r - box.l),
    y: v => box.b - (log(Math.max(v, LOWEST)) - y0) / (y1 - y0) * (box.b - box.t),
    x0, x1, y0, y1 };
}
function draw() {
  const svg = at("plot"), s = scales(); svg.replaceChildren();
  for (let k = Math.ceil(s.x0); k <= s.x1; k++) {
    const x = s.x(10 ** k);
    add(svg, "line", { x1: x, x2: x, y1: box.t, y2: box.b, stroke: "#e4e4e4" });
    add(svg, "text", { x, y: box.b + 18, "text-anchor": "middle" }, +(10 ** k).toPrecision(1));
  }
  const every = s.y1 - s.y0 > 9 ? 3 : 1;
  for (let k = Math.ceil(s.y0); k <= s.y1; k++) if (k % every === 0) {
    const y = s.y(10 ** k);
    add(svg, "line", { x1: box.l, x2: box.r, y1: y, y2: y, stroke: "#e4e4e4" });
    add(svg, "text", { x: box.l - 8, y: y + 4, "text-anchor": "end" }, "1e" + k);
  }
  add(svg, "text", { x: (box.l + box.r) / 2, y: 508, "text-anchor": "middle" },
    "CPU time per simulated second, ms");
  add(svg, "text", { x: 12, y: 24 }, "error, m");
  add(svg, "text", { x: box.l, y: 24 }, "");
  for (const [name, row] of Object.entries(shown.rows)) {
    if (off.has(name)) continue;
    const style = data.styles[name], faint = alone && alone !== name ? .12 : 1;
    const group = add(svg, "g", { opacity: faint });
    const good = row.filter(p => !p[3] && p[1] && p[2] !== null).sort((a, b) => a[1] - b[1]);
    add(group, "polyline", { points: good.map(p => s.x(p[1]) + "," + s.y(p[2])).join(" "),
      fill: "none", stroke: style.color, "stroke-width": style.own ? 2.6 : 1.3,
      "stroke-dasharray": style.dash });
    for (const p of row) {
      if (!p[1]) continue;
      const x = s.x(p[1]), y = p[3] ? box.t - 12 : s.y(p[2]);
      if (p[4] !== null) add(group, "line", { x1: s.x(p[4]), x2: s.x(p[5]), y1: y, y2: y,
        stroke: style.color, "stroke-width": 2 });
      const mark = p[3]
        ? add(group, "path", { d: `M${x - 4},${y - 4}l8,8m0,-8l-8,8`, stroke: style.color,
            "stroke-width": 1.6, fill: "none" })
        : add(group, "circle", { cx: x, cy: y, r: style.own ? 4.5 : 3.4, fill: style.color });
      mark.addEventListener("pointerenter", () => { at("tip").textContent =
        `${name} (${style.parameter} ${p[0]}): ${p[3] ? "failed: " + p[3] + "; " : ""}` +
        `error ${p[2] === null ? "none" : p[2] + " m"}, ${p[1]} ms per simulated second` +
        (p[4] === null ? ". " : ` (quartiles ${p[4]} to ${p[5]}). `) +
        style.description + "."; });
    }
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
    const e = document.createElement("div"), style = data.styles[name];
    e.textContent = "● " + name; e.style.color = style.color; e.title = style.description;
    e.className = off.has(name) ? "off" : "";
    e.onpointerenter = () => { alone = name; draw(); };
    e.onpointerleave = () => { alone = null; draw(); };
    e.onclick = () => { off.has(name) ? off.delete(name) : off.add(name);
      e.className = off.has(name) ? "off" : ""; draw(); };
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
choose(shown);
</script></body></html>
"""
