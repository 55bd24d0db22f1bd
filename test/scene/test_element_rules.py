"""Rules for springs and dampers by table and for compliant stops."""

import re
from typing import Any

import pytest
from scenes import sleeve

from cylconn_ros.errors import SceneError

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
        ({"stops": {"l_min": 0.0, "stiffness": 1e7}, "method": "baumgarte"}, "at most 4e+06 N/m"),
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
