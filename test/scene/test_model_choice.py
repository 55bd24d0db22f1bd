"""The choice of `auto`, the model description, and lean models against full ones with zeros."""

from typing import Any

import numpy as np
import pytest
from scenes import about_y, merged, pair, sleeve

from cylconn_ros.connector.connector import Connector
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.simulate import simulate

FRICTION = {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1, "preload": 2.0}
GAINS = {"stiffness": 2e4, "damping": 60.0, "rotational_stiffness": 40.0, "rotational_damping": 0.1}
ZEROS = [0.0] * 4
METHODS = ["impulse", "baumgarte", "penalty", "augmented_lagrangian"]


def described(**parameters: Any) -> tuple[str, str]:
    connector = Connector(sleeve(**parameters))
    return connector.model, connector.not_modelled


def test_the_description_says_what_is_modelled_and_what_is_not() -> None:
    text, absent = described(friction=FRICTION)
    assert text.startswith("method impulse (auto): friction and reactions of a step solved")
    assert "body A fixed; body B free" in text
    assert "friction 0.2, radius 0.02 m, overlap 0.1 m, preload 2.0 N" in text
    for part in ("inertia of A (fixed)", "springs", "dampers", "stops", "lock", "imposed motion"):
        assert part in absent
    assert "bending" not in text


@pytest.mark.parametrize(
    ("parameters", "modelled", "absent"),
    [
        ({}, "", "friction (coefficient 0): the reactions follow from a linear solve"),
        ({"friction": {**FRICTION, "overlap": 0.0}}, "friction 0.2", "bending in the normal force"),
        ({"friction": {**FRICTION, "max_force": 9.0}}, "at most 9.0 N", "stops"),
        (
            {"friction": {**FRICTION, "coefficient_forward": 0.1}},
            "friction by direction, 0.1 forward and 0.2 backward",
            "stops",
        ),
        (
            {"friction": {**FRICTION, "contact_centre": "body_a", "inputs": ["bending", "radial"]}},
            "its middle carried by body_a, preload 2.0 N, pressed by bending and radial only",
            "stops",
        ),
        ({"friction": {"offset_force": 2.0}}, "offset force 2.0 N", "friction (coefficient 0)"),
        ({"stops": {"theta_max": 1.0}}, "stops", "lock"),
        ({"lock": {"component": "spin", "force": 1.0}}, "lock of spin", "stops"),
        ({"elasticity": {"k1": 1.0}}, "springs", "dampers"),
        ({"damping": {"cr1": 1.0}}, "dampers", "springs"),
        ({"command": {"slide": {"force": 1.0}}}, "imposed motion or force", "gravity"),
    ],
)
def test_every_part_is_named_in_the_right_line(
    parameters: dict[str, Any], modelled: str, absent: str
) -> None:
    present, missing = described(gravity=[0.0, 0.0, 0.0], **parameters)
    assert modelled in present
    assert absent in missing


def lean_and_full() -> dict[str, tuple[dict[str, Any], dict[str, Any]]]:
    """A lean model and the full one whose additional terms are zero or out of reach."""
    table = {"rates": [0.0, 1.0], "forces": [0.0, 10.0], "values": ZEROS}
    constant = {"rates": [0.0, 1.0], "forces": [0.0, 10.0], "values": [0.2] * 4}
    of_table = {"radius": 0.02, "overlap": 0.1, "preload": 2.0}
    return {
        "no friction": ({}, {"friction": {**of_table, "table": table}}),
        "no table": ({"friction": FRICTION}, {"friction": {**of_table, "table": constant}}),
        "no bending": (
            {"friction": {**FRICTION, "overlap": 0.0}},
            {"friction": {**FRICTION, "overlap": 1e200}},
        ),
        "no static friction": (
            {"friction": FRICTION},
            {"friction": {**FRICTION, "static_coefficient": 0.2, "decay": 3.0}},
        ),
        "no cap": ({"friction": FRICTION}, {"friction": {**FRICTION, "max_force": 1e200}}),
        "no springs": (
            {"friction": FRICTION},
            {"friction": FRICTION, "elasticity": {"k1": 1e-200, "kr1": 1e-200},
             "damping": {"c1": 1e-200, "cr1": 1e-200}},
        ),
        "no stops": (
            {"friction": FRICTION},
            {"friction": FRICTION, "stops": {"l_min": -1e6, "l_max": 1e6, "theta_min": -1e6,
                                             "theta_max": 1e6, "restitution": 0.5}},
        ),
        "no lock": (
            {"friction": FRICTION},
            {"friction": FRICTION, "lock": {"component": "slide", "position": -1e6, "force": 1e9}},
        ),
        "no imposed force": (
            {"friction": FRICTION},
            {"friction": FRICTION, "command": {"slide": {"force": 0.0}, "spin": {"force": 0.0}}},
        ),
    }  # fmt: skip


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("case", lean_and_full())
def test_a_lean_model_is_the_full_one_with_zeros(case: str, method: str) -> None:
    if method == "baumgarte" and case in ("no stops", "no lock"):
        with pytest.raises(ValueError, match="has no stops, locks or imposed motion"):
            sleeve(**merged(lean_and_full()[case][1], {"method": method}))
        return
    lean, full = (
        merged(parameters, {"method": method, "penalty": GAINS})
        for parameters in lean_and_full()[case]
    )
    slope: dict[str, Any] = {"shaft": about_y(0.1)}
    for make in (lambda p: sleeve(v=0.3, spin=20.0, **slope, **p), lambda p: pair(**p)):
        runs = [simulate(make(p), samples=300) for p in (lean, full)]
        np.testing.assert_allclose(runs[1].states, runs[0].states, rtol=1e-12, atol=1e-12)
        assert np.ptp(runs[0]["displacement"]) > 0.01


@pytest.mark.parametrize("method", METHODS)
def test_a_fixed_body_is_a_driven_one_at_rest(method: str) -> None:
    runs = [
        simulate(
            sleeve(
                v=0.3,
                spin=20.0,
                method=method,
                penalty=GAINS,
                friction=FRICTION,
                body_a={"kind": kind},
            ),
            samples=300,
        )
        for kind in ("fixed", "driven")
    ]
    np.testing.assert_allclose(runs[1].states, runs[0].states, rtol=0.0, atol=1e-12)


def test_a_far_heavier_body_is_a_fixed_one() -> None:
    """The limit of the full model, as near as 1e14 to 1 gets."""
    fixed = sleeve(v=0.3, spin=20.0, friction=FRICTION, gravity=[0.0, 0.0, 0.0])
    heavy = {"kind": "free", "mass": 1e14, "inertia": [1e14, 0.0, 0.0, 1e14, 0.0, 1e14]}
    free = Scene.from_parameters(merged(_nested(fixed), {"body_a": heavy}))
    ends = [simulate(scene, samples=300).states[-1, 13:] for scene in (fixed, free)]
    np.testing.assert_allclose(ends[1], ends[0], rtol=0.0, atol=1e-12)


def _nested(scene: Scene) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in scene.parameters().items():
        *path, last = name.split(".")
        at = found
        for part in path:
            at = at.setdefault(part, {})
        at[last] = value
    return found
