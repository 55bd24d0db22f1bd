// Builds the page and connects pointer, keys and buttons to the plots.

// Pointer controls of a plot: drag zooms, shift-drag pans, ctrl-wheel zooms, double click shows all, moving sets the cursor.
function addPointerControls(parts, link) {
  const { stage } = parts;
  const selection = element("div", "selection");
  selection.hidden = true;
  stage.append(selection);
  let from = null;
  const at = (event) => {
    const box = stage.getBoundingClientRect();
    const plot = plotArea(box.width, box.height);
    const x = Math.min(Math.max(event.clientX - box.left, plot.left), plot.left + plot.width);
    return { x, t: link.view[0] + ((x - plot.left) / plot.width) * (link.view[1] - link.view[0]), plot };
  };
  stage.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    if (event.pointerType === "mouse") stage.setPointerCapture(event.pointerId);
    if (link.playing) link.pause();
    from = { ...at(event), view: [...link.view], moving: event.shiftKey, touch: event.pointerType === "touch" };
    link.setCursor(from.t);
  });
  stage.addEventListener("pointermove", (event) => {
    if (link.playing) return;
    const now = at(event);
    if (from && from.moving) {
      const by = ((from.x - now.x) / now.plot.width) * (from.view[1] - from.view[0]);
      link.setView(from.view[0] + by, from.view[1] + by);
      return;
    }
    link.setCursor(now.t);
    if (!from || from.touch) return;
    selection.hidden = Math.abs(now.x - from.x) < 4;
    selection.style.left = `${Math.min(from.x, now.x)}px`;
    selection.style.width = `${Math.abs(now.x - from.x)}px`;
  });
  const release = (event) => {
    if (from && !selection.hidden && event.type === "pointerup") {
      const to = at(event);
      link.setView(Math.min(from.t, to.t), Math.max(from.t, to.t));
    }
    selection.hidden = true;
    from = null;
  };
  stage.addEventListener("pointerup", release);
  stage.addEventListener("pointercancel", release);
  stage.addEventListener("dblclick", () => link.whole());
  stage.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.shiftKey) return;
    event.preventDefault();
    link.zoom(Math.exp((event.deltaY || event.deltaX) * 0.002), at(event).t);
  }, { passive: false });
}

function legend(link) {
  const host = document.getElementById("legend");
  const occurring = (group) => link.run.events[group].bits.reduce((all, bits) => all | bits, 0);
  const regime = occurring("regime");
  const entries = [
    [regime & STICK, "stick", "stick"],
    [regime & SLIP, "slip", "slip"],
    [occurring("stop"), "stop", "at a stop"],
    [occurring("lock"), "lock", "locked"],
  ];
  for (const [present, colour, text] of entries) {
    if (!present) continue;
    const entry = element("span");
    const swatch = element("i");
    swatch.style.background = `var(--${colour})`;
    swatch.style.border = "1px solid var(--line)";
    entry.append(swatch, text);
    host.append(entry);
  }
}

function note(text) {
  document.getElementById("notes").append(element("li", "", text));
}

function build(run) {
  const link = new Link(run);
  const plots = document.getElementById("plots"), views = document.getElementById("views");
  const bands = new Bands(link);
  const charts = [new Events(plots, link), ...run.panels.map((panel) => new Chart(plots, panel, link, bands))];
  const sideViews = [new Scene(views, link)];
  if (run.radius !== null) {
    sideViews.push(new Plane(views, link, { key: "disc", title: "Friction disc", unit: "N", x: "f1", y: "m1", limit: "limit",
      labels: ["f₁ friction [N]", "m₁ friction / R [N]"], height: 300, equal: true }));
  }
  sideViews.push(new Plane(views, link, { key: "slip", title: "Slip trajectory", unit: run.radius !== null ? "m" : "m, rad",
    x: "u1", y: "ur1", limit: null, labels: ["slide u₁ [m]", run.radius !== null ? "R · spin uᵣ₁ [m]" : "spin uᵣ₁ [rad]"],
    height: 210, equal: false }));
  if (!run.whole) {
    note(`${run.samples.toLocaleString("en")} samples are shown in ${run.time.length.toLocaleString("en")} buckets of up to `
      + `${run.bucket}, with the smallest and the largest value of each, so every extreme is kept. The 3-D view and the `
      + `trajectories show ${run.path.time.length.toLocaleString("en")} of the samples, including their extremes. `
      + "For every sample of a range: cylconn report --from and --to.");
  }
  if (run.empty.length) note(`All zero (or rounding errors: below 1e−12, or 1e−12 of the greatest force or moment), not shown: ${run.empty.join(", ")}.`);
  const all = [...charts, ...sideViews];
  addPointerControls(charts[0].parts, link);
  legend(link);
  eventControls(link);
  return { link, all };
}

function controls({ link, all }) {
  const clock = document.getElementById("clock"), play = document.getElementById("play");
  const whole = document.getElementById("whole");
  const cursor = () => {
    for (const one of all) one.drawCursor();
    clock.textContent = `t = ${minus(link.t.toFixed(4))} s`;
    play.textContent = link.playing ? "❚❚ pause" : "▶ play";
  };
  const draw = () => {
    for (const one of all) one.draw();
    whole.disabled = link.isWhole;
    cursor();
  };
  // At most one redraw per animation frame: 1 only the cursor, 2 everything.
  let pending = 0;
  const later = (what) => () => {
    if (pending === 2 || (pending === 1 && what === cursor)) return;
    if (!pending) requestAnimationFrame(() => {
      const everything = pending === 2;
      pending = 0;
      (everything ? draw : cursor)();
    });
    pending = what === draw ? 2 : 1;
  };
  link.on("cursor", later(cursor));
  link.on("view", later(draw));
  play.addEventListener("click", () => (link.playing ? link.pause() : link.play()));
  whole.addEventListener("click", () => {
    for (const one of all) one.zoomed = false;
    link.whole();
  });
  document.addEventListener("keydown", (event) => {
    if (event.target.closest("button, summary, input, select") || event.altKey || event.ctrlKey || event.metaKey) return;
    const action = { ArrowLeft: () => link.step(-1), ArrowRight: () => link.step(1), " ": () => play.click(),
      Escape: () => link.whole() }[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });
  onWidth(later(draw));
  link.setCursor(link.run.begin + 0.35 * (link.run.end - link.run.begin));
  onTheme((palette) => {
    link.palette = palette;
    draw();
  });
}

const ready = readRun().then((run) => {
  const built = build(run);
  controls(built);
  return built;
});
ready.catch(failed);
globalThis.report = { ready, plotArea, unitOf };
