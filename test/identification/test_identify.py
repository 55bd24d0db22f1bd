"""Identification of synthetic recordings with noise: the intervals contain the true values."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import bundled, pair, sleeve
from scipy.stats import binom

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.errors import IdentifyError
from cylconn_ros.identification.forces import cubics
from cylconn_ros.identification.forces.windows import Windows
from cylconn_ros.identification.friction import estimate_friction
from cylconn_ros.identification.likelihood.contact_loads import Calibrated, ContactLoads
from cylconn_ros.identification.likelihood.kinetic import fit_law
from cylconn_ros.identification.likelihood.law import FrictionLaw
from cylconn_ros.recording.samples import RecordedSample
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant

Array = NDArray[np.float64]

# docs/how_to/identify.md: IDENTIFY_SEEDS=200 is the long form.
SEEDS = int(os.environ.get("IDENTIFY_SEEDS", "30"))
FALSE_ALARM = 1e-3  # probability of a false alarm per parameter
NOISE = (1e-3, 5e-3, 1e-5, 1e-4)  # m/s, rad/s, m, rad: standard deviations of a component

FRICTION: dict[str, Any] = {
    "friction": {"coefficient": 0.2, "radius": 0.03, "overlap": 0.1, "preload": 3.0}
}
KNOWN = {"coefficient": 0.2, "radius": 0.03, "overlap": 0.1, "preload": 3.0}


def motion_of(
    scene: Scene, steps: int, load: Callable[[float], list[float]] | None = None
) -> Array:
    """(steps, NSAMPLE) samples of a closed loop, with a load on B that may change."""
    plant, connector = Plant(scene), Connector(scene)
    found = np.zeros((steps, layout.NSAMPLE))
    for k in range(steps):
        if load is not None:
            plant.loads[6:] = load(k * scene.period)
        found[k, layout.MOTION], found[k, layout.LOADS] = plant.state, plant.loads
        out = connector.step(found[k])
        plant.step(out[: layout.FORCE_B], out[layout.FORCE_B : layout.STATE0])
    return found


def measured(samples: Array, seed: int, bodies: str = "b", size: float = 1.0) -> Array:
    """Add white sensor noise to samples."""
    rng, noisy = np.random.default_rng(seed), samples.copy()
    n = len(noisy)
    v, w, x, q = (size * one for one in NOISE)
    for body in bodies:
        pose, twist = (
            (layout.A_POSE, layout.A_TWIST) if body == "a" else (layout.B_POSE, layout.B_TWIST)
        )
        noisy[:, pose : pose + 3] += x * rng.standard_normal((n, 3))
        turn = 0.5 * q * rng.standard_normal((n, 3))
        axis, real = noisy[:, pose + 3 : pose + 6].copy(), noisy[:, pose + 6 : pose + 7].copy()
        noisy[:, pose + 3 : pose + 6] += real * turn + np.cross(turn, axis)
        noisy[:, pose + 6] -= (turn * axis).sum(axis=1)
        noisy[:, twist : twist + 3] += v * rng.standard_normal((n, 3))
        noisy[:, twist + 3 : twist + 6] += w * rng.standard_normal((n, 3))
    return noisy


def sampled(rows: Array, times: NDArray[Any]) -> list[RecordedSample]:
    """Return samples as of a recording."""
    periods = np.diff(times, prepend=times[0])
    return [
        RecordedSample(round(t * 1e9), float(h), False, row)
        for t, h, row in zip(times, periods, rows, strict=True)
    ]


def evenly(rows: Array, h: float = 1e-3) -> list[RecordedSample]:
    return sampled(rows, np.arange(len(rows)) * h)


def pushed(static: float | None, steps: int = 2000, turn: float = 0.1) -> tuple[Scene, Array]:
    """A sleeve at rest, with a growing force and moment until it breaks away, and back."""
    parts = {"static_coefficient": static, "decay": 200.0} if static else {}
    scene = sleeve(friction={**FRICTION["friction"], **parts})

    def load(t: float) -> list[float]:
        push = 14.0 * (1.0 - 2.0 * abs((t + 0.5) % 2.0 - 1.0))
        bend = 0.3 * np.sin(5.0 * t)
        return [push, 0.0, 3.0 * np.sin(7.0 * t), turn * np.sin(3.0 * t), float(bend), 0.0]

    return scene, motion_of(scene, steps, load)


def recordings() -> dict[str, tuple[Scene, Array, str, dict[str, float]]]:
    """Scene, true motion, bodies measured, true parameters."""
    demo, two, coast = bundled("demo"), pair(**FRICTION), bundled("coast")
    truth = {"coefficient": 0.2, "radius": 0.02, "overlap": 0.08, "preload": 4.0}
    scene, motion = pushed(0.3)
    return {
        "spinning and sliding": (demo, motion_of(demo, 2000), "b", truth),
        "two free bodies": (two, motion_of(two, 1200), "ab", KNOWN),
        "coasting": (coast, motion_of(coast, 800), "b", {"coefficient": 0.2}),
        "pushed": (scene, motion, "b", {**KNOWN, "static_coefficient": 0.3}),
    }


@pytest.mark.parametrize("name", ["spinning and sliding", "two free bodies", "coasting", "pushed"])
def test_intervals_contain_the_true_value_as_often_as_stated(name: str) -> None:
    scene, motion, bodies, truth = recordings()[name]
    errors: dict[str, list[float]] = {key: [] for key in truth}  # relative to half the interval
    for seed in range(SEEDS):
        found = estimate_friction(scene, evenly(measured(motion, seed, bodies)))
        for key, value in truth.items():
            e = found.estimates[key]
            assert e.found, e.note
            share = abs(e.value - value) / (0.5 * (e.high - e.low))
            good = e.low <= value <= e.high
            errors[key].append(min(share, 1.0) if good else max(share, 1.0 + 1e-9))
    for key, values in errors.items():
        inside = int(np.sum(np.array(values) <= 1.0))
        print(f"{name}: {key} {inside} of {len(values)}")
        assert inside >= binom.ppf(FALSE_ALARM, len(values), 0.95), key
        if key != "static_coefficient":  # its interval is conservative
            assert inside <= binom.ppf(1.0 - FALSE_ALARM, len(values), 0.95), key
            # The expected median is 0.34 of the half interval: it is not much too wide.
            assert np.median(values) > 0.2, key


def test_without_noise_the_estimates_are_exact() -> None:
    scene, motion, _, truth = recordings()["spinning and sliding"]
    found = estimate_friction(scene, evenly(motion))
    for key, value in truth.items():
        e = found.estimates[key]
        assert e.value == pytest.approx(value, rel=2e-3)
        assert e.low <= value <= e.high


def test_the_result_does_not_depend_on_the_start_values() -> None:
    """Wrong friction parameters in the recording do not change the estimates."""
    scene, motion, _, _ = recordings()["spinning and sliding"]
    wrong = scene.parameters() | {
        "friction.coefficient": 0.5,
        "friction.radius": 0.03,
        "friction.overlap": 0.04,
        "friction.preload": 0.0,
    }
    seen = evenly(measured(motion, 1))
    right, other = (
        estimate_friction(scene, seen),
        estimate_friction(Scene.from_parameters(wrong), seen),
    )
    for key, e in right.estimates.items():
        if e.found:
            assert other.estimates[key].value == pytest.approx(e.value, abs=0.2 * (e.high - e.low))


def test_noise_does_not_bias_the_law() -> None:
    """Noise in the normal force: a plain fit underestimates friction, this one does not."""
    rng = np.random.default_rng(1)
    n, law = 4000, FrictionLaw(0.3, 2.0, 20.0, 0.02)
    radial, moment, way = rng.uniform(2.0, 12.0, n), rng.uniform(0.05, 0.4, n), rng.uniform(0, 6, n)
    s = np.column_stack([np.cos(way), np.sin(way) / law.radius])
    limit = law.coefficient * law.normal(radial, moment, np.full(n, law.bending))
    turn = rng.uniform(0.0, 6.0, (2, n))
    wrench = np.column_stack([
        -limit * np.cos(way), radial * np.cos(turn[0]), radial * np.sin(turn[0]),
        -limit * np.sin(way) * law.radius, moment * np.cos(turn[1]), moment * np.sin(turn[1]),
    ])  # fmt: skip
    sizes = np.array([0.3, 0.8, 0.8, 0.006, 0.03, 0.03])
    wrench += sizes * rng.standard_normal((n, 6))
    w = Windows(
        time=np.zeros(n),
        wrench=wrench,
        covariance=np.tile(np.diag(sizes**2), (n, 1, 1)),
        rates=s,
        places=np.zeros((n, 2)),
        ends=np.stack([s, s], axis=1),
        rate_noise=np.zeros((n, 2)),
        segment=np.zeros(n, dtype=np.intp),
        intervals=np.ones(n, dtype=np.intp),
        pressed=np.zeros(n),
        rejected=0,
    )
    data = Calibrated.of(w, ContactLoads.of(w), law.radius)
    found = fit_law(data, FrictionLaw(0.2, 0.0, 10.0, 0.03), range(4))
    off = (found.law.vector - law.vector)[:4] / np.sqrt(np.diag(found.covariance))
    assert np.abs(off).max() < 3.5, off
    # Plain fit: P over the measured Fr, Mbend and 1.
    sizes_seen = np.hypot(wrench[:, [1, 4]], wrench[:, [2, 5]])
    along = -(wrench[:, 0] * np.cos(way) + wrench[:, 3] / law.radius * np.sin(way))
    plain = np.linalg.lstsq(np.column_stack([sizes_seen, np.ones(n)]), along, rcond=None)[0]
    error = np.sqrt(found.covariance[0, 0]) * law.coefficient
    assert plain[0] < law.coefficient - 5.0 * error


def test_a_cubics_slope_has_the_stated_noise() -> None:
    times = np.asarray(np.linspace(0.0, 1.0, 201), dtype=np.float64)[None]
    slope = cubics.fit_cubics(times).slope[0]
    assert slope @ times[0] ** 2 == pytest.approx(1.0)  # d(t^2)/dt at 0.5
    assert np.square(slope).sum() == pytest.approx(75.0 / 200**3 / 0.005**2, rel=0.05)


def test_noise_is_separated_from_motion() -> None:
    rng = np.random.default_rng(2)
    time = np.cumsum(rng.uniform(0.5e-3, 2e-3, 6000))
    mixed = np.array([[1.0, 0.0], [0.6, 0.2]])
    noise = rng.standard_normal((6000, 2)) @ mixed.T
    seen = np.column_stack([300.0 * np.sin(20.0 * time), 50.0 * time**2]) + noise
    assert cubics.noise_covariance(time, seen) == pytest.approx(mixed @ mixed.T, abs=0.06)


# Parameters that a motion does not excite


def test_parameters_without_excitation_are_not_estimated() -> None:
    scene, motion, _, _ = recordings()["coasting"]
    found = estimate_friction(scene, evenly(measured(motion, 3)))
    notes = {name: e.note for name, e in found.estimates.items() if not e.found}
    assert "hardly spins" in notes["radius"]
    assert "no bending moment beyond noise" in notes["overlap"]
    assert "normal force hardly changes" in notes["preload"]
    assert "no break-away" in notes["static_coefficient"]
    assert found.estimates["preload"].value == 5.0


def test_a_spin_determines_only_mu_times_radius() -> None:
    scene = sleeve(spin=40.0, com=(0.0, 0.01, 0.0), **FRICTION)
    found = estimate_friction(scene, evenly(measured(motion_of(scene, 600), 4)))
    assert "determines only mu R" in found.estimates["radius"].note


def test_known_parameters_narrow_the_others() -> None:
    scene, motion, _, _ = recordings()["spinning and sliding"]
    seen = evenly(measured(motion, 5))
    free, held = (
        estimate_friction(scene, seen),
        estimate_friction(scene, seen, {"preload": 4.0, "overlap": 0.08}),
    )
    assert held.estimates["preload"].note == "assumed, as given"
    widths = [
        r.estimates["coefficient"].high - r.estimates["coefficient"].low for r in (free, held)
    ]
    assert widths[1] < 0.5 * widths[0]
    assert held.estimates["coefficient"].low <= 0.2 <= held.estimates["coefficient"].high


def test_rest_bounds_the_static_coefficient_from_below() -> None:
    scene = bundled("demo")  # comes to rest on 12 degrees
    found = estimate_friction(scene, evenly(motion_of(scene, 4500)))
    assert 0.15 < found.static.bound < 0.2
    assert f"at least {found.static.bound:.4g}" in found.estimates["static_coefficient"].note


def test_stops_are_skipped() -> None:
    """A sleeve that bounces between stops, whose force is not friction."""
    scene = sleeve(
        v=2.0, l0=0.0, stops={"l_min": -0.1, "l_max": 0.1, "restitution": 0.9}, **FRICTION
    )
    found = estimate_friction(scene, evenly(measured(motion_of(scene, 700), 6)))
    e = found.estimates["coefficient"]
    assert found.skipped["at a stop or lock"] > 5
    assert e.low <= 0.2 <= e.high
    assert e.high - e.low < 0.1


# Errors


def test_no_slip_is_an_error_that_states_the_slip_rate() -> None:
    scene = sleeve(**FRICTION)
    with pytest.raises(IdentifyError, match=r"too little slip .* 0 windows of slip"):
        estimate_friction(scene, evenly(measured(motion_of(scene, 300), 1)))


def test_a_single_sample_is_an_error() -> None:
    with pytest.raises(IdentifyError, match="1 complete samples: a motion is needed"):
        estimate_friction(sleeve(**FRICTION), evenly(motion_of(sleeve(**FRICTION), 1)))


def test_a_motion_without_friction_is_an_error() -> None:
    scene = sleeve(v=1.0, spin=5.0, com=(0.0, 0.01, 0.0))
    scene = dataclasses.replace(scene, friction=dataclasses.replace(scene.friction, radius=0.02))
    with pytest.raises(IdentifyError, match="no friction shows"):
        estimate_friction(scene, evenly(measured(motion_of(scene, 600), 1)))
