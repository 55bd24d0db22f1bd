"""The judge of hard conditions sees what is wrong, and the way there and back is as stated."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from cylconn_ros.bench.common.methods import served_by
from cylconn_ros.bench.stability import channel, criteria, loop
from cylconn_ros.bench.stability.channel import Channel, Faults
from cylconn_ros.bench.stability.criteria import RESTS, SLIDES
from cylconn_ros.bench.stability.naive import PenaltyNode
from cylconn_ros.bench.stability.scenes import pair, sleeve
from cylconn_ros.bench.stability.solvers import Ours
from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.laws import runs_recorded_or_simulated
from cylconn_ros.simulation.simulate import simulate

# --- the judge ---


def good() -> loop.Trace:
    scene = sleeve()
    return loop.closed(scene, Ours(scene))


def changed(trace: loop.Trace, at: int, by: float, since: float) -> loop.Trace:
    states = trace.states.copy()
    states[trace.time >= since, at] += by
    return dataclasses.replace(trace, states=states)


def test_a_good_run_has_nothing_to_be_said() -> None:
    found = criteria.judge(sleeve(), good(), SLIDES, runs_recorded_or_simulated.broken)
    assert found.survived
    assert found.offset < 1e-8
    assert found.energy <= 0.0


@pytest.mark.parametrize(
    ("at", "by", "since", "reason"),
    [
        (layout.B_POSE + 1, 1.1e-3, 0.5, "offset 1.1 mm"),
        (layout.B_POSE + 2, -0.9e-3, 0.5, ""),
        (layout.B_POSE, 5.0, 0.5, ""),  # along the slot
        (layout.B_POSE + 5, 0.011, 0.5, "angle"),  # half the angle
        (layout.B_TWIST, 2.0, 0.5, "energy"),
        (layout.B_TWIST, math.nan, 0.5, "not finite"),
    ],
)
def test_what_is_wrong_is_seen(at: int, by: float, since: float, reason: str) -> None:
    found = criteria.judge(sleeve(), changed(good(), at, by, since), SLIDES)
    assert found.reason.startswith(reason)
    assert found.survived == (not reason)


@pytest.mark.parametrize(("gained", "reason"), [(0.008, ""), (0.012, "energy +1.19 %")])
def test_a_percent_of_energy_is_granted(gained: float, reason: str) -> None:
    scene = sleeve(gravity=[0.0, 0.0, 0.0], friction={"coefficient": 0.0})
    trace = loop.closed(scene, Ours(scene))
    states = trace.states.copy()
    states[600:, layout.B_TWIST : layout.B_TWIST + 6] *= math.sqrt(1.0 + gained)
    assert criteria.judge(scene, dataclasses.replace(trace, states=states)).reason == reason


def test_the_first_fifth_of_a_second_is_for_settling() -> None:
    trace = good()
    states = trace.states.copy()
    states[(trace.time > 0.1) & (trace.time < 0.19), layout.B_POSE + 1] += 0.1
    assert criteria.judge(sleeve(), dataclasses.replace(trace, states=states)).survived


def test_a_wrench_that_is_not_finite_is_seen() -> None:
    trace = good()
    assert trace.wrenches is not None
    wrenches = trace.wrenches.copy()
    wrenches[7, 3] = math.inf
    found = criteria.judge(sleeve(), dataclasses.replace(trace, wrenches=wrenches))
    assert found.reason.startswith("wrench not finite at 0.007")


def test_an_end_that_is_wrong_is_seen() -> None:
    assert criteria.judge(sleeve(), good(), RESTS).reason.startswith("does not rest")
    scene = sleeve(friction={"coefficient": 3.0})
    trace = loop.closed(scene, Ours(scene))
    assert criteria.judge(scene, trace, RESTS).survived
    assert criteria.judge(scene, trace, SLIDES).reason == "rests and should slide"


def test_a_broken_law_is_seen() -> None:
    trace = good()
    assert trace.outs is not None
    outs = trace.outs.copy()
    outs[100, layout.FORCE + 1] *= 1.0 + 1e-9
    found = criteria.judge(
        sleeve(), dataclasses.replace(trace, outs=outs), SLIDES, runs_recorded_or_simulated.broken
    )
    assert found.reason.startswith("law ")


def test_energy_is_the_plants() -> None:
    scene = pair(gravity=[0.1, 0.2, -9.81])
    run = simulate(scene, 200)
    kinetic, work = criteria.energies(scene, run.states)
    np.testing.assert_allclose(np.diff(kinetic - work), np.diff(run.energy), atol=1e-12)


def test_kinematics_are_the_connectors_where_it_is_right() -> None:
    scene = sleeve(tilt=0.5)
    run = simulate(scene, 50)
    seen = criteria.look(scene, run.states)
    np.testing.assert_allclose(seen.length, run.state("length"), atol=1e-12)
    np.testing.assert_allclose(seen.spin, run.state("angle"), atol=1e-12)
    cosine = np.cos(np.linalg.norm(run.state("misalignment"), axis=1))
    np.testing.assert_allclose(seen.direction[:, 0], cosine, atol=1e-12)


# --- the way between plant and connector ---


def sent(faults: Faults, n: int = 2000) -> list[list[int]]:
    way = Channel(faults, list(range(13, 26)))
    sample = np.zeros(layout.NSAMPLE)
    return [[stamp for stamp, _ in way.deliver(k, k, sample)] for k in range(n)]


def test_a_sound_way_delivers_everything_once() -> None:
    assert sent(Faults()) == [[k] for k in range(2000)]


def test_drops_duplicates_and_reordering_are_of_the_stated_share() -> None:
    drops, twice, swapped = map(
        sent, (Faults(drop=0.1), Faults(duplicate=0.1), Faults(reorder=0.1))
    )
    assert sum(not arrived for arrived in drops) == pytest.approx(200, rel=0.2)
    assert sum(len(arrived) == 2 for arrived in twice) == pytest.approx(200, rel=0.2)
    arrived = [stamp for each in swapped for stamp in each]
    late = [b for a, b in itertools.pairwise(arrived) if b < a]
    assert len(late) == pytest.approx(200, rel=0.3)
    assert sorted(arrived) == list(range(arrived[-1] + 1)), "nothing is lost"


def test_a_wrench_is_late_by_the_stated_samples() -> None:
    way = Channel(Faults(late=3), [])
    acted = [way.act(np.full(12, float(k)))[0] for k in range(6)]
    assert acted == [0.0, 0.0, 0.0, 0.0, 1.0, 2.0]


@pytest.mark.parametrize(("kind", "count"), [("NaN", 26), ("infinity", 26), ("zero quaternion", 2)])
def test_every_field_is_unusable_once(kind: str, count: int) -> None:
    way = Channel(Faults(corrupt=kind), list(range(26)))
    sample = np.ones(layout.NSAMPLE)
    places = set()
    for k in range(1000):
        (_, arrived), *_ = way.deliver(k, k, sample)
        places |= {tuple(np.flatnonzero(arrived != sample))} - {()}
    assert len(places) == count
    assert np.isfinite(sample).all(), "the plant's own is untouched"


def test_periods_are_jittered_by_no_more_than_stated() -> None:
    way = Channel(Faults(jitter=0.3), [])
    stretched = np.array([way.stretch() for _ in range(1000)])
    assert 0.7 <= stretched.min() < 0.72
    assert 1.28 < stretched.max() <= 1.3


def test_a_sound_way_gives_the_run_without_one() -> None:
    """Duplicates change nothing at all: each stamp is answered once."""
    scene = sleeve(duration=0.1)
    through = loop.closed(scene, Ours(scene), Faults(duplicate=0.5))
    np.testing.assert_array_equal(through.states, loop.closed(scene, Ours(scene)).states)


def test_the_loop_is_that_of_simulate() -> None:
    scene = pair(duration=0.1)
    np.testing.assert_array_equal(
        loop.closed(scene, Ours(scene)).states, simulate(scene, 100).states
    )


def test_late_wrenches_pull_the_rug() -> None:
    """Told or not is all the difference."""
    for latency, lives in ((0, False), (2, True)):
        scene = sleeve(latency=latency)
        trace = loop.closed(scene, Ours(scene), Faults(late=2))
        assert criteria.judge(scene, trace).survived == lives


def test_the_bodies_are_put_elsewhere_at_half_time() -> None:
    scene = sleeve(duration=0.1)
    for faults in (Faults(restart=True), Faults(teleport=True)):
        trace = loop.closed(scene, Ours(scene), faults)
        assert trace.begins == (0, 50)
        way = trace.states[50] - trace.states[0]
        if faults.restart:
            np.testing.assert_array_equal(way, 0.0)
        else:
            assert way[layout.B_POSE + 1] == pytest.approx(channel.TELEPORT[1], abs=1e-6)


def test_our_connector_is_fed_as_by_the_node() -> None:
    """A stamp that goes far back begins a new history; a bad sample gives no wrench."""
    scene = sleeve()
    ours = Ours(scene)
    sample = np.zeros(layout.NSAMPLE)
    sample[layout.MOTION] = simulate(scene, 1).states[0]
    for stamp in (10**9, 0):
        expected = Connector(scene).step(sample)[: layout.STATE0]
        np.testing.assert_array_equal(ours.receive(stamp, sample), expected)
        sample[layout.B_POSE + 1] += 0.01  # to be pulled in, unless a new history begins with it
    before = ours.connector.memory
    ours.receive(0, sample)
    np.testing.assert_array_equal(ours.connector.memory, before, "answered once")
    sample[layout.B_TWIST] = math.nan
    assert not ours.receive(10**6, sample).any()


def test_the_hand_written_friction_is_regularised() -> None:
    node = PenaltyNode(served_by(sleeve(com=(0.0, 0.0, 0.0)), "penalty"))
    pushed = []
    for slip in (1e-4, 1e-3, 1.0):
        state = loop.closed(sleeve(velocity=slip, spin=0.0, duration=0.02), Ours(sleeve())).states[
            0
        ]
        state[layout.B_POSE + 2] -= 1e-3  # a millimetre of spring
        sample = np.concatenate([state, np.zeros(12)])
        pushed.append(float(node.answer(sample)[layout.FORCE_B]))
    np.testing.assert_allclose(np.divide(pushed, pushed[-1]), np.tanh([0.1, 1.0, 1000.0]))
    assert pushed[-1] == pytest.approx(-0.2 * (1e-3 * node.k + 2.0))
