"""Jumps of a body: no work, no pull towards the old stick position; sent wrenches are kept."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import bundled
from scipy.spatial.transform import Rotation

from cylconn_ros.bench.stability.criteria import joint_motion
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout, model
from cylconn_ros.laws.runs import first_violation
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant

Array = NDArray[np.float64]

SHIFT = (0.1, 0.02, -0.01)  # m


def scene_of(name: str, latency: int = 0) -> Scene:
    """A bundled scene with method auto."""
    return dataclasses.replace(bundled(name), method="auto", latency=latency)


def teleported(scene: Scene, steps: int, late: int, shift: Array) -> tuple[Array, Array]:
    """(N, 26) states and (N, NOUT) outputs; B is teleported after half of the samples."""
    plant, connector = Plant(scene), Connector(scene)
    way: list[Array] = [np.zeros(12)] * late
    sample = np.zeros(layout.NSAMPLE)
    states, outs = [], []
    for k in range(steps):
        if k == steps // 2:
            plant.state[layout.B_POSE : layout.B_POSE + 3] += shift
        sample[layout.MOTION], sample[layout.LOADS] = plant.state, plant.loads
        states.append(plant.state.copy())
        outs.append(connector.step(sample))
        way.append(outs[-1][: layout.STATE0])
        acts = way.pop(0)
        plant.step(acts[:6], acts[6:])
    return np.array(states), np.array(outs)


@pytest.mark.parametrize("late", [0, 2])
@pytest.mark.parametrize("name", ["jam", "incline_stick", "journal_verge"])
def test_stick_does_not_pull_a_body_back(name: str, late: int) -> None:
    """Stick holds the new position: there is no force along the shaft towards the old one."""
    scene = scene_of(name, late)
    states, outs = teleported(scene, 200, late, np.array(SHIFT))
    assert outs[99, layout.REGIME] == layout.STICK
    seen = joint_motion(scene, states).length
    assert abs(seen[100] - seen[99]) > 0.09
    assert seen[-1] == pytest.approx(seen[100], abs=2e-3)
    assert np.abs(outs[100:, layout.VELOCITY]).max() < 0.01


@pytest.mark.parametrize("late", [0, 2])
@pytest.mark.parametrize("name", ["free_slide", "dry_friction_oscillator", "latch", "coast"])
def test_a_jump_does_no_work(name: str, late: int) -> None:
    """There is no constraint along the shaft: the passivity balance continues without a step."""
    scene = scene_of(name, late)
    steps = 300
    _, outs = teleported(scene, steps, late, np.array([1e-9, 0.0, 0.0]))
    shaft = _direction(scene)
    _, jumped = teleported(scene, steps, late, 0.05 * shaft)
    balance, exchanged = outs[:, layout.PASSIVITY_BALANCE], outs[:, layout.ENERGY_EXCHANGED]
    at = steps // 2
    change = jumped[at, layout.PASSIVITY_BALANCE] - balance[at]
    assert abs(change) < 1e-3 * (exchanged[at] + 1e-3)
    assert jumped[at, layout.ENERGY_EXCHANGED] - exchanged[at] < 1e-3 * (exchanged[at] + 1e-3)


def _direction(scene: Scene) -> Array:
    turn = Rotation.from_quat(scene.body_a.pose[3:]) * Rotation.from_quat(scene.node_a.orientation)
    return np.asarray(turn.apply([1.0, 0.0, 0.0]))


@pytest.mark.parametrize("name", ["jam", "incline_stick", "stuck_pair", "demo"])
def test_the_laws_hold_across_a_jump(name: str) -> None:
    """The checker of the laws detects the jump as well."""
    scene = scene_of(name)
    states, outs = teleported(scene, 300, 0, np.array(SHIFT))
    assert first_violation(dataclasses.replace(scene, method="impulse"), states, outs) == ""


def test_sent_wrenches_are_kept_after_stamps_went_back() -> None:
    """A new history while wrenches of the old one still act: outputs as in a continued run."""
    scene = scene_of("demo", 3)
    plant, connector = Plant(scene), Connector(scene)
    way: list[Array] = [np.zeros(12)] * 3
    sample = np.zeros(layout.NSAMPLE)
    for _ in range(20):
        sample[layout.MOTION], sample[layout.LOADS] = plant.state, plant.loads
        way.append(connector.step(sample)[: layout.STATE0].copy())
        acts = way.pop(0)
        plant.step(acts[:6], acts[6:])
    sample[layout.MOTION] = plant.state
    memory = connector.memory
    went_on = connector.step(sample)[layout.FORCE : layout.FORCE + 3].copy()
    connector.memory = memory
    connector.reset(keep_in_flight=True)
    assert connector.memory[model.HAS_REFERENCE] == 0.0
    anew = connector.step(sample)[layout.FORCE : layout.FORCE + 3].copy()
    np.testing.assert_allclose(anew[1:], went_on[1:], rtol=0.05, atol=0.05)
    connector.memory = memory
    connector.reset()
    forgotten = connector.step(sample)[layout.FORCE : layout.FORCE + 3]
    assert np.abs(forgotten[1:] - went_on[1:]).max() > 1.0


@pytest.mark.parametrize("late", [1, 2, 4])
def test_latency_is_measured_if_samples_are_lost(late: int) -> None:
    """Also if the first sample after the first wrench is lost; the balance is that of energy."""
    scene = scene_of("demo", -1)
    plant, connector = Plant(scene), Connector(scene)
    way: list[Array] = [np.zeros(12)] * late
    last: Array = np.zeros(12)
    sample, gone = np.zeros(layout.NSAMPLE), 0
    found, energy, balance = [], [], []
    for k in range(200):
        gone += 1
        if k % 5 != 1:
            sample[layout.MOTION], sample[layout.LOADS] = plant.state, plant.loads
            out = connector.step(sample, gone * scene.period if k else 0.0)
            gone = 0
            last = out[: layout.STATE0].copy()
            found.append(connector.latency)
            energy.append(plant.energy())
            balance.append(out[layout.PASSIVITY_BALANCE])
        way.append(last)
        acts = way.pop(0)
        plant.step(acts[:6], acts[6:])
    assert found[10] == pytest.approx(late, abs=0.1)
    change = np.array(energy) - energy[0]
    np.testing.assert_allclose(balance, change, atol=5e-3 * np.ptp(change) + 1e-6)
