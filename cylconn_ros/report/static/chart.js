// Plots over time: axes, cursor line, curves.

const LEFT = 86, RIGHT = 12, TOP = 4, BOTTOM = 20;

function plotArea(width, height) {
  return { left: LEFT, top: TOP, width: Math.max(10, width - LEFT - RIGHT), height: Math.max(10, height - TOP - BOTTOM) };
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
    const text = t === values[values.length - 1] ? `${tickText(t, step)} s` : tickText(t, step);
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

class Chart {
  constructor(host, panel, link, bands) {
    this.panel = panel;
    this.link = link;
    this.bands = bands;
    this.parts = frame(host, "time", panel.title, panel.unit + (panel.log ? ", log" : ""), 138);
    this.parts.root.dataset.key = panel.key;
    this.readings = panel.curves.map((curve) => {
      const key = element("span", "key");
      const swatch = element("i", curve.style === "area" ? "area" : "");
      swatch.style.background = `var(--${curve.colour})`;
      const value = element("b");
      key.append(swatch, curve.label, value);
      this.parts.header.append(key);
      return value;
    });
  }

  // Groups of samples to draw: one per pixel column, the same for all curves; one per sample if there are few samples.
  columns(plot) {
    const { run, view } = this.link;
    const [low, high] = view;
    const scale = plot.width / (high - low);
    const from = Math.max(0, before(run.time, low) - 1);
    const to = Math.min(run.time.length - 1, before(run.time, high) + 1);
    const middle = (k) => plot.left + ((run.time[k] + run.until[k]) / 2 - low) * scale;
    const groups = [];
    if (to - from <= 2 * plot.width) {
      for (let k = from; k <= to; k++) groups.push({ x: middle(k), from: k, to: k, gap: run.gap[k] });
      return groups;
    }
    for (let k = from; k <= to; k++) {
      const x = Math.floor(middle(k)) + 0.5;
      const last = groups[groups.length - 1];
      if (last && last.x === x && !run.gap[k]) last.to = k;
      else groups.push({ x, from: k, to: k, gap: run.gap[k] });
    }
    return groups;
  }

  range(groups) {
    let low = Infinity, high = -Infinity, leastPositive = Infinity;
    for (const { drawn } of this.panel.curves) {
      for (let k = groups[0].from; k <= groups[groups.length - 1].to; k++) {
        if (drawn.lo[k] < low) low = drawn.lo[k];
        if (drawn.hi[k] > high) high = drawn.hi[k];
        if (drawn.lo[k] > 0 && drawn.lo[k] < leastPositive) leastPositive = drawn.lo[k];
        if (drawn.hi[k] > 0 && drawn.hi[k] < leastPositive) leastPositive = drawn.hi[k];
      }
    }
    if (this.panel.log) {
      if (!(high > 0)) return [1e-3, 1];
      const floor = Math.max(leastPositive, high * 1e-14);
      return [10 ** Math.floor(Math.log10(floor)), 10 ** Math.ceil(Math.log10(high * 1.05))];
    }
    if (!(high >= low)) return [0, 1];
    if (this.panel.zero) [low, high] = [Math.min(low, 0), Math.max(high, 0)];
    const margin = high > low ? 0.06 * (high - low) : Math.abs(high) * 0.1 || 1;
    return [low === 0 ? 0 : low - margin, high + margin];
  }

  draw() {
    const width = this.parts.stage.clientWidth, height = this.parts.stage.clientHeight;
    const context = prepare(this.parts.base, width, height);
    const plot = plotArea(width, height);
    const groups = this.columns(plot);
    const [low, high] = this.range(groups);
    const scale = this.panel.log
      ? (value) => plot.top + plot.height * (1 - Math.log10(Math.max(value, low) / low) / Math.log10(high / low))
      : (value) => plot.top + plot.height * (1 - (value - low) / (high - low));
    this.scale = scale;
    this.bands.paint(context, plot.left, plot.top, plot.width, plot.height);
    timeAxis(context, this.link, plot);
    this.valueAxis(context, plot, low, high);
    context.save();
    context.beginPath();
    context.rect(plot.left, plot.top - 1, plot.width, plot.height + 2);
    context.clip();
    let floor = null;
    for (const curve of this.panel.curves) {
      const line = this.trace(curve.drawn, groups);
      if (curve.style === "area") {
        this.fill(context, line, floor, curve.colour);
        floor = line;
      }
      this.stroke(context, line, curve);
    }
    context.restore();
    context.strokeStyle = this.link.palette.line;
    context.strokeRect(plot.left - 0.5, plot.top - 0.5, plot.width + 1, plot.height + 1);
  }

  valueAxis(context, plot, low, high) {
    const { palette } = this.link;
    const wanted = plot.height / 26;
    const { values, step } = this.panel.log ? { values: decades(low, high, wanted), step: 0 } : ticks(low, high, wanted);
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (const value of values) {
      const y = this.scale(value);
      context.fillStyle = value === 0 && !this.panel.log ? palette.line : palette.grid;
      context.fillRect(plot.left, Math.round(y), plot.width, 1);
      context.fillStyle = palette.soft;
      const inside = Math.min(Math.max(y, plot.top + 5), plot.top + plot.height - 4);
      context.fillText(this.panel.log ? power(value) : tickText(value, step), plot.left - 6, inside);
    }
  }

  // A curve in pixels: x, upper and lower y of each group; null for a group without values.
  trace(drawn, groups) {
    return groups.map(({ x, from, to, gap }) => {
      let lo = Infinity, hi = -Infinity;
      for (let k = from; k <= to; k++) {
        if (drawn.lo[k] < lo) lo = drawn.lo[k];
        if (drawn.hi[k] > hi) hi = drawn.hi[k];
      }
      return lo <= hi ? { x, gap, lower: this.scale(lo), upper: this.scale(hi) } : null;
    });
  }

  stroke(context, line, curve) {
    context.strokeStyle = this.link.palette[curve.colour];
    context.lineWidth = { line: 1.6, thin: 1, dashed: 1, area: 1 }[curve.style];
    context.setLineDash(curve.style === "dashed" ? [5, 3] : []);
    context.lineJoin = "bevel"; // round joins take seconds for noise
    context.beginPath();
    let at = null;
    for (const point of line) {
      if (!point) {
        at = null;
        continue;
      }
      const { x, lower, upper, gap } = point;
      if (at === null || gap) {
        context.moveTo(x, lower);
        if (lower === upper) context.lineTo(x + 0.01, lower); // a single sample: a dot
        else context.lineTo(x, upper);
        at = upper;
        continue;
      }
      const [first, second] = Math.abs(lower - at) < Math.abs(upper - at) ? [lower, upper] : [upper, lower];
      context.lineTo(x, first);
      if (second !== first) context.lineTo(x, second);
      at = second;
    }
    context.stroke();
    context.setLineDash([]);
  }

  fill(context, line, floor, colour) {
    context.fillStyle = this.link.palette[colour];
    context.globalAlpha = 0.22;
    const zero = this.scale(0);
    const under = (k) => (floor && floor[k] ? floor[k].upper : zero);
    for (let k = 0; k < line.length; ) {
      if (!line[k]) {
        k += 1;
        continue;
      }
      const start = k;
      context.beginPath();
      context.moveTo(line[k].x, line[k].upper);
      for (k += 1; k < line.length && line[k] && !line[k].gap; k++) context.lineTo(line[k].x, line[k].upper);
      for (let back = k - 1; back >= start; back--) context.lineTo(line[back].x, under(back));
      context.fill();
    }
    context.globalAlpha = 1;
  }

  drawCursor() {
    const { context, x, inside } = cursorLine(this.parts, this.link);
    const k = this.link.index;
    this.panel.curves.forEach((curve, j) => {
      this.readings[j].textContent = rangeText(curve.reading.lo[k], curve.reading.hi[k]);
      const value = curve.drawn.hi[k];
      if (!inside || !Number.isFinite(value)) return;
      context.fillStyle = this.link.palette[curve.colour];
      context.beginPath();
      context.arc(x, this.scale(value), 3, 0, 2 * Math.PI);
      context.fill();
    });
  }

  get values() {
    return this.readings.map((reading) => reading.textContent);
  }
}
