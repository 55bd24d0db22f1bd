// Trajectory in a plane: friction disc, slip trajectory.

class Plane {
  // x, y: names of columns of the path; limit: column with the radius of the disc, or null; equal: equal scales.
  constructor(host, link, { key, title, unit, x, y, limit, labels, height, equal }) {
    Object.assign(this, { link, x: link.run.path[x], y: link.run.path[y], labels, equal });
    this.limit = limit ? link.run.path[limit] : null;
    this.parts = frame(host, "plane", title, unit, height);
    this.parts.root.dataset.key = key;
    this.reading = element("span", "key");
    this.parts.header.append(this.reading);
  }

  rows() {
    const { time } = this.link.run.path;
    return [before(time, this.link.view[0]), before(time, this.link.view[1])];
  }

  bounds() {
    const [from, to] = this.rows();
    const box = this.limit ? [0, 0, 0, 0] : [Infinity, -Infinity, Infinity, -Infinity];
    this.limits = [Infinity, 0];
    for (let k = from; k <= to; k++) {
      const r = this.limit ? this.limit[k] : 0;
      if (this.limit && Number.isFinite(r)) this.limits = [Math.min(this.limits[0], r), Math.max(this.limits[1], r)];
      if (!Number.isFinite(this.x[k]) || !Number.isFinite(this.y[k])) continue;
      box[0] = Math.min(box[0], this.x[k], -r || this.x[k]);
      box[1] = Math.max(box[1], this.x[k], r || this.x[k]);
      box[2] = Math.min(box[2], this.y[k], -r || this.y[k]);
      box[3] = Math.max(box[3], this.y[k], r || this.y[k]);
    }
    return box.every(Number.isFinite) ? box : [-1, 1, -1, 1];
  }

  fit(plot) {
    const [x0, x1, y0, y1] = this.bounds();
    let w = Math.max(x1 - x0, 1e-12), h = Math.max(y1 - y0, 1e-12);
    if (x1 === x0 && y1 === y0) w = h = Math.max(Math.abs(x0), Math.abs(y0), 1) * 1e-3;
    if (this.equal) {
      const scale = Math.min(plot.width / w, plot.height / h) * 0.9;
      [w, h] = [plot.width / scale, plot.height / scale];
    } else {
      [w, h] = [1.12 * (x1 > x0 ? w : h), 1.12 * (y1 > y0 ? h : w)];
    }
    const cx = (x0 + x1) / 2, cy = (y0 + y1) / 2;
    this.range = [cx - w / 2, cx + w / 2, cy - h / 2, cy + h / 2];
    this.px = (value) => plot.left + ((value - cx) / w + 0.5) * plot.width;
    this.py = (value) => plot.top + (0.5 - (value - cy) / h) * plot.height;
    this.perUnit = plot.width / w;
  }

  draw() {
    const { palette, run } = this.link;
    const width = this.parts.stage.clientWidth, height = this.parts.stage.clientHeight;
    const context = prepare(this.parts.base, width, height);
    const plot = (this.plot = { left: 60, top: 4, width: Math.max(10, width - 70), height: Math.max(10, height - 40) });
    this.fit(plot);
    this.axes(context, plot);
    context.save();
    context.beginPath();
    context.rect(plot.left, plot.top, plot.width, plot.height);
    context.clip();
    if (this.limit && this.limits[1] > 0) {
      context.strokeStyle = palette.red;
      context.setLineDash([3, 3]);
      context.globalAlpha = 0.5;
      for (const r of this.limits) this.circle(context, r);
      context.setLineDash([]);
      context.globalAlpha = 1;
    }
    const [from, to] = this.rows();
    const colours = [palette["none-strong"], palette["stick-strong"], palette["slip-strong"]];
    context.lineWidth = 1.3;
    context.lineJoin = "bevel";
    let k = from;
    while (k <= to) {
      const regime = run.path.regime[k];
      context.strokeStyle = colours[regime] ?? palette.soft;
      context.beginPath();
      context.moveTo(this.px(this.x[k]), this.py(this.y[k]));
      context.lineTo(this.px(this.x[k]) + 0.01, this.py(this.y[k]));
      const end = k + 300; // one stroke of many thousand crossing segments is slow
      while (k <= to && k < end && run.path.regime[k] === regime) {
        context.lineTo(this.px(this.x[k]), this.py(this.y[k]));
        k += 1;
      }
      if (k <= to) context.lineTo(this.px(this.x[k]), this.py(this.y[k]));
      context.stroke();
    }
    context.restore();
    context.lineWidth = 1;
    context.strokeStyle = palette.line;
    context.strokeRect(plot.left - 0.5, plot.top - 0.5, plot.width + 1, plot.height + 1);
  }

  axes(context, plot) {
    const { palette } = this.link;
    const [x0, x1, y0, y1] = this.range;
    const across = ticks(x0, x1, plot.width / 70), up = ticks(y0, y1, plot.height / 40);
    context.textAlign = "center";
    context.textBaseline = "top";
    for (const value of across.values) {
      context.fillStyle = value === 0 ? palette.line : palette.grid;
      context.fillRect(Math.round(this.px(value)), plot.top, 1, plot.height);
      context.fillStyle = palette.soft;
      context.fillText(tickText(value, across.step), this.px(value), plot.top + plot.height + 4);
    }
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (const value of up.values) {
      context.fillStyle = value === 0 ? palette.line : palette.grid;
      context.fillRect(plot.left, Math.round(this.py(value)), plot.width, 1);
      context.fillStyle = palette.soft;
      context.fillText(tickText(value, up.step), plot.left - 5, this.py(value));
    }
    context.fillStyle = palette.soft;
    context.textAlign = "center";
    context.textBaseline = "bottom";
    context.fillText(this.labels[0], plot.left + plot.width / 2, plot.top + plot.height + 34);
    context.save();
    context.translate(10, plot.top + plot.height / 2);
    context.rotate(-Math.PI / 2);
    context.textBaseline = "middle";
    context.fillText(this.labels[1], 0, 0);
    context.restore();
  }

  circle(context, r) {
    context.beginPath();
    context.arc(this.px(0), this.py(0), Math.max(r, 0) * this.perUnit, 0, 2 * Math.PI);
    context.stroke();
  }

  drawCursor() {
    const { palette, sample } = this.link;
    const width = this.parts.stage.clientWidth, height = this.parts.stage.clientHeight;
    const context = prepare(this.parts.over, width, height);
    const x = this.x[sample], y = this.y[sample];
    const texts = [valueText(x), valueText(y)];
    context.beginPath();
    context.rect(this.plot.left, this.plot.top, this.plot.width, this.plot.height);
    context.clip();
    if (this.limit) {
      texts.push(`limit ${valueText(this.limit[sample])}`);
      context.strokeStyle = palette.red;
      context.lineWidth = 2;
      this.circle(context, this.limit[sample]);
      context.fillStyle = palette.red;
      context.globalAlpha = 0.07;
      context.fill();
      context.globalAlpha = 1;
      context.strokeStyle = palette.ink;
      context.lineWidth = 1.5;
      context.beginPath();
      context.moveTo(this.px(0), this.py(0));
      context.lineTo(this.px(x), this.py(y));
      context.stroke();
    }
    if (Number.isFinite(x) && Number.isFinite(y)) {
      context.fillStyle = palette.ink;
      context.beginPath();
      context.arc(this.px(x), this.py(y), 4, 0, 2 * Math.PI);
      context.fill();
    }
    this.reading.textContent = minus(texts.join(", "));
  }

  get values() {
    return [this.reading.textContent];
  }
}
