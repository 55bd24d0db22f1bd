// Decoder of the packed data of the page.

async function unpack(base64) {
  const text = atob(base64.trim());
  const packed = new Uint8Array(text.length);
  for (let k = 0; k < text.length; k++) packed[k] = text.charCodeAt(k);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

const KINDS = { f4: Float32Array, f8: Float64Array, u1: Uint8Array, u4: Uint32Array };

// The data of the run as arrays. lo and hi are the smallest and largest value of each bucket; they are the same array if
// the page contains every sample.
async function readRun() {
  const head = JSON.parse(document.getElementById("head").textContent);
  const buffer = await unpack(document.getElementById("numbers").textContent);
  const array = ([kind, offset, count]) => new KINDS[kind](buffer, offset, count);
  const range = (places) => {
    const lo = array(places[0]);
    return { lo, hi: places.length > 1 ? array(places[1]) : lo };
  };
  const run = { ...head, time: array(head.time), until: array(head.until), gap: array(head.gap), path: {}, events: {} };
  run.panels = head.panels.map((panel) => ({
    ...panel,
    curves: panel.curves.map((curve) => {
      const drawn = range(curve.drawn);
      return { ...curve, drawn, reading: curve.reading ? range(curve.reading) : drawn };
    }),
  }));
  for (const [name, place] of Object.entries(head.path)) run.path[name] = array(place);
  for (const [name, group] of Object.entries(head.events)) run.events[name] = { names: group.names, bits: array(group.bits) };
  const last = run.time.length - 1;
  run.begin = run.time[0];
  run.end = run.until[last] > run.begin ? run.until[last] : run.begin + 1e-3;
  return run;
}

// Index of the last time that is not after t; 0 if all are.
function before(times, t) {
  let low = 0, high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= t) low = middle; else high = middle - 1;
  }
  return low;
}

// Index of the time nearest to t.
function nearest(times, t) {
  const k = before(times, t);
  return k + 1 < times.length && times[k + 1] - t < t - times[k] ? k + 1 : k;
}
