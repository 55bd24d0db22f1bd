"""Survival criteria detect every kind of failure; the faulty channel has the stated faults."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from cylconn_ros.bench.common.methods import with_method
from cylconn_ros.bench.stability import channel, criteria, loop
from cylconn_ros.bench.stability.channel import Channel, Faults
from cylconn_ros.bench.stability.criteria import RESTS, SLIDES
from cylconn_ros.bench.stability.naive import NaivePenalty
from cylconn_ros.bench.stability.scenes import pair, sleeve
from cylconn_ros.bench.stability.solvers import ConnectorSolver
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.laws.runs import first_violation
from cylconn_ros.simulation.simulate import simulate

# --- criteria ---


def good() -> loop.Trace:
    scene = sleeve()
    return loop.closed_loop(scene, ConnectorSolver(scene))


def changed(trace: loop.Trace, at: int, by: float, since: float) -> loop.Trace:
    states = trace.states.copy()
    states[trace.time >= since, at] += by
    return dataclasses.replace(trace, states=states)


def test_a_good_run_survives() -> None:
    found = criteria.evaluate(sleeve(), good(), SLIDES, first_violation)
    assert found.survived
    assert found.offset < 1e-8
    assert found.energy <= 0.0


@pytest.mark.parametrize(
    ("at", "by", "since", "failure"),
    [
        (layout.B_POSE + 1, 1.1e-3, 0.5, "offset 1.1 mm"),
        (layout.B_POSE + 2, -0.9e-3, 0.5, ""),
        (layout.B_POSE, 5.0, 0.5, ""),  # along the slot
        (layout.B_POSE + 5, 0.011, 0.5, "angle"),  # half the angle
        (layout.B_TWIST, 2.0, 0.5, "energy"),
        (layout.B_TWIST, math.nan, 0.5, "not finite"),
    ],
)
def test_failures_are_detected(at: int, by: float, since: float, failure: str) -> None:
    found = criteria.evaluate(sleeve(), changed(good(), at, by, since), SLIDES)
    assert found.failure.startswith(failure)
    assert found.survived == (not failure)


@pytest.mark.parametrize(("gained", "failure"), [(0.008, ""), (0.012, "energy +1.19 %")])
def test_one_percent_of_energy_is_tolerated(gained: float, failure: str) -> None:
    scene = sleeve(gravity=[0.0, 0.0, 0.0], friction={"coefficient": 0.0})
    trace = loop.closed_loop(scene, ConnectorSolver(scene))
    states = trace.states.copy()
    states[600:, layout.B_TWIST : layout.B_TWIST + 6] *= math.sqrt(1.0 + gained)
    assert criteria.evaluate(scene, dataclasses.replace(trace, states=states)).failure == failure


def test_violations_in_the_first_fifth_of_a_second_do_not_count() -> None:
    trace = good()
    states = trace.states.copy()
    states[(trace.time > 0.1) & (trace.time < 0.19), layout.B_POSE + 1] += 0.1
    assert criteria.evaluate(sleeve(), dataclasses.replace(trace, states=states)).survived


def test_a_wrench_that_is_not_finite_is_detected() -> None:
    trace = good()
    assert trace.wrenches is not None
    wrenches = trace.wrenches.copy()
    wrenches[7, 3] = math.inf
    found = criteria.evaluate(sleeve(), dataclasses.replace(trace, wrenches=wrenches))
    assert found.failure.startswith("wrench not finite at 0.007")


def test_a_wrong_end_is_detected() -> None:
    assert criteria.evaluate(sleeve(), good(), RESTS).failure.startswith("does not rest")
    scene = sleeve(friction={"coefficient": 3.0})
    trace = loop.closed_loop(scene, ConnectorSolver(scene))
    assert criteria.evaluate(scene, trace, RESTS).survived
    assert criteria.evaluate(scene, trace, SLIDES).failure == "rests and should slide"


def test_a_violated_law_is_detected() -> None:
    trace = good()
    assert trace.outs is not None
    outs = trace.outs.copy()
    outs[100, layout.FORCE + 1] *= 1.0 + 1e-9
    found = criteria.evaluate(
        sleeve(), dataclasses.replace(trace, outs=outs), SLIDES, first_violation
    )
    assert found.failure.startswith("law ")


def test_energy_equals_that_of_the_plant() -> None:
    scene = pair(gravity=[0.1, 0.2, -9.81])
    run = simulate(scene, samples=200)
    kinetic, work = criteria.energies(scene, run.states)
    np.testing.assert_allclose(np.diff(kinetic - work), np.diff(run.energy), atol=1e-12)


def test_kinematics_agree_with_the_connector() -> None:
    scene = sleeve(tilt=0.5)
    run = simulate(scene, samples=50)
    motion = criteria.joint_motion(scene, run.states)
    np.testing.assert_allclose(motion.length, run["length"], atol=1e-12)
    np.testing.assert_allclose(motion.spin, run["angle"], atol=1e-12)
    cosine = np.cos(np.linalg.norm(run["misalignment"], axis=1))
    np.testing.assert_allclose(motion.direction[:, 0], cosine, atol=1e-12)


# --- channel between plant and connector ---


def sent(faults: Faults, n: int = 2000) -> list[list[int]]:
    channel = Channel(faults, list(range(13, 26)))
    sample = np.zeros(layout.NSAMPLE)
    return [[stamp for stamp, _ in channel.deliver(k, k, sample)] for k in range(n)]


def test_a_channel_without_faults_delivers_each_sample_once() -> None:
    assert sent(Faults()) == [[k] for k in range(2000)]


def test_drops_duplicates_and_reordering_have_the_stated_shares() -> None:
    drops, twice, swapped = map(
        sent, (Faults(drop=0.1), Faults(duplicate=0.1), Faults(reorder=0.1))
    )
    assert sum(not arrived for arrived in drops) == pytest.approx(200, rel=0.2)
    assert sum(len(arrived) == 2 for arrived in twice) == pytest.approx(200, rel=0.2)
    arrived = [stamp for each in swapped for stamp in each]
    late = [b for a, b in itertools.pairwise(arrived) if b < a]
    assert len(late) == pytest.approx(200, rel=0.3)
    assert sorted(arrived) == list(range(arrived[-1] + 1)), "nothing is lost"


def test_a_wrench_is_late_by_the_stated_number_of_samples() -> None:
    channel = Channel(Faults(late=3), [])
    acted = [channel.act(np.full(12, float(k)))[0] for k in range(6)]
    assert acted == [0.0, 0.0, 0.0, 0.0, 1.0, 2.0]


@pytest.mark.parametrize(("kind", "count"), [("NaN", 26), ("infinity", 26), ("zero quaternion", 2)])
def test_every_field_is_corrupted_once(kind: str, count: int) -> None:
    channel = Channel(Faults(corrupt=kind), list(range(26)))
    sample = np.ones(layout.NSAMPLE)
    fields = set()
    for k in range(1000):
        (_, arrived), *_ = channel.deliver(k, k, sample)
        fields |= {tuple(np.flatnonzero(arrived != sample))} - {()}
    assert len(fields) == count
    assert np.isfinite(sample).all(), "the plant's sample is unchanged"


def test_jitter_stays_within_the_stated_bound() -> None:
    channel = Channel(Faults(jitter=0.3), [])
    factors = np.array([channel.period_factor() for _ in range(1000)])
    assert 0.7 <= factors.min() < 0.72
    assert 1.28 < factors.max() <= 1.3


def test_duplicates_change_nothing() -> None:
    """Each stamp is processed once."""
    scene = sleeve(duration=0.1)
    through = loop.closed_loop(scene, ConnectorSolver(scene), Faults(duplicate=0.5))
    np.testing.assert_array_equal(
        through.states, loop.closed_loop(scene, ConnectorSolver(scene)).states
    )


def test_the_closed_loop_equals_that_of_simulate() -> None:
    scene = pair(duration=0.1)
    np.testing.assert_array_equal(
        loop.closed_loop(scene, ConnectorSolver(scene)).states, simulate(scene, samples=100).states
    )


def test_late_wrenches_need_the_latency() -> None:
    for latency, survives in ((0, False), (2, True)):
        scene = sleeve(latency=latency)
        trace = loop.closed_loop(scene, ConnectorSolver(scene), Faults(late=2))
        assert criteria.evaluate(scene, trace).survived == survives


def test_bodies_are_displaced_at_half_time() -> None:
    scene = sleeve(duration=0.1)
    for faults in (Faults(restart=True), Faults(teleport=True)):
        trace = loop.closed_loop(scene, ConnectorSolver(scene), faults)
        assert trace.starts == (0, 50)
        moved = trace.states[50] - trace.states[0]
        if faults.restart:
            np.testing.assert_array_equal(moved, 0.0)
        else:
            assert moved[layout.B_POSE + 1] == pytest.approx(channel.TELEPORT[1], abs=1e-6)


def test_the_connector_solver_processes_samples_as_the_node_does() -> None:
    """A much earlier stamp begins a new history; a corrupt sample gives a zero wrench."""
    scene = sleeve()
    solver = ConnectorSolver(scene)
    sample = np.zeros(layout.NSAMPLE)
    sample[layout.MOTION] = simulate(scene, samples=1).states[0]
    for stamp in (10**9, 0):
        expected = Connector(scene).step(sample)[: layout.STATE0]
        np.testing.assert_array_equal(solver.receive(stamp, sample), expected)
        sample[layout.B_POSE + 1] += 0.01  # pulled in, unless a new history begins with it
    before = solver.connector.memory
    solver.receive(0, sample)
    np.testing.assert_array_equal(solver.connector.memory, before, "each stamp is processed once")
    sample[layout.B_TWIST] = math.nan
    assert not solver.receive(10**6, sample).any()


def test_the_friction_of_the_naive_penalty_is_regularised() -> None:
    node = NaivePenalty(with_method(sleeve(com=(0.0, 0.0, 0.0)), "penalty"))
    pushed = []
    for slip in (1e-4, 1e-3, 1.0):
        scene = sleeve(velocity=slip, spin=0.0, duration=0.02)
        state = loop.initial_state(scene)
        state[layout.B_POSE + 2] -= 1e-3  # a deflection of 1 mm
        sample = np.concatenate([state, np.zeros(12)])
        pushed.append(float(node.step(sample)[layout.FORCE_B]))
    np.testing.assert_allclose(np.divide(pushed, pushed[-1]), np.tanh([0.1, 1.0, 1000.0]))
    assert pushed[-1] == pytest.approx(-0.2 * (1e-3 * node.k + 2.0))
