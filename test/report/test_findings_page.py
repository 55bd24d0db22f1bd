"""The page of an identification in Chromium: drawn offline, light and dark, wide and narrow."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Page, browser
from paths import BAGS

from cylconn_ros.cli.main import main


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("identify") / "friction.html"
    assert main(["identify", str(BAGS / "lossy"), "--report", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with browser(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


DRAW = """
report.ready.then((built) => {
  globalThis.built = built;
  for (const one of built.all) {
    one.near = true;
    if (one.stale) one.draw();
  }
  return Promise.all(built.all.map((one) => one.ready)).then(() => built.all.length);
})
"""
# For every plot, the colours of series that are not in its picture.
MISSING = """
(async () => {
  const found = [];
  const opaque = new Set(["line", "dashed", "steps", "means", "open", "diamonds"]);
  const canvas = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
  const number = (colour) => {
    canvas.fillStyle = colour;
    canvas.fillRect(0, 0, 1, 1);
    return new Uint32Array(canvas.getImageData(0, 0, 1, 1).data.buffer)[0];
  };
  for (const one of built.all) {
    await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
    const picture = one.view.export("png", false).canvas;
    const { data } = picture.getContext("2d").getImageData(0, 0, picture.width, picture.height);
    const seen = new Set(new Uint32Array(data.buffer));
    const missing = one.plot.series.filter(({ kind, colour }) => opaque.has(kind) && !seen.has(number(one.palette[colour])));
    found.push([one.plot.key, seen.size, missing.map(({ label }) => label)]);
  }
  return found;
})()
"""  # noqa: E501


@pytest.mark.parametrize(("width", "dark"), [(1200, False), (1200, True), (390, False)])
def test_every_plot_is_drawn_offline(chromium: Page, report: Path, width: int, dark: bool) -> None:
    chromium.problems.clear()
    chromium.requests.clear()
    chromium.open(report, width=width, dark=dark)
    assert chromium.run(DRAW) >= 10
    found = {key: (colours, missing) for key, colours, missing in chromium.run(MISSING)}
    assert {key: missing for key, (_, missing) in found.items() if missing} == {}
    assert min(colours for colours, _ in found.values()) > 10  # none is blank
    assert chromium.problems == []
    assert [url for url in chromium.requests if not url.startswith(("file:", "data:"))] == []
    assert chromium.run("document.getElementById('failure').hidden")
    assert chromium.run("document.documentElement.scrollWidth") == width
    red = chromium.run("Number(getComputedStyle(document.body).backgroundColor.match(/\\d+/)[0])")
    assert red < 60 if dark else red > 200


def test_the_verdict_comes_first_and_values_are_readable_when_narrow(
    chromium: Page, report: Path
) -> None:
    chromium.open(report, width=390)
    verdict = chromium.run("document.getElementById('verdict').innerText")
    assert verdict.replace("\n", "").startswith("✓Use these values")
    assert chromium.run("document.getElementById('verdict').getBoundingClientRect().top") < 200
    label = "getComputedStyle(document.querySelector('td:nth-child(3)'), '::before').content"
    assert "95 % interval" in chromium.run(label)
    outside = "[...document.querySelectorAll('td')].filter((e) => e.scrollWidth > 390).length"
    assert chromium.run(outside) == 0


def test_the_theme_button_colours_the_plots_anew(chromium: Page, report: Path) -> None:
    chromium.open(report)
    chromium.run(DRAW)
    colour = "built.all[0].figure.background_fill_color"
    light = chromium.run(colour)
    chromium.run("document.getElementById('theme').click()")
    assert chromium.run(colour) != light


def test_the_table_of_a_plot_has_its_points(chromium: Page, report: Path) -> None:
    chromium.open(report)
    chromium.run(DRAW)
    head, *rows = chromium.run("built.all[0].table()").splitlines()
    assert head == '"series","traction P [N]","normal force FN [N]","low","high"'
    assert len(rows) > 20
