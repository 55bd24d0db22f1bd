"""The compiled search of a fit is the same as the functions of arrays that it stands for."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from cylconn_ros.bench.identification import joints, sensors
from cylconn_ros.core.jit import COMPILED
from cylconn_ros.identification.forces.intervals import measure_intervals
from cylconn_ros.identification.likelihood import kinetic, windows_kernel
from cylconn_ros.identification.likelihood.contact_loads import Calibrated
from cylconn_ros.identification.likelihood.law import NAMES, law_from_vector
from cylconn_ros.identification.slips import prepare, start_law

MODELS = ["all", joints.TELESCOPE]


def _data(model: str) -> Calibrated:
    samples = sensors.measured(joints.motion(model), "white", 1)
    return prepare(measure_intervals(joints.scene(model), samples), 0.02).data


@pytest.mark.parametrize("model", MODELS)
def test_weights_residuals_and_slopes_are_those_of_the_arrays(model: str) -> None:
    data = _data(model)
    law = dataclasses.replace(
        start_law(joints.scene(model), {}), c1=1.5, cr1=2e-3, direction=0.1, offset=0.7,
        stribeck=0.4, decay=6.0, preload=2.0,
    )  # fmt: skip
    every = list(range(len(NAMES)))
    scale: NDArray[np.float64] = np.linspace(0.5, 1.5, len(NAMES), dtype=np.float64)
    n, values = len(data), law.values
    (bending, slope), limit = data.bendings(law.bending), np.empty(n)
    weights, residuals, slopes = np.empty((n, 4)), np.empty(2 * n), np.empty((2 * n, len(every)))
    windows_kernel.limits(data.table, bending, values, limit)
    floor = kinetic._least_variance(limit)
    windows_kernel.evaluate(
        data.table, bending, slope, values, floor, np.array(every), scale, weights, residuals,
        slopes,
    )  # fmt: skip
    inverse, _ = kinetic.factors(data, law)
    expected = kinetic.weighted_residuals(data, law, inverse)
    assert weights.reshape(-1, 2, 2) == pytest.approx(inverse, rel=1e-11, abs=1e-12)
    assert residuals.reshape(-1, 2) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    square = windows_kernel.squares(data.table, bending, values, weights)
    assert square == pytest.approx(np.square(expected).sum())
    derivatives = -np.einsum("nij,njk->nik", inverse, kinetic.slopes_of(data, law, every)) * scale
    assert slopes.reshape(derivatives.shape) == pytest.approx(derivatives, rel=1e-9, abs=1e-9)
    for k in every:  # and these are derivatives
        step = np.zeros(len(NAMES))
        step[k] = 1e-6 * max(abs(law.vector[k]), 1.0)
        ends = [kinetic.friction_of(data, law_from_vector(law.vector + d)) for d in (step, -step)]
        exact = (ends[0] - ends[1]) / (2.0 * step[k])
        column = kinetic.slopes_of(data, law, [k])[:, :, 0]
        assert column == pytest.approx(exact, rel=1e-5, abs=1e-6), NAMES[k]


@pytest.mark.skipif(not COMPILED, reason="no compiler is installed")
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    "free", [(0,), (0, 1, 2, 3), (0, 1, 2, 3, 4, 6, 7, 8, 9), (0, 1, 2, 3, 8, 9)]
)
def test_search_finds_the_law_of_the_arrays(
    model: str, free: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    data, start = _data(model), start_law(joints.scene(model), {})
    # The last one: without Stribeck friction its decay has no effect, so that the step is singular.
    start = dataclasses.replace(start, stribeck=0.3 if len(free) > 6 else 0.0, decay=5.0)
    found = kinetic.searched(data, start, list(free), 3)
    monkeypatch.setattr(kinetic, "COMPILED", False)
    expected = kinetic.searched(data, start, list(free), 3)
    assert found.values == pytest.approx(expected.values, rel=1e-8, abs=1e-10)
