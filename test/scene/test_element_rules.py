"""Rules for springs and dampers by table and for compliant stops."""

import re
from typing import Any

import numpy as np
import pytest
from scenes import sleeve

import cylconn_ros as cr
from cylconn_ros.errors import SceneError
from cylconn_ros.scene.shared_bodies import check

SPRING = {"positions": [0.0, 0.1], "forces": [0.0, 5.0]}
DAMPER = {"rates": [-1.0, 0.0, 1.0], "forces": [-3.0, 0.0, 1.0]}


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"elasticity": {"table": {**SPRING, "positions": [0.1, 0.1]}}},
         "elasticity.table.positions = [0.1, 0.1]: must be ascending"),
        ({"elasticity": {"table": {**SPRING, "forces": [1.0]}}},
         "elasticity.table.forces = [1.0]: must be as many numbers as elasticity.table.positions "
         "(1 and 2 given)"),
        ({"elasticity": {"table": {"positions": [0.1], "forces": [1.0]}}},
         "elasticity.table.positions = [0.1]: must be 2 to 16 numbers (1 given)"),
        ({"elasticity": {"rotational_table": {
            "angles": [float(k) for k in range(17)], "moments": [0.0] * 17}}},
         "must be 2 to 16 numbers (17 given)"),
        ({"elasticity": {"table": {**SPRING, "forces": [0.0, float("nan")]}}},
         "elasticity.table.forces = [0.0, .nan]: must be numbers, finite"),
        ({"damping": {"table": {**DAMPER, "forces": [3.0, 0.0, 1.0]}}},
         "damping.table.forces = [3.0, 0.0, 1.0]: must have the sign of the rate"),
        ({"damping": {"table": {**DAMPER, "forces": [-3.0, 0.5, 1.0]}}},
         "must be 0 at rate 0 (0.5 there)"),
        ({"damping": {"table": {"rates": [0.5, 1.0], "forces": [1.0, 2.0]}}},
         "must be 0 at rate 0 (1 there)"),
        ({"damping": {"table": {"rates": [0.0, 1.0, 2.0], "forces": [0.0, 2.0, 1.0],
                                "extrapolation": "linear"}}},
         "must not fall towards an end with damping.table.extrapolation linear"),
        ({"stops": {"l_min": 0.0, "damping": 3.0}},
         "stops.damping = 3.0: needs stops.stiffness"),
        ({"stops": {"l_min": 0.0, "rotational_stiffness": 3.0}},
         "stops.rotational_stiffness = 3.0: needs stops.theta_min or stops.theta_max"),
        ({"stops": {"l_min": 0.0, "stiffness": 1e3, "restitution": 0.5}},
         "stops.restitution = 0.5: is that of rigid stops"),
        ({"stops": {"l_min": 0.0, "stiffness": 2.1e7}},
         "stops.stiffness: a stiffness of 2.1e+07 N/m is more than the period carries: must be at "
         "most 2e+07 N/m"),
        ({"stops": {"l_min": 0.0, "stiffness": 1e7}, "method": "baumgarte"},
         "stops.stiffness: a stiffness of 1e+07 N/m is more than the period carries: must be at "
         "most 4e+06 N/m with the method baumgarte"),
        ({"damping": {"table": {**DAMPER, "forces": [-1e5, 0.0, 0.0]}}},
         "damping.table.forces: a damping of 100000 N.s/m is more than the period carries: must be "
         "at most 40000 N.s/m"),
        ({"stops": {"l_min": 0.0}, "method": "baumgarte"}, "has no stops"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(values: dict[str, Any], text: str) -> None:
    with pytest.raises(SceneError, match=re.escape(text)):
        sleeve(mass=2.0, **values)


def test_what_can_be_is_accepted() -> None:
    """Compliant stops in a method without rigid ones, and tables that start at rest."""
    sleeve(stops={"l_min": 0.0, "stiffness": 1e3, "damping": 2.0}, method="baumgarte")
    sleeve(damping={"table": {"rates": [0.0, 1.0], "forces": [0.0, 2.0]}})
    scene = sleeve(elasticity={"table": SPRING}, damping={"table": DAMPER})
    assert scene.elasticity.table.forces == (0.0, 5.0)
    scene = sleeve(stops={"l_max": 0.3, "stiffness": 1e3}, command={"slide": {"position": 0.31}})
    assert scene.stops.compliant == (True, False)


@pytest.mark.parametrize("name", ["k1", "kr1"])
def test_a_linear_spring_has_a_greatest_stiffness_on_a_semi_implicit_plant(name: str) -> None:
    """4 m/h^2: beyond it the motion grows by orders of magnitude."""
    given: dict[str, Any] = {"period": 1e-3, "plant_integration": "semi_implicit"}
    text = f"elasticity.{name}: a stiffness of .* must be at most .* semi_implicit"
    with pytest.raises(SceneError, match=text):
        sleeve(elasticity={name: 8.1e6}, **given)
    sleeve(elasticity={"k1": 7.9e6}, **given)
    sleeve(elasticity={name: 8.1e6}, period=1e-3)


@pytest.mark.parametrize("method", ["baumgarte", "penalty", "augmented_lagrangian"])
def test_springs_and_dampers_of_the_sample_have_a_greatest_sum(method: str) -> None:
    """K h^2/m + 2 c h/m <= 2 over linear ones, tables and compliant stops of a component."""
    gains = {"stiffness": 1e5, "damping": 200.0, "rotational_stiffness": 5e2,
             "rotational_damping": 1.0}  # fmt: skip
    given: dict[str, Any] = {"period": 1e-3, "method": method, "mass": 2.0}
    if method != "baumgarte":
        given["penalty"] = gains
    sleeve(elasticity={"k1": 4e6}, **given)
    with pytest.raises(SceneError, match=r"elasticity.k1: .* at most 4e\+06 N/m with the method"):
        sleeve(elasticity={"k1": 4.1e6}, **given)
    with pytest.raises(SceneError, match=r"damping.c1: .* at most 2000 N.s/m with the method"):
        sleeve(damping={"c1": 2100.0}, **given)
    with pytest.raises(SceneError, match=r"elasticity.kr1: .* N.m/rad with the method"):
        sleeve(elasticity={"kr1": 1e6}, **given)
    with pytest.raises(SceneError, match=r"elasticity.k1: .* at most 2e\+06 N/m beside the other"):
        sleeve(elasticity={"k1": 3e6}, damping={"c1": 1000.0}, **given)
    table = {"positions": [-1.0, 0.0, 1.0], "forces": [-1.0, 0.0, 3e6]}
    with pytest.raises(SceneError, match=r"elasticity.table.forces: .* at most 2e\+06 N/m beside"):
        sleeve(elasticity={"k1": 2e6, "table": table}, **given)


@pytest.mark.parametrize("method", ["baumgarte", "penalty", "augmented_lagrangian"])
@pytest.mark.parametrize("integration", ["exact", "semi_implicit"])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_what_is_accepted_from_the_sample_is_stable(
    method: str, integration: str, share: float
) -> None:
    """At the limit, shared between spring and damper, with the mass centre off the axis."""
    h, mass = 1e-3, 2.0
    values: dict[str, Any] = {}
    if method != "baumgarte":
        values["penalty"] = {"stiffness": 1e5, "damping": 200.0, "rotational_stiffness": 5e2,
                             "rotational_damping": 1.0}  # fmt: skip
    scene = sleeve(
        mass=mass, v=0.1, period=h, method=method, plant_integration=integration,
        com=(0.0, 0.03, 0.0), gravity=[0.0] * 3, plant={"duration": 0.5},
        elasticity={"k1": 2.0 * share * mass / h**2}, damping={"c1": (1.0 - share) * mass / h},
        **values,
    )  # fmt: skip
    assert np.abs(cr.simulate(scene)["velocity"][:, 0]).max() < 0.3


@pytest.mark.parametrize(("ratio", "refused"), [(1.9, False), (2.1, True)])
def test_springs_of_several_connectors_on_a_body_add_up(ratio: float, refused: bool) -> None:
    """Two rails with a spring each: 4 m/h^2 for both on a semi-implicit plant."""
    h, mass = 1e-3, 2.0
    rails = {
        name: sleeve(
            mass=mass, period=h, plant_integration="semi_implicit",
            body_a={"kind": "fixed", "frame": "wall"}, body_b={"frame": "drawer"},
            elasticity={"k1": ratio * mass / h**2},
        )
        for name in ("left", "right")
    }  # fmt: skip
    if refused:
        with pytest.raises(
            SceneError, match=r"left.elasticity.k1 = .* must be at most 0.95.* of th"
        ):
            check(rails)
    else:
        check(rails)
