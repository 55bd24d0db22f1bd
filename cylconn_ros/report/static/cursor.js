// State shared by the linked plots: visible time range, cursor, playback.

class Link {
  constructor(run) {
    this.run = run;
    this.view = [run.begin, run.end];
    this.listeners = { view: [], cursor: [] };
    this.playing = null;
    this.palette = readPalette();
    this.place(run.begin);
  }

  on(event, listener) {
    this.listeners[event].push(listener);
  }

  notify(event) {
    for (const listener of this.listeners[event]) listener();
  }

  place(t) {
    this.t = Math.min(Math.max(t, this.run.begin), this.run.end);
    this.index = this.run.whole ? nearest(this.run.time, this.t) : before(this.run.time, this.t);
    this.sample = nearest(this.run.path.time, this.t);
  }

  setCursor(t) {
    this.place(t);
    this.notify("cursor");
  }

  step(by) {
    const k = Math.min(Math.max(this.index + by, 0), this.run.time.length - 1);
    this.setCursor(this.run.time[k]);
  }

  get isWhole() {
    return this.view[0] <= this.run.begin && this.view[1] >= this.run.end;
  }

  setView(low, high) {
    const { begin, end } = this.run;
    const minSpan = Math.max((end - begin) * 1e-7, 1e-9);
    let span = Math.min(Math.max(high - low, minSpan), end - begin);
    let from = Math.min(Math.max(low, begin), end - span);
    this.view = [from, from + span];
    this.notify("view");
  }

  zoom(factor, about) {
    const [low, high] = this.view;
    this.setView(about - (about - low) * factor, about + (high - about) * factor);
  }

  whole() {
    this.setView(this.run.begin, this.run.end);
  }

  // Plays the visible range in real time, a long one in 30 s.
  play() {
    const [low, high] = this.view;
    const rate = Math.max(1, (high - low) / 30);
    let last = performance.now();
    if (this.t >= high - 1e-9 || this.t < low) this.setCursor(low);
    const tick = (now) => {
      const t = this.t + (rate * (now - last)) / 1000;
      last = now;
      this.setCursor(Math.min(t, this.view[1]));
      if (t >= this.view[1]) this.pause(); else this.playing = requestAnimationFrame(tick);
    };
    this.playing = requestAnimationFrame(tick);
    this.notify("cursor");
  }

  pause() {
    cancelAnimationFrame(this.playing);
    this.playing = null;
    this.notify("cursor");
  }
}
