"""Method penalty: what it provides with unknown inertia, and its limits."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scenes import about_y, merged, pair, sleeve, with_period

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.core.layout import SLIP, STICK
from cylconn_ros.errors import SceneError
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.simulate import Run, simulate

GAINS = {"stiffness": 2e5, "damping": 400.0, "rotational_stiffness": 2e3, "rotational_damping": 4.0}
FRICTION = {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1}


def unknown(scene: Scene, **gains: float) -> Scene:
    """The same scene with unknown inertia of body B for the connector; the plant knows it."""
    values = {**scene.parameters(), "body_b.kind": "unknown"}
    values.update({f"penalty.{name}": gain for name, gain in {**GAINS, **gains}.items()})
    return Scene.from_parameters(values)


def run(scene: Scene, duration: float) -> Run:
    return simulate(scene, samples=round(duration / scene.period) + 1)


def test_auto_chooses_by_known_inertia() -> None:
    scene = sleeve(friction=FRICTION)
    assert Connector(scene).method == "impulse"
    connector = Connector(unknown(scene))
    assert connector.method == "penalty"
    assert "penalty (auto)" in connector.model
    assert "unknown" in connector.model


def test_it_holds_the_constraint_and_coasts_to_rest() -> None:
    """Case 1 with unknown mass: the distance is exact up to the elastic slip."""
    friction = {"coefficient": 0.2, "radius": 0.02, "preload": 5.0}
    scene = unknown(sleeve(mass=2.0, v=1.0, friction=friction))
    found = run(scene, 1.0)
    assert found["displacement"][-1] == pytest.approx(0.20309, rel=5e-3)
    assert found.outs[-1, layout.REGIME] == STICK
    settled = found["offset"][-1, 1]
    assert settled == pytest.approx(-2.0 * 9.81 / GAINS["stiffness"], rel=1e-3)  # it gives: m g/k
    assert found["normal_force"][-1] == pytest.approx(2.0 * 9.81 + 5.0, rel=1e-4)
    assert np.ptp(found["displacement"][-200:]) < 1e-6


def test_stick_is_elastic_and_returned_onto_the_disc() -> None:
    scene = unknown(sleeve(shaft=about_y(0.1), friction=FRICTION), stick_stiffness=1e5)
    found = run(scene, 1.0)
    weight = 2.0 * 9.81 * math.sin(0.1)
    assert found.outs[-1, layout.REGIME] == STICK
    assert found["force"][-1, 0] == pytest.approx(-weight, rel=1e-4)
    assert found["displacement"][-1] == pytest.approx(weight / 1e5, rel=0.05)
    sliding = run(unknown(sleeve(v=1.0, spin=30.0, friction=FRICTION)), 0.1)
    slip = sliding.outs[:, layout.REGIME] == SLIP
    assert slip.sum() > 50
    traction, limit = sliding["traction"], sliding["friction_limit"]
    np.testing.assert_allclose(traction[slip], limit[slip], rtol=1e-12)
    assert np.all(traction <= limit * (1.0 + 1e-12))


def test_two_free_bodies_keep_their_momentum() -> None:
    scene = unknown(pair(friction=FRICTION), stiffness=2e4, damping=20.0)
    scene = with_period(scene, 2e-4)
    found = run(scene, 0.3)
    start = Plant(scene)
    # the wrench acts where it was measured: linear momentum is exact, angular to first order
    np.testing.assert_allclose(found.plant.momentum()[:3], start.momentum()[:3], atol=1e-10)
    np.testing.assert_allclose(found.plant.momentum()[3:], start.momentum()[3:], rtol=2e-3)
    assert found["offset_violation"].max() < 2e-3
    assert found.energy[-1] < found.energy[0]


def test_a_spring_too_stiff_for_the_period_diverges() -> None:
    """With k h^2/m well above the stability bound of a sampled spring."""
    scene = unknown(sleeve(v=0.1, friction=FRICTION), stiffness=2e7, damping=400.0)
    found = run(dataclasses.replace(scene, latency=0), 0.2)
    violation = found["offset_violation"]
    assert violation.max() > 1e-2 or np.any(found.outs[:, layout.STATUS] != 0)


@pytest.mark.parametrize("name", ["stiffness", "damping"])
def test_gains_must_be_given(name: str) -> None:
    values = {**unknown(sleeve(friction=FRICTION)).parameters(), f"penalty.{name}": math.nan}
    with pytest.raises(SceneError, match=rf"penalty\.{name} = \.nan: must be given"):
        Connector(Scene.from_parameters(values))


def test_swings_need_an_arm_or_a_stiffness() -> None:
    scene = sleeve(
        **merged({}, {"body_b": {"kind": "unknown"}, "penalty": {"stiffness": 1e4, "damping": 1.0}})
    )
    with pytest.raises(SceneError, match=r"penalty\.rotational_stiffness"):
        Connector(scene)


def test_stops_locks_and_imposed_motion_are_springs() -> None:
    still: dict[str, Any] = {
        "gravity": [0.0, 0.0, 0.0],
        "friction": {**FRICTION, "coefficient": 0.0},
    }
    stopped = run(unknown(sleeve(v=1.0, stops={"l_max": 0.25}, **still)), 0.5)
    assert stopped["length"].max() < 0.26
    assert stopped["velocity"][-1, 0] <= 1e-9
    assert 2 in stopped.outs[:, layout.STOP]
    locked = run(
        unknown(sleeve(v=1.0, lock={"component": "slide", "position": 0.25}, **still)), 0.5
    )
    assert locked["length"][-1] == pytest.approx(0.25, abs=1e-6)
    assert locked.outs[-1, layout.LOCK] == 1
    driven = run(unknown(sleeve(command={"slide": {"velocity": 0.2}}, **still)), 1.0)
    assert driven["displacement"][-1] == pytest.approx(0.2, rel=1e-3)
    pushed = run(unknown(sleeve(command={"slide": {"force": 6.0}}, **still)), 1.0)
    assert pushed["displacement"][-1] == pytest.approx(1.5, rel=1e-9)
    for found in (stopped, locked, driven, pushed):
        parts = sum(
            found[f"force_{part}"]
            for part in ("elastic", "viscous", "friction", "actuation", "reaction")
        )
        np.testing.assert_allclose(parts, found["force"][:, 0], atol=1e-12)
