"""The report page in Chromium: plots, cursor, zoom, keys, light and dark theme."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Page, browser
from test_report import noise_data

from cylconn_ros.recording.run import Run, read_run
from cylconn_ros.report import page, payload


@pytest.fixture(scope="module")
def report(demo_report: Path) -> Path:
    return demo_report


@pytest.fixture(scope="module")
def run(demo_recording: Path) -> Run:
    return read_run(demo_recording)


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with browser(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


@pytest.fixture
def opened(chromium: Page, report: Path) -> Page:
    chromium.problems.clear()
    chromium.requests.clear()
    chromium.open(report)
    chromium.run("report.ready.then((built) => { globalThis.built = built; })")
    chromium.run(DRAW)
    return chromium


VALUES = "built.all.map((one) => [one.parts.root.dataset.key ?? 'events', ...one.values])"
# Plots are drawn when they come near the window; here all of them.
DRAW = """
Promise.all(built.all.filter((one) => one.panel).map(async (one) => {
  one.near = true;
  if (one.stale) one.draw();
  await one.ready;
}))
"""
PIXELS = """
const pixels = async (one) => {
  await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  const { canvas } = one.view.export("png", false);
  return canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
};
"""
# For every plot, the invisible curves: drawn alone in the same scale, they change no pixel.
MISSING = f"""
(async () => {{
  {PIXELS}
  const found = [];
  for (const one of built.all.filter((each) => each.panel)) {{
    one.zoomed = true;
    const picture = async (shown) => {{
      one.shown = one.panel.curves.map((_, j) => j === shown);
      one.draw();
      return (await pixels(one)).data;
    }};
    const empty = await picture(-1), missing = [];
    for (const [j, {{ label }}] of one.panel.curves.entries()) {{
      const alone = await picture(j);
      if (alone.reduce((n, part, k) => n + (part !== empty[k]), 0) < 200) missing.push(label);
    }}
    one.shown.fill(true);
    one.zoomed = false;
    one.draw();
    found.push([one.panel.key, missing]);
  }}
  return found;
}})()
"""
COLOURS = """
built.all.filter((one) => one.parts.base).map((one) => {
  const canvas = one.parts.base, context = canvas.getContext("2d");
  const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
  return new Set(new Uint32Array(data.buffer)).size;
})
"""
# All elements of a page, also in the shadow trees of the plots.
DEEP = """
(function all(root) {
  const inner = (e) => (e.shadowRoot ? all(e.shadowRoot) : []);
  return [...root.querySelectorAll("*")].flatMap((e) => [e, ...inner(e)]);
})
"""
# For every plot, the most frequent colours of two pixel columns.
BEHIND = f"""
(async () => {{
  {PIXELS}
  const found = [];
  for (const one of built.all.filter((each) => each.panel)) {{
    const {{ data, width }} = await pixels(one), {{ bbox }} = one.view.frame;
    const all = new Uint32Array(data.buffer);
    const most = (share) => {{
      const x = Math.round(bbox.left + share * bbox.width) + 3, count = new Map();
      for (let y = bbox.top + 2; y < bbox.bottom - 2; y++) {{
        const pixel = all[Math.round(y) * width + x];
        count.set(pixel, (count.get(pixel) ?? 0) + 1);
      }}
      return [...count].sort((a, b) => b[1] - a[1])[0][0];
    }};
    found.push([one.panel.key, most(0.3), most(0.97)]);
  }}
  return found;
}})()
"""


def place(opened: Page, key: str, share: float) -> tuple[float, float]:
    """Return a point in a plot, at a share of its width."""
    box = opened.run(
        f"(() => {{ const stage = document.querySelector('[data-key={key}] .stage');"
        " stage.scrollIntoView({ block: 'center' }); const b = stage.getBoundingClientRect();"
        " const area = [86, b.width - 106]; return [b.left, b.top, b.height, ...area]; })()"
    )
    return box[0] + box[3] + share * box[4], box[1] + 0.4 * box[2]


def test_the_page_opens_without_errors_and_without_the_network(opened: Page) -> None:
    assert opened.problems == []
    assert [url for url in opened.requests if not url.startswith(("file:", "data:"))] == []
    assert opened.run("document.getElementById('failure').hidden")


@pytest.mark.parametrize("dark", [False, True])
def test_every_plot_has_its_curves(chromium: Page, report: Path, dark: bool) -> None:
    chromium.open(report, dark=dark)
    chromium.run("report.ready.then((built) => { globalThis.built = built; })")
    chromium.run(DRAW)
    missing = dict(chromium.run(MISSING))
    shown = {"slide", "spin", "speed", "normal", "friction", "f1", "m1", "across", "bending"}
    assert {*shown, "violation", "rates", "energy", "residual"} <= set(missing)
    assert {key: labels for key, labels in missing.items() if labels} == {}
    assert min(chromium.run(COLOURS)) > 5  # neither the disc nor the 3-D view is blank
    page_colour = chromium.run("getComputedStyle(document.body).backgroundColor")
    red = int(re.findall(r"\d+", page_colour)[0])
    assert red < 60 if dark else red > 200


def test_the_background_distinguishes_stick_and_slip_in_every_plot(opened: Page) -> None:
    behind = opened.run(BEHIND)
    assert len(behind) > 10
    assert [key for key, slip, stick in behind if slip == stick or not slip or not stick] == []
    for at in (1, 2):  # the same tint in all plots without an area
        tints = [colours[at] for colours in behind]
        assert tints.count(max(tints, key=tints.count)) >= len(behind) - 2


def test_the_cursor_updates_all_readings(opened: Page, run: Run) -> None:
    seen = []
    for share in (0.1, 0.5):
        opened.mouse("mouseMoved", *place(opened, "normal", share))
        opened.wait_for_drawing()
        seen.append(opened.run(VALUES))
        k = opened.run("built.link.index")
        assert abs(k - share * 3999) < 12  # a pixel is 5 samples
        readings = {key: values for key, *values in seen[-1]}
        force = float(run.state["normal_force"][k])
        assert float(readings["normal"][-1]) == pytest.approx(force, rel=1e-4)
        slide = float(run.state["displacement"][k])
        assert float(readings["slide"][0]) == pytest.approx(slide, rel=1e-4)
        limit = float(run.state["friction_limit"][k])
        assert float(readings["disc"][0].split()[-1]) == pytest.approx(limit, rel=1e-4)
        assert f"l {run.state['length'][k]:.4f}" in readings["scene"][0]
    same = [a[0] for a, b in zip(*seen, strict=True) if a == b]
    assert same == ["events"]  # slip at both times


def test_dragging_zooms_all_plots_and_a_double_click_shows_all(opened: Page) -> None:
    (x0, y), (x1, _) = place(opened, "slide", 0.25), place(opened, "slide", 0.5)
    ranges = (
        "built.all.filter((one) => one.panel)"
        ".map((one) => [one.x.start, one.x.end, one.y.start, one.y.end])"
    )
    before = opened.run(ranges)
    opened.mouse("mouseMoved", x0, y)
    opened.mouse("mousePressed", x0, y, button="left", buttons=1, clickCount=1)
    opened.mouse("mouseMoved", x0 + 40, y + 20, button="left", buttons=1)
    opened.mouse("mouseMoved", x1, y + 40, button="left", buttons=1)
    opened.mouse("mouseReleased", x1, y + 40, button="left", clickCount=1)
    opened.wait_for_drawing()
    low, high = opened.run("built.link.view")
    assert (low, high) == (pytest.approx(1.0, abs=0.03), pytest.approx(2.0, abs=0.03))
    after = opened.run(ranges)
    assert all(each[:2] == [low, high] for each in after)
    (_, _, low_before, high_before), (_, _, low_after, high_after) = before[0], after[0]
    assert high_after - low_after < 0.5 * (high_before - low_before)  # the value axis, too
    opened.run("document.getElementById('whole').click()")
    opened.wait_for_drawing()
    assert opened.run("built.link.isWhole")
    assert opened.run(ranges) == before
    assert opened.problems == []


def test_the_legend_hides_and_shows_a_curve(opened: Page) -> None:
    click = "document.querySelector('[data-key=speed] .key').click()"
    visible = "built.all.find((one) => one.panel?.key === 'speed').glyphs.map((g) => g[0].visible)"
    assert opened.run(visible) == [True, True]
    opened.run(click)
    assert opened.run(visible) == [False, True]
    opened.run(click)
    assert opened.run(visible) == [True, True]


def test_hover_names_values_and_units_and_changes_no_curve(opened: Page, run: Run) -> None:
    pixels = (
        f"(async () => {{ {PIXELS} const one = built.all.find((o) => o.panel?.key === 'normal');"
    )
    pixels += " return [...new Set(new Uint32Array((await pixels(one)).data.buffer))].sort(); })()"
    before = opened.run(pixels)
    opened.mouse("mouseMoved", *place(opened, "normal", 0.4))
    opened.mouse("mouseMoved", *place(opened, "normal", 0.5))
    opened.wait_for_drawing()
    text = opened.run("document.querySelector('[data-key=normal] .tip').innerText")
    k = opened.run("built.link.index")
    assert text.startswith(f"t = {opened.run('built.link.t'):.4f} s")
    forces = {name: float(force) for name, force in re.findall(r"(\S+) ([\d.]+) N\b", text)}
    assert forces["Fr"] == pytest.approx(run.state["radial_force"][k], rel=1e-4)
    assert forces["FN"] == pytest.approx(run.state["normal_force"][k], rel=1e-4)
    assert opened.run(pixels) == before
    opened.mouse("mouseMoved", 5, 5)
    opened.wait_for_drawing()
    assert opened.run("document.querySelector('[data-key=normal] .tip').hidden")


def test_small_quantities_have_small_units(opened: Page) -> None:
    find = "((unit, size) => report.unitOf({ unit, curves: [{ drawn: { lo: [size], hi: [0] } }] }))"
    for unit, size, name, factor in (
        ("m", 2.0, "m", 1.0),
        ("m", 0.02, "mm", 1e3),
        ("m", 2e-6, "µm", 1e6),
        ("N m", -3e-9, "nN m", 1e9),
        ("turns", 1.0, "turns", 1.0),
        ("turns", 1e-3, "mrad", 2e3 * 3.141592653589793),
        ("µs", 1e-3, "µs", 1.0),
        ("m", 0.0, "m", 1.0),
    ):
        found = opened.run(f"{find}('{unit}', {size})")
        assert (found["unit"], found["factor"]) == (name, pytest.approx(factor))


def test_a_finger_scrolls_the_page_over_a_plot(chromium: Page, report: Path) -> None:
    chromium.send("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=1)
    try:
        chromium.open(report, width=400)
        chromium.run("report.ready.then((built) => { globalThis.built = built; })")
        chromium.run(DRAW)
        found = chromium.run(
            f"{DEEP}(document).filter((e) => e.classList.contains('bk-events'))"
            ".map((e) => getComputedStyle(e).touchAction)"
        )
        assert len(found) > 10
        assert set(found) == {"auto"}
        assert chromium.run("document.documentElement.scrollWidth") == 400
    finally:
        chromium.send("Emulation.setTouchEmulationEnabled", enabled=False)


def test_the_table_of_a_plot_has_every_sample(opened: Page, run: Run) -> None:
    head, *rows = opened.run(
        "built.all.find((one) => one.panel?.key === 'slide').table()"
    ).splitlines()
    assert head == "time [s],u₁ [m]"
    assert len(rows) == len(run.state["displacement"])
    assert float(rows[-1].split(",")[1]) == pytest.approx(run.state["displacement"][-1], rel=1e-6)


def test_the_events_are_listed_and_can_be_jumped_to(opened: Page) -> None:
    opened.run("built.link.setCursor(0.0)")
    opened.run("document.getElementById('later').click()")
    assert opened.run("built.link.t") == pytest.approx(3.54, abs=0.01)  # comes to rest
    names = opened.run("[...document.getElementById('event').options].map((o) => o.textContent)")
    assert any(name.endswith("stick") for name in names)
    assert any(name.endswith("stopped") for name in names)


def test_the_library_is_at_most_three_megabytes() -> None:
    text = page.library()
    assert len(text.encode()) <= 3e6
    assert "</script" not in text


def test_keys_step_and_play(opened: Page) -> None:
    opened.run("built.link.setCursor(1.0)")

    def press(key: str) -> None:
        event = f"new KeyboardEvent('keydown', {{ key: '{key}', bubbles: true }})"
        opened.run(f"document.body.dispatchEvent({event})")

    press("ArrowRight")
    assert opened.run("built.link.index") == 1001
    press(" ")
    opened.run("new Promise((done) => setTimeout(done, 300))")
    press(" ")
    assert opened.run("built.link.t") > 1.001
    assert opened.run("built.link.playing === null")


def test_the_button_changes_light_and_dark(opened: Page) -> None:
    colour = "getComputedStyle(document.body).backgroundColor"
    light = opened.run(colour)
    opened.run("document.getElementById('theme').click()")
    assert opened.run(colour) != light
    assert opened.problems == []


def test_a_long_run_notes_its_decimation(chromium: Page, tmp_path: Path) -> None:
    head, numbers = payload.build_payload(noise_data(100_000))
    path = tmp_path / "long.html"
    path.write_text(page.render("long", [], [], [], "", head, numbers))
    chromium.problems.clear()
    chromium.open(path)
    chromium.run("report.ready.then((built) => { globalThis.built = built; })")
    chromium.run(DRAW)
    assert chromium.problems == []
    notes = chromium.run("document.getElementById('notes').textContent")
    assert "100,000 samples are shown in 8,000 buckets of up to 13" in notes
    assert "every extreme is kept" in notes
    chromium.run("built.link.setCursor(73.18)")
    chromium.wait_for_drawing()
    readings = {key: first for key, first, *_ in chromium.run(VALUES)}
    assert "… 1000.0" in readings["slide"]
    assert dict(chromium.run(MISSING))["slide"] == []


def test_zeros_of_a_logarithmic_plot_lie_at_its_lower_edge(chromium: Page, tmp_path: Path) -> None:
    found = noise_data(500)
    (states,) = found.read_states(None)  # views of the arrays, one block
    states.fields["residual"][:] = 0.0
    states.fields["residual"][250] = 2e-16
    head, numbers = payload.build_payload(found)
    path = tmp_path / "zeros.html"
    path.write_text(page.render("zeros", [], [], [], "", head, numbers))
    chromium.open(path)
    chromium.run("report.ready.then((built) => { globalThis.built = built; })")
    chromium.run(DRAW)
    one = "built.all.find((one) => one.panel?.key === 'residual')"
    low, high, *values = chromium.run(
        f"(() => {{ const one = {one}; return [one.y.start, one.y.end,"
        " ...new Set(one.sources[0].data.y)]; })()"
    )
    assert (low, high) == (pytest.approx(1e-18), pytest.approx(1e-15))
    assert sorted(values) == [low, pytest.approx(2e-16)]


def test_a_damaged_page_shows_an_error(chromium: Page, report: Path, tmp_path: Path) -> None:
    text = report.read_text()
    path = tmp_path / "damaged.html"
    at = text.index('id="numbers">') + 500
    path.write_text(text[:at] + "AAAA" * 200 + text[at + 800 :])
    chromium.events.clear()
    chromium.send("Page.navigate", url=path.as_uri())
    chromium.run(
        "new Promise((done) => setTimeout(done, 200)).then(() => report.ready).catch(() => 0)"
    )
    assert "could not be drawn" in chromium.run("document.getElementById('failure').textContent")
    assert not chromium.run("document.getElementById('failure').hidden")


def test_a_missing_browser_fails_with_the_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("CYLCONN_BROWSER", "no-such-browser")
    with pytest.raises(AssertionError, match="sudo apt install chromium"):
        __import__("browser").find_browser()
