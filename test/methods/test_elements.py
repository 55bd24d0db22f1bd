"""Springs and dampers by table, and compliant stops: order, energy, stability, rest, every method.

The references are closed forms, and an integration from kink to kink that shares no code with the
connector (reference/nonlinear_slide.py).
"""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scenes import sleeve

import cylconn_ros as cr
from cylconn_ros.core import layout
from cylconn_ros.reference.nonlinear_slide import slide
from cylconn_ros.simulation.group import simulate_group
from cylconn_ros.simulation.minimal import solve

MASS, PUSH = 2.0, -4.0  # kg, N
STOP = {"l_min": 0.1, "stiffness": 2000.0}
DAMPED = {**STOP, "damping": 30.0, "damping_depth": 0.02}
TABLES: dict[str, Any] = {
    "elasticity": {
        "table": {
            "positions": [-0.08, -0.03, 0.02, 0.05],
            "forces": [-80.0, -10.0, 0.0, 60.0],
            "extrapolation": "linear",
        }
    },
    "damping": {
        "table": {
            "rates": [-0.5, 0.0, 0.3],
            "forces": [-2.0, 0.0, 3.0],
            "extrapolation": "linear",
        }
    },
}
CASES: dict[str, dict[str, Any]] = {
    "stop": {"stops": STOP}, "damped stop": {"stops": DAMPED}, "tables": TABLES,
}  # fmt: skip
GAINS = {"stiffness": 2e4, "damping": 40.0, "rotational_stiffness": 1e2, "rotational_damping": 0.2}
END = 0.4


def moving(v: float = -1.0, **values: Any) -> cr.Scene:
    """A sleeve at 0.2 m that moves against the slot's direction, pushed by 4 N that way."""
    defaults: dict[str, Any] = {"gravity": [PUSH / MASS, 0.0, 0.0], "plant": {"duration": END}}
    return sleeve(mass=MASS, v=v, l0=0.2, **{**defaults, **values})


def errors(case: dict[str, Any], periods: list[float], **values: Any) -> np.ndarray[Any, Any]:
    """Errors of position and velocity at the end, one row a period."""
    found = []
    for h in periods:
        scene = moving(period=h, **{**case, **values})
        run = cr.simulate(scene)
        exact = slide(scene, 0.2, -1.0, PUSH, 0.0, float(run.time[-1]))
        found.append((run["length"][-1] - exact.position, run["velocity"][-1][0] - exact.velocity))
    return np.abs(found)


@pytest.mark.parametrize("name", CASES)
def test_impulse_is_second_order_across_kinks(name: str) -> None:
    """Five periods. A knot that falls within a step changes its error: the order is the fitted one.

    Without damping of a stop, and for tables, each halving divides the error by four.
    """
    periods = [8e-3 / 2**k for k in range(5)]
    found = errors(CASES[name], periods, method="impulse")
    for error in found.T:
        assert np.polyfit(np.log(periods), np.log(error), 1)[0] > 1.9
        if name != "damped stop":
            assert np.all(np.log2(error[:-1] / error[1:]) > 1.85)


@pytest.mark.parametrize("name", CASES)
def test_minimal_agrees_with_the_integration_from_kink_to_kink(name: str) -> None:
    scene = moving(method="minimal", **CASES[name])
    exact = slide(scene, 0.2, -1.0, PUSH, 0.0, END)
    found = solve(scene, END)
    assert abs(found.length[-1] - exact.position) < 1e-8
    assert abs(found.velocity[-1] - exact.velocity) < 1e-7


@pytest.mark.parametrize("integration", ["exact", "semi_implicit"])
@pytest.mark.parametrize("multiple", [0.01, 0.3, 1.0, 4.0, 10.0])
def test_a_stop_returns_the_speed_at_any_stiffness(multiple: float, integration: str) -> None:
    """A stop without damping of up to 10 m/h^2: no energy is gained or lost, wherever it is met."""
    h = 1e-3
    for shift in np.linspace(0.0, 1.0, 7):
        stops = {"l_min": 0.15 + shift * h, "stiffness": multiple * MASS / h**2}
        scene = moving(
            period=h, gravity=[0.0] * 3, stops=stops, plant_integration=integration,
            plant={"duration": 0.06 + 4.0 * h / math.sqrt(multiple)},
        )  # fmt: skip
        run = cr.simulate(scene)
        assert abs(run["velocity"][-1][0] - 1.0) < 1e-9
        if integration == "exact":
            assert abs(run["passivity_balance"][-1]) < 1e-9


def test_contact_takes_half_an_oscillation_and_its_force_starts_at_zero() -> None:
    """It takes pi sqrt(m/k) without damping; with damping, the force never pulls."""
    scene = moving(period=1e-4, gravity=[0.0] * 3, stops=STOP)
    run = cr.simulate(scene)
    touching = run["stop"] == 1
    assert abs(1e-4 * touching.sum() - math.pi * math.sqrt(MASS / 2000.0)) < 2e-4
    force = cr.simulate(moving(period=1e-4, stops=DAMPED))["force_reaction"]
    assert force.min() == 0.0
    first = force[force > 0.0][0]
    assert first < 2000.0 * 1e-4 + 30.0 * 1e-4 / 0.02  # of one step into the stop
    assert force.max() > 50.0


def test_a_body_rests_on_a_compliant_stop() -> None:
    """Under its load it settles at load/stiffness; with friction it sticks there."""
    stops = {"l_min": 0.19, "stiffness": 1000.0, "damping": 60.0, "damping_depth": 1e-4}
    run = cr.simulate(moving(v=0.0, stops=stops, plant={"duration": 2.0}))
    assert abs(run["length"][-1] - (0.19 + PUSH / 1000.0)) < 1e-9
    assert abs(run["force_reaction"][-1] + PUSH) < 1e-6
    assert run["stop"][-1] == 1
    rough = {"coefficient": 0.2, "radius": 0.02, "preload": 5.0}
    run = cr.simulate(moving(v=0.0, spin=0.3, stops=stops, friction=rough, plant={"duration": 2.0}))
    assert run["regime"][-1] == layout.STICK
    assert int(run["flags"][-1]) & layout.STOPPED
    held = run["force_reaction"][-1] + run["force_friction"][-1]
    assert abs(held + PUSH) < 1e-9
    assert abs(run["force_friction"][-1]) <= 1.0 + 1e-9
    assert np.ptp(run["length"][-500:]) < 1e-12


def test_stored_energy_is_the_integral_of_the_table() -> None:
    """The account closes: kinetic energy and table exchange what damping takes, to rounding."""
    scene = moving(gravity=[0.0] * 3, elasticity=TABLES["elasticity"])
    run = cr.simulate(scene)
    assert np.abs(run["passivity_balance"]).max() < 1e-13
    t = scene.elasticity.table
    u = np.linspace(0.0, 1.0, 20001) * (run["length"][-1] - 0.2)
    force = np.interp(u, t.positions, t.forces)
    stored = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(u))
    kinetic = 0.5 * MASS * (1.0 - run["velocity"][-1][0] ** 2)
    if t.positions[0] < u[-1] < t.positions[-1]:
        assert abs(kinetic - stored) < 1e-7


@pytest.mark.parametrize("method", ["penalty", "augmented_lagrangian", "baumgarte"])
def test_methods_that_take_forces_from_the_sample(method: str) -> None:
    """Second order without damping, of the first with it; and the parts add up."""
    gains = {} if method == "baumgarte" else {"penalty": GAINS}
    periods = [2e-3, 1e-3, 5e-4]
    plain = errors(CASES["stop"], periods, method=method, **gains)
    damped = errors(CASES["damped stop"], periods, method=method, **gains)
    assert plain[-1, 0] < 1e-5
    assert damped[-1, 0] < 3e-4
    assert damped[-1, 0] < 0.6 * damped[0, 0]


def test_observe_separates_the_elements() -> None:
    """Method observe on the motion of impulse: nothing is left for friction."""
    scene = moving(stops=DAMPED, **TABLES)
    run = cr.simulate(scene)
    watch = cr.Connector(dataclasses.replace(scene, method="observe"))
    sample = np.zeros(layout.NSAMPLE)
    left = []
    for state in run.states:
        sample[layout.MOTION] = state
        out = watch.step(sample)
        left.append(out[layout.FORCE_FRICTION])
    assert np.abs(left[2:]).max() < 1e-6 * np.abs(run["force"][:, 0]).max()


def test_connectors_on_shared_bodies_have_the_elements_of_one() -> None:
    """Two rails, each with half of the stiffness of one sleeve with all of it."""
    half = cr.Stops(l_min=-0.1, stiffness=2e4, damping=150.0)
    whole = cr.Stops(l_min=-0.1, stiffness=4e4, damping=300.0)
    table = cr.SpringTable(positions=(-0.2, -0.05, 0.0), forces=(-30.0, -5.0, 0.0))

    def rail(y: float, stops: cr.Stops, elastic: bool) -> cr.Scene:
        return cr.Scene(
            period=1e-3,
            gravity=(-9.81, 0.0, 0.0),
            body_a=cr.Body(kind="fixed", frame="frame"),
            body_b=cr.Body(
                kind="free", frame="body", mass=20.0, inertia=(0.01, 0, 0, 0.02, 0, 0.02)
            ),
            node_a=cr.Node(position=(0.0, y, 0.0), orientation=(0.0, 0.0, 0.0, 1.0)),
            node_b=cr.Node(position=(0.0, y, 0.0)),
            stops=stops,
            elasticity=cr.Elasticity(table=table) if elastic else cr.Elasticity(),
        )

    both = simulate_group([rail(0.2, half, True), rail(-0.2, half, False)], 300).outs
    alone = cr.simulate(dataclasses.replace(
        rail(0.0, whole, True), plant=cr.PlantSettings(duration=0.299)
    ))  # fmt: skip
    assert np.abs(both[:, 0, layout.LENGTH] - alone["length"][:300]).max() < 1e-10
    assert np.abs(both[:, :, layout.FORCE_REACTION]).max() > 200.0
    flags = int(np.bitwise_or.reduce(both[:, :, layout.FLAGS].astype(int).ravel()))
    assert not flags & layout.NOT_CONVERGED
    assert both[:, :, layout.RESIDUAL].max() < 1e-9


def test_spin_has_tables_and_stops_of_its_own() -> None:
    """A rotational stop returns the spin; a damper by table takes the angle at constant moment."""
    stops = {"theta_max": 0.5, "rotational_stiffness": 5.0}
    run = cr.simulate(moving(v=0.0, spin=4.0, gravity=[0.0] * 3, stops=stops))
    assert abs(run["angular_velocity"][-1][0] + 4.0) < 1e-6
    table = {"rates": [-10.0, -1e-3, 1e-3, 10.0], "moments": [-0.01, -0.01, 0.01, 0.01]}
    scene = moving(
        v=0.0, spin=4.0, gravity=[0.0] * 3, damping={"rotational_table": table},
        inertia=[0.02, 0.0, 0.0, 0.02, 0.0, 0.02],
    )  # fmt: skip
    run = cr.simulate(scene)
    t = run.time[-1]
    assert abs(run["angular_velocity"][-1][0] - (4.0 - 0.01 / 0.02 * t)) < 1e-9
