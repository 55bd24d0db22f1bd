"""Method impulse at its limits: bad samples, limited wrenches, correction, undersampling."""

import dataclasses
import math

import numpy as np
import pytest
from scenes import about_y, pair, sleeve

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.simulate import simulate

FRICTION = {"coefficient": 0.2, "radius": 0.02, "overlap": 0.1, "preload": 0.5}


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e200])
def test_extreme_numbers_in_a_sample_are_handled(value: float) -> None:
    scene = pair(friction=FRICTION, latency=0)
    good = np.concatenate([Plant(scene).state, np.zeros(12)])
    for field in range(layout.NSAMPLE):
        connector = Connector(scene)
        first = connector.step(good).copy()
        bad = good.copy()
        bad[field] = value
        memory = connector.memory
        out = connector.step(bad)
        assert out[layout.STATUS] == layout.NOT_FINITE
        assert not np.any(out[: layout.STATE0])
        assert np.all(np.isfinite(out))
        np.testing.assert_array_equal(connector.memory, memory)
        assert np.all(np.isfinite(first))


@pytest.mark.parametrize("size", [0.0, 5e-324, 1e-200, 1e-7])
def test_a_zero_quaternion_is_refused(size: float) -> None:
    scene = pair(friction=FRICTION)
    for at in (3, 16):
        sample = np.concatenate([Plant(scene).state, np.zeros(12)])
        sample[at : at + 4] *= size
        out = Connector(scene).step(sample)
        assert out[layout.STATUS] == layout.BAD_QUATERNION
        assert not np.any(out[: layout.STATE0])


def test_a_long_quaternion_is_normalised() -> None:
    scene = pair(friction=FRICTION)
    sample = np.concatenate([Plant(scene).state, np.zeros(12)])
    expected = Connector(scene).step(sample)
    sample[3:7] *= 1.7
    sample[16:20] *= 0.4
    np.testing.assert_allclose(Connector(scene).step(sample), expected, atol=1e-12)


def test_without_a_period_there_is_no_wrench() -> None:
    scene = dataclasses.replace(pair(), period=0.0)
    sample = np.concatenate([Plant(pair()).state, np.zeros(12)])
    assert Connector(scene).step(sample)[layout.STATUS] == layout.NO_PERIOD
    assert Connector(scene).step(sample, 1e-3)[layout.STATUS] == layout.OK


def test_limits_scale_both_wrenches_by_one_factor() -> None:
    scene = pair(friction=FRICTION)
    sample = np.concatenate([Plant(scene).state, np.zeros(12)])
    free = Connector(scene).step(sample)
    limited = dataclasses.replace(scene, limits=dataclasses.replace(scene.limits, force=1.0))
    out = Connector(limited).step(sample)
    assert np.linalg.norm(out[layout.FORCE_B : layout.FORCE_B + 3]) == pytest.approx(1.0)
    factor = out[layout.FORCE_B] / free[layout.FORCE_B]
    np.testing.assert_allclose(out[: layout.STATE0], factor * free[: layout.STATE0], rtol=1e-12)
    assert int(out[layout.FLAGS]) & layout.LIMITED
    np.testing.assert_array_equal(
        out[layout.FORCE : layout.FORCE + 6], free[layout.FORCE : layout.FORCE + 6]
    )


def test_the_correction_rate_of_a_large_misalignment_is_bounded() -> None:
    tilt = math.radians(20.0)
    scene = sleeve(
        node_b={"orientation": [0.0, 0.0, 0.0, 1.0]},
        reference={"misalignment": "zero", "pull_in_rate": 1.0},
        gravity=[0.0, 0.0, 0.0],
    )
    values = {**scene.parameters(), "plant.body_b.pose": [0.2, 0.0, 0.0, *about_y(tilt)]}
    scene = Scene.from_parameters(values)
    found = simulate(scene, samples=round(2.0 / scene.period) + 1)
    assert found["angular_violation"][0] == pytest.approx(tilt)
    assert found["spin_violation"].max() < 1.1
    assert found["angular_violation"][-1] < 1e-9
    assert int(found.outs[0, layout.FLAGS]) & layout.MISALIGNED


def test_undersampled_rotation_is_flagged_and_bounded() -> None:
    scene = sleeve(com=(0.03, 0.02, 0.01), spin=600.0, friction=FRICTION)
    found = simulate(scene, samples=round(0.3 / scene.period) + 1)
    assert int(found.outs[0, layout.FLAGS]) & layout.UNDERSAMPLED
    assert found.energy[-1] < found.energy[0]
    assert found["offset_violation"].max() < 2e-3
