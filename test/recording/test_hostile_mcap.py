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
from mcap.writer import CompressionType

from cylconn_ros.cli.main import main
from cylconn_ros.recording.bag import Bag

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
