"""The compiled loop of a fit is the same as the functions of arrays that it stands for."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from cylconn_ros.bench.identification import joints, sensors
from cylconn_ros.core.jit import COMPILED
from cylconn_ros.identification.forces.intervals import measure_intervals
from cylconn_ros.identification.likelihood import kinetic
from cylconn_ros.identification.likelihood.law import NAMES, law_from_vector
from cylconn_ros.identification.slips import prepare, start_law


@pytest.mark.skipif(not COMPILED, reason="no compiler is installed")
@pytest.mark.parametrize("model", ["all", joints.TELESCOPE])
def test_weights_residuals_and_slopes_are_those_of_the_arrays(model: str) -> None:
    scene = joints.scene(model)
    samples = sensors.measured(joints.motion(model), "white", 1)
    data = prepare(measure_intervals(scene, samples), 0.02).data
    law = dataclasses.replace(
        start_law(scene, {}), c1=1.5, cr1=2e-3, direction=0.1, offset=0.7, stribeck=0.4, decay=6.0,
        preload=2.0,
    )  # fmt: skip
    every = list(range(len(NAMES)))
    scale: NDArray[np.float64] = np.linspace(0.5, 1.5, len(NAMES), dtype=np.float64)
    found = kinetic._linearised(data, law, every, scale)
    inverse, _ = kinetic.factors(data, law)
    residuals = kinetic.weighted_residuals(data, law, inverse)
    assert found[0].reshape(-1, 2, 2) == pytest.approx(inverse, rel=1e-11, abs=1e-12)
    assert found[1].reshape(-1, 2) == pytest.approx(residuals, rel=1e-9, abs=1e-9)
    assert kinetic._square(data, law, found[0]) == pytest.approx(np.square(residuals).sum())
    slopes = -np.einsum("nij,njk->nik", inverse, kinetic.slopes_of(data, law, every)) * scale
    assert found[2].reshape(slopes.shape) == pytest.approx(slopes, rel=1e-9, abs=1e-9)
    for k in every:  # and these are derivatives
        step = np.zeros(len(NAMES))
        step[k] = 1e-6 * max(abs(law.vector[k]), 1.0)
        ends = [kinetic.friction_of(data, law_from_vector(law.vector + d)) for d in (step, -step)]
        exact = (ends[0] - ends[1]) / (2.0 * step[k])
        column = kinetic.slopes_of(data, law, [k])[:, :, 0]
        assert column == pytest.approx(exact, rel=1e-5, abs=1e-6), NAMES[k]
