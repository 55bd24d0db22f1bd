// Plots of points, lines and intervals by BokehJS; heading, legend and export around them.

const NARROW = 560; // px, width of a plot below which its axes take less room
const POINT_HEIGHT = 320, ROW_HEIGHT = 30, ROWS_AROUND = 96;

// Text of a tick: without a power of ten for small steps of a larger value.
function pointTick(value, step) {
  const decimals = Math.max(0, Math.ceil(-Math.log10(step) - 1e-9));
  return Math.abs(value) < 1e5 && decimals <= 6 ? minus((Math.abs(value) < 1e-9 * step ? 0 : value).toFixed(decimals)) : tickText(value, step);
}

class PointPlot {
  constructor(host, plot) {
    Object.assign(this, { plot, figure: null, view: null, palette: null });
    const root = element("section", plot.bad ? "panel points marked" : "panel points"), header = element("header");
    root.dataset.key = plot.key;
    header.append(element("h3", "", plot.title));
    if (plot.mark) header.append(element("span", `badge${plot.bad ? " bad" : plot.good ? " good" : ""}`, plot.mark));
    const keys = element("div", "keys");
    for (const one of plot.series) {
      if (!one.label) continue;
      const key = element("span", "key"), swatch = element("i", one.kind);
      swatch.style.setProperty("--swatch", `var(--${one.colour})`);
      key.append(swatch, one.label);
      keys.append(key);
    }
    const save = element("button", "export", "CSV");
    save.title = "save the points as a table";
    save.addEventListener("click", () => download(`${plot.key}.csv`, this.table()));
    const stage = element("div", "stage");
    stage.style.height = `${this.height}px`;
    stage.setAttribute("role", "img");
    stage.setAttribute("aria-label", `${plot.title}: ${plot.labels[1]} against ${plot.labels[0]}. ${plot.mark} ${plot.note}`);
    root.append(header, save, keys, stage);
    if (plot.note) root.append(element("p", "note", plot.note));
    host.append(root);
    this.parts = { root, stage };
    // Plots are made when they come near the window.
    new IntersectionObserver((entries) => {
      this.near = entries[entries.length - 1].isIntersecting;
      if (this.near && this.stale) this.draw();
    }, { rootMargin: "300px" }).observe(root);
  }

  get height() {
    return this.plot.names.length ? ROWS_AROUND + ROW_HEIGHT * this.plot.names.length : POINT_HEIGHT;
  }

  // Smallest and largest finite value of columns.
  extent(columns) {
    let low = Infinity, high = -Infinity;
    for (const column of columns) {
      for (const value of column) {
        if (Number.isFinite(value)) [low, high] = [Math.min(low, value), Math.max(high, value)];
      }
    }
    if (!(high >= low)) return [0, 1];
    const margin = high > low ? 0.05 * (high - low) : Math.abs(high) * 0.1 || 1;
    return [low === 0 ? 0 : low - margin, high === 0 ? 0 : high + margin];
  }

  ranges() {
    const { names, equal, series } = this.plot, flat = (...keys) => series.flatMap((one) => keys.map((key) => one[key] ?? []));
    const ends = ["low", "high"];
    let x = this.extent(names.length ? flat("x", ...ends) : flat("x"));
    let y = names.length ? [-0.7, names.length - 0.3] : this.extent(flat("y", ...ends));
    if (equal) {
      const { clientWidth } = this.parts.stage, width = clientWidth - this.left - 16, height = this.height - 62;
      const scale = Math.max((x[1] - x[0]) / width, (y[1] - y[0]) / height);
      const around = ([low, high], pixels) => [(low + high - pixels * scale) / 2, (low + high + pixels * scale) / 2];
      [x, y] = [around(x, width), around(y, height)];
    }
    return [x, y];
  }

  get left() {
    const narrow = this.parts.stage.clientWidth < NARROW;
    if (!this.plot.names.length) return narrow ? 58 : 68;
    return Math.min(7.2 * Math.max(...this.plot.names.map((name) => name.length)) + 16, narrow ? 140 : 240);
  }

  make() {
    const { plot } = this, { Range1d } = Bokeh, { names } = plot;
    const [x, y] = this.ranges();
    this.x = new Range1d({ start: x[0], end: x[1] });
    this.y = new Range1d({ start: y[0], end: y[1] });
    this.figure = Bokeh.Plotting.figure({
      x_range: this.x, y_range: this.y, height: this.height, sizing_mode: "stretch_width",
      // A finger that drags scrolls the page; the tools can be chosen there, too.
      tools: "box_zoom,pan,ywheel_zoom,xwheel_zoom,reset,save", active_drag: COARSE.matches ? null : "box_zoom",
      active_scroll: null, toolbar_location: "above", toolbar_inner: true, min_border_left: this.left, min_border_right: 16,
      min_border_top: 4, output_backend: "canvas", lod_threshold: null,
      x_axis_label: plot.labels[0], y_axis_label: names.length ? "" : plot.labels[1],
    });
    this.figure.toolbar.setv({ logo: null, autohide: true, stylesheets: [TOOLBAR_STYLE] });
    const [below] = this.figure.below, [side] = this.figure.left;
    for (const axis of [below, side]) {
      axis.setv({ axis_label_text_font_style: "normal", axis_label_text_font_size: "12px", axis_label_standoff: 4 });
      axis.formatter.doFormat = (values) => {
        const step = values.length > 1 ? Math.abs(values[1] - values[0]) : 1;
        return values.map((value) => pointTick(value, step));
      };
    }
    below.ticker.desired_num_ticks = this.parts.stage.clientWidth < NARROW ? 4 : 7;
    if (names.length) {
      side.ticker = new Bokeh.FixedTicker({ ticks: names.map((_, k) => k) });
      side.formatter.doFormat = (values) => values.map((k) => names[k] ?? "");
    }
    this.painters = plot.series.flatMap((one) => this.add(one));
    this.colour();
    this.ready = Bokeh.Plotting.show(this.figure, this.parts.stage).then((view) => (this.view = view));
  }

  // Adds a series; returns functions that give its glyphs the colours of a palette.
  add({ kind, colour, x, y, low, high }) {
    const { figure } = this, source = new Bokeh.ColumnDataSource({ data: { x, y, low: low ?? x, high: high ?? x } });
    const line = ({ glyph }) => (palette) => (glyph.line_color = palette[colour]);
    const fill = ({ glyph }) => (palette) => glyph.setv({ fill_color: palette[colour] });
    const [fx, fy, fl, fh] = ["x", "y", "low", "high"].map((field) => ({ field }));
    if (kind === "steps") return [line(figure.step(fx, fy, "after", { source, line_width: 2 }))];
    if (kind === "line" || kind === "dashed") {
      return [line(figure.line(fx, fy, { source, line_width: 2, line_dash: kind === "dashed" ? [6, 4] : [] }))];
    }
    if (kind === "band") return [fill(figure.varea(fx, fl, fh, { source, fill_alpha: 0.18 }))];
    if (kind === "rings") return [line(figure.scatter(fx, fy, { source, size: 5, fill_color: null, line_alpha: 0.8 }))];
    if (kind === "diamonds") {
      return [line(figure.scatter(fx, fy, { source, marker: "diamond", size: 12, fill_color: null, line_width: 2 }))];
    }
    if (kind === "means" || kind === "open") {
      const ends = this.plot.names.length ? [fl, fy, fh, fy] : [fx, fl, fx, fh];
      const bar = figure.segment(...ends, { source, line_width: 2.4 });
      if (kind === "means") return [line(bar), fill(figure.scatter(fx, fy, { source, size: 8, line_color: null }))];
      return [line(bar), line(figure.scatter(fx, fy, { source, marker: "diamond", size: 15, fill_color: null, line_width: 2 }))];
    }
    return [fill(figure.scatter(fx, fy, { source, size: 4, line_color: null, fill_alpha: 0.45 }))];
  }

  colour() {
    colourFigure(this.figure, this.palette);
    for (const paint of this.painters) paint(this.palette);
  }

  draw(palette) {
    if (palette) this.palette = palette;
    this.stale = true;
    if (!this.near) return;
    this.stale = false;
    if (this.figure) this.colour();
    else this.make();
  }

  // The points as CSV, series by series.
  table() {
    const { labels, names, series } = this.plot;
    const quote = (text) => `"${text.replace(/"/g, '""')}"`;
    const rows = [["series", names.length ? "row" : labels[1], labels[0], "low", "high"].map(quote).join(",")];
    for (const { label, x, y, low, high } of series) {
      for (let k = 0; k < x.length; k++) {
        const row = names.length ? quote(names[y[k]] ?? "") : y[k];
        rows.push([quote(label), row, x[k], low?.[k] ?? "", high?.[k] ?? ""].join(","));
      }
    }
    return `${rows.join("\n")}\n`;
  }
}
