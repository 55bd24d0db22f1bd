"""Synchronisation of messages to samples: completeness, order, duplicates, restarts, axes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cylconn_ros.connector.frames import into_world
from cylconn_ros.connector.synchronizer import MIN_OLD_SAMPLES, REORDERING, SampleMatcher
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
    """Pose and twist of a body at a stamp; the result of the second."""
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


def test_every_number_is_written_to_its_index():
    m = both_free()
    numbers = np.arange(1.0, 27.0).tolist()
    m.pose(0, 1, "", numbers[0:7])
    m.twist(0, 1, "", numbers[7:13])
    m.pose(1, 1, "", numbers[13:20])
    m.load(0, 0, "world", [30.0, 31.0, 32.0, 33.0, 34.0, 35.0])
    m.load(1, 0, "world", [40.0, 41.0, 42.0, 43.0, 44.0, 45.0])
    m.twist(1, 1, "", numbers[20:26])
    assert m.sample[layout.MOTION].tolist() == numbers
    assert m.sample[layout.A_LOAD : layout.A_LOAD + 6].tolist() == list(range(30, 36))
    assert m.sample[layout.B_LOAD : layout.B_LOAD + 6].tolist() == list(range(40, 46))


def test_a_fixed_body_needs_no_message_and_has_the_pose_of_the_scene():
    m = matcher(body_a__pose=[7, 8, 9, 0, 0, 0, 1])
    assert send(m, 5) is not None
    assert m.sample[:13].tolist() == [7, 8, 9, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0]


def test_the_time_between_samples_is_in_seconds():
    m = matcher()
    assert send(m, 3 * MS).h == 0.0
    assert send(m, 5 * MS).h == pytest.approx(0.002)


def test_a_newer_complete_sample_drops_an_incomplete_one():
    m = matcher()
    m.pose(1, 1 * MS, "world", POSE)
    assert send(m, 2 * MS).stamp == 2 * MS
    assert m.twist(1, 1 * MS, "world", TWIST) is None
    assert counted(m, samples=1, incomplete=1, late=1)


def test_interleaved_samples_are_both_complete():
    m = matcher()
    assert m.pose(1, 1 * MS, "world", POSE) is None
    assert m.pose(1, 2 * MS, "world", POSE) is None
    assert m.twist(1, 1 * MS, "world", TWIST).stamp == 1 * MS
    assert m.twist(1, 2 * MS, "world", TWIST).stamp == 2 * MS
    assert counted(m, samples=2)


def test_a_duplicate_sample_is_reported_and_changes_nothing():
    m = matcher()
    send(m, 5, number=1.0)
    before = m.sample.copy()
    again = send(m, 5, number=2.0)
    assert again == (5, 0.0, True, False)
    assert np.array_equal(m.sample, before)
    assert counted(m, samples=1, duplicate_messages=2, duplicate_samples=1)
    assert send(m, 5).repeated  # any number of times
    assert m.pose(1, 5, "world", POSE) is None  # not for a part of the sample


def test_the_first_of_two_messages_with_one_stamp_is_used():
    m = matcher()
    m.pose(1, 5, "world", POSE)
    m.pose(1, 5, "world", (9.0, *POSE[1:]))
    m.twist(1, 5, "world", TWIST)
    assert m.sample[layout.B_POSE] == 1.0
    assert counted(m, samples=1, duplicate_messages=1)


def test_a_sample_overtaken_by_the_next_is_late():
    m = matcher()
    send(m, 1 * MS)
    send(m, 3 * MS)
    assert send(m, 2 * MS) is None
    assert send(m, 4 * MS).h == pytest.approx(0.001)
    assert counted(m, samples=3, late=2)


def test_a_long_jump_back_of_the_stamps_is_a_restart():
    m = matcher()
    for k in range(20):
        send(m, k * MS)
    back = send(m, 0)
    assert back == (0, 0.0, False, True)
    assert send(m, MS) == (MS, 0.001, False, False)
    assert counted(m, samples=22, restarts=1)


def test_a_short_jump_back_is_a_restart_if_the_old_sample_is_repeated():
    m = matcher()
    for k in range(REORDERING):
        send(m, k * MS)
    results = [send(m, 0) for _ in range(MIN_OLD_SAMPLES)]  # a plant in lock step repeats it
    assert results[:-1] == [None] * (MIN_OLD_SAMPLES - 1)
    assert results[-1].restarted
    assert m.counts.restarts == 1
    assert m.counts.late == 2 * (MIN_OLD_SAMPLES - 1)


def test_a_short_jump_back_is_a_restart_if_several_old_samples_follow():
    m = matcher()
    for k in range(REORDERING):
        send(m, k * MS)
    results = [send(m, k * MS) for k in range(4)]
    assert [result is not None for result in results] == [False, False, True, True]
    assert results[2].restarted
    assert results[3] == (3 * MS, 0.001, False, False)


def test_without_a_period_the_limit_of_reordering_follows_the_stamps():
    m = matcher(period=0.0)
    send(m, 0)
    send(m, 100 * MS)
    assert send(m, 50 * MS) is None
    m = matcher(period=0.0)
    send(m, 5)
    assert send(m, 3).restarted  # one sample defines no period


def test_reset_forgets_stamps_and_incomplete_samples():
    m = matcher()
    send(m, 100 * MS)
    m.pose(1, 101 * MS, "world", POSE)
    m.reset()
    assert m.last_stamp is None
    assert m.twist(1, 101 * MS, "world", TWIST) is None
    assert send(m, 5) == (5, 0.0, False, False)
    assert counted(m, samples=2, incomplete=1)


def test_memory_is_bounded_and_dropped_samples_are_counted():
    m = matcher()
    for k in range(2000):
        m.pose(1, k * MS, "world", POSE)
    assert counted(m, incomplete=2000 - 1024)
    assert m.twist(1, 1999 * MS, "world", TWIST).stamp == 1999 * MS
    assert m.counts.incomplete == 1999
    for k in range(900):
        m.pose(1, k, "world", POSE)
    assert counted(m, samples=1, incomplete=1999, late=900)


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
    ("frame", "default", "turned", "unknown"),
    [
        ("world", "body", False, 0),
        ("body_b", "world", True, 0),
        ("", "world", False, 0),
        ("", "body", True, 0),
        ("odom", "world", False, 1),
        ("body_a", "body", True, 1),  # the other body's frame is not accepted
        ("/world", "body", False, 0),  # a leading slash changes nothing
        ("/body_b", "world", True, 0),
        ("/", "world", False, 0),
        ("/odom", "world", False, 1),
    ],
)
def test_the_frame_states_the_axes_of_twist_and_load(frame, default, turned, unknown):
    m = matcher(twist_axes=default)
    m.load(1, 0, frame, TWIST)
    m.pose(1, 5, "world", (*POSE[:3], *QUARTER))
    m.twist(1, 5, frame, TWIST)
    expected = TURNED if turned else TWIST
    twist = m.sample[layout.B_TWIST : layout.B_TWIST + 6]
    assert twist.tolist() == pytest.approx(expected)
    assert m.sample[layout.B_LOAD : layout.B_LOAD + 6].tolist() == pytest.approx(expected)
    assert m.counts.unknown_frames == 2 * unknown


def test_a_load_in_body_axes_rotates_with_the_body_until_the_next():
    m = matcher()
    m.load(1, 0, "body_b", TWIST)
    send(m, 1 * MS)
    assert m.sample[layout.B_LOAD : layout.B_LOAD + 6].tolist() == pytest.approx(TWIST)
    m.pose(1, 2 * MS, "world", (*POSE[:3], *QUARTER))
    m.twist(1, 2 * MS, "world", TWIST)
    assert m.sample[layout.B_LOAD : layout.B_LOAD + 6].tolist() == pytest.approx(TURNED)
    m.load(1, 0, "world", (0.0,) * 6)
    send(m, 3 * MS)
    assert not m.sample[layout.B_LOAD : layout.B_LOAD + 6].any()


def test_a_pose_in_an_unknown_frame_is_counted():
    m = matcher()
    m.pose(1, 5, "/world", POSE)
    assert m.counts.unknown_frames == 0
    m.pose(1, 6, "map", POSE)
    assert m.counts.unknown_frames == 1


def test_a_leading_slash_in_the_parameters_changes_nothing():
    m = matcher(world_frame="/world", body_b__frame="/body_b")
    m.pose(1, 5, "world", (*POSE[:3], *QUARTER))
    m.twist(1, 5, "body_b", TWIST)
    assert m.counts.unknown_frames == 0
    assert m.sample[layout.B_TWIST : layout.B_TWIST + 6].tolist() == pytest.approx(TURNED)


def test_odometry_carries_pose_and_twist_with_the_twist_in_the_child_frame():
    m = matcher(input="odometry")
    pose = (*POSE[:3], *QUARTER)
    assert m.motion(1, 5, ("world", "body_b"), pose, TWIST).stamp == 5
    assert m.sample[layout.B_TWIST : layout.B_TWIST + 6].tolist() == pytest.approx(TURNED)
    m.motion(1, 6, ("world", "world"), pose, TWIST)
    assert m.sample[layout.B_TWIST : layout.B_TWIST + 6].tolist() == pytest.approx(TWIST)
    assert m.motion(1, 6, ("world", "body_b"), pose, TWIST).repeated
    m.motion(1, 7, ("world", "base_link"), pose, TWIST)
    assert m.counts.unknown_frames == 1


def test_the_length_of_the_quaternion_does_not_affect_a_rotation():
    quarter = [7.0 * component for component in QUARTER]
    assert into_world((*POSE[:3], *quarter), TWIST) == pytest.approx(TURNED)


@pytest.mark.parametrize("q", [(0.0,) * 4, (math.nan, 0.0, 0.0, 1.0), (math.inf, 0.0, 0.0, 0.0)])
def test_a_quaternion_without_direction_gives_nan(q):
    assert all(math.isnan(number) for number in into_world((*POSE[:3], *q), TWIST))


@given(
    st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: math.hypot(*q) > 0.1),
    st.lists(st.floats(-9.0, 9.0), min_size=6, max_size=6),
)
def test_a_rotation_and_its_inverse_give_the_same_pair(q, pair):
    turned = into_world([0.0] * 3 + q, pair)
    assert np.hypot.reduce(turned[:3]) == pytest.approx(np.hypot.reduce(pair[:3]), abs=1e-9)
    back = into_world([0.0] * 3 + [-q[0], -q[1], -q[2], q[3]], turned)
    assert back == pytest.approx(pair, abs=1e-9)


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 60)), max_size=300))
def test_every_message_is_part_of_a_sample_or_counted(arrivals):
    """Stamps ascend within a history, and every message is used or counted."""
    m = both_free()
    last = None
    for stream, stamp in arrivals:
        process = m.twist if stream % 2 else m.pose
        found = process(stream // 2, stamp * MS, "world", TWIST if stream % 2 else POSE)
        if found is None:
            continue
        if last is not None and not found.restarted:
            assert found.repeated == (found.stamp == last)
            assert found.stamp >= last
        last = found.stamp
    c = m.counts
    assert sum(m.received.values()) == len(arrivals)
    incomplete = sum(slot.received.bit_count() for slot in m._pending.values())
    dropped = len(arrivals) - 4 * c.samples - c.duplicate_messages - c.late - incomplete
    assert c.incomplete <= dropped <= 3 * c.incomplete
    assert len(m._pending) <= 1024
    assert len(m._old) <= 8
