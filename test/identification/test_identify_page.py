"""``cylconn identify --report``: whether to believe the values, for every kind of recording."""

from __future__ import annotations

import html
import json
import re
from pathlib import Path

import numpy as np
import pytest
from paths import BAGS
from test_identify import evenly, measured, pushed
from test_recordings_together import write_axis

from cylconn_ros.bench.identification import axis, joints, sensors
from cylconn_ros.cli.identify_page import friction_findings
from cylconn_ros.cli.main import main
from cylconn_ros.identification.friction import Identification, estimate_friction
from cylconn_ros.identification.likelihood.patterns import group_tests

RESIDUALS = {"over_rate", "over_slide", "over_direction", "over_load", "over_place", "over_time"}


def words(path: Path) -> str:
    """Return the text of a page without its scripts and marks."""
    text = re.sub(r"<(script|style).*?</\1>", " ", path.read_text(encoding="utf-8"), flags=re.S)
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]*>", " ", text)))


def plots(path: Path) -> dict[str, dict]:
    """Return the plots of a page by their keys."""
    found = re.search(r'id="head">(.*?)</script>', path.read_text(encoding="utf-8"), re.S)
    assert found
    return {plot["key"]: plot for plot in json.loads(found[1])["plots"]}


def rejected() -> Identification:
    """Identify a friction that depends on the place in the slot."""
    rows = joints.motion("Coulomb")
    drive = np.zeros((len(rows), 2))
    drive[:, 0] = 3.0 * np.sin(1.5 * rows[:, 13])
    return estimate_friction(joints.scene(), sensors.measured(rows, "white", 1), drive=drive)


def test_a_model_that_holds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two recordings together, from the node."""
    page, numbers = tmp_path / "a.html", tmp_path / "a.json"
    options = ["--with", str(BAGS / "lossy"), "--report", str(page), "--json", str(numbers)]
    assert main(["identify", str(BAGS / "lossy"), *options]) == 0
    printed = capsys.readouterr().out
    assert f"report      {page}" in printed
    assert f"next: open {page} in a browser; put the values into friction.*" in printed
    text, found = words(page), json.loads(numbers.read_text())
    assert "Use these values" in text
    assert "no pattern remains over rate, direction, load, place and time" in text
    for name in ("coefficient", "preload", "overlap", "radius"):
        low, high = found["estimates"][f"friction.{name}"]["interval_95"]
        assert f"{low:.5g} … {high:.5g}" in text
    for term, reason in found["left_out_terms"].items():
        assert f"{term} left out {reason}" in text
    assert "Do not use" not in text
    drawn = plots(page)
    assert {"traction", "disc", "steps_coefficient", "over_rate", "over_time"} <= set(drawn)
    assert not any(plot["bad"] for plot in drawn.values())
    assert "recording lossy, lossy" in text


def test_a_rejected_model_shows_its_pattern_and_no_value() -> None:
    found = rejected()
    page = friction_findings(found, ["repeat"])
    assert (page.verdict, page.state) == ("Do not use: there are no values", "bad")
    assert any("in a way that no term of the model has" in line for line in page.reasons)
    assert any(line.startswith("Residual along the slip over") for line in page.reasons)
    sections = {section.key: section for section in page.sections}
    table = sections["estimates"].table
    assert table is not None
    assert {row[1] for row in table.rows} == {"–"}
    assert ("withheld", "see the verdict") in {(row[3], row[4]) for row in table.rows}
    marked = {plot.key: plot.note for plot in sections["residuals"].plots if plot.bad}
    patterns = {one.over: one for one in found.patterns if one.rejected}
    assert len(marked) == len(patterns) >= 1
    assert all("Residual" in note for note in marked.values())
    assert set(marked) < RESIDUALS | {"over_angle"}


def test_residuals_are_those_of_the_patterns() -> None:
    found = rejected()
    (pattern,) = [p for p in found.patterns if p.over == "time [s]" and p.component == "along"]
    residuals, time = found.residuals.along, found.residuals.over["time [s]"]
    assert len(residuals) == len(time) == found.windows
    parts = np.array_split(np.argsort(time, kind="stable"), len(pattern.means))
    for part, mean in zip(parts, pattern.means, strict=True):
        assert residuals[part].min() <= mean <= residuals[part].max()


def test_bars_of_group_means_are_their_standard_errors() -> None:
    rng = np.random.default_rng(1)
    x, r = rng.uniform(size=400), rng.standard_normal(400)
    ones = np.ones((400, 1))
    (plain,) = group_tests({"along": r}, r[:, None], ones, {"x": x}, 1.0, 4)
    (tilted,) = group_tests({"along": r + 2.0 * x}, (r + 2.0 * x)[:, None], ones, {"x": x}, 1.0, 4)
    assert plain.errors == pytest.approx(np.full(8, 1.0 / np.sqrt(50.0)), rel=0.3)
    assert (np.abs(plain.means) < 3.5 * plain.errors).all()
    assert not plain.rejected
    assert tilted.rejected
    assert (np.diff(tilted.middles) > 0.0).all()


def test_intervals_before_and_after_a_term() -> None:
    """Without the viscous term mu is far off; with it the interval contains the truth."""
    rows = joints.motion("viscous")
    found = estimate_friction(joints.scene(), sensors.measured(rows, "white", 1))
    page = friction_findings(found, [])
    steps = next(section for section in page.sections if section.key == "steps")
    (mu,) = [plot for plot in steps.plots if plot.key == "steps_coefficient"]
    assert mu.names[-1] == "Coulomb"
    assert "+ c1" in mu.names
    assert mu.names[0] == "reported"
    before, after = mu.series
    assert before.low is not None
    assert before.high is not None
    assert not before.low[0] < 0.2 < before.high[0]
    assert after.x[0] == found["coefficient"].value


def test_break_aways_and_what_is_not_known() -> None:
    scene, motion = pushed(0.3)
    found = estimate_friction(scene, evenly(measured(motion, 1)), {"overlap": 0.1})
    sections = {section.key: section for section in friction_findings(found, []).sections}
    table = sections["estimates"].table
    assert table is not None
    rows = {row[0].partition(":")[0]: row for row in table.rows}
    assert rows["L"][1:] == ["(0.1 m)", "–", "assumed", "assumed, as given"]
    assert "break-away" in rows["µ static"][4]
    traction = sections["law"].plots[0]
    assert {"diamonds", "rings", "band"} <= {one.kind for one in traction.series}


def test_an_axis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_axis(tmp_path / "bag", axis.simulate(seed=5))
    page = tmp_path / "axis.html"
    options = ["--axis", "/joint_states:carriage", "--report", str(page)]
    assert main(["identify", str(tmp_path / "bag"), *options]) == 0
    assert f"report      {page}" in capsys.readouterr().out
    text = words(page)
    assert "Use these values" in text
    assert "µ, FCint, L and R are not told apart" in text
    assert "a constant force that was not recorded" in text.lower()
    assert "95.11" in text
    assert {"friction", "over_rate", "over_place", "over_time", "steps_mass"} == {
        key for key in plots(page) if not key.startswith("steps") or key == "steps_mass"
    }


def test_a_recording_that_determines_nothing_has_a_page(tmp_path: Path) -> None:
    bag, page = tmp_path / "rest", tmp_path / "rest.html"
    simulate = ["simulate", "demo", "--duration", "0.01", "-o", str(bag)]
    assert main(simulate) == 0
    assert main(["identify", str(bag), "--report", str(page)]) == 1
    text = words(page)
    assert "No values: this recording does not determine what was asked" in text
    assert "Too little slip" in text


def test_a_wrong_name_is_refused_before_the_work(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", str(BAGS / "lossy"), "--report", "friction.pdf"]) == 2
    assert "friction.pdf: the page must end in .html" in capsys.readouterr().err
