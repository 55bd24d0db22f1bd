// Plots over time: curves by BokehJS; legend, readings, cursor and export around them.

const LEFT = 86, RIGHT = 20, TOP = 4, BOTTOM = 20, HEIGHT = 168;

function plotArea(width, height) {
  return { left: LEFT, top: TOP, width: Math.max(10, width - LEFT - RIGHT), height: Math.max(10, height - TOP - BOTTOM) };
}

// Text of a tick of time; the last one names the unit.
function timeText(t, step, last) {
  return last ? `${tickText(t, step)} s` : tickText(t, step);
}

function timeAxis(context, link, plot) {
  const [low, high] = link.view;
  const { values, step } = ticks(low, high, plot.width / 90);
  context.textAlign = "center";
  context.textBaseline = "top";
  for (const t of values) {
    const x = plot.left + ((t - low) / (high - low)) * plot.width;
    context.fillStyle = link.palette.grid;
    context.fillRect(Math.round(x), plot.top, 1, plot.height);
    context.fillStyle = link.palette.soft;
    const text = timeText(t, step, t === values[values.length - 1]);
    context.fillText(text, Math.min(x, plot.left + plot.width - 8), plot.top + plot.height + 5);
  }
}

function cursorLine(parts, link) {
  const width = parts.stage.clientWidth, height = parts.stage.clientHeight;
  const context = prepare(parts.over, width, height);
  const plot = plotArea(width, height);
  const [low, high] = link.view;
  const x = plot.left + ((link.t - low) / (high - low)) * plot.width;
  const inside = x >= plot.left - 0.5 && x <= plot.left + plot.width + 0.5;
  if (inside) {
    context.fillStyle = link.palette.ink;
    context.globalAlpha = 0.65;
    context.fillRect(Math.round(x), plot.top, 1, plot.height);
    context.globalAlpha = 1;
  }
  return { context, plot, x, inside };
}

// Units of small quantities: prefix, factor and the magnitude from which on the unit suits.
const PREFIXES = [["", 1, 0.1], ["m", 1e3, 1e-4], ["µ", 1e6, 1e-7], ["n", 1e9, 0]];
const PREFIXED = new Set(["m", "m/s", "rad", "rad/s", "N", "N m"]);

function unitOf(panel) {
  let size = 0;
  for (const { drawn } of panel.curves) {
    for (const values of [drawn.lo, drawn.hi]) {
      for (const value of values) if (Number.isFinite(value)) size = Math.max(size, Math.abs(value));
    }
  }
  const small = panel.unit === "turns" && size < 0.05; // turns have no smaller unit
  const unit = small ? "rad" : panel.unit, scale = small ? 2 * Math.PI : 1;
  if (!PREFIXED.has(unit) || size === 0) return { unit: panel.unit, factor: 1 };
  const [prefix, factor] = PREFIXES.find(([, , least]) => size * scale >= least);
  return { unit: prefix + unit, factor: factor * scale };
}

// Height of the stops in the plots of slide and spin: the stops are lengths and angles, both plots count from the start.
function stopLines(run, key) {
  const { path, geometry } = run;
  if (key === "spin") {
    const shift = path.turned.find(Number.isFinite) ?? 0;
    return named(geometry.angle_stops, ["theta_min", "theta_max"], (angle) => (angle + shift) / (2 * Math.PI));
  }
  if (key !== "slide") return [];
  const k = path.u1.findIndex((value, at) => Number.isFinite(value) && Number.isFinite(path.length[at]));
  return k < 0 ? [] : named(geometry.stops, ["l_min", "l_max"], (length) => length + path.u1[k] - path.length[k]);
}

function named(stops, names, height) {
  return stops.flatMap((stop, at) => (stop === null ? [] : [{ name: names[at], value: height(stop) }]));
}

class Chart {
  constructor(host, panel, link, bands) {
    Object.assign(this, { panel, link, bands, shown: panel.curves.map(() => true), figure: null, view: null });
    Object.assign(this, unitOf(panel));
    this.stops = stopLines(link.run, panel.key);
    const root = element("section", "panel time"), header = element("header"), heading = element("h3", "", panel.title);
    heading.append(" ", element("small", "", `[${this.unit}${panel.log ? ", log" : ""}]`));
    header.append(heading);
    root.dataset.key = panel.key;
    this.readings = panel.curves.map((curve, j) => {
      const key = element("button", "key");
      key.title = "show or hide this curve";
      key.setAttribute("aria-pressed", "true");
      const swatch = element("i", curve.style === "area" ? "area" : "");
      swatch.style.background = `var(--${curve.colour})`;
      const value = element("b");
      key.append(swatch, curve.label, value);
      key.addEventListener("click", () => this.toggle(j, key));
      header.append(key);
      return value;
    });
    const save = element("button", "export", "CSV");
    save.title = "save the visible range as a table";
    save.addEventListener("click", () => download(`${panel.key}.csv`, this.table()));
    header.append(save);
    const stage = element("div", "stage"), line = element("div", "cursor"), tip = element("div", "tip");
    tip.hidden = true;
    stage.style.height = `${HEIGHT}px`;
    stage.setAttribute("role", "img");
    stage.setAttribute("aria-label", `${panel.title}, ${this.unit}`);
    stage.append(line, tip);
    root.append(header, stage);
    host.append(root);
    this.parts = { root, header, stage, line, tip };
    // Plots are made when they come near the window: a page of sixteen opens as fast as one of three.
    new IntersectionObserver((entries) => {
      this.near = entries[entries.length - 1].isIntersecting;
      if (this.near && this.stale) this.draw();
    }, { rootMargin: "200px" }).observe(root);
  }

  toggle(j, key) {
    this.shown[j] = !this.shown[j];
    key.setAttribute("aria-pressed", String(this.shown[j]));
    this.draw();
  }

  // Groups of samples to draw: one per half pixel, the same for all curves; one per sample if there are few samples.
  columns() {
    const { run, view } = this.link;
    const [low, high] = view, width = Math.max(100, this.parts.stage.clientWidth - LEFT);
    const scale = width / (high - low);
    const from = Math.max(0, before(run.time, low) - 1);
    const to = Math.min(run.time.length - 1, before(run.time, high) + 1);
    const groups = [];
    let last = null, pixel = NaN;
    for (let k = from; k <= to; k++) {
      const t = (run.time[k] + run.until[k]) / 2, x = Math.floor((t - low) * scale);
      if (last && to - from > 2 * width && x === pixel && !run.gap[k]) last.to = k;
      else groups.push((last = { t, from: k, to: k, gap: run.gap[k] }));
      pixel = x;
    }
    return groups;
  }

  // A curve as points: smallest and largest value of each group, nearest first; NaN at gaps.
  trace(drawn, groups) {
    const x = [], y = [];
    let at = NaN;
    for (const { t, from, to, gap } of groups) {
      let lo = Infinity, hi = -Infinity;
      for (let k = from; k <= to; k++) {
        if (drawn.lo[k] < lo) lo = drawn.lo[k];
        if (drawn.hi[k] > hi) hi = drawn.hi[k];
      }
      if (gap || !(lo <= hi)) {
        x.push(t); y.push(NaN);
      }
      if (!(lo <= hi)) continue;
      [lo, hi] = [lo * this.factor, hi * this.factor];
      const points = lo === hi ? [lo] : Math.abs(hi - at) < Math.abs(lo - at) ? [hi, lo] : [lo, hi];
      for (const value of points) {
        x.push(t); y.push(value);
      }
      at = points[points.length - 1];
    }
    return { x, y };
  }

  range(traces) {
    let low = Infinity, high = -Infinity;
    traces.forEach(({ y }, j) => {
      if (!this.shown[j]) return;
      for (const value of y) {
        if (!Number.isFinite(value) || (this.panel.log && !(value > 0))) continue;
        [low, high] = [Math.min(low, value), Math.max(high, value)];
      }
    });
    if (this.panel.log) {
      if (!(high > 0)) return [1e-3, 1];
      const top = Math.ceil(Math.log10(high * 1.05)), bottom = Math.floor(Math.log10(Math.max(low, high * 1e-14)));
      return [10 ** Math.min(bottom, top - 3), 10 ** top]; // within one decade, every tick would have its text
    }
    if (!(high >= low)) return [0, 1];
    if (this.panel.zero) [low, high] = [Math.min(low, 0), Math.max(high, 0)];
    const margin = high > low ? 0.06 * (high - low) : Math.abs(high) * 0.1 || 1;
    return [low === 0 ? 0 : low - margin, high + margin];
  }

  make() {
    const { link, panel } = this, { Range1d, Span, ColumnDataSource } = Bokeh;
    this.x = new Range1d({ start: link.view[0], end: link.view[1] });
    this.y = new Range1d({ start: 0, end: 1 });
    this.figure = Bokeh.Plotting.figure({
      x_range: this.x, y_range: this.y, y_axis_type: panel.log ? "log" : "linear", height: HEIGHT, sizing_mode: "stretch_width",
      // A finger that drags scrolls the page; the tools can be chosen there, too.
      tools: "box_zoom,pan,ywheel_zoom,xwheel_zoom,reset,save", active_drag: COARSE.matches ? null : "box_zoom",
      active_scroll: null, toolbar_location: "above", toolbar_inner: true, min_border_left: LEFT, min_border_right: RIGHT,
      min_border_top: TOP, output_backend: "canvas", lod_threshold: null,
    });
    this.figure.toolbar.setv({ logo: null, autohide: true, stylesheets: [TOOLBAR_STYLE] });
    this.figure.below[0].formatter.doFormat = (times) => {
      const step = times.length > 1 ? times[1] - times[0] : 1;
      return times.map((t, k) => timeText(t, step, k === times.length - 1));
    };
    this.bandSources = ["stick", "slip", "stop", "lock"].map((name) => {
      const source = new ColumnDataSource({ data: { x0: [], x1: [] } });
      const strip = this.figure.vstrip({ field: "x0" }, { field: "x1" }, { source, line_color: null, level: "underlay" });
      return { name, source, strip };
    });
    this.sources = [];
    this.glyphs = panel.curves.map((curve, j) => {
      const source = new ColumnDataSource({ data: { x: [], y: [], floor: [] } });
      this.sources.push(source);
      const made = [];
      if (curve.style === "area") {
        made.push(this.figure.varea({ field: "x" }, { field: "floor" }, { field: "y" }, { source, fill_alpha: 0.22 }));
      }
      const line = this.figure.line({ field: "x" }, { field: "y" }, { source,
        line_width: curve.style === "line" ? 1.6 : 1, line_dash: curve.style === "dashed" ? [5, 3] : [] });
      made.push(line);
      return made;
    });
    this.spans = this.stops.map(({ name, value }) => {
      const span = new Span({ location: value * this.factor, dimension: "width", line_dash: "dashed", line_width: 1.2, name });
      this.figure.add_layout(span);
      return span;
    });
    const changed = () => {
      if (this.busy) return;
      this.zoomed = this.y.start !== this.auto[0] || this.y.end !== this.auto[1];
      if (this.x.start !== link.view[0] || this.x.end !== link.view[1]) link.setView(this.x.start, this.x.end);
    };
    this.x.change.connect(changed);
    this.y.change.connect(changed);
    this.figure.on_event("reset", () => this.whole());
    this.figure.on_event("doubletap", () => this.whole());
    const point = (event) => {
      if (link.playing) return;
      link.setCursor(event.x);
      this.tell(event);
    };
    this.figure.on_event("mousemove", point);
    this.figure.on_event("tap", point);
    this.figure.on_event("mouseleave", () => (this.parts.tip.hidden = true));
    this.update();
    this.ready = Bokeh.Plotting.show(this.figure, this.parts.stage).then((view) => {
      this.view = view;
      this.drawCursor();
    });
  }

  // Time and values of the shown curves beside the pointer.
  tell({ sx, sy }) {
    const { tip, stage } = this.parts, { bbox } = this.view.frame, { link } = this;
    const inside = sx >= bbox.left && sx <= bbox.right && sy >= bbox.top && sy <= bbox.bottom;
    tip.hidden = !inside;
    if (!inside) return;
    const rows = this.panel.curves.flatMap((curve, j) => (this.shown[j] ? [[curve, this.reading(curve)]] : []));
    const text = (row) => {
      const [curve, value] = row, line = element("div");
      const swatch = element("i");
      swatch.style.background = `var(--${curve.colour})`;
      line.append(swatch, `${curve.label.replace(/ \[.*/, "")} `, element("b", "", `${value} ${this.unitText(curve)}`));
      return line;
    };
    tip.replaceChildren(element("div", "", `t = ${minus(link.t.toFixed(4))} s`), ...rows.map(text));
    const left = sx > stage.clientWidth / 2;
    tip.style.left = left ? "" : `${sx + 14}px`;
    tip.style.right = left ? `${stage.clientWidth - sx + 14}px` : "";
  }

  reading(curve) {
    const k = this.link.index;
    return rangeText(curve.reading.lo[k] * this.factor, curve.reading.hi[k] * this.factor);
  }

  // Unit of a curve: of its label, in plots of two units, else of the plot.
  unitText(curve) {
    return /\[(.*)\]/.exec(curve.label)?.[1] ?? (this.unit === "1" ? "" : this.unit);
  }

  whole() {
    this.zoomed = false;
    this.link.whole();
  }

  draw() {
    this.stale = true;
    if (!this.near) return;
    this.stale = false;
    if (this.figure) this.update();
    else this.make();
  }

  update() {
    const { palette, view } = this.link, groups = this.columns();
    const traces = this.panel.curves.map(({ drawn }) => this.trace(drawn, groups));
    this.busy = true;
    if (!this.zoomed) this.auto = this.range(traces);
    if (this.panel.log) { // zero lies at the lower edge
      for (const { y } of traces) y.forEach((value, k) => { if (value <= this.auto[0]) y[k] = this.auto[0]; });
    }
    let floor = null;
    traces.forEach((trace, j) => {
      const { colour, style } = this.panel.curves[j];
      const under = floor && floor.length === trace.y.length ? floor : trace.y.map(() => 0);
      this.sources[j].data = { ...trace, floor: under };
      if (style === "area") floor = trace.y;
      for (const glyph of this.glyphs[j]) {
        glyph.visible = this.shown[j];
        if (glyph.glyph.properties.line_color) glyph.glyph.line_color = palette[colour];
        if (glyph.glyph.properties.fill_color) glyph.glyph.fill_color = palette[colour];
      }
    });
    const bands = this.bands.times();
    for (const { name, source, strip } of this.bandSources) {
      source.data = bands[name];
      strip.glyph.fill_color = palette[name];
      strip.glyph.fill_alpha = name === "stop" || name === "lock" ? 0.25 : 1;
    }
    for (const span of this.spans) span.line_color = palette.stop;
    colourFigure(this.figure, palette);
    this.x.setv({ start: view[0], end: view[1] });
    if (!this.zoomed) this.y.setv({ start: this.auto[0], end: this.auto[1] });
    this.busy = false;
  }

  // The visible range as CSV: smallest and largest value of a bucket, one column if every sample is there.
  table() {
    const { run, view } = this.link, { curves } = this.panel;
    const names = curves.flatMap(({ label }) => (run.whole ? [label] : [`${label} min`, `${label} max`]));
    const rows = [["time [s]", ...names.map((name) => (name.includes("[") ? name : `${name} [${this.panel.unit}]`))].join(",")];
    for (let k = 0; k < run.time.length; k++) {
      if (run.until[k] < view[0] || run.time[k] > view[1]) continue;
      rows.push([run.time[k], ...curves.flatMap(({ reading: r }) => (run.whole ? [r.lo[k]] : [r.lo[k], r.hi[k]]))].join(","));
    }
    return `${rows.join("\n")}\n`;
  }

  drawCursor() {
    const { view, t } = this.link;
    this.panel.curves.forEach((curve, j) => (this.readings[j].textContent = this.reading(curve)));
    const { line } = this.parts;
    line.hidden = !this.view || t < view[0] || t > view[1];
    if (line.hidden) return;
    const { bbox } = this.view.frame;
    line.style.left = `${bbox.left + ((t - view[0]) / (view[1] - view[0])) * bbox.width}px`;
    line.style.top = `${bbox.top}px`;
    line.style.height = `${bbox.height}px`;
  }

  get values() {
    return this.readings.map((reading) => reading.textContent);
  }
}
