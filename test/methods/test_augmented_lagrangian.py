"""Method augmented_lagrangian: no steady-state deflection; unstable gains are lowered."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scenes import about_y, merged, pair, sleeve, with_period

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.core.layout import GAINS_LOWERED, SLIP, STICK
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.simulate import Run, simulate

GAINS = {"stiffness": 2e5, "damping": 400.0, "rotational_stiffness": 2e3, "rotational_damping": 4.0}
FRICTION = {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1}


def unknown(scene: Scene, method: str = "augmented_lagrangian", **gains: Any) -> Scene:
    """The same scene with unknown inertia of body B for the connector; the plant knows it."""
    values = {**scene.parameters(), "body_b.kind": "unknown", "method": method}
    values.update({f"penalty.{name}": gain for name, gain in {**GAINS, **gains}.items()})
    return Scene.from_parameters(values)


def run(scene: Scene, duration: float) -> Run:
    return simulate(scene, samples=round(duration / scene.period) + 1)


def lowered(found: Run) -> np.ndarray:
    return (found.outs[:, layout.FLAGS].astype(int) & GAINS_LOWERED) != 0


def test_there_is_no_steady_state_deflection() -> None:
    """The penalty method deflects by m g/k; here the multiplier takes over the load."""
    scene = sleeve(mass=2.0, v=0.1, friction=FRICTION)
    penalty = run(unknown(scene, "penalty"), 1.5)
    found = run(unknown(scene), 1.5)
    assert penalty["offset_violation"][-1] == pytest.approx(2.0 * 9.81 / 2e5, rel=1e-6)
    assert found["offset_violation"][-1] < 1e-12
    assert found["normal_force"][-1] == pytest.approx(2.0 * 9.81, rel=1e-9)
    assert not lowered(found).any()


def test_the_distance_to_rest_is_that_of_penalty() -> None:
    """Case 1; the initial deflection changes friction for a few hundredths of a second."""
    friction = {"coefficient": 0.2, "radius": 0.02, "preload": 5.0}
    found = run(unknown(sleeve(mass=2.0, v=1.0, friction=friction)), 1.0)
    assert found["displacement"][-1] == pytest.approx(0.2030868, rel=5e-4)
    assert found.outs[-1, layout.REGIME] == STICK
    assert np.ptp(found["displacement"][-200:]) < 1e-6


def test_friction_is_that_of_penalty() -> None:
    """Elastic stick, and friction at its limit in slip."""
    scene = unknown(sleeve(shaft=about_y(0.1), friction=FRICTION), stick_stiffness=1e5)
    found = run(scene, 1.0)
    weight = 2.0 * 9.81 * math.sin(0.1)
    assert found["force"][-1, 0] == pytest.approx(-weight, rel=1e-4)
    assert found["displacement"][-1] == pytest.approx(weight / 1e5, rel=0.05)
    sliding = run(unknown(sleeve(v=1.0, spin=30.0, friction=FRICTION)), 0.1)
    slip = sliding.outs[:, layout.REGIME] == SLIP
    assert slip.sum() > 50
    traction, limit = sliding["traction"], sliding["friction_limit"]
    np.testing.assert_allclose(traction[slip], limit[slip], rtol=1e-12)
    phi = sliding["force_friction"][slip], sliding["moment_friction"][slip] / 0.02
    power = phi[0] * sliding["slip_velocity"][slip, 0]
    power += phi[1] * sliding["slip_velocity"][slip, 1]
    assert power[0] == 0.0  # nothing presses yet: the spring is at rest
    assert np.all(power[1:] < 0.0)


def test_the_first_step_is_that_of_penalty() -> None:
    """With a zero multiplier only rho k e differs."""
    scene = pair(friction=FRICTION)
    first, same = (
        run(unknown(scene, method), 0.0).outs[0] for method in ("augmented_lagrangian", "penalty")
    )
    np.testing.assert_allclose(first[: layout.FLAGS], same[: layout.FLAGS], rtol=0.0, atol=1e-12)


def test_two_free_bodies_keep_their_momentum() -> None:
    gains: dict[str, Any] = {"stiffness": 2e4, "damping": 60.0}
    gains |= {"rotational_stiffness": 200.0, "rotational_damping": 0.6}
    scene = unknown(pair(friction=FRICTION), **gains)
    scene = with_period(scene, 2e-4)
    found = run(scene, 0.3)
    start = Plant(scene)
    np.testing.assert_allclose(found.plant.momentum()[:3], start.momentum()[:3], atol=1e-10)
    np.testing.assert_allclose(found.plant.momentum()[3:], start.momentum()[3:], rtol=2e-3)
    assert found.energy[-1] < found.energy[0]


@pytest.mark.parametrize(
    ("stiffness", "damping"),
    [
        (2e7, 400.0),  # k h/2 > c: unstable whatever the mass
        (2e5, 40.0),  # hardly damped
        (2e5, 6e3),  # c h/m = 3: every sample overshoots
        (4e5, 2e4),  # and ten
    ],
)
def test_unstable_gains_are_lowered(stiffness: float, damping: float) -> None:
    """Gains with which a spring diverges are lowered in time, flagged, and the motion is damped."""
    arm = 0.1**2
    gains: dict[str, Any] = {
        "stiffness": stiffness,
        "damping": damping,
        "rotational_stiffness": 2e3,
        "rotational_damping": 4.0,
        "stick_stiffness": 1e4,
    }
    scene = sleeve(mass=2.0, inertia=[2.0 * arm, 0.0, 0.0, 2.0 * arm, 0.0, 2.0 * arm], v=0.1)
    lock_step = dataclasses.replace(unknown(scene, "penalty", **gains), latency=0)
    spring = run(lock_step, 2.0)
    assert lowered(spring)[-1]
    assert spring["offset_violation"].max() < 0.05  # what is left of it lets the weight sag
    found = run(unknown(scene, **gains), 4.0)
    assert lowered(found)[-1]
    violation = found["offset_violation"]
    assert violation.max() < 3e-3
    assert violation[-1] < 0.1 * violation.max()
    assert np.all(found.outs[:, layout.STATUS] == layout.OK)


def test_the_requested_gain_is_used_until_it_is_unstable() -> None:
    """The bound is rho < c h/m = 0.2: 0.1 is stable unchanged; 0.5 is lowered until stable."""
    for rho, lower in ((0.1, False), (0.5, True)):
        found = run(unknown(sleeve(mass=2.0, v=0.1), multiplier_gain=rho), 3.0)
        assert lowered(found).any() == lower
        assert found["offset_violation"][-1] < 1e-8


def test_the_passivity_balance_is_bounded() -> None:
    """W minus the spring's energy is at most the pull-in work and 1 % of the energy exchanged."""
    found = run(unknown(sleeve(mass=2.0, v=0.5, spin=10.0, com=(0.01, 0.002, 0.0))), 1.0)
    stored = 0.5 * GAINS["stiffness"] * found["offset_violation"] ** 2
    stored += 0.5 * GAINS["rotational_stiffness"] * found["angular_violation"] ** 2
    pull_in = stored.max()
    balance, exchanged = found["passivity_balance"], found["energy_exchanged"]
    assert np.all(balance + stored <= pull_in + 0.01 * exchanged)


def test_reset_restores_the_gains() -> None:
    """Reset restores the requested gains and a zero multiplier."""
    scene = unknown(sleeve(mass=2.0, v=0.1), multiplier_gain=0.5)
    connector, plant = Connector(scene), Plant(scene)
    sample = np.zeros(layout.NSAMPLE)
    answers = []
    for attempt in range(2):
        connector.reset()
        plant = Plant(scene)
        for _ in range(300):
            sample[layout.MOTION] = plant.state
            out = connector.step(sample)
            plant.step(out[0:6], out[6:12])
        answers.append(out.copy())
        assert attempt or int(out[layout.FLAGS]) & GAINS_LOWERED
    np.testing.assert_array_equal(answers[0], answers[1])


def test_it_needs_the_gains_of_penalty() -> None:
    scene = sleeve(**merged({}, {"body_b": {"kind": "unknown"}, "method": "augmented_lagrangian"}))
    with pytest.raises(ValueError, match=r"penalty\.stiffness = \.nan: .* augmented_lagrangian"):
        Connector(scene)
