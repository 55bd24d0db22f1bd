"""Friction of a joint whose overlap changes with the slide, and whose contact's middle moves."""

from __future__ import annotations

import os

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom

from cylconn_ros.bench.identification import joints, sensors
from cylconn_ros.core import overlap
from cylconn_ros.identification.forces.contact import contact_of
from cylconn_ros.identification.friction import estimate_friction
from cylconn_ros.scene.packing import pack

Array = NDArray[np.float64]

# 200 in the long form: IDENTIFY_SEEDS=200.
SEEDS = int(os.environ.get("IDENTIFY_SEEDS", "10"))
TRUTH = {"coefficient": 0.2, "preload": 3.0, "overlap": 0.5, "radius": 0.02}


@pytest.fixture(scope="module")
def telescope() -> Array:
    """Exact samples of a telescope."""
    return joints.motion(joints.TELESCOPE)


@pytest.mark.parametrize("change", ["increasing", "decreasing", "constant"])
@pytest.mark.parametrize("centre", ["auto", "body_a", "between"])
def test_the_contact_is_that_of_the_step(change: str, centre: str) -> None:
    scene = sensors.scene(
        coefficient=0.2, radius=0.02, overlap=0.3, overlap_change=change, overlap_at=0.1,
        overlap_min=0.05, overlap_max=0.6, contact_centre=centre,
    )  # fmt: skip
    contact = contact_of(scene, np.nan)
    lengths: Array = np.linspace(-0.6, 0.8, 14, dtype=np.float64)
    expected = [overlap.contact_range(pack(scene), 0.0, length) for length in lengths]
    bending = 2.0 / np.array([one.overlap for one in expected])
    assert contact.bending(2.0 / 0.3, lengths) == pytest.approx(bending)
    step = 1e-6
    ends = [contact.bending(2.0 / 0.3 + sign * step, lengths) for sign in (1.0, -1.0)]
    slope = (ends[0] - ends[1]) / (2.0 * step)
    assert contact.slope(2.0 / 0.3, lengths) == pytest.approx(slope, abs=1e-6)
    wrench = np.arange(1.0, 7.0) * np.ones((14, 1))
    arm = np.array([one.centre for one in expected])
    moved = contact.about_middle(wrench, lengths)
    assert moved[:, 4] == pytest.approx(5.0 - arm * 3.0)
    assert moved[:, 5] == pytest.approx(6.0 + arm * 2.0)


def test_all_parameters_are_found_within_their_intervals(telescope: Array) -> None:
    inside = dict.fromkeys(TRUTH, 0)
    for seed in range(SEEDS):
        samples = sensors.measured(telescope, "white", seed)
        found = estimate_friction(joints.scene(joints.TELESCOPE), samples)
        assert found.accepted
        assert "the recording shows friction.overlap_change = increasing" in found.verdict()[-1]
        assert found["overlap"].note == "at the slide 0 m"
        for name, value in TRUTH.items():
            inside[name] += found[name].low <= value <= found[name].high
            assert found[name].value == pytest.approx(value, rel=0.2)
    assert min(inside.values()) >= binom.ppf(1e-3, SEEDS, 0.95)


@pytest.mark.parametrize(
    "stated",
    [
        {"overlap": 0.4},
        {"overlap": 5.0, "overlap_change": "decreasing", "overlap_at": 0.0},
        {"overlap": 0.4, "contact_centre": "body_a", "overlap_at": 0.0},
    ],
    ids=["constant", "decreasing", "other centre"],
)
def test_another_change_than_that_of_the_joint_is_rejected(
    telescope: Array, stated: dict[str, float | str]
) -> None:
    scene = sensors.scene(coefficient=0.1, radius=0.025, **stated)
    found = estimate_friction(scene, sensors.measured(telescope, "white", 1))
    assert not found.accepted
    assert np.isnan(found["coefficient"].value)


def test_a_change_that_the_joint_has_not_is_named() -> None:
    samples = sensors.measured(joints.motion("Coulomb"), "white", 1)
    found = estimate_friction(joints.scene(joints.TELESCOPE), samples)
    assert not found.accepted
    assert "a constant overlap describes the recording better" in found.verdict()[0]
