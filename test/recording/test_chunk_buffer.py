"""Chunk buffers: append from Python and compiled code, and writing them as MCAP chunks."""

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
from cylconn_ros.recording.mcap.chunk_buffer import ACCEPTED, REFUSED, ChunkBuffer, MessageArrays
from cylconn_ros.recording.mcap.kernels import append
from cylconn_ros.recording.mcap.writer import McapWriter
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
def append_one(
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
    """Call ``append`` from compiled code."""
    return append(
        records, entries, state, counts, channel, log_time, publish_time, data, length
    )  # fmt: skip


def append_compiled(
    buffer: ChunkBuffer, channel: int, log_time: int, publish_time: int, data: bytes
) -> bool:
    longer = np.frombuffer(data + b"bytes behind the message", np.uint8)
    return bool(append_one(*buffer.arrays, channel, log_time, publish_time, longer, len(data)))


def counts() -> NDArray[np.int64]:
    return np.zeros((2, 4), np.int64)


def test_python_and_compiled_code_append_the_same_bytes() -> None:
    interpreted, compiled = ChunkBuffer(4096, counts()), ChunkBuffer(4096, counts())
    for buffer in (interpreted, compiled):
        buffer.arrays.counts[ACCEPTED, 1] = (1 << 32) - 1  # the next one needs more than 32 bits
    for channel, log_time, publish_time, data in MESSAGES:
        assert interpreted.append(channel, data, log_time, publish_time)
        assert append_compiled(compiled, channel, log_time, publish_time, data)
    assert len(interpreted) == len(compiled) == len(MESSAGES)
    assert bytes(interpreted.contents()[0]) == bytes(compiled.contents()[0])
    np.testing.assert_array_equal(interpreted.contents()[1], compiled.contents()[1])
    np.testing.assert_array_equal(interpreted.arrays.counts, compiled.arrays.counts)

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
    assert bytes(interpreted.contents()[0]) == expected
    assert interpreted.contents()[1].tolist() == [
        [channel, log_time, offset]
        for (channel, log_time, *_), offset in zip(MESSAGES, at, strict=True)
    ]
    interpreted.clear()
    assert len(interpreted) == 0
    assert bytes(interpreted.contents()[0]) == b""


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize(("size", "capacity"), [(3 * 131, 3), (3 * 131 - 1, 2), (2 * 131 + 31, 2)])
def test_a_message_that_does_not_fit_leaves_the_buffer_unchanged(
    compiled: bool, size: int, capacity: int
) -> None:
    buffer, data = ChunkBuffer(size, counts()), bytes(range(100))
    for k in range(4):
        assert buffer.fits(1, 100) is (k < capacity)
        before = bytes(buffer.contents()[0])
        accepted = (
            append_compiled(buffer, 2, k, k, data) if compiled else buffer.append(2, data, k, k)
        )
        assert accepted is (k < capacity)
        assert accepted or bytes(buffer.contents()[0]) == before
    assert len(buffer) == capacity
    assert buffer.arrays.counts[ACCEPTED].tolist() == [0, 0, capacity, 0]
    # Compiled code counts at once; Python code reserves another buffer before it counts.
    assert buffer.arrays.counts[REFUSED].tolist() == [0, 0, (4 - capacity) * compiled, 0]


def test_small_messages_fill_the_index_first() -> None:
    buffer = ChunkBuffer(6400, counts())
    while buffer.append(1, b"", 0, 0):
        pass
    assert len(buffer) == 100
    assert not append_compiled(buffer, 1, 0, 0, b"")
    assert ChunkBuffer.for_messages(1000, 0, counts()).fits(1000, 0)
    assert ChunkBuffer.for_messages(1, 1 << 20, counts()).fits(1, 1 << 20)


def test_compiled_code_records_under_the_lock(tmp_path: Path) -> None:
    with RunWriter(tmp_path / "run", TOPICS, {}) as writer:
        channels = [writer.channels[topic.name] for topic in TOPICS]
        for k in range(200):
            with writer.lock:
                buffer = writer.reserve(3, 300)
                for channel in channels[:2]:
                    assert append_compiled(buffer, channel, 10 * k, k, bytes([k]) * 100)
            writer.write("/t2", b"python", 10 * k + 1, k)
        assert writer.counts == {"/t0": 200, "/t1": 200, "/t2": 200}
    run = read_run(tmp_path / "run")
    for topic in ("/t0", "/t1"):
        assert list(run.raw(topic)) == [(10 * k, k, bytes([k]) * 100) for k in range(200)]
    assert list(run.raw("/t2")) == [(10 * k + 1, k, b"python") for k in range(200)]


def test_records_have_sequence_numbers_and_an_index_per_channel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "_CHUNK", 1000)
    with RunWriter(tmp_path / "run", TOPICS, {}) as writer:
        for k in range(40):  # log times not in order
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
    with path.open("rb") as stream:  # via the index, in order of log time
        read = [m.log_time for _, _, m in make_reader(stream).iter_messages(topics=["/t1"])]
    assert read == sorted(times[1::2])


def test_every_message_index_entry_points_to_its_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "_CHUNK", 1000)
    with RunWriter(tmp_path / "run", TOPICS, {}, "none") as writer:
        for k in range(60):
            writer.write(f"/t{k * k % 3}", bytes(k), 1000 - k, k)
    checked, chunk = 0, b""
    with (tmp_path / "run" / "run_0.mcap").open("rb") as stream:
        for record in StreamReader(stream, emit_chunks=True).records:
            if isinstance(record, Chunk):
                chunk = record.data
            elif isinstance(record, MessageIndex):
                times = [log_time for log_time, _ in record.records]
                assert times == sorted(times, reverse=True)  # recording order
                for log_time, offset in record.records:
                    head = struct.unpack_from("<BQHIQQ", chunk, offset)
                    assert (head[0], head[2], head[4]) == (5, record.channel_id, log_time)
                    assert head[1] == 22 + (1000 - log_time)
                    checked += 1
    assert checked == 60


def test_a_batch_is_recorded_as_single_messages_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "_CHUNK", 1000)
    rng = np.random.default_rng(3)
    size = rng.integers(0, 300, 200)
    size[50] = 5000
    messages = MessageArrays(
        data=rng.integers(0, 256, 6000).astype(np.uint8),
        channel=rng.integers(1, 4, 200),
        log_time=FIRST + np.arange(200),
        publish_time=np.arange(200) ** 2,
        start=rng.integers(0, 1000, 200),
        size=size,
    )
    with RunWriter(tmp_path / "run", TOPICS, {}) as writer:
        writer.write("/t1", b"before", 1, 2)
        writer.write_batch(messages)
    with pytest.raises(RecordingError, match="closed"):
        writer.write_batch(messages)
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


def test_a_message_larger_than_a_buffer_gets_its_own_buffer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "_CHUNK", 1000)
    sizes = [10, 5000, 20, 900, 3_000_000, 30]
    with RunWriter(tmp_path / "run", TOPICS, {}) as writer:
        for k, size in enumerate(sizes):
            writer.write("/t0", bytes(size), k, k)
    found = [(k, len(data)) for k, _, data in read_run(tmp_path / "run").raw("/t0")]
    assert found == list(enumerate(sizes))


def test_a_closed_writer_refuses_and_counts_messages(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "run", TOPICS, {})
    assert writer.append(1, b"x", 0, 0)
    writer.close()
    assert not writer.append(1, b"y", 0, 0)
    with writer.lock:
        buffer = writer.reserve(1, 1)
        assert not append_compiled(buffer, 1, 0, 0, b"z")
        assert not buffer.append(1, b"z", 0, 0)
    assert "recording is closed" in writer.refusal
    assert writer.counts["/t0"] == 1
    assert writer.lost == {"/t0": 2, "/t1": 0, "/t2": 0}
    assert read_run(tmp_path / "run").counts["/t0"] == 1


def test_concurrent_writers_lose_no_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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


def test_the_index_of_many_chunks_is_complete(tmp_path: Path) -> None:
    file = McapWriter(tmp_path / "many.mcap", "zstd")
    channel = file.add_channel("/a", file.add_schema("std_msgs/msg/Empty", ""), {})
    buffer = ChunkBuffer(1 << 12, np.zeros((2, 2), np.int64))
    for k in range(300):
        assert buffer.append(channel, bytes([0, 1, 0, 0, k % 256]), k, k)
        file.add_chunk(*buffer.contents())
        buffer.clear()
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
