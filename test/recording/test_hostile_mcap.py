"""MCAP files with one hostile record: an undefined channel, a bomb, a wrong length."""

from __future__ import annotations

import resource
import struct
from collections.abc import Callable
from pathlib import Path

import any_bags
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from cylconn_ros.cli.main import main
from cylconn_ros.errors import RecordingError
from cylconn_ros.recording import schema
from cylconn_ros.recording.bag import Bag
from cylconn_ros.scene.resources import shipped

ROWS = any_bags.motion()[:200]


def with_first_chunk(data: bytes, change: Callable[[bytes], bytes]) -> bytes:
    """An MCAP file whose first chunk has the content ``change`` makes of it."""
    at = 8
    while True:
        opcode, length = struct.unpack_from("<BQ", data, at)
        if opcode == Opcode.CHUNK:
            content = change(data[at + 9 : at + 9 + length])
            head = struct.pack("<BQ", opcode, len(content))
            return data[:at] + head + content + data[at + 9 + length :]
        at += 9 + length


def bomb(_: bytes) -> bytes:
    """A gigabyte of zeros in a chunk of some kilobytes, with a true header."""
    size = 1 << 30
    compressor = zstandard.ZstdCompressor().compressobj(size=size)
    records = b"".join(compressor.compress(bytes(1 << 20)) for _ in range(1 << 10))
    records += compressor.flush()
    head = struct.pack("<QQQII4s", 10**18, 10**18 + 1, size, 0, 4, b"zstd")
    return head + struct.pack("<Q", len(records)) + records


def long_records(content: bytes) -> bytes:
    """The length of the records has one bit more."""
    at = 8 + 8 + 8 + 4 + 4 + struct.unpack_from("<I", content, 28)[0]
    return content[: at + 7] + bytes([content[at + 7] ^ 0x40]) + content[at + 8 :]


def unknown_channel(content: bytes) -> bytes:
    """The first message of an uncompressed chunk belongs to a channel that nothing defines."""
    at = content.index(struct.pack("<BQ", Opcode.MESSAGE, 22 + len(ROWS[0][2]))) + 9
    changed = content[:at] + struct.pack("<H", 999) + content[at + 2 :]
    return changed[:24] + bytes(4) + changed[28:]  # CRC 0: not checked


CASES = {"bomb": bomb, "length": long_records, "unknown channel": unknown_channel}


@pytest.mark.parametrize("name", CASES)
def test_the_rest_of_the_file_is_kept_in_bounded_memory(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = any_bags.mcap(tmp_path / "x.mcap", ROWS, compression=CompressionType.NONE)
    path.write_bytes(with_first_chunk(path.read_bytes(), CASES[name]))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    codes = [main([command, str(path)]) for command in ("info", "replay", "report", "identify")]
    assert set(codes) <= {0, 1, 2}
    capsys.readouterr()
    kept = tmp_path / "kept"
    salvaged = main(["salvage", str(path), "-o", str(kept)])
    out, err = capsys.readouterr()
    assert "x.mcap" in out + err
    found = [tuple(m) for m in Bag(kept if salvaged == 0 else path).messages()]
    lost = [row for row in ROWS if row not in found]
    assert 1 <= len(lost) <= (1 if name == "unknown channel" else 20)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000  # KiB


LEVELS = "".join(
    f"{'=' * 80}\nMSG: b/L{k}\n" + "".join(f"L{k + 1} x{j}\n" for j in range(10))
    for k in range(1, 14)
)
SCHEMAS = {
    "itself": ("p/msg/A", "A a\n", "schema of p/A: it contains itself"),
    "bomb": (
        "b/msg/L1",
        LEVELS.partition("MSG: b/L1\n")[2] + f"{'=' * 80}\nMSG: b/L14\nfloat64 y\n",
        "10000 fields",
    ),
}


@pytest.mark.parametrize("name", SCHEMAS)
def test_definitions_without_end_are_refused(name: str, tmp_path: Path) -> None:
    kind, text, reason = SCHEMAS[name]
    with pytest.raises(RecordingError, match=reason):
        schema.parse(kind, text)

    def declare(writer: Writer) -> None:
        number = writer.register_schema(kind, "ros2msg", text.encode())
        writer.add_message(writer.register_channel("/x", "cdr", number), 10**18, bytes(12), 0)

    path = any_bags.mcap(tmp_path / "x.mcap", ROWS, before=declare)
    assert main(["info", str(path)]) == 0


def test_stored_texts_that_are_none_stop_only_what_needs_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def declare(writer: Writer) -> None:
        writer.add_metadata("cylconn_ros", {"parameters": "[", "connectors": "{", "node": "\0"})
        fields = writer.register_schema("cylconn_ros/msg/ConnectorState", "ros2msg", b"float64 x\n")
        channel = writer.register_channel("/connector/state", "cdr", fields)
        writer.add_message(channel, 10**18, b"\0\1\0\0" + bytes(8), 0)

    path = any_bags.mcap(tmp_path / "x.mcap", ROWS, before=declare)
    path.write_bytes(path.read_bytes()[:-60])
    assert main(["info", str(path)]) == 1
    assert main(["salvage", str(path), "-o", str(tmp_path / "kept")]) == 0
    scene = ["--params", str(shipped("slide_and_spin"))]
    for command in (["replay", *scene], ["replay", "--compare", *scene], ["report"]):
        assert main([command[0], str(path), *command[1:]]) == 2
        error = capsys.readouterr().err.strip().splitlines()[-1]
        assert error.startswith(f"cylconn {command[0]}: {path}")
