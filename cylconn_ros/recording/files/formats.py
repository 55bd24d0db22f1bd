"""What a file is by its first bytes: recordings that are read, and others that are named."""

from __future__ import annotations

from pathlib import Path

from cylconn_ros.errors import RecordingError

MCAP, SQLITE, ZSTD, LZ4 = "MCAP", "SQLite", "zstd", "lz4"

_HEAD = 16  # bytes that tell the format
_READ = (
    (b"\x89MCAP", MCAP),
    (b"SQLite format 3\0", SQLITE),
    (b"\x28\xb5\x2f\xfd", ZSTD),
    (b"\x04\x22\x4d\x18", LZ4),
)
_SUFFIXES = {".mcap": MCAP, ".db3": SQLITE, ".zstd": ZSTD, ".zst": ZSTD, ".lz4": LZ4}
_ROS1 = "convert it with rosbags-convert --src {path} --dst NEW (pip install rosbags)"
_OTHERS = (
    (b"#ROSBAG V", f"a ROS 1 bag: {_ROS1}"),
    (b"\x1f\x8b", "compressed with gzip: unpack it with gunzip"),
    (b"BZh", "compressed with bzip2: unpack it with bunzip2"),
    (b"\xfd7zXZ", "compressed with xz: unpack it with unxz"),
    (b"PK\x03\x04", "a zip archive: unpack it with unzip"),
    (b"\x89HDF", "an HDF5 file: write its samples as a rosbag2 recording (rosbags, mcap)"),
    (b"ULog", "a PX4 log: convert it with ulog2rosbag or ulog2mcap"),
    (b"PAR1", "a Parquet table: write its samples as a rosbag2 recording (rosbags, mcap)"),
)


def identify(path: Path) -> str:
    """Return MCAP, SQLITE, ZSTD or LZ4.

    A file whose first bytes are damaged counts as what its suffix says.

    Raises
    ------
        RecordingError: the file is none of these; the message says what it is and which tool
            converts it, as far as known. Named pipes and devices are refused without opening them.
        OSError: it cannot be read.
    """
    path.stat()
    if not path.is_file():
        raise RecordingError(f"{path}: is not a regular file")
    with path.open("rb") as stream:
        head = stream.read(_HEAD)
    if not head:
        raise RecordingError(f"{path}: contains no readable message: it is empty")
    for start, kind in _READ:
        if head.startswith(start):
            return kind
    for start, text in _OTHERS:
        if head.startswith(start):
            raise RecordingError(f"{path}: is not a recording but {text.format(path=path)}")
    kind = _SUFFIXES.get(path.suffix, "")
    if kind == MCAP:
        return kind
    if path.suffix == ".bag":
        text = _ROS1.format(path=path)
        raise RecordingError(f"{path}: is not a recording of rosbag2; if it is a ROS 1 bag, {text}")
    raise RecordingError(
        f"{path}: is not a recording (a directory with metadata.yaml, .mcap or .db3)"
        + (f"; its content is not {kind}" if kind else "")
    )


def is_recording(path: Path) -> bool:
    """Return whether a file in a directory is part of a recording, by its name and content."""
    if not _SUFFIXES.keys() & set(path.suffixes[-1:]) or not path.is_file():
        return False
    if path.suffix in (".mcap", ".db3"):
        return True
    return path.with_suffix("").suffix in (".mcap", ".db3")
