"""Delay compensation: wrenches computed for the time of action, with given or measured latency."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import bundled

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout, model
from cylconn_ros.reference.library import LIBRARY
from cylconn_ros.scene.packing import pack
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant
from cylconn_ros.simulation.simulate import simulate

Array = NDArray[np.float64]


@dataclasses.dataclass
class Loop:
    """A run with delayed wrenches and lost samples, as seen by the plant."""

    energy: Array
    offset: Array
    swing: Array
    outs: Array
    connector: Connector


def through(scene: Scene, late: int, steps: int, latency: int, lost: float = 0.0) -> Loop:
    """Run ``scene`` with wrenches delayed by ``late`` periods and some samples lost."""
    plant, connector = Plant(scene), Connector(dataclasses.replace(scene, latency=latency))
    rng = np.random.default_rng(1)
    way: list[Array] = [np.zeros(12)] * late
    sample, gone = np.zeros(layout.NSAMPLE), 0
    last: Array = np.zeros(12)
    energy, outs = np.empty(steps), []
    for k in range(steps):
        energy[k] = plant.energy()
        sample[layout.MOTION], sample[layout.LOADS] = plant.state, plant.loads
        gone += 1
        if k == 0 or rng.random() >= lost:
            out = connector.step(sample, gone * scene.period if k else 0.0)
            last, gone = out[layout.FORCE_A : layout.STATE0].copy(), 0
            outs.append(out)
        way.append(last)
        acts = way.pop(0)
        plant.step(acts[:6], acts[6:])
    answers = np.array(outs)
    offset = answers[:, layout.OFFSET_VIOLATION]
    return Loop(energy, offset, answers[:, layout.ANGULAR_VIOLATION], answers, connector)


def short(name: str) -> Scene:
    """A bundled scene with method impulse."""
    return dataclasses.replace(bundled(name), method="auto")


def unheld(scene: Scene, late: int) -> float:
    """Energy that the bodies gain before the first wrench arrives, J."""
    plant, none = Plant(scene), np.zeros(6)
    start, speeds = plant.energy(), plant.state.copy()
    for _ in range(late):
        plant.step(none, none)
    gained = abs(plant.energy() - start)
    for body, at in ((scene.body_a, 7), (scene.body_b, 20)):
        if body.kind == "free":
            fallen = plant.state[at : at + 3] - speeds[at : at + 3]
            gained += 0.5 * body.mass * float(fallen @ fallen)
    return gained


@pytest.mark.parametrize("name", sorted(LIBRARY))
def test_every_bundled_scene_stays_bounded(name: str) -> None:
    """One to five samples of delay, given or measured; a tenth of the samples lost.

    The bodies are free until the first wrench arrives. Until the latency is measured, which needs a
    force that changes, wrenches may add energy; the added energy is bounded.
    """
    scene = short(name)
    steps = max(60, min(600, round(1.0 / scene.period)))
    prompt = simulate(scene, samples=steps)
    turnover = np.ptp(prompt.energy) + prompt["energy_exchanged"][-1]
    for late in (1, 5):
        fall = unheld(scene, late)
        for latency in (late, -1):
            for lost in (0.0, 0.1):
                run = through(scene, late, steps, latency, lost)
                assert np.isfinite(run.outs[:, : layout.REGIME]).all()
                settled = steps // 4
                assert run.offset[settled:].max() < 1e-3
                assert run.swing[settled:].max() < 1e-2
                if latency == late and lost == 0.0:
                    allowed = (
                        0.02 * turnover + (late + 1) ** 2 * fall + 1e-6
                    )  # brought back in a step
                    assert run.energy.max() < prompt.energy.max() + allowed
                else:
                    allowed = 20.0 * (turnover + fall) + 1e-6
                    assert run.energy[-1] < prompt.energy.max() + allowed


@pytest.mark.parametrize("integration", ["exact", "semi_implicit"])
def test_constraint_errors_are_as_without_delay(integration: str) -> None:
    """After the transient; without the prediction the same run diverges."""
    scene = dataclasses.replace(short("demo"), plant_integration=integration)
    prompt = simulate(scene, samples=600)["offset_violation"][300:].max()
    for late in (1, 2, 3, 5):
        assert through(scene, late, 600, late).offset[300:].max() < 1.5 * prompt + 1e-12
    if integration == "exact":
        assert not np.nanmax(through(scene, 1, 600, 0).offset) < 1.0


def test_the_latency_is_measured() -> None:
    """Also if samples are lost; without delay the measured latency stays zero."""
    scene = short("demo")
    for late in (0, 1, 2, 4, 8):
        run = through(scene, late, 400, -1, 0.1)
        assert run.connector.memory[model.MEASURED_LATENCY] == late
    changed = through(scene, 3, 300, -1).connector
    assert changed.memory[model.MEASURED_LATENCY] == 3.0


def test_the_reported_kinematics_are_those_of_the_sample() -> None:
    """Reported positions belong to the stamp, not to the time of action."""
    scene = short("demo")
    run = through(scene, 3, 300, 3)
    length, speed = run.outs[:, layout.LENGTH], run.outs[:, layout.VELOCITY]
    moved = np.diff(length)
    mean = 0.5 * (speed[1:] + speed[:-1]) * scene.period
    np.testing.assert_allclose(moved, mean, atol=1e-7)
    assert run.outs[0, layout.DISPLACEMENT] == 0.0


def test_unknown_inertia_lowers_the_gains() -> None:
    """A damper that acts d + 1/2 periods late stays stable with a gain lower by 1 + 2 d."""
    settings = bundled("demo").parameters()
    settings |= {"body_b.kind": "unknown", "penalty.stiffness": 1e5, "penalty.damping": 400.0}
    prompt = pack(Scene.from_parameters(settings | {"method": "penalty"}))
    late = pack(Scene.from_parameters(settings | {"method": "penalty", "latency": 2}))
    at = model.PENALTY
    assert late[at] == pytest.approx(prompt[at] / 25.0)
    assert late[at + 2] == pytest.approx(prompt[at + 2] / 5.0)
    assert (
        "to 1/25"
        in Connector(Scene.from_parameters(settings | {"method": "penalty", "latency": 2})).model
    )


def test_the_memory_includes_the_sent_wrenches() -> None:
    """Restoring the memory reproduces the outputs."""
    scene = dataclasses.replace(short("demo"), latency=2)
    plant, connector = Plant(scene), Connector(scene)
    sample = np.zeros(layout.NSAMPLE)
    for _ in range(5):
        sample[layout.MOTION] = plant.state
        out = connector.step(sample)
        plant.step(out[layout.FORCE_A : layout.FORCE_B], out[layout.FORCE_B : layout.STATE0])
    memory = connector.memory
    first = connector.step(sample)
    connector.memory = memory
    np.testing.assert_array_equal(connector.step(sample), first)
    assert not math.isclose(connector.step(sample)[layout.FORCE_B], first[layout.FORCE_B])
