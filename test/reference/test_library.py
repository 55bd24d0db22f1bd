"""Bundled scenes against their reference values, and the page that lists them."""

from pathlib import Path

import numpy as np
import pytest
from paths import ROOT
from scenes import CONFIG, bundled, with_period

from cylconn_ros.cli import main, scenes
from cylconn_ros.core import layout
from cylconn_ros.reference import library
from cylconn_ros.reference.group_answers import GROUPS
from cylconn_ros.scene.scene import Scene, load_all
from cylconn_ros.simulation.group import simulate_group
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.simulate import simulate

SLOW_REFERENCES = ("demo", "hub_and_rotor", "journal_pendulum")


def compared(name: str, scene: Scene) -> dict[str, library.Comparison]:
    run = simulate(scene)
    assert np.all(run.outs[:, layout.STATUS] == layout.OK)
    return {each.name: each for each in library.compare(name, run)}


def test_every_scene_has_reference_values() -> None:
    files = {path.stem for path in CONFIG.glob("*.yaml")}
    assert files == {*library.LIBRARY, *GROUPS, "connector"}


@pytest.mark.parametrize("name", GROUPS)
@pytest.mark.parametrize("period", [4e-3, 1e-3, 5e-4])
def test_a_scene_of_several_connectors_reaches_its_reference_values(
    name: str, period: float
) -> None:
    loaded = load_all(CONFIG / f"{name}.yaml")
    scenes_of = {each: with_period(scene, period) for each, scene in loaded.items()}
    together = list(scenes_of.values())
    run = simulate_group(together, scenes.steps(together[0]) + 1)
    assert np.all(run.outs[:, :, layout.STATUS] == layout.OK)
    assert not np.any(run.outs[:, :, layout.FLAGS].astype(int) & layout.NOT_CONVERGED)
    found = library.compare_group(name, scenes_of, run)
    assert {each.name: each.error for each in found if not each.ok} == {}


@pytest.mark.parametrize("name", library.LIBRARY)
def test_a_scene_reaches_its_reference_values(name: str) -> None:
    found = compared(name, bundled(name))
    assert found
    assert {each.name: each.error for each in found.values() if not each.ok} == {}


@pytest.mark.parametrize("name", [name for name in library.LIBRARY if name not in SLOW_REFERENCES])
@pytest.mark.parametrize("period", [4e-3, 5e-4])
def test_errors_scale_with_the_period_by_the_order(name: str, period: float) -> None:
    found = compared(name, with_period(bundled(name), period))
    assert {each.name: each.error for each in found.values() if not each.ok} == {}


@pytest.mark.parametrize("name", library.LIBRARY)
def test_the_plant_starts_on_the_constraint(name: str) -> None:
    """The first sample satisfies the constraint in position and velocity."""
    scene = bundled(name)
    start = simulate(scene, samples=1)
    assert np.isfinite(Plant(scene).state).all()
    assert start["velocity_violation"][0] < 1e-12
    assert start["spin_violation"][0] < 1e-12


def test_a_wrong_friction_law_misses_the_reference_values() -> None:
    """The tolerances detect a factor of two in bending, or a coefficient off by a thousandth."""
    drawer = bundled("drawer_slide").parameters()
    wrong = Scene.from_parameters({**drawer, "friction.overlap": 0.1})
    run = simulate(wrong)
    right = library.expected("drawer_slide", bundled("drawer_slide"), run.time[-1])
    assert abs(right[0].of(run) - right[0].value) > 1e3 * right[0].allowed(1e-3)
    coast = bundled("coast").parameters()
    wrong = Scene.from_parameters({**coast, "friction.coefficient": 0.2002})
    run = simulate(wrong)
    for each in library.expected("coast", bundled("coast"), run.time[-1]):
        assert abs(each.of(run) - each.value) > each.allowed(1e-3)


def test_simulate_prints_the_comparison(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["simulate", "three_answers"]) == 0
    text = capsys.readouterr().out
    assert "reference   closed form: |f1|" in text
    assert "first friction force  3.500000 N  (reference 3.500000, error" in text
    assert main.main(["simulate", "coast", "--duration", "0.1"]) == 0
    assert "reference" not in capsys.readouterr().out
    assert main.main(["simulate", "telescope_of_two_stages"]) == 0
    assert "✓ ring's slide" in capsys.readouterr().out


def test_simulate_fails_if_a_reference_value_is_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "coast.yaml"
    text = (CONFIG / "coast.yaml").read_text()
    other.write_text(text)
    monkeypatch.setattr(scenes, "bundled", lambda: {"coast": other})
    monkeypatch.setitem(library.LIBRARY, "coast", library.LIBRARY["press_fit"])
    assert main.main(["simulate", "coast"]) == 0  # the same formula
    monkeypatch.setitem(library.LIBRARY, "coast", library.LIBRARY["binding_above"])
    assert main.main(["simulate", "coast"]) == 1
    assert "✗ creep" in capsys.readouterr().out
    other.write_text(text.replace("period: 0.001", "period: 0.001\n    method: baumgarte"))
    assert main.main(["simulate", "coast"]) == 0, "a method of lower order has no limit"
    assert "  creep" in capsys.readouterr().out


def test_the_page_of_scenes_is_up_to_date() -> None:
    """Line by line; values of slow reference solutions are not computed again."""
    page = (ROOT / "docs/reference/scenes.md").read_text()
    fast = [name for name in library.LIBRARY if name not in SLOW_REFERENCES]
    for name in library.LIBRARY:
        assert f"| `{name}` |" in page
    for line in library.lines({name: bundled(name) for name in fast}):
        assert line in page
    for line in library.group_lines({name: load_all(CONFIG / f"{name}.yaml") for name in GROUPS}):
        assert line in page
    assert page.startswith(library.HEAD)
