"""A connector of an Abaqus deck as a scene, in two systems of units."""

from pathlib import Path

import numpy as np
import pytest

from cylconn_ros.errors import ModelError
from cylconn_ros.importing import from_abaqus

DECK = """
*HEADING
** telescopic strut
*NODE
1, 0., 0., 0.
2, 200., 0., 0.
*ELEMENT, TYPE=CONN3D2, ELSET=STRUT
10, 1, 2
*ELEMENT, TYPE=MASS, ELSET=M2
20, 2
*ELEMENT, TYPE=ROTARYI, ELSET=R2
21, 2
*MASS, ELSET=M2
0.002
*ROTARY INERTIA, ELSET=R2
1., 2., 2., 0., 0., 0.
*ORIENTATION, NAME=ORI, SYSTEM=RECTANGULAR
1., 0., 0., 0., 1., 0.
*CONNECTOR SECTION, ELSET=STRUT, BEHAVIOR=SLIDER
CYLINDRICAL
ORI
*CONNECTOR BEHAVIOR, NAME=SLIDER
*CONNECTOR ELASTICITY, COMPONENT=1
5.
*CONNECTOR DAMPING, COMPONENT=1
0.02
*CONNECTOR FRICTION, PREDEFINED
10., 60., 5.
*FRICTION
0.2
*CONNECTOR STOP, COMPONENT=1
150., 300.
*CONNECTOR CONSTITUTIVE REFERENCE
190., , , 0.
*CONNECTOR PLASTICITY, COMPONENT=1
3.
*BOUNDARY
1, ENCASTRE
*STEP
*DYNAMIC
0.001, 1.
*DLOAD
, GRAV, 9810., 0., 0., -1.
*CONNECTOR LOAD
STRUT, 1, 12.
*END STEP
"""


def test_a_strut(tmp_path: Path) -> None:
    path = tmp_path / "strut.inp"
    path.write_text(DECK)
    draft = from_abaqus.draft_of(path, "strut", "mm-t-s")
    scene = draft.scene()
    assert scene is not None
    assert (scene.body_b.mass, scene.body_b.inertia[3]) == pytest.approx((2.0, 0.002))
    assert scene.body_a.kind == "fixed"
    friction = scene.friction
    assert (friction.radius, friction.overlap, friction.preload) == pytest.approx((0.01, 0.06, 5.0))
    assert friction.coefficient == 0.2
    assert (scene.elasticity.k1, scene.damping.c1) == pytest.approx((5000.0, 20.0))
    assert (scene.stops.l_min, scene.stops.l_max) == pytest.approx((0.15, 0.3))
    assert (scene.reference.length, scene.command.slide.force) == pytest.approx((0.19, 12.0))
    assert scene.gravity == pytest.approx((0.0, 0.0, -9.81))
    assert [what.split()[0] for what in draft.left_out] == ["*CONNECTOR", "*DYNAMIC"]


AMPLITUDES = """\
*AMPLITUDE, NAME=RAMP
0., 0., 0.1, 1.,
0.3, 0.5
*AMPLITUDE, NAME=SHAKER, DEFINITION=PERIODIC
1, 31.41592653589793, 0., 0.5
3., 4.
*AMPLITUDE, NAME=SMOOTHED, DEFINITION=SMOOTH STEP
0., 0., 1., 1.
"""


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("RAMP", {"times": (0.0, 0.1, 0.3), "values": (0.0, 1.0, 0.5)}),
        ("SHAKER", {"frequency": 5.0, "mean": 0.5, "amplitude": 5.0}),
    ],
)
def test_an_amplitude_of_a_load(name: str, expected: dict[str, object], tmp_path: Path) -> None:
    path = tmp_path / "strut.inp"
    load = f"*CONNECTOR LOAD, AMPLITUDE={name}"
    path.write_text(DECK.replace("*CONNECTOR LOAD", AMPLITUDES + load))
    draft = from_abaqus.draft_of(path, "strut", "mm-t-s")
    scene = draft.scene()
    assert scene is not None
    factor = scene.plant.slide_amplitude
    for key, value in expected.items():
        assert getattr(factor, key) == pytest.approx(value)
    # A cos w t + B sin w t
    t = 0.013
    if name == "SHAKER":
        angle = 2.0 * np.pi * 5.0 * t
        assert factor.at(t) == pytest.approx(0.5 + 3.0 * np.cos(angle) + 4.0 * np.sin(angle))
    assert scene.command.slide.force == pytest.approx(12.0)


def test_an_amplitude_of_another_kind_is_listed_with_its_load(tmp_path: Path) -> None:
    path = tmp_path / "strut.inp"
    load = "*CONNECTOR LOAD, AMPLITUDE=SMOOTHED"
    path.write_text(DECK.replace("*CONNECTOR LOAD", AMPLITUDES + load))
    draft = from_abaqus.draft_of(path, "strut", "mm-t-s")
    scene = draft.scene()
    assert scene is not None
    assert np.isnan(scene.command.slide.force)
    assert any(what.startswith("*CONNECTOR LOAD") for what in draft.left_out)


def test_tables_of_nonlinear_elasticity_and_damping(tmp_path: Path) -> None:
    """Force and position, or rate, in each line."""
    path = tmp_path / "strut.inp"
    nonlinear = DECK.replace(
        "COMPONENT=1\n5.\n", "COMPONENT=1, NONLINEAR\n-9., -3.\n0., 0.\n4., 2.\n"
    )
    nonlinear = nonlinear.replace(
        "COMPONENT=1\n0.02\n", "COMPONENT=1, NONLINEAR\n0., 0.\n5., 100.\n"
    )
    path.write_text(nonlinear)
    scene = from_abaqus.draft_of(path, "strut", "mm-t-s").scene()
    assert scene is not None
    assert scene.elasticity.table.positions == pytest.approx((-0.003, 0.0, 0.002))
    assert scene.elasticity.table.forces == pytest.approx((-9.0, 0.0, 4.0))
    assert scene.damping.table.rates == pytest.approx((0.0, 0.1))
    assert scene.damping.table.forces == pytest.approx((0.0, 5.0))
    assert scene.elasticity.k1 == 0.0
    assert scene.elasticity.table.extrapolation == "constant"


@pytest.mark.parametrize("of", ["CONNECTOR ELASTICITY", "CONNECTOR BEHAVIOR"])
def test_the_extrapolation_of_tables(tmp_path: Path, of: str) -> None:
    """Of the keyword, else of the behaviour; constant if neither says it."""
    path = tmp_path / "strut.inp"
    deck = DECK.replace("COMPONENT=1\n5.\n", "COMPONENT=1, NONLINEAR\n-9., -3.\n0., 0.\n4., 2.\n")
    path.write_text(deck.replace(f"*{of},", f"*{of}, EXTRAPOLATION=LINEAR,"))
    scene = from_abaqus.draft_of(path, "strut", "mm-t-s").scene()
    assert scene is not None
    assert scene.elasticity.table.extrapolation == "linear"


@pytest.mark.parametrize(
    ("change", "units", "said"),
    [
        (("", ""), None, "carries no units"),
        (("", ""), "mm-stone-s", "mm-stone-s"),
        (("CYLINDRICAL", "HINGE"), "mm-t-s", "must be CYLINDRICAL"),
        (("ELSET=STRUT, B", "ELSET=OTHER, B"), "mm-t-s", "the deck has OTHER"),
        (("*HEADING", "*INCLUDE, INPUT=x.inp"), "mm-t-s", "another file"),
        (("0.2\n", "much\n"), "mm-t-s", "not a number"),
        (("0., 1., 0.\n*CONN", "2., 0., 0.\n*CONN"), "mm-t-s", "on one line"),
    ],
)
def test_a_deck_that_cannot_be_used(
    tmp_path: Path, change: tuple[str, str], units: str | None, said: str
) -> None:
    path = tmp_path / "strut.inp"
    path.write_text(DECK.replace(*change) if change[0] else DECK)
    with pytest.raises(ModelError, match=said):
        from_abaqus.draft_of(path, "STRUT", units)


def test_a_body_without_mass_is_left_open(tmp_path: Path) -> None:
    path = tmp_path / "strut.inp"
    path.write_text(DECK.replace("*MASS, ELSET=M2\n0.002\n", ""))
    draft = from_abaqus.draft_of(path, "STRUT", "mm-t-s")
    assert draft.required == ["body_b.mass"]
    assert draft.scene() is None
