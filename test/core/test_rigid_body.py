"""Rigid bodies under held wrenches, against SciPy's integration of Newton's and Euler's laws."""

import math

import numpy as np
import pytest
from scenes import merged, order, pair, rotation, sleeve, with_period
from scipy.integrate import solve_ivp

from cylconn_ros.errors import SceneError
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant

WRENCH = np.array([1.0, -2.0, 3.0, 0.02, -0.03, 0.05])


def tumbling(**parameters: object) -> Scene:
    change = {"wrench": {"axes": "world", "point": "com"}, "plant": {"body_b": {}}}
    scene = sleeve(com=(0.03, 0.02, 0.01), v=0.4, **merged(change, parameters))
    values: dict[str, object] = dict(scene.parameters())
    values["plant.body_b.twist"] = [0.4, 0.1, -0.2, 3.0, 9.0, -4.0]
    return Scene.from_parameters(values)


def integrated(
    scene: Scene, duration: float, *, in_body: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Mass centre and orientation matrix after ``duration``, by DOP853."""
    body, start = scene.body_b, Plant(scene).state[13:]
    turn = rotation(start[3:7])
    inertia = np.array(body.inertia)[[0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(3, 3)
    arm = turn @ body.com
    force0, torque0 = WRENCH[:3], WRENCH[3:]

    def rates(_t: float, y: np.ndarray) -> np.ndarray:
        r, v, w = y[3:12].reshape(3, 3), y[12:15], y[15:18]  # w in body axes
        force = r @ turn.T @ force0 if in_body else force0
        torque = turn.T @ torque0 if in_body else r.T @ torque0
        skew = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        dw = np.linalg.solve(inertia, torque - np.cross(w, inertia @ w))
        return np.array([*v, *(r @ skew).ravel(), *(force / body.mass + scene.gravity), *dw])

    velocity = start[7:10] + np.cross(start[10:], arm)
    y0 = np.array([*(start[:3] + arm), *turn.ravel(), *velocity, *(turn.T @ start[10:])])
    y = solve_ivp(rates, (0, duration), y0, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return y[:3], y[3:12].reshape(3, 3)


def errors(scene: Scene, duration: float, *, in_body: bool = False) -> tuple[float, float]:
    """Errors of the mass centre and of the orientation; the wrench is sent once and held."""
    plant = Plant(with_period(scene, duration))
    plant.step(np.zeros(6), WRENCH)
    com, turn = integrated(scene, duration, in_body=in_body)
    r = rotation(plant.state[16:20])
    return (
        float(np.abs(plant.state[13:16] + r @ scene.body_b.com - com).max()),
        float(np.abs(r - turn).max()),
    )


def test_a_held_wrench_moves_the_body_by_newton_and_euler() -> None:
    scene = tumbling()
    periods = [0.0095, 0.008, 0.0065, 0.005, 0.004]  # a single inner step each
    found = [errors(scene, h) for h in periods]
    assert max(e[0] for e in found) < 1e-11  # translation is exact
    assert order(periods, [e[1] for e in found]) > 4.8  # of one step: order four over a run


def test_a_wrench_held_in_body_axes_turns_with_the_body() -> None:
    scene = tumbling(wrench={"hold": "body"})
    assert max(errors(scene, 0.01, in_body=True)) < 1e-6
    assert errors(scene, 0.01, in_body=False)[0] > 1e-6


def test_momentum_of_a_free_body_is_exact_and_energy_kept() -> None:
    plant = Plant(pair(spin=20.0))
    before, energy = plant.momentum(), plant.energy()
    for _ in range(1000):
        plant.step(np.zeros(6), np.zeros(6))
    np.testing.assert_allclose(plant.momentum(), before, rtol=1e-12, atol=1e-12)
    assert plant.energy() == pytest.approx(energy, rel=1e-9)


def test_a_semi_implicit_plant_is_first_order() -> None:
    scene = tumbling(plant_integration="semi_implicit")
    duration, periods, found = 0.1, [2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4], []
    com, _ = integrated(scene, duration)
    for h in periods:
        plant = Plant(with_period(scene, h))
        for _ in range(round(duration / h)):
            plant.step(np.zeros(6), WRENCH)
        arm = rotation(plant.state[16:20]) @ scene.body_b.com
        found.append(float(np.abs(plant.state[13:16] + arm - com).max()))
    assert order(periods, found) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("axes", ["body", "world"])
@pytest.mark.parametrize("point", ["origin", "com"])
def test_every_form_of_a_wrench_moves_the_body_the_same(axes: str, point: str) -> None:
    scene = tumbling(wrench={"axes": axes, "point": point})
    start = Plant(scene).state[13:]
    turn = rotation(start[3:7])
    force, torque = WRENCH[:3], WRENCH[3:].copy()
    if point == "origin":
        torque = torque + np.cross(turn @ scene.body_b.com, force)
    if axes == "body":
        force, torque = turn.T @ force, turn.T @ torque
    plant, expected = Plant(scene), Plant(tumbling())
    plant.step(np.zeros(6), np.array([*force, *torque]))
    expected.step(np.zeros(6), WRENCH)
    np.testing.assert_allclose(plant.state, expected.state, atol=1e-14)


def test_loads_act_at_the_body_origin_and_turn_with_it() -> None:
    scene = tumbling(plant={"body_b": {"load": list(WRENCH)}})
    loaded = Plant(with_period(scene, 1e-6))  # in which the point of application hardly turns
    pushed = Plant(with_period(tumbling(wrench={"point": "origin"}), 1e-6))
    loaded.step(np.zeros(6), np.zeros(6))
    pushed.step(np.zeros(6), WRENCH)
    np.testing.assert_allclose(loaded.state, pushed.state, atol=1e-9)
    coarse, fine = Plant(scene), Plant(with_period(scene, scene.period / 64))
    coarse.step(np.zeros(6), np.zeros(6))
    for _ in range(64):
        fine.step(np.zeros(6), np.zeros(6))
    np.testing.assert_allclose(coarse.state, fine.state, atol=1e-9)


def test_a_plant_refuses_bodies_without_inertia() -> None:
    with pytest.raises(SceneError, match=r"period = 0\.0: must be > 0 s for a plant"):
        Plant(with_period(sleeve(), 0.0))
    gains = {"stiffness": 1e4, "damping": 10.0}
    unknown = sleeve(penalty=gains, body_b={"kind": "unknown", "mass": math.nan})
    with pytest.raises(SceneError, match=r"body_b\.mass, body_b\.inertia: must be given"):
        Plant(unknown)
