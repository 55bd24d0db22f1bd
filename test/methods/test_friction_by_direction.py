"""Friction by direction, an offset force, and what presses: closed forms, orders, every method.

With m R^2 = I the direction of slip is constant on one normal force N, and so is its coefficient:
|s|' = -mu(theta) N/m. With m R^2 = 2 I it turns: SciPy integrates m v' = -mu(c) N c and
I w' = -mu(c) N R^2 w/|s|, with c = v/|s|.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import cylconn_ros as cr
from cylconn_ros.core import layout
from cylconn_ros.laws import residuals
from cylconn_ros.laws.runs import simulated
from cylconn_ros.simulation.simulate import simulate

MASS, G, RADIUS = 2.0, 10.0, 0.05
FORWARD, BACKWARD = 0.1, 0.4
GAINS = {"penalty.stiffness": 1e5, "penalty.damping": 300.0, "penalty.stick_stiffness": 1e5}
METHODS = ("impulse", "minimal", "baumgarte", "penalty", "augmented_lagrangian")


def sleeve(ratio: float = 1.0, method: str = "impulse", **changes: Any) -> cr.Scene:
    """A sleeve with m R^2/I = ``ratio`` on a level shaft."""
    inertia = MASS * RADIUS**2 / ratio
    scene = cr.Scene.from_parameters(
        {
            "period": 1e-3,
            "latency": 0,
            "method": method,
            "gravity": [0.0, 0.0, -G],
            "body_b": {"kind": "free", "mass": MASS,
                       "inertia": [inertia, 0.0, 0.0, inertia, 0.0, inertia]},
            "node_a": {"orientation": [0.0, 0.0, 0.0, 1.0]},
            "friction": {"coefficient_forward": FORWARD, "coefficient_backward": BACKWARD,
                         "radius": RADIUS},
        }
    )  # fmt: skip
    gains = GAINS | {"penalty.rotational_stiffness": 1e3} if method in METHODS[3:] else {}
    return scene.replace(gains | changes)


def turning(angle: float, speed: float = 1.0) -> dict[str, Any]:
    """Slip at ``angle`` to the slide."""
    v, w = speed * math.cos(angle), speed * math.sin(angle) / RADIUS
    return {"plant.body_b.twist": [v, 0.0, 0.0, w, 0.0, 0.0]}


@pytest.mark.parametrize("method", ["impulse", "minimal"])
@pytest.mark.parametrize("angle", [0.0, 0.5, math.pi / 2, 2.5, math.pi, -2.0])
def test_the_coefficient_of_a_slip_direction(angle: float, method: str) -> None:
    """The mean and the cosine: stop time and direction of slide and spin together."""
    mu = 0.5 * (FORWARD + BACKWARD) + 0.5 * (FORWARD - BACKWARD) * math.cos(angle)
    time = 1.0 / (mu * G)
    run = cr.simulate(sleeve(1.0, method, **turning(angle)), duration=time - 0.01)
    left = 1.0 - mu * G * run.time[-1]
    slip = run["slip_velocity"][-1]
    expected = np.array([math.cos(angle), math.sin(angle)]) * left
    np.testing.assert_allclose(slip, expected, atol=1e-9)
    assert run["friction_coefficient"][1] == pytest.approx(mu, rel=1e-9)
    ended = cr.simulate(sleeve(1.0, method, **turning(angle)), duration=time + 0.05)
    stops = ended["stop_time"]
    at = np.flatnonzero(stops >= 0.0)[-1]
    assert ended.time[at] + stops[at] == pytest.approx(time, abs=1e-9)


def integrated(ratio: float, angle: float, end: float) -> np.ndarray:
    """Slide, turn, their rates at ``end``."""

    def rate(_: float, y: np.ndarray) -> list[float]:
        s = math.hypot(y[2], RADIUS * y[3])
        c = y[2] / s
        mu = 0.5 * (FORWARD + BACKWARD) + 0.5 * (FORWARD - BACKWARD) * c
        return [y[2], y[3], -mu * G * c, -ratio * mu * G * y[3] / s]

    begin = [0.0, 0.0, math.cos(angle), math.sin(angle) / RADIUS]
    found = solve_ivp(rate, (0.0, end), begin, "DOP853", rtol=1e-12, atol=1e-14)
    return np.array(found.y[:, -1])


@pytest.mark.parametrize("angle", [0.7, 2.2])
def test_slip_that_turns_is_second_order(angle: float) -> None:
    expected = integrated(2.0, angle, 0.2)
    errors = []
    for h in (2e-3, 1e-3, 5e-4, 2.5e-4):
        scene = sleeve(2.0, **turning(angle)).replace({"period": h})
        run = cr.simulate(scene, duration=0.2)
        found = [run["displacement"][-1], RADIUS * run["rotation"][-1], *run["slip_velocity"][-1]]
        errors.append(np.abs(found - expected * [1.0, RADIUS, 1.0, RADIUS]).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 1.9)
    assert errors[-1] < 1e-6
    exact = cr.simulate(sleeve(2.0, "minimal", **turning(angle)), duration=0.2)
    assert exact["displacement"][-1] == pytest.approx(expected[0], abs=1e-9)
    assert exact["rotation"][-1] == pytest.approx(expected[1], abs=1e-7)


@pytest.mark.parametrize("offset", [0.0, 3.0, -1.5])
@pytest.mark.parametrize("method", METHODS)
def test_a_sleeve_is_held_within_its_band(method: str, offset: float) -> None:
    """-mu_b N < F - offset < mu_f N, unsymmetric, shifted by the offset force."""
    weight = MASS * G
    edges = {-1.0: offset - BACKWARD * weight, 1.0: offset + FORWARD * weight}
    near = 1e-6 if method in METHODS[:2] else 1e-2  # stick of the others is elastic or creeps
    for side, edge in edges.items():
        for beyond in (-near, near):
            load = [edge + side * beyond * weight, 0.0, 0.0, 0.0, 0.0, 0.0]
            changes = {"plant.body_b.load": load, "friction.offset_force": offset}
            run = cr.simulate(sleeve(1.0, method, **changes), duration=0.5)
            moved, slides = side * run["displacement"][-1], 0.5 * near * G * 0.5**2
            if method in METHODS[:2]:
                assert moved == pytest.approx(slides if beyond > 0.0 else 0.0, rel=1e-2, abs=1e-15)
                assert (run["regime"][-1] == layout.SLIP) == (beyond > 0.0)
            else:
                assert (moved > 0.7 * slides) == (beyond > 0.0)
            np.testing.assert_allclose(run["force_actuation"], -offset)


def test_sticking_has_the_limit_of_its_direction() -> None:
    """A moment along with the force: P = limit(c) with c the direction that would slip."""
    weight = MASS * G
    for angle in (0.3, 1.2, 2.9):
        mu = 0.5 * (FORWARD + BACKWARD) + 0.5 * (FORWARD - BACKWARD) * math.cos(angle)
        for share, regime in ((1.0 - 1e-9, layout.STICK), (1.0 + 1e-9, layout.SLIP)):
            size = share * mu * weight
            load = [size * math.cos(angle), 0, 0, size * math.sin(angle) * RADIUS, 0, 0]
            changes: dict[str, Any] = {"plant.body_b.load": load}
            run = cr.simulate(sleeve(**changes), duration=0.01)
            assert run["regime"][-1] == regime
            assert run["friction_limit"][0] == pytest.approx(mu * weight, rel=1e-8)


@pytest.mark.parametrize(
    ("inputs", "normal"),
    [(["preload"], 7.0), (["radial"], 20.0), (["bending"], 80.0), (["radial", "preload"], 27.0),
     (["preload", "bending", "radial"], 107.0)],
)  # fmt: skip
def test_only_inputs_press(inputs: list[str], normal: float) -> None:
    """M g = 20 N, 2 M/L = 80 N with M = 4 N.m, FCint = 7 N."""
    for method in METHODS:
        scene = sleeve(1.0, method, **{
            "friction.inputs": inputs, "friction.preload": 7.0, "friction.overlap": 0.1,
            "plant.body_b.load": [0.0, 0.0, 0.0, 0.0, 0.0, 4.0], **turning(0.0),
        })  # fmt: skip
        run = cr.simulate(scene, duration=0.1)
        near = 1e-2 if method in METHODS[3:] else 1e-5  # theirs oscillate about it
        assert run["normal_force"][-50:].mean() == pytest.approx(normal, rel=near)
        assert run["force_friction"][-50:].mean() == pytest.approx(-FORWARD * normal, rel=near)


def test_bending_that_does_not_press_keeps_its_changing_overlap() -> None:
    scene = sleeve(**{
        "friction.inputs": ["radial"], "friction.overlap": 0.1,
        "friction.overlap_change": "decreasing", **turning(0.0),
    })  # fmt: skip
    run = cr.simulate(scene, duration=0.05)
    assert not run["bending_force"].any()
    assert run["normal_force"][-1] == pytest.approx(MASS * G)
    np.testing.assert_allclose(run["overlap"], 0.1 - run["displacement"], atol=1e-3)


@pytest.mark.parametrize("integration", ["exact", "semi_implicit"])
@pytest.mark.parametrize("method", ["impulse", "baumgarte", "penalty", "augmented_lagrangian"])
def test_the_laws_hold(method: str, integration: str) -> None:
    scene = sleeve(2.0, method, **{
        "plant_integration": integration, "body_b.com": [0.02, 0.01, 0.0],
        "friction.overlap": 0.1, "friction.offset_force": 2.0,
        "plant.body_b.load": [9.0, 0.0, 0.0, 0.1, 0.0, 0.0], **turning(2.0),
    })  # fmt: skip
    if method == "impulse":
        scene = scene.replace({"stops.l_max": 0.02, "stops.restitution": 0.5})
    run = simulate(scene, 0.3)
    loads = tuple(float(x) for x in run.plant.loads)
    samples = simulated(scene, method, run.states, run.outs, loads)
    for block, _ in samples.blocks():
        found = residuals.check(block, method)
        assert {
            law: worst for law, r in found.items() if (worst := np.max(np.nan_to_num(r))) > 1e-12
        } == {}


def test_observe_sees_both_coefficients_and_not_the_offset() -> None:
    scene = sleeve(1.0, "minimal", **{"elasticity.k1": 200.0, "friction.offset_force": 1.5,
                                      **turning(0.0, 2.0)})  # fmt: skip
    moved = simulate(scene, 0.6)
    observer = cr.Connector(scene.replace({"method": "observe"}))
    rows = np.zeros((len(moved.states), layout.NSAMPLE))
    rows[:, layout.MOTION], rows[:, layout.LOADS] = moved.states, moved.plant.loads
    seen = observer.run(rows)
    speed, mu = seen[:, layout.VELOCITY], seen[:, layout.FRICTION_COEFFICIENT]
    speed[0] = 0.0  # before the first interval nothing was seen
    for sliding, expected in ((speed > 0.3, FORWARD), (speed < -0.3, BACKWARD)):
        assert sliding.sum() > 20
        assert np.abs(mu[sliding] - expected).max() < 5e-3
        limit = seen[sliding, layout.FRICTION_LIMIT]
        np.testing.assert_allclose(limit, expected * MASS * G, rtol=1e-6)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"coefficient_forward": -0.1}, "coefficient_forward = -0.1: must be a number >= 0"),
        ({"coefficient": 0.2}, "coefficient = 0.2: must not be given together with both"),
        ({"static_coefficient": 0.2, "decay": 1.0}, r"0.25, the mean of both directions"),
        ({"coefficient_forward": math.nan, "coefficient_backward": 0.2,
          "table.rates": [0.0], "table.forces": [1.0], "table.values": [0.3]},
         "coefficient_backward = 0.2: must not be given together with friction.table"),
({"inputs": ["radial", "radial"]}, "each once"),
        ({"inputs": ["weight"]}, r"inputs = \['weight'\]: must be one or more of"),
        ({"inputs": "radial"}, "inputs = 'radial': must be one or more of"),
        ({"offset_force": math.inf}, "offset_force = .inf: must be a number"),
    ],
)  # fmt: skip
def test_values_that_contradict_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(cr.SceneError, match=words):
        sleeve(**{f"friction.{name}": value for name, value in changes.items()})


def test_one_coefficient_of_a_direction_leaves_the_other() -> None:
    friction = cr.Friction(coefficient=0.3, coefficient_forward=0.1, radius=0.02)
    assert friction.by_direction == (0.1, 0.3)
    assert friction.mean_coefficient == pytest.approx(0.2)
    assert friction.direction == pytest.approx(-0.5)
    assert cr.Friction(coefficient_backward=0.1, radius=0.02).on
    assert cr.Friction(coefficient=0.3).direction == 0.0


def test_nothing_that_presses_is_no_friction() -> None:
    """Inputs [preload] without a preload (it may come later): the motion of no friction."""
    between = {"stops.l_min": -0.02, "stops.l_max": 0.02, "stops.restitution": 0.8,
               **turning(1.0)}  # fmt: skip
    idle = cr.simulate(sleeve(**{"friction.inputs": ["preload"], **between}), duration=0.3)
    free = cr.simulate(
        sleeve(
            **{"friction.coefficient_forward": 0.0, "friction.coefficient_backward": 0.0, **between}
        ),
        duration=0.3,
    )
    np.testing.assert_allclose(idle["displacement"], free["displacement"], atol=1e-13)
    np.testing.assert_allclose(idle["rotation"], free["rotation"], rtol=1e-13)
