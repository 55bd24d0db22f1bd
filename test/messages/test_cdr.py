"""CDR decoders and encoders against the serialization of ROS, and with damaged bytes."""

import contextlib
import struct
from collections.abc import Callable

import numpy as np
import pytest
from cylconn_ros.msg import ConnectorState
from geometry_msgs.msg import PoseStamped, TransformStamped, TwistStamped, WrenchStamped
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from cylconn_ros.core import layout
from cylconn_ros.messages import cdr_decoder, cdr_encoder
from cylconn_ros.scene.inputs import INPUTS, InputType

STAMP = 7_000_000_009
READERS: list[Callable[[bytes], object]] = [
    cdr_decoder.read_pose,
    cdr_decoder.read_twist,
    cdr_decoder.read_wrench,
    cdr_decoder.read_odometry,
    cdr_decoder.read_joint_state,
    cdr_decoder.read_stamp,
]
# Lengths 0 to 8 put the numbers at every possible alignment.
frames = pytest.mark.parametrize(
    "frame", ["", "a", "ab", "abc", "abcd", "abcde", "größe", "x" * 99]
)


def stamped(message, frame):
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(STAMP, 1_000_000_000)
    message.header.frame_id = frame
    return message


def set_pose(pose, numbers):
    point, q = pose.position, pose.orientation
    point.x, point.y, point.z, q.x, q.y, q.z, q.w = numbers


def set_pair(first, second, numbers):
    first.x, first.y, first.z, second.x, second.y, second.z = numbers


def pose_message(frame):
    message = stamped(PoseStamped(), frame)
    set_pose(message.pose, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0))
    return message


def twist_message(frame):
    message = stamped(TwistStamped(), frame)
    set_pair(message.twist.linear, message.twist.angular, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    return message


def wrench_message(frame):
    message = stamped(WrenchStamped(), frame)
    set_pair(message.wrench.force, message.wrench.torque, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    return message


def odometry_message(frame, child="child"):
    message = stamped(Odometry(), frame)
    message.child_frame_id = child
    set_pose(message.pose.pose, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0))
    twist = message.twist.twist
    set_pair(twist.linear, twist.angular, (8.0, 9.0, 10.0, 11.0, 12.0, 13.0))
    return message


def joint_message(frame):
    message = stamped(JointState(), frame)
    message.name = ["slide", "spin"]
    message.position, message.velocity, message.effort = [1.0, 2.0], [3.0, 4.0], [5.0, 6.0]
    return message


MESSAGES = [pose_message, twist_message, wrench_message, odometry_message, joint_message]


def assert_same(data, message):
    """Assert that bytes are a message, by its fields: ROS does not initialise the padding."""
    assert len(data) == len(serialize_message(message))
    assert deserialize_message(data, type(message)) == message


def swap(data: bytes, layout_: str) -> bytes:
    """Turn a little-endian message into a big-endian one, its fields given as struct codes."""
    return b"\x00\x00\x00\x00" + struct.pack(
        ">" + layout_, *struct.unpack_from("<" + layout_, data, 4)
    )


@frames
def test_pose_is_decoded(frame):
    read = cdr_decoder.read_pose(serialize_message(pose_message(frame)))
    assert read == (STAMP, frame, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0))


@frames
@pytest.mark.parametrize(
    ("make", "read"),
    [(twist_message, cdr_decoder.read_twist), (wrench_message, cdr_decoder.read_wrench)],
)
def test_twist_and_wrench_are_decoded(make, read, frame):
    assert read(serialize_message(make(frame))) == (STAMP, frame, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0))


@frames
@pytest.mark.parametrize("child", ["", "b", "body_b"])
def test_odometry_is_decoded(frame, child):
    read = cdr_decoder.read_odometry(serialize_message(odometry_message(frame, child)))
    assert (read.stamp, read.frame, read.child_frame) == (STAMP, frame, child)
    assert read.pose == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
    assert read.twist == (8.0, 9.0, 10.0, 11.0, 12.0, 13.0)


@frames
def test_joint_state_is_decoded(frame):
    read = cdr_decoder.read_joint_state(serialize_message(joint_message(frame)))
    assert read[:3] == (STAMP, frame, ("slide", "spin"))
    assert read[3:] == ((1.0, 2.0), (3.0, 4.0), (5.0, 6.0))


def test_joint_state_without_numbers_is_decoded():
    read = cdr_decoder.read_joint_state(serialize_message(stamped(JointState(), "f")))
    assert read == (STAMP, "f", (), (), (), ())


def test_big_endian_is_decoded():
    # The header with "abc" and its zero ends at byte 16 of the body: no padding before the numbers
    data = swap(serialize_message(pose_message("abc")), "iII4s7d")
    assert cdr_decoder.read_pose(data) == (STAMP, "abc", (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0))


def test_stamp_before_the_epoch_is_decoded():
    message = pose_message("f")
    message.header.stamp.sec, message.header.stamp.nanosec = -2, 5
    assert cdr_decoder.read_stamp(serialize_message(message)) == -2_000_000_000 + 5


@frames
def test_stamped_encoder_agrees_with_ros(frame):
    writer = cdr_encoder.StampedWriter(frame)
    writer.write(1, np.zeros(6))  # must not affect the next message
    data = writer.write(STAMP, np.arange(1.0, 7.0))
    assert_same(data, wrench_message(frame))
    data = cdr_encoder.StampedWriter(frame, 7).write(STAMP, np.arange(1.0, 8.0))
    assert_same(data, pose_message(frame))


@frames
def test_odometry_encoder_agrees_with_ros(frame):
    writer = cdr_encoder.OdometryWriter(frame, "child")
    data = writer.write(STAMP, np.arange(1.0, 8.0), np.arange(8.0, 14.0))
    assert_same(data, odometry_message(frame))


@frames
def test_joint_state_encoder_agrees_with_ros(frame):
    writer = cdr_encoder.JointStateWriter(frame, ("slide", "spin"))
    data = writer.write(STAMP, (1.0, 2.0), (3.0, 4.0), (5.0, 6.0))
    assert_same(data, joint_message(frame))


@frames
def test_state_encoder_writes_every_field(frame):
    out = np.arange(1.0, layout.NOUT + 1.0)
    whole = (2, 5, 3, 1, 0xFFFF0102)
    out[layout.REGIME :] = whole
    writer = cdr_encoder.StateWriter(frame, "impulse")
    data = writer.write(STAMP, out)
    message = deserialize_message(data, ConnectorState)
    assert message.header == stamped(ConnectorState(), frame).header
    for name, width in layout.STATE_FIELDS:
        at = layout.STATE_INDEX[name]
        value = getattr(message, name)
        assert (list(value) if width > 1 else [value]) == out[at : at + width].tolist(), name
    found = (message.regime, message.stop, message.lock, message.status, message.flags)
    assert found == whole
    assert message.method == "impulse"
    assert_same(data, message)


@frames
def test_a_new_input_type_is_one_row_of_the_table(frame):
    """A type with another set of quantities is decoded and encoded without code of its own."""
    kind = InputType("transform", "geometry_msgs/msg/TransformStamped", "", 56, pose=0,
                     has_child_frame=True)  # fmt: skip
    message = stamped(TransformStamped(), frame)
    message.child_frame_id = "child"
    point, q = message.transform.translation, message.transform.rotation
    point.x, point.y, point.z, q.x, q.y, q.z, q.w = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
    found = cdr_decoder.read_input(kind, serialize_message(message))
    assert found == (STAMP, frame, "child", (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0), ())
    writer = cdr_encoder.InputWriter(kind, frame, "child")
    assert_same(writer.write(STAMP, np.arange(1.0, 8.0), np.zeros(6)), message)


@pytest.mark.parametrize("kind", INPUTS, ids=lambda kind: kind.topic)
def test_input_types_agree_with_ros(kind):
    make = {"pose": pose_message, "twist": twist_message, "load": wrench_message,
            "odom": odometry_message}[kind.topic]  # fmt: skip
    message = make("frame")
    found = cdr_decoder.read_input(kind, serialize_message(message))
    writer = cdr_encoder.InputWriter(kind, "frame", "child")
    assert_same(writer.write(STAMP, np.array(found.pose), np.array(found.pair)), message)


@pytest.mark.parametrize("make", MESSAGES)
def test_cut_off_or_too_long_messages_are_refused(make):
    reader = READERS[MESSAGES.index(make)]
    data = serialize_message(make("body_b"))
    reader(data + b"\x00" * 3)  # padding is accepted
    for end in range(len(data) - 3):
        with pytest.raises(cdr_decoder.CdrError):
            reader(data[:end])
    with pytest.raises(cdr_decoder.CdrError, match="expected"):
        reader(data + bytes(32))


@pytest.mark.parametrize("kind", [b"\x00\x02", b"\x00\x03", b"\x00\x07", b"\x01\x00", b"\xff\xff"])
def test_other_encapsulations_are_refused(kind):
    data = serialize_message(pose_message("f"))
    with pytest.raises(cdr_decoder.CdrError, match="not plain CDR"):
        cdr_decoder.read_pose(kind + data[2:])


def test_impossible_stamp_is_refused():
    data = bytearray(serialize_message(pose_message("f")))
    data[8:12] = struct.pack("<I", 1_000_000_000)
    with pytest.raises(cdr_decoder.CdrError, match="1000000000 nanoseconds"):
        cdr_decoder.read_pose(bytes(data))


@pytest.mark.parametrize("reader", READERS)
@given(data=st.binary(max_size=900))
def test_random_bytes_are_decoded_or_raise_cdr_error(reader, data):
    for head in (b"", b"\x00\x01\x00\x00", b"\x00\x00\x00\x00"):
        with contextlib.suppress(cdr_decoder.CdrError):
            reader(head + data)


@pytest.mark.parametrize("make", MESSAGES)
@given(at=st.integers(0, 60), value=st.binary(min_size=1, max_size=4))
def test_damaged_messages_are_decoded_or_raise_cdr_error(make, at, value):
    data = bytearray(serialize_message(make("body_b")))
    data[at : at + len(value)] = value
    with contextlib.suppress(cdr_decoder.CdrError):
        READERS[MESSAGES.index(make)](bytes(data))
