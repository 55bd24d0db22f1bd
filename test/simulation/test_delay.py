"""The simulated delay of wrenches: plant.latency, and latency > 0."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import bundled

import cylconn_ros as cr
from cylconn_ros.core import layout, model
from cylconn_ros.errors import SceneError
from cylconn_ros.simulation.delay import WrenchDelay
from cylconn_ros.simulation.plant import Plant

Array = NDArray[np.float64]


def late(name: str, latency: int, delay: float = math.nan, **changes: Any) -> cr.Scene:
    """A bundled scene with method impulse, the declared latency and the plant's delay."""
    scene = dataclasses.replace(bundled(name), method="impulse", latency=latency, **changes)
    return dataclasses.replace(scene, plant=dataclasses.replace(scene.plant, latency=delay))


def end_error(scene: cr.Scene, start: float, end: float) -> float:
    """Error of slide and rotation (m) at ``end`` against the solution from the state at ``start``.

    The wrenches of the first periods do not act, so that the motion from t = 0 is another one.
    """
    run = cr.simulate(scene, duration=end)
    first, h = round(start / scene.period), scene.period
    state = run.states[first]
    bodies = [
        dataclasses.replace(
            body, pose=tuple(state[at : at + 7]), twist=tuple(state[at + 7 : at + 13])
        )
        for body, at in ((scene.plant.body_a, 0), (scene.plant.body_b, 13))
    ]
    plant = dataclasses.replace(scene.plant, body_a=bodies[0], body_b=bodies[1])
    exact = dataclasses.replace(scene, method="minimal", latency=0, plant=plant)
    solution = cr.simulate(exact, samples=round((end - start) / h) + 1)
    moved = run.outs[-1] - run.outs[first]
    expected = solution.outs[-1] - solution.outs[0]
    arm = scene.friction.radius
    slid = moved[layout.LENGTH] - expected[layout.LENGTH]
    turned = moved[layout.ANGLE] - expected[layout.ANGLE]
    return float(math.hypot(slid, arm * turned))


@pytest.mark.parametrize("latency", [1, 3, 8])
@pytest.mark.parametrize("name", ["demo", "eccentric_rotor"])
def test_a_delay_leaves_the_accuracy(name: str, latency: int) -> None:
    """Order 2 with a declared delay, and an error as without it."""
    errors, without = [], []
    for h in (2e-3, 1e-3, 5e-4):
        errors.append(end_error(late(name, latency, period=h), 0.1, 0.5))
        without.append(end_error(late(name, 0, period=h), 0.1, 0.5))
    assert math.log2(errors[0] / errors[-1]) / 2.0 > 1.7
    assert errors[-1] < 4.0 * without[-1]


@pytest.mark.parametrize("delay", [0.4, 1.0, 2.0, 2.75])
@pytest.mark.parametrize(
    "changes",
    [{}, {"plant_integration": "semi_implicit"}, {"wrench": cr.Wrench(axes="body", hold="body")}],
    ids=["exact", "semi_implicit", "held in body axes"],
)
def test_the_loop_and_the_node_delay_alike(delay: float, changes: dict[str, Any]) -> None:
    """The compiled loop and the plant node's queue give the same bits."""
    scene = late("demo", round(delay), delay, **changes)
    run = cr.simulate(scene, samples=50)
    plant, connector = Plant(scene), cr.Connector(scene)
    queue, sample = WrenchDelay(plant, delay), np.zeros(layout.NSAMPLE)
    for k in range(50):
        np.testing.assert_array_equal(plant.state, run.states[k])
        sample[layout.MOTION], sample[layout.LOADS] = plant.state, plant.loads
        out = connector.step(sample)
        queue.put(0, plant.time_ns, out[0:6])
        queue.put(1, plant.time_ns, out[6:12])
        queue.step()
    assert plant.steps == 50


@pytest.mark.parametrize("delay", [1.0, 2.5])
def test_a_wrench_acts_from_its_time_on(delay: float) -> None:
    """The momentum of a free body under constant wrenches, zero before the first acts."""
    scene = late("coast", 0, delay)
    plant, h = Plant(scene), scene.period
    queue, force = WrenchDelay(plant, delay), np.array([3.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    start = plant.momentum()[0]
    for k in range(6):
        queue.put(1, plant.time_ns, force)
        queue.step()
        acted = max(k + 1 - delay, 0.0) * h
        assert plant.momentum()[0] - start == pytest.approx(3.0 * acted, abs=1e-14)


def test_a_wrench_that_arrives_later_acts_at_once() -> None:
    """Free running: the wrench of sample 0 arrives after three periods, the delay is one."""
    scene = late("coast", 0, 1.0)
    plant, h = Plant(scene), scene.period
    queue, start = WrenchDelay(plant, 1.0), plant.momentum()[0]
    for k in range(5):
        if k == 3:
            queue.put(1, 0, np.array([3.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
        queue.step()
    assert plant.momentum()[0] - start == pytest.approx(3.0 * 2 * h, abs=1e-14)


def test_a_delay_that_is_not_declared_is_simulated() -> None:
    """plant.latency alone: the connector is not told, and its wrenches add energy."""
    told, not_told = (cr.simulate(late("demo", n, 2.0), samples=120) for n in (2, 0))
    assert told["offset_violation"][60:].max() < 1e-6
    assert not not_told["offset_violation"].max() < 1e-3


def test_no_delay_leaves_the_bits() -> None:
    """plant.latency = 0 and latency <= 0 are the loop without a delay."""
    plain = cr.simulate(late("demo", 0), samples=100)
    zero = cr.simulate(late("demo", 0, 0.0), samples=100)
    np.testing.assert_array_equal(plain.outs, zero.outs)
    assert late("demo", -1).plant_latency == late("demo", 0).plant_latency == 0.0
    assert late("demo", 3).plant_latency == 3.0
    assert late("demo", 3, 0.5).plant_latency == 0.5


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"method": "minimal"}, "latency = 2.0: must be 0 for a motion"),
        ({"method": "auto", "tolerance": 1e-6}, "latency = 2.0: must be 0 for a motion"),
    ],
)
def test_a_motion_without_wrenches_has_no_delay(changes: dict[str, Any], message: str) -> None:
    """The method minimal and a tolerance refuse a delay."""
    with pytest.raises(SceneError, match=message):
        cr.simulate(dataclasses.replace(late("demo", 2), **changes), samples=10)


def test_a_delay_has_a_bound() -> None:
    """A delay beyond any simulator is a mistake in the unit."""
    with pytest.raises(
        SceneError, match=r"plant.latency = 1000000000.0: must be at most 1000 samples"
    ):
        late("demo", 0, 1e9)


@pytest.mark.parametrize("name", ["demo", "hub_and_rotor", "end_stop"])
def test_the_loop_has_no_latency_to_measure(name: str) -> None:
    """In lock step the outputs are those of a connector that measures the latency: same bits."""
    scene = bundled(name)
    assert scene.latency == -1
    run = cr.simulate(scene, samples=300)
    assert run.connector.par[model.LATENCY] == 0.0
    samples = np.zeros((300, layout.NSAMPLE))
    samples[:, layout.MOTION] = run.states
    samples[:, layout.LOADS] = run.plant.loads
    np.testing.assert_array_equal(cr.Connector(scene).run(samples), run.outs)
    late = cr.simulate(scene.replace({"plant.latency": 1.0}), samples=2)
    assert late.connector.par[model.LATENCY] == model.MEASURED
