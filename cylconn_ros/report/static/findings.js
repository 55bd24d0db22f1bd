// Builds a page of findings: the plots of each section.

async function readPlots() {
  const head = JSON.parse(document.getElementById("head").textContent);
  const buffer = await unpack(document.getElementById("numbers").textContent);
  const array = ([kind, offset, count]) => new KINDS[kind](buffer, offset, count);
  return head.plots.map((plot) => ({
    ...plot,
    series: plot.series.map(({ columns, ...one }) => ({
      ...one, ...Object.fromEntries(Object.entries(columns).map(([name, place]) => [name, array(place)])),
    })),
  }));
}

function pageOf(plots) {
  const all = plots.map((plot) => new PointPlot(document.querySelector(`#${plot.section} .plots`), plot));
  onTheme((palette) => {
    for (const one of all) one.draw(palette);
  });
  return { all };
}

const ready = readPlots().then(pageOf);
ready.catch(failed);
globalThis.report = { ready };
