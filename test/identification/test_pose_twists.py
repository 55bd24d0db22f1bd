"""Twists from poses, for recordings that have none."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from test_inertia import _write, write_joint

from cylconn_ros.bench.identification import joints, sensors
from cylconn_ros.cli.main import main
from cylconn_ros.core import layout
from cylconn_ros.errors import IndeterminateError
from cylconn_ros.identification.forces.pose_twists import has_no_twists, twists_from_poses
from cylconn_ros.recording.samples import SampleArrays

TRUTH = {"coefficient": 0.2, "preload": 3.0, "overlap": 0.1, "radius": 0.02}
RNG = np.random.default_rng(1)


def pushed(n: int = 400) -> SampleArrays:
    """A mass of 2 kg under random forces that are held over uneven intervals, exact."""
    h = RNG.uniform(0.8e-3, 1.2e-3, n)
    h[0] = 0.0
    rows = np.zeros((n, layout.NSAMPLE))
    rows[:, [layout.A_POSE + 6, layout.B_POSE + 6]] = 1.0
    force = RNG.normal(size=(n, 3))
    x, v = np.zeros(3), np.array([1.0, 0.5, -0.3])
    for k in range(n):
        if k:
            a = force[k - 1] / 2.0
            x, v = x + h[k] * v + 0.5 * h[k] ** 2 * a, v + h[k] * a
        rows[k, layout.B_POSE : layout.B_POSE + 3] = x
        rows[k, layout.B_TWIST : layout.B_TWIST + 3] = v
    rows[:, layout.LOADS][:, 6:9] = force
    stamps = np.round(np.cumsum(h) * 1e9).astype(np.int64)
    return SampleArrays(stamps, np.diff(stamps, prepend=stamps[0]) * 1e-9, np.zeros(n, bool), rows)


def test_momentum_of_averaged_twists_and_loads_balances() -> None:
    samples = pushed()
    drive = np.zeros((len(samples), 2))
    drive[1:, 0] = samples.samples[:-1, layout.LOADS][:, 6]
    found = twists_from_poses(samples, 50.0, drive)
    assert found.points == 11
    rows = found.samples.samples
    change = 2.0 * np.diff(rows[:, layout.B_TWIST : layout.B_TWIST + 3], axis=0)
    impulse = rows[:-1, layout.LOADS][:, 6:9] * found.samples.h[1:, None]
    assert impulse[:-1] == pytest.approx(change[:-1], abs=1e-6)  # stamps are in ns
    assert found.drive is not None
    assert found.drive[1:, 0] * found.samples.h[1:] == pytest.approx(change[:, 0], abs=1e-6)


def test_a_steady_screw_motion_is_exact() -> None:
    n, rate = 60, np.array([0.4, -2.0, 5.0])
    samples = pushed(n)
    t = (samples.stamps - samples.stamps[0]) * 1e-9
    size = float(np.linalg.norm(rate))
    half = 0.5 * size * t[:, None]
    samples.samples[:, layout.B_POSE + 3 : layout.B_POSE + 6] = np.sin(half) * rate / size
    samples.samples[:, layout.B_POSE + 6] = np.cos(half)[:, 0]
    found = twists_from_poses(samples, 80.0).samples
    expected = np.tile(rate, (len(found), 1))
    assert found.samples[:, layout.B_TWIST + 3 :][:, :3] == pytest.approx(expected, abs=1e-9)
    middle = np.searchsorted(samples.stamps, found.stamps)
    orientations = slice(layout.B_POSE + 3, layout.B_POSE + 7)
    exact = samples.samples[middle, orientations]
    assert found.samples[:, orientations] == pytest.approx(exact, abs=1e-12)


def test_groups_end_at_gaps_and_a_slow_recording_has_a_smaller_bandwidth() -> None:
    samples = pushed()
    samples.stamps[200:] += 50_000_000
    samples.h[200] += 0.05
    found = twists_from_poses(samples)
    assert found.samples.restarted.sum() == 2
    samples.h *= 20.0
    slow = SampleArrays(samples.stamps * 20, samples.h, samples.restarted, samples.samples)
    assert twists_from_poses(slow, 50.0).bandwidth == pytest.approx(0.577 / 0.1, rel=0.05)
    with pytest.raises(IndeterminateError, match="takes 11 successive"):
        twists_from_poses(samples[:15], 50.0 / 20.0)


@pytest.mark.parametrize("recorded", ["absent", "zero", "filtered"])
def test_friction_of_a_recording_without_usable_twists(
    recorded: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kind = "filtered twist" if recorded == "filtered" else "poses only"
    samples = sensors.measured(joints.motion("Coulomb"), kind, 3)
    assert has_no_twists(samples) == (recorded != "filtered")
    bag, params = tmp_path / "bag", tmp_path / "sleeve.yaml"
    names = ("pose", "load") if recorded == "absent" else ("pose", "twist", "load")
    write_joint(bag, samples, names)
    _write(params, joints.scene())
    options = ["identify", str(bag), "--params", str(params)]
    if recorded == "filtered":
        assert main(options) == 1
        assert "--bandwidth" in capsys.readouterr().out
        options += ["--bandwidth", "50"]
    assert main([*options, "--json", "-"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert any("bandwidth 52.5 Hz" in line for line in found["verdict"])
    for name, value in TRUTH.items():
        low, high = found["estimates"][f"friction.{name}"]["interval_95"]
        assert low <= value <= high, name
        assert high - low < value


def test_a_bandwidth_that_is_none_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["identify", "bag", "--bandwidth", "0"])
    assert "must be a number > 0 Hz" in capsys.readouterr().err
