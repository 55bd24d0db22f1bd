"""Messages copied into trays, by Python and by compiled code, and trays into chunks of a file."""

from __future__ import annotations

import struct
import threading
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Chunk, MessageIndex
from mcap.stream_reader import StreamReader
from numpy.typing import NDArray

from cylconn_ros.core.jit import kernel
from cylconn_ros.errors import RecordingError
from cylconn_ros.recording import writer as writer_module
from cylconn_ros.recording.chunk_buffer import ACCEPTED, REFUSED, Messages, Tray
from cylconn_ros.recording.kernels import put
from cylconn_ros.recording.mcap_writer import Container
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.recording.run import read_run
from cylconn_ros.recording.writer import RunWriter

TOPICS = [TopicInfo(f"/t{k}", "std_msgs/msg/String") for k in range(3)]
FIRST = 1_700_000_000_000_000_123
MESSAGES = [
    # channel, log time, publish time, message
    (1, FIRST, FIRST - 1, b"\x00\x01\x00\x00" + bytes(range(77))),
    (3, FIRST + 5, 7, b""),
    (1, FIRST - 9, 1 << 62, b"x"),
    (2, 0, 0, bytes(300)),
    (1, (1 << 63) - 1, 255, b"\xff" * 41),
]


@kernel
def put_one(
    records: NDArray[np.uint8],
    entries: NDArray[np.int64],
    state: NDArray[np.int64],
    counts: NDArray[np.int64],
    channel: int,
    log_time: int,
    publish_time: int,
    data: NDArray[np.uint8],
    length: int,
) -> bool:
    """Call ``put`` as compiled code does."""
    return put(
        records, entries, state, counts, channel, log_time, publish_time, data, length
    )  # fmt: skip


def put_compiled(tray: Tray, channel: int, log_time: int, publish_time: int, data: bytes) -> bool:
    longer = np.frombuffer(data + b"what follows is not part of it", np.uint8)
    return bool(put_one(*tray.arrays, channel, log_time, publish_time, longer, len(data)))


def counts() -> NDArray[np.int64]:
    return np.zeros((2, 4), np.int64)


def test_python_and_compiled_code_put_in_the_same() -> None:
    ours, theirs = Tray(4096, counts()), Tray(4096, counts())
    for tray in (ours, theirs):
        tray.arrays.counts[ACCEPTED, 1] = (1 << 32) - 1  # the next number does not fit into 32 bits
    for channel, log_time, publish_time, data in MESSAGES:
        assert ours.put(channel, data, log_time, publish_time)
        assert put_compiled(theirs, channel, log_time, publish_time, data)
    assert len(ours) == len(theirs) == len(MESSAGES)
    assert bytes(ours.held()[0]) == bytes(theirs.held()[0])
    np.testing.assert_array_equal(ours.held()[1], theirs.held()[1])
    np.testing.assert_array_equal(ours.arrays.counts, theirs.arrays.counts)

    expected, at = b"", []
    numbers = {1: (1 << 32) - 1, 2: 0, 3: 0}
    for channel, log_time, publish_time, data in MESSAGES:
        at.append(len(expected))
        expected += struct.pack(
            "<BQHIQQ", 5, 22 + len(data), channel, numbers[channel] & 0xFFFFFFFF, log_time,
            publish_time,
        )  # fmt: skip
        expected += data
        numbers[channel] += 1
    assert bytes(ours.held()[0]) == expected
    assert ours.held()[1].tolist() == [
        [channel, log_time, offset]
        for (channel, log_time, *_), offset in zip(MESSAGES, at, strict=True)
    ]
    ours.clear()
    assert len(ours) == 0
    assert bytes(ours.held()[0]) == b""


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize(("size", "room"), [(3 * 131, 3), (3 * 131 - 1, 2), (2 * 131 + 31, 2)])
def test_what_does_not_fit_leaves_a_tray_as_it_was(compiled: bool, size: int, room: int) -> None:
    tray, data = Tray(size, counts()), bytes(range(100))
    for k in range(4):
        assert tray.has_room(1, 100) is (k < room)
        before = bytes(tray.held()[0])
        taken = put_compiled(tray, 2, k, k, data) if compiled else tray.put(2, data, k, k)
        assert taken is (k < room)
        assert taken or bytes(tray.held()[0]) == before
    assert len(tray) == room
    assert tray.arrays.counts[ACCEPTED].tolist() == [0, 0, room, 0]
    # Who puts in from Python looks for another tray first.
    assert tray.arrays.counts[REFUSED].tolist() == [0, 0, (4 - room) * compiled, 0]


def test_many_small_messages_fill_a_tray_too() -> None:
    tray = Tray(6400, counts())
    while tray.put(1, b"", 0, 0):
        pass
    assert len(tray) == 100
    assert not put_compiled(tray, 1, 0, 0, b"")
    assert Tray.for_messages(1000, 0, counts()).has_room(1000, 0)
    assert Tray.for_messages(1, 1 << 20, counts()).has_room(1, 1 << 20)


def test_compiled_code_records_under_the_lock(tmp_path: Path) -> None:
    with RunWriter(tmp_path / "run", TOPICS, {}) as writer:
        channels = [writer.channels[topic.name] for topic in TOPICS]
        for k in range(200):
            with writer.lock:
                tray = writer.tray(3, 300)
                for channel in channels[:2]:
                    assert put_compiled(tray, channel, 10 * k, k, bytes([k]) * 100)
            writer.write("/t2", b"python", 10 * k + 1, k)
        assert writer.counts == {"/t0": 200, "/t1": 200, "/t2": 200}
    run = read_run(tmp_path / "run")
    for topic in ("/t0", "/t1"):
        assert list(run.raw(topic)) == [(10 * k, k, bytes([k]) * 100) for k in range(200)]
    assert list(run.raw("/t2")) == [(10 * k + 1, k, b"python") for k in range(200)]


def test_records_are_numbered_and_indexed_by_channel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "_CHUNK", 1000)
    with RunWriter(tmp_path / "run", TOPICS, {}) as writer:
        for k in range(40):  # times that go up and down
            writer.write(f"/t{k % 2}", bytes(50), 1000 + 7 * k % 40, k)
    path = tmp_path / "run" / "run_0.mcap"
    with path.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        found = [(c.topic, m.sequence, m.log_time) for _, c, m in
                 reader.iter_messages(log_time_order=False)]  # fmt: skip
    assert found == [(f"/t{k % 2}", k // 2, 1000 + 7 * k % 40) for k in range(40)]
    assert summary is not None
    assert summary.statistics is not None
    assert len(summary.chunk_indexes) > 3
    times = [log_time for *_, log_time in found]
    assert summary.statistics.message_start_time == min(times)
    assert summary.statistics.message_end_time == max(times)
    done = 0
    for chunk in summary.chunk_indexes:
        assert list(chunk.message_index_offsets) == [1, 2]
        count = chunk.uncompressed_size // 81
        own = times[done : done + count]
        assert (chunk.message_start_time, chunk.message_end_time) == (min(own), max(own))
        done += count
    with path.open("rb") as stream:  # by the index, in the order of time
        read = [m.log_time for _, _, m in make_reader(stream).iter_messages(topics=["/t1"])]
    assert read == sorted(times[1::2])


def test_every_index_leads_to_its_messages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_module, "_CHUNK", 1000)
    with RunWriter(tmp_path / "run", TOPICS, {}, "none") as writer:
        for k in range(60):
            writer.write(f"/t{k * k % 3}", bytes(k), 1000 - k, k)
    seen, chunk = 0, b""
    with (tmp_path / "run" / "run_0.mcap").open("rb") as stream:
        for record in StreamReader(stream, emit_chunks=True).records:
            if isinstance(record, Chunk):
                chunk = record.data
            elif isinstance(record, MessageIndex):
                times = [log_time for log_time, _ in record.records]
                assert times == sorted(times, reverse=True)  # as they came
                for log_time, offset in record.records:
                    head = struct.unpack_from("<BQHIQQ", chunk, offset)
                    assert (head[0], head[2], head[4]) == (5, record.channel_id, log_time)
                    assert head[1] == 22 + (1000 - log_time)
                    seen += 1
    assert seen == 60


def test_many_at_once_are_what_they_are_one_by_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "_CHUNK", 1000)
    rng = np.random.default_rng(3)
    size = rng.integers(0, 300, 200)
    size[50] = 5000
    messages = Messages(
        data=rng.integers(0, 256, 6000).astype(np.uint8),
        channel=rng.integers(1, 4, 200),
        log_time=FIRST + np.arange(200),
        publish_time=np.arange(200) ** 2,
        start=rng.integers(0, 1000, 200),
        size=size,
    )
    with RunWriter(tmp_path / "run", TOPICS, {}) as writer:
        writer.write("/t1", b"before", 1, 2)
        writer.write_each(messages)
    with pytest.raises(RecordingError, match="closed"):
        writer.write_each(messages)
    assert sum(writer.lost.values()) == 200
    run = read_run(tmp_path / "run")
    found = {topic.name: list(run.raw(topic.name)) for topic in TOPICS}
    assert found.pop("/t1")[0] == (1, 2, b"before")
    for topic, read in found.items():
        assert read == [
            (log, publish, messages.data[start : start + length].tobytes())
            for channel, log, publish, start, length in zip(*messages[1:], strict=True)
            if TOPICS[channel - 1].name == topic
        ]


def test_a_message_larger_than_a_tray_has_one_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "_CHUNK", 1000)
    sizes = [10, 5000, 20, 900, 3_000_000, 30]
    with RunWriter(tmp_path / "run", TOPICS, {}) as writer:
        for k, size in enumerate(sizes):
            writer.write("/t0", bytes(size), k, k)
    found = [(k, len(data)) for k, _, data in read_run(tmp_path / "run").raw("/t0")]
    assert found == list(enumerate(sizes))


def test_after_the_end_everything_is_refused_and_counted(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "run", TOPICS, {})
    assert writer.put(1, b"x", 0, 0)
    writer.close()
    assert not writer.put(1, b"y", 0, 0)
    with writer.lock:
        tray = writer.tray(1, 1)
        assert not put_compiled(tray, 1, 0, 0, b"z")
        assert not tray.put(1, b"z", 0, 0)
    assert "recording is closed" in writer.refusal
    assert writer.counts["/t0"] == 1
    assert writer.lost == {"/t0": 2, "/t1": 0, "/t2": 0}
    assert read_run(tmp_path / "run").counts["/t0"] == 1


def test_many_threads_lose_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer_module, "_CHUNK", 2000)
    monkeypatch.setattr(writer_module, "_BACKLOG", 6000)
    with RunWriter(tmp_path / "run", TOPICS, {}) as writer:

        def write(topic: str) -> None:
            for k in range(500):
                writer.write(topic, topic.encode() * 20, k, k)

        threads = [threading.Thread(target=write, args=(topic.name,)) for topic in TOPICS]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    run = read_run(tmp_path / "run")
    for topic in TOPICS:
        expected = [(k, k, topic.name.encode() * 20) for k in range(500)]
        assert list(run.raw(topic.name)) == expected


def test_the_index_of_many_chunks_is_whole(tmp_path: Path) -> None:
    file = Container(tmp_path / "many.mcap", "zstd")
    channel = file.add_channel("/a", file.add_schema("std_msgs/msg/Empty", ""), {})
    tray = Tray(1 << 12, np.zeros((2, 2), np.int64))
    for k in range(300):
        assert tray.put(channel, bytes([0, 1, 0, 0, k % 256]), k, k)
        file.add_chunk(*tray.held())
        tray.clear()
    file.finish()
    file.close()
    with (tmp_path / "many.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert len(summary.chunk_indexes) == summary.statistics.chunk_count == 300
        found = [(message.log_time, message.data[-1]) for _, _, message in reader.iter_messages()]
        assert found == [(k, k % 256) for k in range(300)]
