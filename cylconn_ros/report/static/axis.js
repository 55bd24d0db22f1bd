// Axis ticks, number formats, canvas and DOM helpers.

// Round steps (1, 2, 5 times a power of ten) that divide a range into about `wanted` parts.
function ticks(low, high, wanted) {
  const span = high - low;
  if (!(span > 0)) return { values: [low], step: 1 };
  const rough = span / Math.max(wanted, 1);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].find((factor) => factor * power >= rough) * power;
  const values = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) values.push(k * step);
  return { values, step };
}

// Powers of ten within a range, at most about `wanted` of them.
function decades(low, high, wanted) {
  const first = Math.ceil(Math.log10(low) - 1e-9), last = Math.floor(Math.log10(high) + 1e-9);
  const every = Math.max(1, Math.ceil((last - first + 1) / Math.max(wanted, 1)));
  const values = [];
  for (let k = first; k <= last; k++) if (k % every === 0) values.push(10 ** k);
  return values;
}

const SUPERSCRIPTS = "⁰¹²³⁴⁵⁶⁷⁸⁹";

function power(value) {
  const digits = String(Math.round(Math.log10(value)));
  return "10" + [...digits].map((c) => (c === "-" ? "⁻" : SUPERSCRIPTS[Number(c)])).join("");
}

// Text of a tick, with the decimals that its step needs.
function tickText(value, step) {
  if (value === 0 || Math.abs(value) < 1e-9 * step) return "0";
  if (Math.abs(value) >= 1e5 || step < 1e-4) return minus(value.toExponential(Math.max(0, Math.min(6, digits(value, step)))));
  return minus(value.toFixed(Math.max(0, Math.ceil(-Math.log10(step) - 1e-9))));
}

function digits(value, step) {
  return Math.floor(Math.log10(Math.abs(value))) - Math.floor(Math.log10(step) + 1e-9);
}

function minus(text) {
  return text.replace(/-/g, "−");
}

// Text of a value at the cursor: five significant digits.
function valueText(value) {
  if (!Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  return minus(size >= 1e5 || size < 1e-3 ? value.toExponential(3) : value.toPrecision(5));
}

function rangeText(lo, hi) {
  return lo === hi || !Number.isFinite(lo) ? valueText(lo) : `${valueText(lo)} … ${valueText(hi)}`;
}

// Colours of the style sheet, for drawing on a canvas.
function readPalette() {
  const style = getComputedStyle(document.documentElement);
  const names = ["panel", "ink", "soft", "line", "grid", "blue", "orange", "green", "red", "purple", "sky", "stick", "slip",
    "stop", "lock", "stick-strong", "slip-strong", "none-strong", "shaft", "sleeve", "mark", "collar"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

// Sizes a canvas to the device pixels, clears it, and returns its context in CSS pixels.
function prepare(canvas, width, height) {
  const ratio = window.devicePixelRatio || 1;
  const w = Math.max(1, Math.round(width * ratio)), h = Math.max(1, Math.round(height * ratio));
  if (canvas.width !== w || canvas.height !== h) {
    canvas.width = w;
    canvas.height = h;
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = "11px system-ui, -apple-system, 'Segoe UI', Roboto, Arial, sans-serif";
  return context;
}

// Creates an element with a class and a text.
function element(tag, className, text) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  if (text !== undefined) made.textContent = text;
  return made;
}

// Creates a panel: header with title; stage with one canvas for the plot and one for the cursor.
function frame(host, kind, title, unit, height) {
  const root = element("section", `panel ${kind}`);
  const header = element("header");
  const heading = element("h3", "", title);
  if (unit) heading.append(" ", element("small", "", `[${unit}]`));
  header.append(heading);
  const stage = element("div", "stage");
  stage.style.height = `${height}px`;
  const base = element("canvas"), over = element("canvas");
  base.setAttribute("role", "img");
  base.setAttribute("aria-label", unit ? `${title}, ${unit}` : title);
  stage.append(base, over);
  root.append(header, stage);
  host.append(root);
  return { root, header, stage, base, over };
}
