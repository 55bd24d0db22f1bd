"""A held misalignment: B rotates about its own axis."""

import numpy as np
import pytest
from scenes import merged, order, pair, rotation, sleeve
from scipy.spatial.transform import Rotation

from cylconn_ros.core import kinematics
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.minimal import solve
from cylconn_ros.simulation.simulate import Run, simulate

FRICTION = {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1, "preload": 2.0}
FINE = [4e-3, 2e-3, 1e-3]
DURATION = 0.2


def held(base: Scene, swing: tuple[float, float, float], spin: float = 8.0) -> Scene:
    """``base`` with B spinning about its own axis, at the angle ``swing`` to the slot."""
    axis = Rotation.from_rotvec(swing).as_matrix()[:, 0]
    turning = np.array(base.plant.body_a.twist[3:])
    twist = list(base.plant.body_b.twist[:3])
    values = merged(
        base.parameters(),
        {
            "node_b.orientation": tuple(map(float, Rotation.from_rotvec(swing).as_quat())),
            "plant.body_b.twist": (*twist, *map(float, turning + spin * axis)),
        },
    )
    return Scene.from_parameters(values)


def run(scene: Scene, period: float) -> Run:
    values = {**scene.parameters(), "period": period}
    return simulate(Scene.from_parameters(values), samples=round(DURATION / period) + 1)


SCENES = {
    "on a shaft": held(sleeve(v=0.3, com=(0.03, 0.02, 0.01), friction=FRICTION), (0.0, 0.8, 1.9)),
    "nearly turned round": held(sleeve(v=0.3, com=(0.03, 0.02, 0.01)), (0.0, 3.14, 0.0)),
    "two free bodies": held(pair(friction=FRICTION), (0.0, -0.7, 0.9)),
}


@pytest.mark.parametrize("name", SCENES)
def test_the_motion_is_that_of_method_minimal(name: str) -> None:
    """Second order, compared with a solution in joint coordinates."""
    scene = SCENES[name]
    truth = solve(scene, DURATION, times=[0.0, DURATION])
    errors = []
    for period in FINE:
        found = run(scene, period)
        b = slice(13, 16)
        error = [found.states[-1][b] - truth.states[-1][b]]
        turned = rotation(found.states[-1][16:20]) - rotation(truth.states[-1][16:20])
        errors.append(float(np.linalg.norm([*np.ravel(error), *np.ravel(turned)])))
        assert found["angular_violation"].max() < 1e-3 * (period / 1e-3) ** 2
    assert order(FINE, errors) > 1.8
    assert errors[-1] < 1e-4
    assert abs(truth.angle[-1] - truth.angle[0]) > 1.0


@pytest.mark.parametrize("name", SCENES)
def test_the_rate_of_the_angle_is_the_reported_spin(name: str) -> None:
    found = run(SCENES[name], 1e-3)
    angle, spin = found["angle"], found["angular_velocity"][:, 0]
    middle = np.diff(angle) / 1e-3
    np.testing.assert_allclose(middle, 0.5 * (spin[1:] + spin[:-1]), atol=1e-3)


def test_moments_are_about_the_held_axis() -> None:
    """The published torque of a damper on the spin is along e1b."""
    scene = held(sleeve(gravity=[0.0, 0.0, 0.0]), (0.0, 0.8, 1.9))
    values = {**scene.parameters(), "damping.cr1": 1e-3, "method": "penalty",
              "penalty.stiffness": 1e3, "penalty.damping": 1.0,
        "penalty.rotational_stiffness": 1.0, "wrench.axes": "world"}  # fmt: skip
    found = simulate(Scene.from_parameters(values), samples=1)
    axis = Rotation.from_rotvec((0.0, 0.8, 1.9)).as_matrix()[:, 0]
    np.testing.assert_allclose(found.outs[0, 9:12], -8e-3 * axis, atol=1e-12)


def test_a_swing_of_rounding_is_ignored() -> None:
    assert kinematics.aligned(kinematics.swing_of(3e-16, -5e-16))
    assert not kinematics.aligned(kinematics.swing_of(1e-9, 0.0))
