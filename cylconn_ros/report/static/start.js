// What all pages share: theme, width, message of a page that cannot be drawn, look of BokehJS, saving a table.

const COARSE = matchMedia("(pointer: coarse)");
const TOOLBAR_STYLE = ":host { --background-color: var(--panel); --icon-color: var(--soft); --color: var(--ink); --divider-color: var(--line); }"
  + " :host(.bk-inner) { background: linear-gradient(to left, var(--panel) 190px, transparent 190px); }";

// Calls `apply` with the colours now and at every change between light and dark.
function onTheme(apply) {
  const system = matchMedia("(prefers-color-scheme: dark)");
  const theme = (dark) => {
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    apply(readPalette());
  };
  document.getElementById("theme").addEventListener("click", () => theme(document.documentElement.dataset.theme !== "dark"));
  system.addEventListener("change", () => theme(system.matches));
  theme(system.matches);
}

// Calls `apply` when the width of the window has changed.
function onWidth(apply) {
  let width = document.documentElement.clientWidth;
  window.addEventListener("resize", () => {
    if (width === document.documentElement.clientWidth) return;
    width = document.documentElement.clientWidth;
    apply();
  });
}

function failed(error) {
  const place = document.getElementById("failure");
  place.hidden = false;
  place.textContent = `This page could not be drawn: ${error?.message ?? error}. It needs a browser of 2023 or later.`;
}

window.addEventListener("error", (event) => failed(event.error ?? event.message));

function colourFigure(figure, palette) {
  figure.setv({ background_fill_color: palette.panel, border_fill_color: palette.panel, outline_line_color: palette.line });
  for (const axis of [...figure.below, ...figure.left]) {
    axis.setv({ axis_line_color: palette.line, major_tick_line_color: palette.line, minor_tick_line_color: null,
      major_label_text_color: palette.soft, axis_label_text_color: palette.soft });
  }
  for (const grid of figure.center) if (grid.properties.grid_line_color) grid.grid_line_color = palette.grid;
}

function download(name, text) {
  const link = element("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
