"""Incomplete and damaged recordings: error messages and recovery."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader
from test_recording import METADATA, SAMPLES, TOPICS, write_run

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording import writer as writer_module
from cylconn_ros.recording.mcap.writer import McapWriter
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.recording.run import Run, read_run
from cylconn_ros.recording.salvage import salvage
from cylconn_ros.recording.writer import RunWriter


def test_unfinished_and_other_directories_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="No such file"):
        read_run(tmp_path / "nothing")
    with pytest.raises(RecordingError, match="not a recording"):
        read_run(tmp_path)
    (tmp_path / "metadata.yaml").write_text("just: this")
    with pytest.raises(RecordingError, match="not metadata of a recording"):
        read_run(tmp_path)
    writer = RunWriter(tmp_path / "open", TOPICS, METADATA)
    run = read_run(writer.directory / "open_0.mcap")
    assert "never finished" in str(run.incomplete)
    writer.close()
    assert read_run(writer.directory).incomplete is None


def everything(run: Run) -> dict[str, list[tuple[int, int, bytes]]]:
    return {topic: list(run.raw(topic)) for topic in run.counts}


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_all_chunks_before_a_truncation_are_recovered(
    tmp_path: Path, compression: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "_CHUNK", 20_000)
    monkeypatch.setattr(writer_module, "_BACKLOG", 20_000)  # several chunks
    write_run(tmp_path / "run", compression)
    path = tmp_path / "run" / "run_0.mcap"
    whole, data = read_run(path), path.read_bytes()
    messages = everything(whole)
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    ends = [chunk.chunk_start_offset + chunk.chunk_length for chunk in summary.chunk_indexes]
    assert len(ends) > 4
    cuts = [*ends, *(end - 1 for end in ends), *range(ends[0], len(data), len(data) // 7)]
    cuts.append(len(data) - 1)
    for number, cut in enumerate(cuts):
        broken = tmp_path / f"broken{number}"
        broken.mkdir()
        (broken / "broken_0.mcap").write_bytes(data[:cut])
        expected = sum(end <= cut for end in ends)
        if not expected:
            with pytest.raises(RecordingError, match="contains no readable message"):
                salvage(broken)
            continue
        saved = salvage(broken)
        assert saved.directory == tmp_path / f"broken{number}_salvaged"
        found = read_run(saved.directory)
        assert found.incomplete is None
        assert saved.messages == sum(found.counts.values())
        assert found.parameters == whole.parameters
        assert found.metadata["salvaged"].startswith("from broken_0.mcap: ")
        for topic, raw in everything(found).items():
            assert raw == messages[topic][: len(raw)]
        with Reader(saved.directory) as foreign:
            assert foreign.message_count == saved.messages
    assert saved.messages == sum(whole.counts.values())  # only the end was missing


def test_a_damaged_chunk_is_skipped_and_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "_CHUNK", 20_000)
    monkeypatch.setattr(writer_module, "_BACKLOG", 20_000)
    write_run(tmp_path / "run")
    path = tmp_path / "run" / "run_0.mcap"
    whole, data = read_run(path), bytearray(path.read_bytes())
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    damaged = summary.chunk_indexes[1]
    data[damaged.chunk_start_offset + damaged.chunk_length // 2] ^= 0xFF
    path.write_bytes(data)
    saved = salvage(path, tmp_path / "saved")
    assert saved.damage == "1 of its chunks cannot be read"
    assert 0 < saved.messages < sum(whole.counts.values())
    assert read_run(tmp_path / "saved").incomplete is None
    with pytest.raises(RecordingError, match="never overwritten"):
        salvage(path, tmp_path / "saved")


def test_a_slow_disk_blocks_the_writer_or_refuses_messages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "_CHUNK", 1000)
    monkeypatch.setattr(writer_module, "_BACKLOG", 5000)
    inner = McapWriter.add_chunk

    def slow(*arguments: Any) -> None:
        time.sleep(0.05)
        inner(*arguments)

    monkeypatch.setattr(McapWriter, "add_chunk", slow)
    info = TopicInfo("/x", "std_msgs/msg/String")
    with RunWriter(tmp_path / "blocking", [info], {}) as writer:
        for k in range(40):
            writer.write("/x", bytes(1000), k, k)
    assert writer.counts["/x"] == read_run(tmp_path / "blocking").counts["/x"] == 40
    reasons = []
    with RunWriter(tmp_path / "refusing", [info], {}, wait_for_disk=False) as writer:
        for k in range(40):
            try:
                writer.write("/x", bytes(1000), k, k)
            except RecordingError as error:
                reasons.append(str(error))
        assert writer.lost["/x"] == len(reasons) > 20
        assert "the disk is too slow" in reasons[0]
    run = read_run(tmp_path / "refusing")
    assert run.counts["/x"] == 40 - len(reasons)


def test_missing_messages_make_a_run_incomplete(tmp_path: Path) -> None:
    write_run(tmp_path / "run")
    path = tmp_path / "run" / "metadata.yaml"
    path.write_text(path.read_text().replace(f"message_count: {SAMPLES}\n", "message_count: 401\n"))
    assert "lists 401 messages, found 400" in str(read_run(tmp_path / "run").incomplete)
