// State timeline: regimes, stops, locks, refused samples and flags, as bands behind every plot and as a plot of its own.

// Bitwise or of the bits in each pixel column of a plot.
function columnsOfBits(run, group, view, width) {
  const bits = run.events[group].bits;
  const columns = new Uint32Array(Math.max(1, Math.ceil(width)));
  const scale = width / (view[1] - view[0]);
  const last = run.time.length - 1;
  const from = Math.max(0, before(run.time, view[0]));
  for (let k = from; k <= last && run.time[k] <= view[1]; k++) {
    if (!bits[k]) continue;
    const next = k < last && !run.gap[k + 1] ? run.time[k + 1] : run.until[k];
    const x0 = Math.max(0, Math.floor((run.time[k] - view[0]) * scale));
    const x1 = Math.min(columns.length - 1, Math.max(x0, Math.ceil((next - view[0]) * scale) - 1));
    for (let x = x0; x <= x1; x++) columns[x] |= bits[k];
  }
  return columns;
}

// Intervals [start, end) of pixel columns for which `test` holds.
function intervals(columns, test) {
  const found = [];
  let start = -1;
  for (let x = 0; x <= columns.length; x++) {
    const on = x < columns.length && test(columns[x]);
    if (on && start < 0) start = x;
    if (!on && start >= 0) {
      found.push([start, x]);
      start = -1;
    }
  }
  return found;
}

const STICK = 2, SLIP = 4;

// Background of the plots: tints for stick and slip (both if a column has both), and for stops and locks.
class Bands {
  constructor(link) {
    this.link = link;
    link.on("view", () => (this.found = null));
  }

  // Intervals of each state in the visible range, as columns of times, s.
  times() {
    if (this.found) return this.found;
    const { run, view } = this.link, width = 1000;
    const at = (x) => view[0] + (x / width) * (view[1] - view[0]);
    const columns = (group, mask) => {
      const found = intervals(columnsOfBits(run, group, view, width), (bits) => bits & mask);
      return { x0: found.map(([a]) => at(a)), x1: found.map(([, b]) => at(b)) };
    };
    this.found = { stick: columns("regime", STICK), slip: columns("regime", SLIP), stop: columns("stop", ~0),
      lock: columns("lock", ~0) };
    return this.found;
  }
}

// Times at which a state begins: stick, stops, locks, refused samples and flags; in order.
function beginnings(run) {
  const found = [];
  for (const [group, { bits, names }] of Object.entries(run.events)) {
    for (let k = 0, earlier = 0; k < bits.length; earlier = bits[k], k++) {
      const begun = (bits[k] & ~earlier) >>> 0;
      if (!begun) continue;
      names.forEach((name, bit) => {
        if (!(begun & (1 << bit)) || (group === "regime" && (1 << bit) !== STICK)) return;
        if (k || group !== "regime") found.push({ t: run.time[k], name: group === "status" ? `refused: ${name}` : name });
      });
    }
  }
  return found.sort((a, b) => a.t - b.t);
}

// List of events with buttons for the previous and the next one.
function eventControls(link) {
  const listed = beginnings(link.run), list = document.getElementById("event");
  const go = (event) => {
    if (!event) return;
    const [low, high] = link.view;
    if (event.t < low || event.t > high) link.setView(event.t - (high - low) / 2, event.t + (high - low) / 2);
    link.setCursor(event.t);
  };
  const most = 1000; // a longer list is slow to open; the buttons reach all
  listed.slice(0, most).forEach(({ t, name }, k) => list.append(new Option(`${minus(t.toFixed(4))} s  ${name}`, k)));
  if (listed.length > most) list.append(new Option(`… and ${listed.length - most} more`, -1));
  list.options[0].textContent = `events: ${listed.length}`;
  list.disabled = !listed.length;
  list.addEventListener("change", () => {
    go(listed[Number(list.value)]);
    list.selectedIndex = 0;
  });
  document.getElementById("earlier").addEventListener("click", () => go(listed.findLast(({ t }) => t < link.t - 1e-9)));
  document.getElementById("later").addEventListener("click", () => go(listed.find(({ t }) => t > link.t + 1e-9)));
}

const GROUP_COLOURS = { stop: "stop", lock: "lock", status: "red", flags: "purple" };

// Timeline with one row for each state that occurs.
class Events {
  constructor(host, link) {
    this.link = link;
    this.rows = [];
    for (const [group, { bits, names }] of Object.entries(link.run.events)) {
      let occurring = 0;
      for (const value of bits) occurring |= value;
      names.forEach((name, bit) => {
        if (!((occurring >>> bit) & 1)) return;
        const colour = group === "regime" ? ["none-strong", "stick-strong", "slip-strong"][bit] : GROUP_COLOURS[group];
        this.rows.push({ group, name: group === "status" ? `refused: ${name}` : name, mask: (1 << bit) >>> 0, colour });
      });
    }
    this.parts = frame(host, "time events", "State timeline", "", 17 * this.rows.length + 24);
    this.now = element("span", "key");
    this.parts.header.append(this.now);
  }

  draw() {
    const { run, view, palette } = this.link;
    const width = this.parts.stage.clientWidth, height = this.parts.stage.clientHeight;
    const context = prepare(this.parts.base, width, height);
    const plot = plotArea(width, height);
    timeAxis(context, this.link, plot);
    const cache = {};
    this.rows.forEach((row, k) => {
      const columns = (cache[row.group] ??= columnsOfBits(run, row.group, view, plot.width));
      const y = plot.top + 17 * k;
      context.fillStyle = palette.soft;
      context.textAlign = "right";
      context.textBaseline = "middle";
      context.fillText(row.name, plot.left - 6, y + 9, plot.left - 8);
      context.fillStyle = palette[row.colour];
      for (const [a, b] of intervals(columns, (bits) => bits & row.mask)) {
        context.fillRect(plot.left + a, y + 4, Math.max(b - a, 1.5), 10);
      }
    });
  }

  drawCursor() {
    cursorLine(this.parts, this.link);
    const active = this.rows.filter((row) => this.link.run.events[row.group].bits[this.link.index] & row.mask);
    this.now.textContent = active.map((row) => row.name).join(", ") || "none";
  }

  get values() {
    return [this.now.textContent];
  }
}
