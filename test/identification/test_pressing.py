"""What presses shaft and sleeve: a commanded preload, and parts of the normal force left out."""

from __future__ import annotations

import dataclasses
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from cylconn_ros.bench.identification import joints, sensors
from cylconn_ros.errors import IdentifyError
from cylconn_ros.identification.forces.drives import commanded_preload
from cylconn_ros.identification.friction import Identification, estimate_friction
from cylconn_ros.recording.run import Run
from cylconn_ros.recording.samples import SampleArrays
from cylconn_ros.scene.scene import Scene

TIME: NDArray[np.float64] = np.arange(joints.SAMPLES, dtype=np.float64) * sensors.PERIOD
STEPS: NDArray[np.float64] = np.where(TIME // 0.7 % 2 == 0, 2.0, 9.0)
WAVE: NDArray[np.float64] = 4.0 + 3.0 * np.sin(2.1 * TIME)


def inside(found: Identification, truth: dict[str, float]) -> bool:
    assert found.accepted, found.doubts
    return all(abs(found[n].value - v) < found[n].high - found[n].low for n, v in truth.items())


def drive(pressed: NDArray[np.float64]) -> NDArray[np.float64]:
    columns = np.zeros((len(pressed), 3))
    columns[:, 2] = np.r_[pressed[:1], pressed[:-1]]
    return columns


@pytest.mark.parametrize("pressed", [STEPS, WAVE], ids=["steps", "wave"])
def test_a_commanded_preload_is_a_known_input(pressed: NDArray[np.float64]) -> None:
    samples = sensors.measured(joints.motion("Coulomb", pressed), "white", 0)
    found = estimate_friction(joints.scene(), samples, drive=drive(pressed))
    assert inside(found, {"coefficient": 0.2, "overlap": 0.1, "radius": 0.02})
    assert not found["preload"].found
    assert "commanded" in found["preload"].note
    mu = found["coefficient"]
    assert mu.high - mu.low < 0.003  # a constant preload, estimated beside it: 0.006
    # Without the command the recording is refused, and with a wrong one too.
    assert not estimate_friction(joints.scene(), samples).accepted
    wrong = estimate_friction(joints.scene(), samples, drive=drive(pressed - 1.5))
    assert "contradicts that preload is commanded" in wrong.doubts[0]


def test_its_value_is_in_force_from_the_next_sample_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Poses at 0 to 3 ms; 5 N are commanded after the one at 1 ms."""
    rows = SampleArrays(
        np.arange(4) * 1_000_000, np.full(4, 1e-3), np.zeros(4, np.bool_), np.zeros((4, 1))
    )
    module = "cylconn_ros.identification.forces.drives"
    times, values = np.array([1_500_000]), np.array([5.0])
    monkeypatch.setattr(f"{module}.preloads", lambda _: (times, values))
    monkeypatch.setattr(f"{module}.in_force", lambda *_: np.array([-1, -1, 0, 0]))
    found = commanded_preload(cast(Run, None), rows, 3.0)
    assert found is not None
    assert found.tolist() == [3.0, 3.0, 3.0, 5.0]


def scene(inputs: tuple[str, ...], preload: float = 3.0) -> Scene:
    base = joints.scene()
    friction = dataclasses.replace(base.friction, inputs=inputs, preload=preload)
    return dataclasses.replace(base, friction=friction)


@pytest.mark.parametrize(
    ("inputs", "truth"),
    [
        (("radial", "preload"), {"coefficient": 0.2, "preload": 3.0, "radius": 0.02}),
        (("radial", "bending"), {"coefficient": 0.2, "overlap": 0.1, "radius": 0.02}),
        # Only mu/L shows, and mu FCint: mu is that of the overlap of the scene, 0.08 m.
        (("bending", "preload"), {"coefficient": 0.16, "preload": 3.75, "radius": 0.02}),
        (("bending",), {"coefficient": 0.16, "radius": 0.02}),
        (("preload",), {"coefficient": 0.2, "radius": 0.02}),
    ],
)
def test_parts_left_out_of_the_normal_force(
    inputs: tuple[str, ...], truth: dict[str, float]
) -> None:
    samples = sensors.measured(joints.motion("Coulomb", None, inputs), "white", 0)
    found = estimate_friction(scene(inputs), samples)
    assert inside(found, truth)
    left_out = {"bending": "overlap", "preload": "preload"}
    for name, parameter in left_out.items():
        assert ("left out" in found[parameter].note) == (name not in inputs)
    if inputs == ("preload",):
        with pytest.raises(IdentifyError, match="nothing presses"):
            estimate_friction(scene(inputs, 0.0), samples)


def test_a_preload_that_presses_although_it_is_left_out_is_seen() -> None:
    samples = sensors.measured(joints.motion("Coulomb"), "white", 0)
    found = estimate_friction(scene(("radial", "bending")), samples)
    assert "contradicts that preload is left out" in found.doubts[0]
