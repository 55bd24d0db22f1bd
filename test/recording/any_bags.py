"""Recordings of one known motion in every form that rosbag2 and others write them."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import yaml
from mcap.opcode import Opcode
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scenes import bundled

from cylconn_ros.core import layout
from cylconn_ros.messages.cdr_encoder import StampedWriter
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.message_definitions import interface
from cylconn_ros.simulation.simulate import simulate

SAMPLES = 700
END = 0.310641  # m, of the closed form (config/slide_and_spin.yaml): at rest from 0.585 s
TOPICS = {
    "/body_b/pose": "geometry_msgs/msg/PoseStamped",
    "/body_b/twist": "geometry_msgs/msg/TwistStamped",
}
Row = tuple[str, int, bytes]  # topic, log time, message


def motion(quaternion: float = 1.0, same_stamp: bool = False) -> list[Row]:
    """Messages of the scene slide_and_spin, by log time."""
    run = simulate(bundled("slide_and_spin"), samples=SAMPLES)
    writers = {"/body_b/pose": StampedWriter("world", 7), "/body_b/twist": StampedWriter("world")}
    rows: list[Row] = []
    for k, time in enumerate(run.time):
        stamp, log_time = 0 if same_stamp else round(time * 1e9), 10**18 + round(time * 1e9)
        pose = run.states[k, layout.B_POSE : layout.B_POSE + 7].copy()
        pose[3:] *= quaternion
        twist = np.ascontiguousarray(run.states[k, layout.B_TWIST : layout.B_TWIST + 6])
        rows.append(("/body_b/pose", log_time, bytes(writers["/body_b/pose"].write(stamp, pose))))
        data = bytes(writers["/body_b/twist"].write(stamp, twist))
        rows.append(("/body_b/twist", log_time + 1000, data))
    return rows


def by_topic(rows: Sequence[Row]) -> list[Row]:
    return sorted(rows, key=lambda row: row[0])


def shuffled(rows: Sequence[Row]) -> list[Row]:
    order = np.random.default_rng(0).permutation(len(rows))
    return [rows[k] for k in order]


def mcap(
    path: Path,
    rows: Sequence[Row],
    *,
    chunk: int = 4096,
    before: Callable[[Writer], Any] | None = None,
    **options: Any,
) -> Path:
    """An MCAP file of the mcap library; channels are declared at their first message."""
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk, **options)
        writer.start(profile="ros2", library="test")
        if before is not None:
            before(writer)
        channels: dict[str, int] = {}
        for topic, log_time, data in rows:
            if topic not in channels:
                kind = TOPICS[topic]
                text = interface(kind).definition.encode()
                schema = writer.register_schema(kind, "ros2msg", text)
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic], log_time, data, log_time)
        writer.finish()
    return path


def rosbags(path: Path, rows: Sequence[Row], plugin: StoragePlugin, mode: str = "") -> Path:
    """A directory written by rosbags, compressed by ``mode`` (file or message, zstd)."""
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = RosbagsWriter(path, version=9, storage_plugin=plugin)
    if mode:
        writer.set_compression(CompressionMode[mode.upper()], CompressionFormat.ZSTD)
    with writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in TOPICS.items()
        }
        for topic, log_time, data in rows:
            writer.write(connections[topic], log_time, data)
    return path


def as_recorded_by_rosbag2(
    path: Path, run: Path, mode: str, skip: int = 0, outputs: bool = True
) -> Path:
    """The messages of a run without what cylconn_ros stores, but for the first ``skip`` samples.

    Without ``outputs`` their topics are there, but not their messages.
    """
    source = Bag(run)
    store = get_typestore(Stores.ROS2_JAZZY)
    for topic, kind in source.types.items():
        if kind not in store.fielddefs:
            store.register(get_types_from_msg(source.definitions[topic], kind))
    writer = RosbagsWriter(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(CompressionMode[mode.upper()], CompressionFormat.ZSTD)
    left = {topic: skip if outputs or topic in TOPICS else 10**9 for topic in source.types}
    with writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in source.types.items()
        }
        for topic, log_time, data in source.messages():
            left[topic] -= 1
            if left[topic] < 0:
                writer.write(connections[topic], log_time, data)
    return path


def metadata(directory: Path, change: Callable[[dict[str, Any]], Any]) -> Path:
    """Change metadata.yaml."""
    path = directory / "metadata.yaml"
    content = yaml.safe_load(path.read_text())
    change(content["rosbag2_bagfile_information"])
    path.write_text(yaml.safe_dump(content))
    return directory


def loose(writer: Writer) -> None:
    """Channels that cannot be decoded: no schema, another encoding."""
    for topic, encoding in (("/notes", "json"), ("/raw", "cdr")):
        channel = writer.register_channel(topic, encoding, 0)
        writer.add_message(channel, 10**18, b'{"a": 1}', 10**18)


def late(writer: Writer) -> None:
    """Two megabytes of another topic in front."""
    text = interface("std_msgs/msg/String").definition.encode()
    schema = writer.register_schema("std_msgs/msg/String", "ros2msg", text)
    channel = writer.register_channel("/log", "cdr", schema)
    noise = np.random.default_rng(1).bytes(2000)
    data = b"\0\1\0\0" + len(noise).to_bytes(4, "little") + noise
    for k in range(1000):
        writer.add_message(channel, 10**18 - 10**9 + k, data, 0)


def extended(data: bytes) -> bytes:
    """An MCAP file with three bytes more at the end of every message index."""
    magic, at = data[:8], 8
    parts = [magic]
    while at < len(data) - len(magic):
        opcode, length = struct.unpack_from("<BQ", data, at)
        content = data[at + 9 : at + 9 + length]
        if opcode == Opcode.MESSAGE_INDEX:
            content += b"\1\2\3"
        parts.append(struct.pack("<BQ", opcode, len(content)) + content)
        at += 9 + length
    return b"".join([*parts, magic])


def build(name: str, directory: Path) -> list[Path]:
    """Make one of :data:`FORMS`; returns what is to be named on the command line."""
    rows = motion()
    half = len(rows) // 2
    path = directory / name
    if name.startswith("rosbags_"):
        _, plugin, *mode = name.split("_")
        rosbags(path, rows, StoragePlugin[plugin.upper()], *mode)
        return [path]
    if name == "by_topic":
        return [mcap(path.with_suffix(".mcap"), by_topic(rows))]
    if name == "shuffled":
        return [mcap(path.with_suffix(".mcap"), shuffled(rows))]
    if name == "late_topic":
        return [mcap(path.with_suffix(".mcap"), rows, before=late)]
    if name == "schemaless":
        return [mcap(path.with_suffix(".mcap"), rows, before=loose)]
    if name == "no_summary":
        names = ("repeat_channels", "repeat_schemas", "use_statistics", "use_summary_offsets")
        options: dict[str, Any] = dict.fromkeys(names, False)
        return [mcap(path.with_suffix(".mcap"), rows, index_types=IndexType.NONE, **options)]
    if name == "extended":  # as by a later version of the format: more fields in a record
        plain = mcap(path.with_suffix(".mcap"), rows)
        plain.write_bytes(extended(plain.read_bytes()))
        return [plain]
    if name == "unchunked":
        return [mcap(path.with_suffix(".mcap"), shuffled(rows), use_chunking=False)]
    if name == "lz4":
        return [mcap(path.with_suffix(".mcap"), rows, compression=CompressionType.LZ4)]
    if name == "lz4_file":
        plain = mcap(directory / "plain.mcap", rows)
        packed = directory / "plain.mcap.lz4"
        packed.write_bytes(lz4.frame.compress(plain.read_bytes()))
        return [packed]
    if name == "lz4_messages":
        packed_rows = [(topic, time, lz4.frame.compress(data)) for topic, time, data in rows]
        return [mcap(path.with_suffix(".mcap"), packed_rows)]
    if name == "several_files":  # in the wrong order, and overlapping in time
        return [
            mcap(directory / "b.mcap", rows[half - 60 :: 1]),
            mcap(directory / "a.mcap", rows[: half - 60]),
        ]
    if name == "split":
        path.mkdir()
        mcap(path / "split_9.mcap", rows[:half])
        mcap(path / "split_10.mcap", rows[half:])
        return [path]
    # Directories with metadata.yaml of other versions, or wrong.
    plugin = StoragePlugin.SQLITE3 if name == "old_relative_path" else StoragePlugin.MCAP
    rosbags(path, rows, plugin)
    (file,) = (each for each in path.iterdir() if each.suffix in (".mcap", ".db3"))

    def old(information: dict[str, Any]) -> None:
        information["version"] = 2
        information["relative_file_paths"] = [f"{name}/{file.name}"]
        for key in ("custom_data", "files", "ros_distro", "compression_mode"):
            information.pop(key, None)

    changes: dict[str, Callable[[dict[str, Any]], Any]] = {
        "old_relative_path": old,
        "null_topics": lambda i: i.update(topics_with_message_count=None, custom_data=None),
        "old_metadata": lambda i: i.update(topics_with_message_count=[{"name": "/x"}]),
        "stale_path": lambda i: i.update(relative_file_paths=["other_name.mcap"]),
        "path_outside": lambda i: i.update(relative_file_paths=["/etc/hostname"]),
        "wrong_types": lambda i: i.update(relative_file_paths=7, custom_data=[1], version="x"),
    }
    if name in changes:
        metadata(path, changes[name])
    elif name == "no_metadata":
        (path / "metadata.yaml").unlink()
    elif name == "no_yaml":
        (path / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    elif name == "own_definitions":
        raise AssertionError
    return [path]


FORMS = (
    "by_topic", "shuffled", "late_topic", "schemaless", "no_summary", "extended", "unchunked",
    "lz4", "lz4_file", "lz4_messages", "several_files", "split", "rosbags_mcap", "rosbags_sqlite3",
    "rosbags_mcap_file", "rosbags_mcap_message", "rosbags_sqlite3_file", "rosbags_sqlite3_message",
    "old_relative_path", "null_topics", "old_metadata", "stale_path", "path_outside",
    "wrong_types", "no_metadata", "no_yaml",
)  # fmt: skip
