"""Loads of slow windows are not biased, and a recording that is sampled too slowly is named."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cylconn_ros.bench.identification import joints, sensors
from cylconn_ros.identification.forces.intervals import measure_intervals
from cylconn_ros.identification.friction import estimate_friction
from cylconn_ros.identification.likelihood.law import slip
from cylconn_ros.identification.slips import prepare


def test_the_load_of_slow_windows_is_not_that_of_all_windows() -> None:
    """It was 0.4 N too large where this motion is slow: Stribeck friction was too small."""
    rows, errors = joints.motion("Stribeck"), []
    for seed in range(40):
        samples = sensors.measured(rows, "uneven stamps", seed)
        data = prepare(measure_intervals(joints.scene(), samples), 0.02).data
        radial = np.hypot(14.0 * np.sin(3.1 * data.windows.time), sensors.WEIGHT)
        slow = slip(data.windows.rates, 0.02)[0] < 0.12
        errors += (data.loads[:, 0] - radial)[slow].tolist()
    assert len(errors) > 100
    assert abs(np.mean(errors)) < 0.2


@pytest.mark.parametrize(("step", "slow"), [(5, False), (20, True)])
def test_a_recording_that_is_sampled_too_slowly_is_named(
    step: int, slow: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A motion of 1 Hz at 200 and 50 Hz: at 50 Hz R was off by more than its interval."""
    monkeypatch.setattr(joints, "SAMPLES", 20_000)
    rows = joints.motion("Coulomb")[::step]
    monkeypatch.setattr(sensors, "PERIOD", 1e-3 * step)
    scene = dataclasses.replace(joints.scene(), period=1e-3 * step)
    found = estimate_friction(scene, sensors.measured(rows, "white", 1))
    assert found.accepted != slow
    if slow:
        assert "sampled too slowly" in found.doubts[0]
        assert "record at more than 100 Hz (seen: 50 Hz)" in found.doubts[0]


def test_loads_that_are_held_are_no_error_of_the_sample_period() -> None:
    """Of every second sample they are half a period late: intervals were 2.3 times too wide."""
    samples = sensors.measured(joints.motion("with offset"), "white", 1)
    mu = estimate_friction(joints.scene(), samples)["coefficient"]
    assert mu.low < 0.2 < mu.high
    assert mu.high - mu.low < 0.012
