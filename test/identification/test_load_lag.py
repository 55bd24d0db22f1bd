"""Loads that act at other times than their stamps say, and known parameters that are wrong."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from cylconn_ros.bench.identification import joints, sensors
from cylconn_ros.core import layout
from cylconn_ros.identification.friction import Identification, estimate_friction
from cylconn_ros.identification.load_lag import interpolated
from cylconn_ros.recording.samples import SampleArrays

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def samples() -> SampleArrays:
    return sensors.measured(joints.motion("Coulomb"), "white", 1)


def every(samples: SampleArrays, k: int) -> SampleArrays:
    """Return every k-th sample: a slower sensor."""
    rows = slice(None, None, k)
    stamps = samples.stamps[rows]
    h = np.diff(stamps, prepend=stamps[0]) * 1e-9
    return SampleArrays(stamps, h, samples.restarted[rows], samples.samples[rows])


def found_at(samples: SampleArrays) -> Identification:
    return estimate_friction(dataclasses.replace(joints.scene(), period=0.0), samples)


@pytest.mark.parametrize("rate", [50, 100, 200])
def test_loads_of_a_slow_sensor_are_interpolated(samples: SampleArrays, rate: int) -> None:
    """Held until the next sample they made R 19 % too large at 50 Hz, without a warning."""
    found = found_at(every(samples, 1000 // rate))
    assert found.accepted
    assert "interpolated instead of held" in found.remarks[-1]
    assert found.misfit < 1.5
    assert found["radius"].value == pytest.approx(0.02, rel=0.015)
    assert found["coefficient"].value == pytest.approx(0.2, rel=0.1)


@pytest.mark.parametrize("late", [10, -3])
def test_loads_with_another_clock_are_named(samples: SampleArrays, late: int) -> None:
    rows = samples.samples.copy()
    loads = np.roll(rows[:, layout.LOADS], late, axis=0)
    rows[:, layout.LOADS] = loads
    shifted = SampleArrays(samples.stamps, samples.h, samples.restarted, rows)[20:-20]
    found = estimate_friction(joints.scene(), shifted)
    assert not found.accepted
    way = "after" if late > 0 else "before"
    assert f"ms {way} their stamps" in found.doubts[0]
    size = float(found.doubts[0].split()[2])
    assert size == pytest.approx(abs(late), abs=0.3)


@pytest.mark.parametrize(("late", "accepted"), [(2, True), (-1, True), (6, False)])
def test_an_effort_with_another_clock_is_shifted(
    samples: SampleArrays, late: int, accepted: bool
) -> None:
    """The push and the turn as the effort of a drive; by more than three samples it is refused."""
    rows = samples.samples.copy()
    loads = rows[:, layout.LOADS]
    drive = np.zeros((len(rows), 2))
    drive[1:] = loads[:-1, [6, 9]]
    loads[:, [6, 9]] = 0.0
    kept = slice(20, -20)
    shifted = SampleArrays(samples.stamps, samples.h, samples.restarted, rows)[kept]
    found = estimate_friction(joints.scene(), shifted, None, np.roll(drive, late, axis=0)[kept])
    assert found.accepted == accepted
    text = found.remarks[-1] if accepted else found.doubts[0]
    size = float(text.split("act")[1].split()[1 if accepted else 0])
    assert abs(size) == pytest.approx(abs(late), abs=0.4)
    if accepted:
        assert "shifted by this time" in text
        for name, value in {"coefficient": 0.2, "radius": 0.02}.items():
            assert found[name].value == pytest.approx(value, rel=0.03)


def test_loads_of_a_simulator_stay_held(samples: SampleArrays) -> None:
    found = estimate_friction(joints.scene(), samples)
    assert found.accepted
    assert not found.remarks


@pytest.mark.parametrize(
    ("name", "value", "truth"),
    [("preload", 0.0, 3.0), ("overlap", 0.05, 0.1), ("radius", 0.03, 0.02)],
)
def test_a_known_value_that_the_recording_contradicts_is_named(
    samples: SampleArrays, name: str, value: float, truth: float
) -> None:
    """With a known preload of 0 N mu was 0.231 [0.230, 0.232], without a warning."""
    found = estimate_friction(joints.scene(), samples, {name: value})
    assert not found.accepted
    assert f"contradicts the known {name} = {value:.4g}" in found.doubts[0]
    right = estimate_friction(joints.scene(), samples, {name: truth})
    assert right.accepted


def test_averaged_loads_of_every_second_sample_are_those_of_both_intervals(
    samples: SampleArrays,
) -> None:
    averaged = interpolated(samples[:101])
    thinned = averaged.every_second()
    impulse = [
        (one.samples[:-1, layout.LOADS] * one.h[1:, None]).sum(axis=0)
        for one in (averaged, thinned)
    ]
    assert impulse[1] == pytest.approx(impulse[0], rel=1e-9, abs=1e-12)
