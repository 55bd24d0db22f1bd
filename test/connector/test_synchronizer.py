"""Samples from messages: completeness, order, repetition, restarts, axes; everything counted."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cylconn_ros.connector.frames import into_world
from cylconn_ros.connector.synchronizer import INSISTENCE, REORDERING, SampleMatcher
from cylconn_ros.core import layout
from cylconn_ros.scene.scene import Scene

MS = 1_000_000
INERTIA = [0.002, 0.0, 0.0, 0.003, 0.0, 0.004]
POSE = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)
TWIST = (4.0, 5.0, 6.0, 7.0, 8.0, 9.0)
QUARTER = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))  # a quarter turn about z
TURNED = (-5.0, 4.0, 6.0, -8.0, 7.0, 9.0)  # TWIST after it


def matcher(**changes):
    parameters = {"node_a.orientation": [0, 0, 0, 1], "body_b.mass": 1, "body_b.inertia": INERTIA}
    parameters.update({name.replace("__", "."): value for name, value in changes.items()})
    return SampleMatcher(Scene.from_parameters(parameters))


def both_free(**changes):
    return matcher(body_a__kind="free", body_a__mass=1, body_a__inertia=INERTIA, **changes)


def send(m, stamp, body=1, number=0.0):
    """Pose and twist of a body at a stamp; the answer to the second."""
    assert m.pose(body, stamp, "world", (number, *POSE[1:])) is None
    return m.twist(body, stamp, "world", TWIST)


def counted(m, **expected):
    found = {name: count for name, count in vars(m.counts).items() if count}
    return found == expected


def test_a_sample_is_complete_with_pose_and_twist_of_every_moving_body():
    m = both_free()
    assert m.pose(0, 5, "world", POSE) is None
    assert m.twist(1, 5, "world", TWIST) is None
    assert m.twist(0, 5, "world", TWIST) is None
    assert m.missing == ("body_b/pose",)
    assert m.pose(1, 5, "world", POSE) == (5, 0.0, False, False)
    assert m.missing == ()
    assert m.sample.tolist() == [*POSE, *TWIST, *POSE, *TWIST, *[0.0] * 12]
    assert counted(m, samples=1)


def test_distinct_numbers_arrive_in_their_places():
    m = both_free()
    numbers = np.arange(1.0, 27.0).tolist()
    m.pose(0, 1, "", numbers[0:7])
    m.twist(0, 1, "", numbers[7:13])
    m.pose(1, 1, "", numbers[13:20])
    m.load(0, "world", [30.0, 31.0, 32.0, 33.0, 34.0, 35.0])
    m.load(1, "world", [40.0, 41.0, 42.0, 43.0, 44.0, 45.0])
    m.twist(1, 1, "", numbers[20:26])
    assert m.sample[layout.MOTION].tolist() == numbers
    assert m.sample[layout.A_LOAD : layout.A_LOAD + 6].tolist() == list(range(30, 36))
    assert m.sample[layout.B_LOAD : layout.B_LOAD + 6].tolist() == list(range(40, 46))


def test_a_fixed_body_needs_no_message_and_stands_where_the_scene_says():
    m = matcher(body_a__pose=[7, 8, 9, 0, 0, 0, 1])
    assert send(m, 5) is not None
    assert m.sample[:13].tolist() == [7, 8, 9, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0]


def test_the_step_between_samples_is_told_in_seconds():
    m = matcher()
    assert send(m, 3 * MS).h == 0.0
    assert send(m, 5 * MS).h == pytest.approx(0.002)


def test_a_newer_complete_sample_overtakes_an_incomplete_one():
    m = matcher()
    m.pose(1, 1 * MS, "world", POSE)
    assert send(m, 2 * MS).stamp == 2 * MS
    assert m.twist(1, 1 * MS, "world", TWIST) is None
    assert counted(m, samples=1, incomplete=1, late=1)


def test_interleaved_samples_both_come_out():
    m = matcher()
    assert m.pose(1, 1 * MS, "world", POSE) is None
    assert m.pose(1, 2 * MS, "world", POSE) is None
    assert m.twist(1, 1 * MS, "world", TWIST).stamp == 1 * MS
    assert m.twist(1, 2 * MS, "world", TWIST).stamp == 2 * MS
    assert counted(m, samples=2)


def test_a_repeated_stamp_is_answered_again_and_changes_nothing():
    m = matcher()
    send(m, 5, number=1.0)
    before = m.sample.copy()
    again = send(m, 5, number=2.0)
    assert again == (5, 0.0, True, False)
    assert np.array_equal(m.sample, before)
    assert counted(m, samples=1, repeated=2, answered_again=1)
    assert send(m, 5).repeated  # as often as it is asked
    assert m.pose(1, 5, "world", POSE) is None  # but not for half a sample


def test_the_first_of_two_messages_with_one_stamp_counts():
    m = matcher()
    m.pose(1, 5, "world", POSE)
    m.pose(1, 5, "world", (9.0, *POSE[1:]))
    m.twist(1, 5, "world", TWIST)
    assert m.sample[layout.B_POSE] == 1.0
    assert counted(m, samples=1, repeated=1)


def test_a_sample_overtaken_by_the_next_is_late():
    m = matcher()
    send(m, 1 * MS)
    send(m, 3 * MS)
    assert send(m, 2 * MS) is None
    assert send(m, 4 * MS).h == pytest.approx(0.001)
    assert counted(m, samples=3, late=2)


def test_stamps_that_jump_back_begin_a_new_history():
    m = matcher()
    for k in range(20):
        send(m, k * MS)
    back = send(m, 0)
    assert back == (0, 0.0, False, True)
    assert send(m, MS) == (MS, 0.001, False, False)
    assert counted(m, samples=22, restarts=1)


def test_a_short_jump_back_is_accepted_when_the_source_insists():
    m = matcher()
    for k in range(REORDERING):
        send(m, k * MS)
    answers = [send(m, 0) for _ in range(INSISTENCE)]  # a plant in lock step asks again
    assert answers[:-1] == [None] * (INSISTENCE - 1)
    assert answers[-1].restarted
    assert m.counts.restarts == 1
    assert m.counts.late == 2 * (INSISTENCE - 1)


def test_a_short_jump_back_of_a_source_that_goes_on_is_accepted():
    m = matcher()
    for k in range(REORDERING):
        send(m, k * MS)
    answers = [send(m, k * MS) for k in range(4)]
    assert [answer is not None for answer in answers] == [False, False, True, True]
    assert answers[2].restarted
    assert answers[3] == (3 * MS, 0.001, False, False)


def test_without_a_period_the_reach_follows_the_stamps():
    m = matcher(period=0.0)
    send(m, 0)
    send(m, 100 * MS)
    assert send(m, 50 * MS) is None
    m = matcher(period=0.0)
    send(m, 5)
    assert send(m, 3).restarted  # one sample tells no period


def test_forget_begins_anew():
    m = matcher()
    send(m, 100 * MS)
    m.pose(1, 101 * MS, "world", POSE)
    m.forget()
    assert m.last_stamp is None
    assert m.twist(1, 101 * MS, "world", TWIST) is None
    assert send(m, 5) == (5, 0.0, False, False)
    assert counted(m, samples=2, incomplete=1)


def test_memory_is_bounded_and_what_is_given_up_is_counted():
    m = matcher()
    for k in range(1000):
        m.pose(1, k * MS, "world", POSE)
    assert counted(m, incomplete=1000 - 64)
    assert m.twist(1, 999 * MS, "world", TWIST).stamp == 999 * MS
    assert m.counts.incomplete == 999
    for k in range(900):
        m.pose(1, k, "world", POSE)
    assert counted(m, samples=1, incomplete=999, late=900)


def test_stamps_within_the_tolerance_are_one_sample():
    m = both_free(stamp_tolerance=0.0002)
    m.pose(0, 10 * MS, "world", POSE)
    m.twist(0, 10 * MS + 100_000, "world", TWIST)
    m.pose(1, 10 * MS - 100_000, "world", POSE)
    assert m.twist(1, 10 * MS, "world", TWIST).stamp == 10 * MS + 100_000
    m.pose(0, 11 * MS, "world", POSE)
    m.twist(0, 11 * MS, "world", TWIST)
    m.pose(1, 11 * MS + 200_001, "world", POSE)
    assert m.twist(1, 11 * MS, "world", TWIST) is None
    assert counted(m, samples=1)


def test_without_tolerance_a_nanosecond_is_another_sample():
    m = matcher()
    m.pose(1, 5, "world", POSE)
    assert m.twist(1, 6, "world", TWIST) is None


@pytest.mark.parametrize(
    ("frame", "default", "turned", "foreign"),
    [
        ("world", "body", False, 0),
        ("body_b", "world", True, 0),
        ("", "world", False, 0),
        ("", "body", True, 0),
        ("odom", "world", False, 1),
        ("body_a", "body", True, 1),  # the other body's axes are not offered
    ],
)
def test_the_frame_says_in_which_axes_twist_and_load_are(frame, default, turned, foreign):
    m = matcher(twist_axes=default)
    m.load(1, frame, TWIST)
    m.pose(1, 5, "world", (*POSE[:3], *QUARTER))
    m.twist(1, 5, frame, TWIST)
    expected = TURNED if turned else TWIST
    twist = m.sample[layout.B_TWIST : layout.B_TWIST + 6]
    assert twist.tolist() == pytest.approx(expected)
    assert m.sample[layout.B_LOAD : layout.B_LOAD + 6].tolist() == pytest.approx(expected)
    assert m.counts.foreign_frames == 2 * foreign


def test_a_load_in_body_axes_turns_with_the_body_until_the_next():
    m = matcher()
    m.load(1, "body_b", TWIST)
    send(m, 1 * MS)
    assert m.sample[layout.B_LOAD : layout.B_LOAD + 6].tolist() == pytest.approx(TWIST)
    m.pose(1, 2 * MS, "world", (*POSE[:3], *QUARTER))
    m.twist(1, 2 * MS, "world", TWIST)
    assert m.sample[layout.B_LOAD : layout.B_LOAD + 6].tolist() == pytest.approx(TURNED)
    m.load(1, "world", (0.0,) * 6)
    send(m, 3 * MS)
    assert not m.sample[layout.B_LOAD : layout.B_LOAD + 6].any()


def test_a_pose_in_a_foreign_frame_is_counted():
    m = matcher()
    m.pose(1, 5, "map", POSE)
    assert counted(m, foreign_frames=1)


def test_odometry_is_pose_and_twist_in_one_with_the_twist_in_the_child_frame():
    m = matcher(input="odometry")
    pose = (*POSE[:3], *QUARTER)
    assert m.odometry(1, 5, ("world", "body_b"), pose, TWIST).stamp == 5
    assert m.sample[layout.B_TWIST : layout.B_TWIST + 6].tolist() == pytest.approx(TURNED)
    m.odometry(1, 6, ("world", "world"), pose, TWIST)
    assert m.sample[layout.B_TWIST : layout.B_TWIST + 6].tolist() == pytest.approx(TWIST)
    assert m.odometry(1, 6, ("world", "body_b"), pose, TWIST).repeated
    m.odometry(1, 7, ("world", "base_link"), pose, TWIST)
    assert m.counts.foreign_frames == 1


def test_the_quaternion_s_length_does_not_matter_to_a_turn():
    quarter = [7.0 * component for component in QUARTER]
    assert into_world((*POSE[:3], *quarter), TWIST) == pytest.approx(TURNED)


@pytest.mark.parametrize("q", [(0.0,) * 4, (math.nan, 0.0, 0.0, 1.0), (math.inf, 0.0, 0.0, 0.0)])
def test_a_direction_that_nobody_knows_is_not_a_number(q):
    assert all(math.isnan(number) for number in into_world((*POSE[:3], *q), TWIST))


@settings(deadline=None)
@given(
    st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: math.hypot(*q) > 0.1),
    st.lists(st.floats(-9.0, 9.0), min_size=6, max_size=6),
)
def test_turning_there_and_back_gives_the_same(q, pair):
    turned = into_world([0.0] * 3 + q, pair)
    assert np.hypot.reduce(turned[:3]) == pytest.approx(np.hypot.reduce(pair[:3]), abs=1e-9)
    back = into_world([0.0] * 3 + [-q[0], -q[1], -q[2], q[3]], turned)
    assert back == pytest.approx(pair, abs=1e-9)


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 60)), max_size=300))
def test_whatever_arrives_every_message_is_accounted_for(arrivals):
    """Samples ascend within a history, and no message vanishes."""
    m = both_free()
    last = None
    for stream, stamp in arrivals:
        take = m.twist if stream % 2 else m.pose
        matched = take(stream // 2, stamp * MS, "world", TWIST if stream % 2 else POSE)
        if matched is None:
            continue
        if last is not None and not matched.restarted:
            assert matched.repeated == (matched.stamp == last)
            assert matched.stamp >= last
        last = matched.stamp
    c = m.counts
    assert sum(m.received.values()) == len(arrivals)
    under_construction = sum(slot.seen.bit_count() for slot in m._pending.values())
    given_up = len(arrivals) - 4 * c.samples - c.repeated - c.late - under_construction
    assert c.incomplete <= given_up <= 3 * c.incomplete
    assert len(m._pending) <= 64
    assert len(m._old) <= 8
