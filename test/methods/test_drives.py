"""Imposed motion with a greatest force, at stops and locks: known answers."""

import math
from typing import Any

import numpy as np
import pytest
from scenes import sleeve, with_period

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.errors import SceneError
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.simulate import Run, simulate

FRICTION = {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1}
HALF = math.sqrt(0.5)
REST: dict[str, Any] = {"mass": 2.0, "l0": 0.0, "v": 0.0}
WEIGHTLESS: dict[str, Any] = {"gravity": [0.0, 0.0, 0.0], **REST}
GAINS = {
    "method": "penalty",
    "penalty": {
        "stiffness": 1e5, "damping": 400.0, "rotational_stiffness": 10.0,
        "rotational_damping": 0.05,
    },
}  # fmt: skip


def drive(**slide: float) -> dict[str, Any]:
    return {"slide": slide}


def run(scene: Scene, duration: float, period: float = 1e-3) -> Run:
    return simulate(with_period(scene, period), samples=round(duration / period) + 1)


def blocked(found: Run) -> Any:
    return (found.outs[:, layout.FLAGS].astype(int) & layout.DRIVE_BLOCKED) != 0


@pytest.mark.parametrize("integration", ["exact", "semi_implicit"])
@pytest.mark.parametrize("gains", [{}, GAINS], ids=["impulse", "penalty"])
def test_a_drive_pushes_with_its_greatest_force(gains: dict[str, Any], integration: str) -> None:
    """10 N on 2 kg towards 1 m/s: 0.5 m/s after 0.1 s, on the rail; exact once it is reached."""
    scene = sleeve(
        command=drive(velocity=1.0, max_force=10.0), plant_integration=integration,
        **gains, **WEIGHTLESS,
    )  # fmt: skip
    found = run(scene, 0.3)
    assert found["velocity"][100, 0] == pytest.approx(0.5, abs=1e-13)
    np.testing.assert_allclose(found["force_reaction"][:190], 10.0, rtol=1e-12)
    assert found["velocity"][-1, 0] == pytest.approx(1.0, abs=1e-13 if not gains else 1e-5)
    assert np.abs(found["offset"]).max() < 1e-12
    assert not blocked(found).any()


def test_a_drive_that_cannot_hold_the_load_gives_way() -> None:
    """A lift of 2 kg, held by up to 10 N: it falls with g - F/m; up to 20 N: it stays."""
    for most, acceleration in ((10.0, -9.81 + 5.0), (20.0, 0.0)):
        scene = sleeve(
            shaft=(0.0, -HALF, 0.0, HALF), command=drive(velocity=0.0, max_force=most), **REST
        )
        found = run(scene, 0.2)
        assert found["velocity"][-1, 0] == pytest.approx(0.2 * acceleration, abs=1e-12)
    assert found["force_reaction"][-1] == pytest.approx(2.0 * 9.81, rel=1e-12)


@pytest.mark.parametrize("most", [math.inf, 10.0])
@pytest.mark.parametrize("gains", [{}, GAINS], ids=["impulse", "penalty"])
def test_a_stop_wins_over_a_drive(most: float, gains: dict[str, Any]) -> None:
    scene = sleeve(
        command=drive(velocity=1.0, max_force=most), stops={"l_max": 0.2}, **gains, **WEIGHTLESS
    )
    found = run(scene, 0.6 if not gains else 2.0)  # penalty: it bounces as its dampers let it
    assert found["length"][-1] == pytest.approx(0.2, abs=1e-12 if not gains else 1e-3)
    assert found["length"].max() < 0.2 + (1e-12 if not gains else 3e-3)
    assert (found.outs[-100:, layout.STOP] == 2).any()
    assert blocked(found)[-100:].any()
    assert not blocked(found)[:150].any()


def test_a_stop_wins_also_with_friction_and_spin() -> None:
    scene = sleeve(
        l0=0.0, v=1.0, spin=5.0, friction=FRICTION, command=drive(velocity=1.0),
        stops={"l_max": 0.05},
    )  # fmt: skip
    found = run(scene, 0.2)
    assert found["length"].max() <= 0.05 + 1e-12
    assert blocked(found)[-1]
    assert found["residual"].max() < 1e-12


def test_a_rebound_against_a_limited_drive() -> None:
    """After an impact at 1 m/s with restitution 0.5 the drive's 5 m/s^2 turn it in 0.025 m."""
    scene = sleeve(
        command=drive(velocity=1.0, max_force=10.0), stops={"l_max": 0.2, "restitution": 0.5},
        **WEIGHTLESS,
    )  # fmt: skip
    found = run(scene, 0.45)
    after = found["length"][302:]
    assert after.min() == pytest.approx(0.2 - 0.025, abs=2e-6)
    assert not blocked(found)[310:400].any()


def test_a_lock_wins_over_a_drive() -> None:
    scene = sleeve(
        command=drive(velocity=1.0), lock={"component": "slide", "position": 0.05}, **WEIGHTLESS
    )
    found = run(scene, 0.1)
    assert found["length"][-1] == pytest.approx(0.05, abs=1e-12)
    assert blocked(found)[-1]
    assert found.outs[-1, layout.LOCK] == 1


@pytest.mark.parametrize("most", [math.inf, 10.0])
def test_an_imposed_position_is_approached_at_the_drives_own_speed(most: float) -> None:
    command = drive(position=0.1, max_force=most, approach_speed=0.5)
    for pull_in in (0.1, 2.0):
        scene = sleeve(command=command, reference={"pull_in_speed": pull_in}, **WEIGHTLESS)
        found = run(scene, 0.6)
        assert found["velocity"][:, 0].max() == pytest.approx(0.5, rel=1e-9)
        assert found["length"].max() < 0.1 + 1e-5
        assert found["length"][-1] == pytest.approx(0.1, abs=1e-12)
        assert np.abs(found["force_reaction"]).max() <= most
        assert not blocked(found).any()


def test_a_spin_drive_has_a_greatest_moment() -> None:
    """0.01 N.m on 2e-3 kg.m^2: 5 rad/s^2."""
    scene = sleeve(
        inertia=[2e-3, 0.0, 0.0, 3e-3, 0.0, 3e-3], spin=0.0,
        command={"spin": {"velocity": 2.0, "max_force": 0.01}}, **WEIGHTLESS,
    )  # fmt: skip
    found = run(scene, 0.2)
    assert found["angular_velocity"][-1, 0] == pytest.approx(1.0, rel=1e-11)
    np.testing.assert_allclose(found["moment_reaction"], 0.01, rtol=1e-12)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"command": drive(position=0.3), "stops": {"l_max": 0.2}},
         r"command.slide.position = 0.3: must be <= stops.l_max \(0.2\)"),
        ({"command": {"spin": {"position": -3.0}}, "stops": {"theta_min": -1.0}},
         r"command.spin.position = -3.0: must be >= stops.theta_min \(-1.0\)"),
        ({"lock": {"component": "slide", "position": 0.3}, "stops": {"l_max": 0.2}},
         r"lock.position = 0.3: must be <= stops.l_max \(0.2\)"),
        ({"command": drive(force=1.0, max_force=2.0)},
         r"command.slide.max_force = 2.0: must not be given with command.slide.force \(1.0\)"),
        ({"command": drive(velocity=1.0, max_force=0.0)}, "command.slide.max_force = 0.0: must be"),
        ({"command": drive(velocity=1.0, max_force=1.0), "method": "minimal"},
         "command.slide.max_force = 1.0: the method minimal has no drive that gives way"),
        ({"command": drive(velocity=1.0), "stops": {"l_max": 0.2}, "method": "minimal"},
         "command.slide.velocity = 1.0: the method minimal has no drive that a stop holds back"),
        ({"command": drive(velocity=1.0, max_force=1.0), "method": "observe"},
         "command.slide.max_force = 1.0: the method observe sends no wrench"),
        ({"command": drive(max_force=1.0), "method": "baumgarte"},
         "command.slide.max_force = 1.0: the method baumgarte has no"),
        ({"command": drive(position=0.1, max_force=1.0), **GAINS},
         "command.slide.max_force = 1.0: with the method penalty must not be given with a pos"),
    ],
)  # fmt: skip
def test_contradictions_are_refused_with_both_parameters(
    changes: dict[str, Any], text: str
) -> None:
    with pytest.raises(SceneError, match=text):
        sleeve(**changes)


def test_a_commanded_position_beyond_a_stop_is_refused() -> None:
    connector = Connector(sleeve(stops={"l_max": 0.2}))
    with pytest.raises(SceneError, match=r"position of slide = 0.3: must be <= stops.l_max"):
        connector.impose("slide", position=0.3)
    connector.impose("slide", position=0.2, max_force=3.0)
