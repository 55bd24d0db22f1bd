"""The stored energy of the report, against quadrature and the balance of a motion."""

from typing import Any

import numpy as np
import pytest
from scenes import sleeve

import cylconn_ros as cr
from cylconn_ros.report.stored import FIELDS, stored_energy

TABLE = {"positions": [-0.02, 0.01, 0.03], "forces": [-4.0, 1.0, 9.0]}


def energy(scene: cr.Scene, run: Any) -> Any:
    stored = stored_energy(scene.parameters())
    assert stored is not None
    return stored({name: run[name] for name in FIELDS})


@pytest.mark.parametrize("beyond", ["constant", "linear"])
def test_a_table_stores_the_integral_of_its_force(beyond: str) -> None:
    table: dict[str, Any] = {**TABLE, "extrapolation": beyond}
    scene = sleeve(elasticity={"table": table})
    u = np.linspace(-0.05, 0.06, 110001)
    x, y = table["positions"], table["forces"]
    force = np.interp(u, x, y)
    if beyond == "linear":
        force = np.where(u < x[0], y[0] + (u - x[0]) * 5.0 / 0.03, force)
        force = np.where(u > x[2], y[2] + (u - x[2]) * 8.0 / 0.02, force)
    exact = np.concatenate(([0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(u))))
    exact -= np.interp(0.0, u, exact)
    zero = np.zeros_like(u)
    found = energy(scene, dict(zip(FIELDS, (u, zero, zero, zero), strict=True)))
    np.testing.assert_allclose(found, exact, atol=1e-9)


def test_springs_and_stops_exchange_energy_with_the_motion() -> None:
    """Kinetic plus stored energy is constant between the samples that touch the stop."""
    scene = sleeve(
        mass=2.0, v=-1.0, l0=0.2, period=1e-4, gravity=[0.0] * 3,
        elasticity={"k1": 50.0, "table": {**TABLE, "extrapolation": "linear"}},
        stops={"l_min": 0.15, "stiffness": 4000.0}, plant={"duration": 0.3},
    )  # fmt: skip
    run = cr.simulate(scene)
    assert run["stop"].max() == 1
    total = 0.5 * 2.0 * run["velocity"][:, 0] ** 2 + energy(scene, run)
    np.testing.assert_allclose(total, total[0], rtol=1e-5)


def test_there_is_none_without_springs() -> None:
    assert stored_energy(sleeve(stops={"l_min": 0.0}).parameters()) is None
    assert stored_energy({"period": "x"}) is None
