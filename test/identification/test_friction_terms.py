"""Choice of the friction model, known drives, an axis from its effort, tables and advice."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from test_identify import evenly, measured, pushed

from cylconn_ros.bench.identification import axis, coverage, joints, sensors
from cylconn_ros.cli.main import main
from cylconn_ros.errors import IdentifyError
from cylconn_ros.identification.advice import advice, feed_forward
from cylconn_ros.identification.effort import AxisRecording, estimate_axis
from cylconn_ros.identification.forces.pose_twists import twists_from_poses
from cylconn_ros.identification.friction import estimate_friction
from cylconn_ros.identification.recording import identify
from cylconn_ros.recording.samples import SampleArrays


def test_friction_by_direction_does_not_make_the_normal_force_vanish() -> None:
    """Without the determinant and the calibration of loads, mu was 220 here."""
    rows = joints.motion("by direction")
    found = estimate_friction(joints.scene(), sensors.measured(rows, "white", 1))
    assert found.choice.terms == ("difference by direction",)
    assert found["coefficient"].value == pytest.approx(0.2, rel=0.05)
    assert found["coefficient_positive"].value == pytest.approx(0.24, rel=0.05)
    assert "holds: Coulomb, difference by direction" in found.verdict()[0]


@pytest.mark.parametrize("seed", [100, 103])
def test_several_missing_terms_do_not_hide_each_other(seed: int) -> None:
    """One by one none enters: the misfit of the others widens the interval of each."""
    rows = joints.motion("all")
    found = estimate_friction(joints.scene(), sensors.measured(rows, "coloured", seed))
    assert found.accepted
    assert set(found.choice.terms) == {
        "viscous friction of the slide", "difference by direction", "offset force",
        "Stribeck decay",
    }  # fmt: skip
    truth = {"coefficient": 0.2, "radius": 0.02, "c1": 2.0, "offset": 1.0, "stribeck": 0.5}
    for name, value in truth.items():
        assert found[name].low <= value <= found[name].high, name


def test_a_term_that_a_later_one_explains_leaves() -> None:
    """Viscous friction of the spin enters before R is free, and is not needed afterwards."""
    rows = joints.motion("all")
    found = estimate_friction(joints.scene(), sensors.measured(rows, "white", 1))
    assert "viscous friction of the spin" not in found.choice.terms
    assert any("viscous friction of the spin" in terms for terms, _ in found.choice.steps)


def test_friction_that_no_term_describes_is_rejected_and_has_no_numbers() -> None:
    """A friction that depends on the place in the slot."""
    rows = joints.motion("Coulomb")
    places = rows[:, 13]
    drive = np.zeros((len(rows), 2))
    drive[:, 0] = 3.0 * np.sin(1.5 * places)
    found = estimate_friction(joints.scene(), sensors.measured(rows, "white", 1), drive=drive)
    assert not found.accepted
    assert math.isnan(found["coefficient"].value)
    assert "model rejected" in found["coefficient"].note
    assert found.verdict()[0].startswith("do not use")
    with pytest.raises(IdentifyError, match="no table"):
        feed_forward(found, ".csv")


def test_a_stribeck_decay_that_the_parameters_state_is_estimated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Slip slower than 5/decay was left out: nothing remained of this motion."""
    bag = tmp_path / "bag"
    assert main(["simulate", "stribeck_coast", "-o", str(bag)]) == 0
    capsys.readouterr()
    found = identify(bag)
    assert found.accepted
    assert found.choice.terms == ("Stribeck decay",)
    for name, value in {"coefficient": 0.1, "stribeck": 1.5, "decay": 4.0}.items():
        assert found[name].value == pytest.approx(value, rel=1e-3)
        assert found[name].low <= value <= found[name].high


@pytest.mark.parametrize(
    ("seed", "reason"),
    [
        (3, "the recording demands Stribeck decay"),
        (1, "the recording contradicts preload = 0, assumed"),
    ],
)
def test_slow_slip_that_is_lost_in_the_noise_withholds_the_values(seed: int, reason: str) -> None:
    """Mu was 15 % too large, and nothing said so."""
    samples = sensors.measured(joints.motion("Stribeck"), "poses only", seed)
    scene = dataclasses.replace(joints.scene(), period=0.0)
    found = estimate_friction(scene, twists_from_poses(samples, 80.0).samples)
    assert not found.accepted
    assert reason in found.verdict()[0]


def test_a_known_drive_is_not_friction() -> None:
    scene, motion = pushed(None)
    drive = np.zeros((len(motion), 2))
    drive[1:] = motion[:-1][:, [32, 35]]
    motion[:, [32, 35]] = 0.0
    found = estimate_friction(scene, evenly(measured(motion, 1)), drive=drive)
    assert found["coefficient"].low <= 0.2 <= found["coefficient"].high


def test_an_axis_from_positions_and_effort_alone() -> None:
    recording = axis.simulate(seed=3)
    halves = [
        AxisRecording(recording.time[part], recording.position[part], recording.effort[part])
        for part in (slice(0, 12000), slice(12000, None))
    ]
    for given in ([recording], halves):
        found = estimate_axis(given)
        for name, value in axis.TRUTH.items():
            assert found[name][0] == pytest.approx(value, rel=0.01), name
    still = dataclasses.replace(recording, position=0.0 * recording.position)
    with pytest.raises(IdentifyError, match="0 windows"):
        estimate_axis([still])


def test_a_constant_force_that_was_not_recorded_is_an_offset() -> None:
    recording = axis.simulate(seed=3)
    found = estimate_axis([recording])
    biased = estimate_axis([dataclasses.replace(recording, effort=recording.effort + 5.0)])
    moved = biased.value - found.value
    assert moved[3] == pytest.approx(5.0, abs=1e-6)
    assert moved[:3] == pytest.approx(np.zeros(3), abs=1e-6)
    assert biased.residual == pytest.approx(found.residual, rel=1e-3)


def test_a_table_and_advice() -> None:
    rows = joints.motion("viscous")
    found = estimate_friction(joints.scene(), sensors.measured(rows, "white", 1), {"radius": 0.02})
    table = np.array(
        [
            [float(x) for x in line.split(",")]
            for line in feed_forward(found, ".csv").splitlines()[1:]
        ]
    )
    slope = (table[-1, 1] - table[-2, 1]) / (table[-1, 0] - table[-2, 0])
    assert slope == pytest.approx(2.0, rel=0.05)
    assert "feed_forward:" in feed_forward(found, ".yaml")
    (next_motion,) = advice(found)  # everything is determined, as far as the parameters hold
    assert "at another inclination" in next_motion


def test_samples_of_the_study_are_what_they_say() -> None:
    samples = sensors.measured(joints.motion("Coulomb"), "uneven stamps", 1)
    assert isinstance(samples, SampleArrays)
    assert np.ptp(samples.h[1:]) > 0.5e-3
    draw = coverage.draw((coverage.AXIS, "encoder", 1), {})
    assert {f"identify/{name}" for name in axis.TRUTH} < set(draw)
