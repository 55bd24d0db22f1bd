"""Delay compensation: wrenches computed for the time of action, with given or measured latency."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import bundled

from cylconn_ros.bench.faults import free_running
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import latency_estimation, layout, model
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
        plant.over_time.follow(connector, k)
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
        assert run.connector.latency == pytest.approx(late, abs=0.1)
    for late in (0, 3):
        exact = through(scene, late, 300, -1).connector
        assert exact.latency == pytest.approx(late, abs=0.01)


def test_the_greatest_latency_that_is_measured_is_the_bound() -> None:
    """A wrench one period later than the last stored one: the sums end where they end."""
    mem, last = np.zeros(model.NMEM), layout.MAX_LATENCY
    mem[model.MEASURED_LATENCY], mem[model.DELAYED] = last, 1.0
    for sums in (model.LATENCY_FIT, model.INTERVAL_FIT):
        mem[sums : sums + 3 * last : 3] = 10.0  # nothing but the last wrench explains the motion
        mem[sums + 3 * last : sums + 3 * last + 3] = 1.0, -1.0, 1.0
    mem[model.LAST_NEEDED : model.LAST_NEEDED + 3] = 100.0, -1.0, -5.0
    latency_estimation.estimate(mem, 0.0)
    assert mem[model.MEASURED_LATENCY] == last
    assert 0.0 <= mem[model.LATENCY_SPREAD] < 20.0


@pytest.mark.parametrize("lag", [0.3, 0.7, 1.0, 2.5, 5.2])
@pytest.mark.parametrize("name", ["demo", "drawer_slide", "free_flight"])
def test_a_fraction_of_a_period_is_measured(name: str, lag: float) -> None:
    scene = dataclasses.replace(short(name), period=0.002, tolerance=0.0)
    found = free_running.run(scene, free_running.Lag(lag))
    assert found.latency == pytest.approx(lag, abs=0.05)
    assert found.spread < 0.25


@pytest.mark.parametrize("integration", ["exact", "semi_implicit"])
@pytest.mark.parametrize("name", sorted(LIBRARY))
def test_in_lock_step_measuring_changes_no_bit(name: str, integration: str) -> None:
    """Wrenches, state fields and flags are those of ``latency: 0``."""
    scene = dataclasses.replace(short(name), plant_integration=integration, tolerance=0.0)
    plant, told = Plant(scene), Connector(dataclasses.replace(scene, latency=0))
    measured = Connector(dataclasses.replace(scene, latency=-1))
    checked = Connector(dataclasses.replace(scene, latency=0), check_latency=True)
    sample = np.zeros(layout.NSAMPLE)
    for _ in range(200):
        sample[layout.MOTION], sample[layout.LOADS] = plant.state, plant.loads
        out = told.step(sample)
        np.testing.assert_array_equal(measured.step(sample), out)
        np.testing.assert_array_equal(checked.step(sample), out)
        plant.step(out[layout.FORCE_A : layout.FORCE_B], out[layout.FORCE_B : layout.STATE0])
    assert measured.latency == checked.latency == 0.0


@pytest.mark.parametrize(("declared", "late"), [(1, 0), (1, 1), (1, 3), (3, 1)])
@pytest.mark.parametrize("name", ["demo", "drawer_slide", "free_flight", "jam"])
def test_a_refuted_latency_is_replaced_by_the_measured_one(
    name: str, declared: int, late: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Declared alone, each wrong one runs away: by 100 m within 2 s or to numbers not finite."""
    given = dataclasses.replace(short(name), period=0.002, tolerance=0.0)
    made: list[Connector] = []

    def connector(scene: Scene) -> Connector:
        told = dataclasses.replace(scene, latency=declared)
        made.append(Connector(told, check_latency=True))
        return made[-1]

    monkeypatch.setattr(free_running, "Connector", connector)
    motion = free_running.run(given, free_running.Lag(float(late)))
    assert motion.offset < 1e-5
    assert made[0].latency == pytest.approx(late, abs=0.1)
    assert made[0].measured_latency == pytest.approx(late, abs=0.1)


@pytest.mark.parametrize("late", [1, 2, 5])
@pytest.mark.parametrize("name", ["demo", "free_flight", "incline_stick", "stuck_pair"])
def test_checking_a_true_latency_changes_no_bit(name: str, late: int) -> None:
    scene = dataclasses.replace(short(name), tolerance=0.0)
    runs = []
    for checked in (False, True):
        connector = Connector(dataclasses.replace(scene, latency=late), check_latency=checked)
        plant, sample = Plant(scene), np.zeros(layout.NSAMPLE)
        way: list[Array] = [np.zeros(12)] * late
        outs = []
        for _ in range(150):
            sample[layout.MOTION], sample[layout.LOADS] = plant.state, plant.loads
            outs.append(connector.step(sample).copy())
            way.append(outs[-1][layout.FORCE_A : layout.STATE0])
            acts = way.pop(0)
            plant.step(acts[:6], acts[6:])
        runs.append(np.array(outs))
    np.testing.assert_array_equal(runs[0], runs[1])


@pytest.mark.parametrize(("declared", "checked"), [(1, False), (0, True)])
def test_a_declared_latency_is_kept(declared: int, checked: bool) -> None:
    """Of motion that does not follow from the wrenches; and 0, of samples as they are."""
    scene = dataclasses.replace(short("demo"), tolerance=0.0)
    connector = Connector(dataclasses.replace(scene, latency=declared), check_latency=checked)
    plant, sample = Plant(scene), np.zeros(layout.NSAMPLE)
    sent: list[Array] = [np.zeros(12)]
    for k in range(12):
        plant.loads[7] = math.sin(0.3 * k)
        sample[layout.MOTION], sample[layout.LOADS] = plant.state, plant.loads
        sent.append(connector.step(sample)[layout.FORCE_A : layout.STATE0].copy())
        acts = sent[-2] if checked else sent[-1]
        plant.step(acts[:6], acts[6:])
    assert connector.latency == declared
    assert connector.measured_latency == (pytest.approx(1.0, abs=0.05) if checked else None)


def test_without_force_and_motion_the_latency_is_unknown() -> None:
    scene = short("demo").replace({"gravity": [0.0, 0.0, 0.0], "plant.body_b.twist": [0.0] * 6})
    plant, connector = Plant(scene), Connector(dataclasses.replace(scene, latency=-1))
    sample = np.zeros(layout.NSAMPLE)
    sample[layout.MOTION] = plant.state
    for _ in range(50):
        connector.step(sample)
    assert connector.measured_latency is None
    assert connector.latency == 0.0


@pytest.mark.parametrize("kind", ["constant", "jitter"])
@pytest.mark.parametrize("lag", [0.0, 0.3, 1.0, 2.5, 5.0])
@pytest.mark.parametrize("name", ["drawer_slide", "incline", "telescopic_strut"])
def test_a_free_running_plant_is_held(name: str, lag: float, kind: str) -> None:
    """Nothing declared: offset, angle, force and energy stay within their limits."""
    scene = dataclasses.replace(short(name), period=0.002, tolerance=0.0)
    late = free_running.Lag(lag, kind)
    motion, exact = free_running.run(scene, late), free_running.run(scene, None)
    assert free_running.failures(scene, exact, motion, late) == []


def test_the_limits_of_a_free_running_plant_are_exceeded_without_compensation() -> None:
    scene = dataclasses.replace(short("demo"), period=0.002, tolerance=0.0)
    exact, late = free_running.run(scene, None), free_running.Lag(1.0)
    fallen = free_running.Motion(1.0, 1.0, 1e3 * exact.force, 1e3, 1.0)
    reasons = free_running.failures(scene, exact, fallen, late)
    assert reasons == ["offset", "angle", "force", "energy"]
    assert free_running.failures(scene, exact, free_running.Motion(), late) == ["not finite"]


def test_a_push_one_sample_late_costs_little_more_than_declared() -> None:
    """A drawer at rest, pushed beside its rail; the latency is not declared, the load is known."""
    settings = bundled("drawer_slide").parameters() | {
        "period": 0.002, "plant_integration": "semi_implicit", "method": "auto",
    }  # fmt: skip
    worst = []
    for latency in (1, -1):
        scene = Scene.from_parameters(settings | {"latency": latency})
        plant, connector = Plant(scene), Connector(scene)
        sample, torque, angle = np.zeros(layout.NSAMPLE), 0.0, 0.0
        acts: np.ndarray = np.zeros(12)
        for k in range(700):
            load = plant.loads
            load[6], load[10] = (5.0, 0.25) if 250 <= k < 500 else (0.0, 0.0)
            sample[layout.MOTION], sample[layout.LOADS] = plant.state, load
            out = connector.step(sample)
            if k > 200:
                torque = max(torque, float(np.linalg.norm(out[layout.TORQUE_B : layout.STATE0])))
                angle = max(angle, float(out[layout.ANGULAR_VIOLATION]))
            if k > 0:  # held until the first wrench acts
                plant.step(acts[:6], acts[6:])
            acts = out[: layout.STATE0].copy()
        worst.append((torque, angle))
    assert worst[1][0] < 2.0 * worst[0][0]
    assert worst[1][1] < 2.0 * worst[0][1] + 1e-9


@pytest.mark.parametrize("late", [0, 3])
def test_unknown_inertia_lowers_the_gains_that_put_in_energy(late: int) -> None:
    """With gains that are stable in lock step only; nothing is declared."""
    settings = bundled("demo").parameters()
    settings |= {
        "body_b.kind": "unknown", "penalty.stiffness": 2e5, "penalty.damping": 400.0,
        "method": "penalty", "latency": -1,
    }  # fmt: skip
    scene = Scene.from_parameters(settings)
    run = through(scene, late, 400, -1)
    assert np.isfinite(run.outs[:, : layout.REGIME]).all()
    assert run.offset.max() < 0.01
    lowered = run.outs[:, layout.FLAGS].astype(int) & layout.GAINS_LOWERED
    assert bool(lowered.any()) == (late > 0)
    if late:
        in_lock_step = through(scene, late, 400, 0)  # as a declared latency of 0 takes it
        assert np.nanmax(in_lock_step.offset) < 0.01
        assert (in_lock_step.outs[:, layout.FLAGS].astype(int) & layout.GAINS_LOWERED).any()


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


@pytest.mark.parametrize("start", [0, 50])
def test_a_load_that_arrives_late_is_no_latency(start: int) -> None:
    """Lock step, a load alternates every 20 samples, and is known one sample late twice."""
    scene = dataclasses.replace(short("demo"), tolerance=0.0)
    plant, connectors = Plant(scene), []
    for latency in (0, -1):
        connectors.append(Connector(dataclasses.replace(scene, latency=latency)))
    sample, known = np.zeros(layout.NSAMPLE), plant.loads.copy()
    for k in range(start + 160):
        if k % 20 == 0:
            plant.loads[6:9] = 2.0 * math.cos(k), 1.0, math.sin(k)
        if k not in (start + 20, start + 40):
            known = plant.loads.copy()
        sample[layout.MOTION], sample[layout.LOADS] = plant.state, known
        told, measured = (connector.step(sample).copy() for connector in connectors)
        if start or k > 120:
            np.testing.assert_allclose(measured[:12], told[:12], atol=1e-9)
        plant.step(measured[:6], measured[6:12])
    assert connectors[1].latency == connectors[1].latency_spread == 0.0
