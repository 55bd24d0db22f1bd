"""Recorded runs, checked with independent readers: rosbags and mcap-ros2-support."""

from __future__ import annotations

import math
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Time
from cylconn_ros.msg import ConnectorState
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from mcap_ros2.reader import read_ros2_messages
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosReliability
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from cylconn_ros.core.layout import STATE_FIELDS
from cylconn_ros.errors import RecordingError, UnknownNameError
from cylconn_ros.recording.message_definitions import interface
from cylconn_ros.recording.metadata import TopicInfo, parameters_yaml
from cylconn_ros.recording.run import read_run
from cylconn_ros.recording.writer import RunWriter

SAMPLES = 400  # several chunks
START_NS = 1_700_000_000_000_000_000
TOPICS = [
    TopicInfo("/body_b/pose", "geometry_msgs/msg/PoseStamped"),
    TopicInfo("/body_b/twist", "geometry_msgs/msg/TwistStamped", reliability="best_effort"),
    TopicInfo("/body_b/wrench", "geometry_msgs/msg/WrenchStamped"),
    TopicInfo("/connector/state", "cylconn_ros/msg/ConnectorState"),
    TopicInfo("/connector/joint_state", "sensor_msgs/msg/JointState"),
    TopicInfo("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"),
    TopicInfo("/body_a/load", "geometry_msgs/msg/WrenchStamped"),  # never written
]
PARAMETERS = {
    "period": 0.001,
    "friction.coefficient": 0.2,
    "friction.max_force": math.inf,
    "reference.length": math.nan,
    "node_a.orientation": (0.0, 0.0, 0.0, 1.0),
    "friction.table.rates": (),
    "body_a.frame": "rail",
}
METADATA = {
    "version": "1.2.3",
    "method": "impulse",
    "parameters": parameters_yaml(PARAMETERS),
}


def header(k: int, frame: str = "world") -> Header:
    return Header(stamp=Time(sec=k // 1000, nanosec=(k % 1000) * 1_000_000), frame_id=frame)


def fill(message: Any, start: float) -> None:
    """Set every float of a message to a different number."""
    value = start
    for name, kind in message.get_fields_and_field_types().items():
        item = getattr(message, name)
        if isinstance(item, float):
            setattr(message, name, value)
            value += 1.0
        elif isinstance(item, np.ndarray):
            item[:] = value + np.arange(len(item))
            value += len(item)
        elif "/" in kind and not isinstance(item, Header):
            fill(item, value)
            value += 10.0


def state(k: int) -> ConnectorState:
    message = ConnectorState(header=header(k, "rail"), regime=k % 3, flags=k, method="impulse")
    fill(message, k + 0.25)
    message.stop_time = -1.0
    return message


def messages(k: int) -> list[tuple[str, Any]]:
    pose = PoseStamped(header=header(k))
    twist = TwistStamped(header=header(k, "world" if k % 2 else "sleeve"))  # two lengths of string
    wrench = WrenchStamped(header=header(k, "sleeve"))
    for number, message in enumerate((pose, twist, wrench)):
        fill(message, 1000.0 * number + k)
    joints = JointState(
        header=header(k),
        name=["slide", "spin"],
        position=[0.5 * k, 0.25 * k],
        velocity=[1.0, 2.0] if k % 4 else [3.0],  # two message layouts
        effort=[0.0, 1.0],
    )
    found: list[tuple[str, Any]] = [
        ("/body_b/pose", pose),
        ("/body_b/twist", twist),
        ("/body_b/wrench", wrench),
        ("/connector/state", state(k)),
        ("/connector/joint_state", joints),
    ]
    if k % 100 == 0:
        values = [KeyValue(key="answered", value=str(k))]
        status = DiagnosticStatus(level=b"\x00", name="connector", message="fine", values=values)
        found.append(("/diagnostics", DiagnosticArray(header=header(k), status=[status])))
    return found


def log_time(k: int) -> int:
    return START_NS + 250_000 * k


def write_run(
    directory: Path, compression: str = "zstd"
) -> dict[str, list[tuple[int, Any, bytes]]]:
    """Write the sample run; returns per topic the log time, message and bytes of every message."""
    written: dict[str, list[tuple[int, Any, bytes]]] = {topic.name: [] for topic in TOPICS}
    with RunWriter(directory, TOPICS, METADATA, compression) as writer:
        for k in range(SAMPLES):
            for topic, message in messages(k):
                cdr = serialize_message(message)
                writer.write(topic, cdr, log_time(k), log_time(k) - 7)
                written[topic].append((log_time(k), message, cdr))
        assert writer.counts == {topic: len(items) for topic, items in written.items()}
    return written


@pytest.fixture(scope="module", params=["zstd", "none"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    directory = tmp_path_factory.mktemp("runs") / f"run_{request.param}"
    return directory, write_run(directory, request.param)


def plain(value: Any) -> Any:
    """Convert a message of any library to comparable numbers, strings and lists; NaN to text."""
    if isinstance(value, (str, int, bytes)):
        return value
    if isinstance(value, float):
        return "nan" if math.isnan(value) else value
    if isinstance(value, (list, tuple, np.ndarray)) or hasattr(value, "typecode"):
        return [plain(item) for item in value]
    if hasattr(value, "get_fields_and_field_types"):
        names = value.get_fields_and_field_types()
    else:
        names = getattr(value, "__dataclass_fields__", None) or value.__slots__
    fields = [name for name in names if not name.isupper() and not name.startswith("__")]
    return {name: plain(getattr(value, name)) for name in fields}


def level(content: Any) -> Any:
    """DiagnosticStatus.level is bytes in rclpy and a number elsewhere."""
    statuses = content.get("status")
    for status in statuses if isinstance(statuses, list) else []:
        if isinstance(status["level"], bytes):
            status["level"] = status["level"][0]
    return content


def test_rosbags_reads_every_message(run: Any) -> None:
    directory, written = run
    expected = {topic: iter(items) for topic, items in written.items()}
    with AnyReader([directory]) as reader:
        assert {c.topic: c.msgcount for c in reader.connections} == {
            topic: len(items) for topic, items in written.items()
        }
        for connection, stamp, data in reader.messages():
            time, message, cdr = next(expected[connection.topic])
            assert (stamp, bytes(data)) == (time, cdr)
            assert plain(reader.deserialize(data, connection.msgtype)) == level(plain(message))
    assert all(next(rest, None) is None for rest in expected.values())


def test_mcap_ros2_support_reads_every_message(run: Any) -> None:
    directory, written = run
    expected = {topic: iter(items) for topic, items in written.items()}
    for read in read_ros2_messages(str(directory / f"{directory.name}_0.mcap")):
        time, message, _ = next(expected[read.channel.topic])
        assert read.log_time_ns == time
        assert read.publish_time_ns == time - 7
        assert plain(read.ros_msg) == level(plain(message))
    assert all(next(rest, None) is None for rest in expected.values())


def test_bare_file_opens_in_rosbags(run: Any) -> None:
    directory, written = run
    with AnyReader([directory / f"{directory.name}_0.mcap"]) as reader:
        assert reader.message_count == sum(map(len, written.values()))


def test_metadata_yaml_has_the_rosbag2_format(run: Any) -> None:
    directory, written = run
    metadata = yaml.safe_load((directory / "metadata.yaml").read_text())
    info = metadata["rosbag2_bagfile_information"]
    assert info["version"] == 9
    assert info["storage_identifier"] == "mcap"
    assert info["relative_file_paths"] == [f"{directory.name}_0.mcap"]
    assert info["starting_time"]["nanoseconds_since_epoch"] == START_NS
    assert info["duration"]["nanoseconds"] == 250_000 * (SAMPLES - 1)
    assert info["message_count"] == sum(map(len, written.values()))
    assert info["custom_data"]["version"] == "1.2.3"
    assert info["custom_data"]["method"] == "impulse"
    with Reader(directory) as reader:
        assert reader.duration == 250_000 * (SAMPLES - 1) + 1  # rosbags counts the last nanosecond
        for connection in reader.connections:
            assert connection.digest == interface(connection.msgtype).type_hash
            (qos,) = connection.ext.offered_qos_profiles
            effort = connection.topic == "/body_b/twist"
            assert qos.reliability == (
                QosReliability.BEST_EFFORT if effort else QosReliability.RELIABLE
            )
            assert qos.depth == 50


def test_columns_of_a_run(run: Any) -> None:
    directory, written = run
    read = read_run(directory)
    assert read.incomplete is None
    assert read.version == "1.2.3"
    assert read.counts == {topic: len(items) for topic, items in written.items()}
    assert read.duration == pytest.approx(250e-6 * (SAMPLES - 1))

    states = read.state
    assert states.undecodable == 0
    assert states.time[-1] == pytest.approx(1e-3 * (SAMPLES - 1))
    for name, _ in STATE_FIELDS:
        expected = np.array([getattr(m, name) for _, m, _ in written["/connector/state"]])
        np.testing.assert_array_equal(states[name], expected, err_msg=name)
    np.testing.assert_array_equal(states["flags"], np.arange(SAMPLES))
    assert set(states["method"]) == {"impulse"}
    np.testing.assert_array_equal(states.log_time, [log_time(k) for k in range(SAMPLES)])
    np.testing.assert_array_equal(states.publish_time, states.log_time - 7)

    twist = read.table(read.topic("body_b/twist"))
    assert list(twist["header.frame_id"][:3]) == ["sleeve", "world", "sleeve"]
    np.testing.assert_array_equal(twist["twist.linear.x"], 1000.0 + np.arange(SAMPLES))

    joints = read.table("/connector/joint_state")
    np.testing.assert_array_equal(joints["position"][:, 1], 0.25 * np.arange(SAMPLES))
    assert list(joints["name"][3]) == ["slide", "spin"]
    assert [len(row) for row in joints["velocity"][:5]] == [1, 2, 2, 2, 1]

    assert len(read.table("/body_a/load")) == 0
    assert [item[2] for item in read.raw("/body_b/pose")] == [
        c for *_, c in written["/body_b/pose"]
    ]
    with pytest.raises(RecordingError, match="list of messages"):
        read.table("/diagnostics")
    with pytest.raises(RecordingError, match="no topic /nowhere"):
        read.table("/nowhere")
    with pytest.raises(UnknownNameError, match=r"no field 'speed'; it has header\.stamp\.sec, "):
        states["speed"]


def test_parameters_come_back_as_a_scene_file(run: Any) -> None:
    parameters = read_run(run[0]).parameters
    assert parameters["friction"]["coefficient"] == 0.2
    assert parameters["friction"]["max_force"] == math.inf
    assert math.isnan(parameters["reference"]["length"])
    assert parameters["node_a"]["orientation"] == [0.0, 0.0, 0.0, 1.0]
    assert "table" not in parameters["friction"]  # an empty list has no type in ROS 2
    assert parameters["body_a"]["frame"] == "rail"


def test_big_endian_messages_are_decoded_and_malformed_ones_counted(tmp_path: Path) -> None:
    pose = PoseStamped(header=header(5))
    pose.pose.position.x = 1.5
    little = serialize_message(pose)
    big = bytearray(b"\x00\x00\x00\x00")
    for start, size in ((4, 4), (8, 4), (12, 4)):  # sec, nanosec, length of "world"
        big += little[start : start + size][::-1]
    big += little[16:28]  # the text and its padding
    for start in range(28, len(little), 8):
        big += little[start : start + 8][::-1]
    broken = [b"", b"\x00", little[:40], little + bytes(8), b"\x00\x07" + little[2:], b"\xff" * 90]
    with RunWriter(tmp_path / "run", TOPICS[:1], {}) as writer:
        for k, data in enumerate([little, *broken, bytes(big)]):
            writer.write("/body_b/pose", data, k, k)
    table = read_run(tmp_path / "run").table("/body_b/pose")
    assert table.undecodable == len(broken)
    np.testing.assert_array_equal(table["pose.position.x"], [1.5, 1.5])
    np.testing.assert_array_equal(table.stamp, [5_000_000, 5_000_000])
    np.testing.assert_array_equal(table.log_time, [0, 1 + len(broken)])


def test_empty_sequences_are_read(tmp_path: Path) -> None:
    with RunWriter(tmp_path / "run", [TopicInfo("/j", "sensor_msgs/msg/JointState")], {}) as writer:
        for k in range(3):
            writer.write("/j", serialize_message(JointState(header=header(k), name=["spin"])), k, k)
    joints = read_run(tmp_path / "run").table("/j")
    assert joints.undecodable == 0
    assert joints["position"].shape == (3, 0)
    assert list(joints["name"][:, 0]) == ["spin"] * 3


def test_a_run_is_never_overwritten(tmp_path: Path) -> None:
    directory = tmp_path / "run"
    directory.mkdir()
    (directory / "precious").write_text("data")
    with pytest.raises(RecordingError, match="never overwritten"):
        RunWriter(directory, TOPICS, METADATA)
    assert [p.name for p in directory.iterdir()] == ["precious"]


@pytest.mark.parametrize(
    ("topics", "compression", "message"),
    [
        (TOPICS, "lzma", "record.compression: 'lzma' is not one of zstd, none"),
        ([TOPICS[0], TOPICS[0]], "zstd", "/body_b/pose is listed more than once"),
        ([TopicInfo("/x", "no_such_msgs/msg/X")], "zstd", "no_such_msgs/msg/X: no X.json"),
        ([TopicInfo("/x", "X")], "zstd", "expected package/msg/Name"),
    ],
)
def test_invalid_arguments_are_refused(
    tmp_path: Path, topics: list[TopicInfo], compression: str, message: str
) -> None:
    with pytest.raises(RecordingError, match=message):
        RunWriter(tmp_path / "run", topics, {}, compression)
    assert not (tmp_path / "run").exists()


def test_refused_messages_are_counted(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "run", TOPICS, METADATA)
    with pytest.raises(RecordingError, match="topic /other is not recorded here"):
        writer.write("/other", b"", 0, 0)
    writer.close()
    writer.close()  # does nothing
    with pytest.raises(RecordingError, match="closed"):
        writer.write("/body_b/pose", b"", 0, 0)
    assert writer.lost["/body_b/pose"] == 1
    run = read_run(tmp_path / "run")
    assert sum(run.counts.values()) == 0
    assert run.duration == 0.0


def test_a_full_disk_ends_the_recording_not_the_program(tmp_path: Path) -> None:
    """A file size limit simulates a full disk; the errors are those of the operating system."""
    script = """
        import os, resource, signal, sys, time
        from pathlib import Path
        from cylconn_ros.errors import RecordingError, UnknownNameError
        from cylconn_ros.recording.metadata import TopicInfo
        from cylconn_ros.recording.writer import RunWriter
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        writer = RunWriter(Path(sys.argv[1]), [TopicInfo("/x", "std_msgs/msg/String")], {}, "none")
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
        refused = 0
        for k in range(1000):
            time.sleep(0.001)
            try:
                writer.write("/x", os.urandom(1000), k, k)
            except RecordingError as error:
                refused += 1
                reason = str(error)
        assert 0 < writer.counts["/x"] < 200, writer.counts
        assert writer.lost["/x"] == 1000 - writer.counts["/x"] >= refused
        assert "File too large" in reason, reason
        try:
            writer.close()
        except RecordingError as error:
            print(error)
        """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script), str(tmp_path / "run")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "File too large" in done.stdout
    info = yaml.safe_load((tmp_path / "run" / "metadata.yaml").read_text())
    assert "File too large" in info["rosbag2_bagfile_information"]["custom_data"]["incomplete"]
    run = read_run(tmp_path / "run")  # complete chunks and an end
    assert 0 < run.counts["/x"] < 200
    assert "File too large" in str(run.incomplete)


def test_topics_below_the_node_are_found(tmp_path: Path) -> None:
    info = TopicInfo("/arm/joint/command", "sensor_msgs/msg/JointState")
    with RunWriter(tmp_path / "run", [info], {"node": "/arm/joint"}) as writer:
        writer.write(info.name, b"x", 1, 1)
    assert read_run(tmp_path / "run").topic("~/command") == info.name
    with RunWriter(tmp_path / "other", [info], {}) as writer:
        writer.write(info.name, b"x", 1, 1)
    assert read_run(tmp_path / "other").topic("~/command") == info.name
