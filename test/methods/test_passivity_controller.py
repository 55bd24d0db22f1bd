"""The passivity controller lowers gains that generate energy, and no others."""

import numpy as np
import pytest

from cylconn_ros.bench.faults import free_running
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant

FREE = {
    "kind": "unknown", "mass": 1.0, "com": [0.02, 0.0, 0.0],
    "inertia": [0.001, 0.0, 0.0, 0.002, 0.0, 0.002],
}  # fmt: skip


def scene(method: str, stiffness: float, damping: float) -> Scene:
    return Scene.from_parameters(
        {
            "method": method,
            "body_b": FREE,
            "node_a": {"orientation": [0.0, 0.0, 0.0, 1.0]},
            "friction": {"coefficient": 0.1, "radius": 0.02, "overlap": 0.1, "preload": 5.0},
            "penalty": {"stiffness": stiffness, "damping": damping},
            "plant": {"body_b": {"twist": [1.0, 0.0, 0.0, 1.0, 0.0, 0.0]}},
        }
    )


@pytest.mark.parametrize("noise", [1e-5, 1e-3])
@pytest.mark.parametrize("method", ["penalty", "augmented_lagrangian"])
def test_noise_of_the_measured_twists_lowers_no_gain(method: str, noise: float) -> None:
    """Noise reverses and grows by chance; the offset stays that of the weight, 0.1 mm, or less."""
    given, rng = scene(method, 1e5, 200.0), np.random.default_rng(0)
    connector, plant = Connector(given), Plant(given)
    sample, out = np.zeros(layout.NSAMPLE), np.empty(layout.NOUT)
    for _ in range(10_000):
        sample[layout.MOTION], sample[layout.LOADS] = plant.state, plant.loads
        sample[layout.MOTION][20:26] += noise * rng.normal(size=6)
        connector.step(sample, out=out)
        assert not int(out[layout.FLAGS]) & layout.GAINS_LOWERED
        plant.step(out[layout.FORCE_A : layout.FORCE_B], out[layout.FORCE_B : layout.STATE0])
    assert out[layout.OFFSET_VIOLATION] < 1.1e-4


@pytest.mark.parametrize("too_great", [3.0, 30.0, 300.0])
@pytest.mark.parametrize("method", ["penalty", "augmented_lagrangian"])
def test_gains_that_are_too_great_are_lowered_in_time(method: str, too_great: float) -> None:
    """Damping 1000 N.s/m is c h/m = 1: three to three hundred times that in a second."""
    given = scene(method, 3e5 * too_great, 1000.0 * too_great)
    connector, plant = Connector(given), Plant(given)
    sample, out = np.zeros(layout.NSAMPLE), np.empty(layout.NOUT)
    greatest = 0.0
    for _ in range(1000):
        sample[layout.MOTION], sample[layout.LOADS] = plant.state, plant.loads
        connector.step(sample, out=out)
        greatest = max(greatest, float(out[layout.OFFSET_VIOLATION]))
        plant.step(out[layout.FORCE_A : layout.FORCE_B], out[layout.FORCE_B : layout.STATE0])
    assert int(out[layout.FLAGS]) & layout.GAINS_LOWERED
    assert greatest < 5e-3


def hanging(method: str, kind: str) -> Scene:
    """A sleeve that coasts to rest on its rail; careful gains for 5 ms: it sags by 4.9 mm."""
    return Scene.from_parameters(
        {
            "method": method,
            "period": 5e-3,
            "plant_integration": "semi_implicit",
            "body_b": {"kind": kind, "mass": 2.0, "inertia": [0.01, 0.0, 0.0, 0.02, 0.0, 0.02]},
            "node_a": {"orientation": [0.0, 0.0, 0.0, 1.0]},
            "friction": {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1},
            "penalty": {"stiffness": 4000.0, "damping": 120.0},
            "plant": {"duration": 2.0, "body_b": {"twist": [0.5, 0.0, 0.0, 3.0, 0.0, 0.0]}},
        }
    )


@pytest.mark.parametrize("lag", [1.0, 2.5, 5.0])
@pytest.mark.parametrize("method", ["penalty", "augmented_lagrangian"])
def test_rest_on_elastic_constraints_keeps_its_gains_at_any_lag(method: str, lag: float) -> None:
    """Small oscillations return energy from the springs: no reason to weaken them."""
    found = free_running.run(hanging(method, "free"), free_running.Lag(lag))
    assert found.latency == pytest.approx(np.ceil(lag), abs=0.1)
    assert found.offset < 5.5e-3


@pytest.mark.parametrize(
    ("method", "lag", "most"),
    [("penalty", 2.0, 6e-3), ("penalty", 3.0, 2.0), ("penalty", 5.0, 2.0), ("penalty", 12.0, 50.0),
     ("augmented_lagrangian", 2.0, 6e-3), ("augmented_lagrangian", 3.0, 0.1),
     ("augmented_lagrangian", 5.0, 2.0), ("augmented_lagrangian", 12.0, 50.0)],
)  # fmt: skip
def test_unknown_inertia_with_a_lag_does_not_run_away(method: str, lag: float, most: float) -> None:
    """Gains that the lag makes unstable are lowered; their weight then lets the body sag."""
    with np.errstate(all="ignore"):
        found = free_running.run(hanging(method, "unknown"), free_running.Lag(lag))
    assert found.offset < most
