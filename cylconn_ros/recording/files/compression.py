"""Compression by rosbag2: of a whole file, or of each message (zstd; lz4 if it is installed).

Compression inside an MCAP file (of its chunks) is read by recording/mcap. What a compressed part
expands to is limited, so that no file takes more memory or disk than a recording would.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

import zstandard

from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.files import formats
from cylconn_ros.recording.mcap.message_block import MessageBlock, RawMessage, from_messages

MAX_PART = 1 << 28
"""Bytes of a chunk or message at most, when uncompressed."""
_MAX_RATIO = 200  # of a file, beyond MAX_PART
_PIECE = 1 << 20
_BLOCK = 1 << 24  # uncompressed bytes of one block of messages
_ZSTD, _LZ4 = b"\x28\xb5\x2f\xfd", b"\x04\x22\x4d\x18"


class CompressionError(ValueError):
    """Compressed data cannot be read."""


def lz4_frame() -> Any:
    """Return the module lz4.frame; raise CompressionError if it is not installed."""
    try:
        import lz4.frame
    except ImportError:
        raise CompressionError("compressed with lz4, which needs: pip install lz4") from None
    return lz4.frame


def unzstd(data: bytes, size: int | None = None) -> bytes:
    """Decompress a zstd frame of ``size`` bytes (None: as the frame states).

    Raises CompressionError if it is damaged, of another size, or larger than :data:`MAX_PART`.
    """
    try:
        stated = zstandard.frame_content_size(data)
        most = MAX_PART if size is None else size
        if most > MAX_PART or stated > most:
            raise CompressionError(f"{max(stated, most)} bytes uncompressed: more than {MAX_PART}")
        if stated >= 0:
            found = zstandard.ZstdDecompressor().decompress(data)
        else:
            with zstandard.ZstdDecompressor().stream_reader(data) as reader:
                found = _read_at_most(reader, most)
    except zstandard.ZstdError as error:
        raise CompressionError(str(error)) from None
    if size is not None and len(found) != size:
        raise CompressionError(f"{len(found)} bytes uncompressed, not {size}")
    return found


def unlz4(data: bytes, size: int | None = None) -> bytes:
    """Decompress an lz4 frame; arguments and errors as of :func:`unzstd`."""
    most = MAX_PART if size is None else size
    if most > MAX_PART:
        raise CompressionError(f"{most} bytes uncompressed: more than {MAX_PART}")
    try:
        found = bytes(lz4_frame().LZ4FrameDecompressor().decompress(data, max_length=most + 1))
    except (RuntimeError, EOFError) as error:
        raise CompressionError(str(error)) from None
    if len(found) > most or (size is not None and len(found) != size):
        raise CompressionError("not of the stated size")
    return found


def unpacked(path: Path, kind: str) -> IO[bytes]:
    """Decompress a file into a temporary one, which is deleted with the returned object.

    Args:
        path: the compressed file.
        kind: formats.ZSTD or formats.LZ4.

    Raises RecordingError if it cannot be decompressed or becomes too large.
    """
    most = max(MAX_PART, _MAX_RATIO * path.stat().st_size)
    suffix = path.with_suffix("").suffix
    target = tempfile.NamedTemporaryFile(prefix="cylconn_", suffix=suffix)  # noqa: SIM115
    written = 0
    try:
        with path.open("rb") as source:
            for piece in _pieces(source, kind):
                written += len(piece)
                if written > most:
                    raise RecordingError(
                        f"{path}: compressed with {kind}, expands to more than {most >> 20} MiB, "
                        f"{_MAX_RATIO} times its size: not a recording"
                    )
                target.write(piece)
    except (zstandard.ZstdError, CompressionError, RuntimeError, EOFError) as error:
        if not written:
            raise RecordingError(f"{path}: compressed with {kind}: {error}") from None
    target.flush()
    return target


def is_compressed(block: MessageBlock) -> bool:
    """Return whether the messages of a block are compressed: CDR never begins as these formats."""
    if not len(block) or block.size[0] < 4:
        return False
    at = int(block.start[0])
    return block.raw[at : at + 4] in (_ZSTD, _LZ4)


def decompressed(block: MessageBlock) -> Iterator[MessageBlock]:
    """Yield the messages of a block uncompressed; those that cannot be are left as they are."""
    found: list[RawMessage] = []
    size = 0
    functions: dict[bytes, Callable[[bytes], bytes]] = {_ZSTD: unzstd, _LZ4: unlz4}
    for message in block.messages():
        function = functions.get(message.data[:4])
        if function is not None:
            with contextlib.suppress(CompressionError):  # it is then counted as undecodable
                message = message._replace(data=function(message.data))
        found.append(message)
        size += len(message.data)
        if size > _BLOCK:
            yield from_messages(found)
            found, size = [], 0
    if found:
        yield from_messages(found)


def _pieces(source: IO[bytes], kind: str) -> Iterator[bytes]:
    """Yield the uncompressed content of a stream piece by piece."""
    if kind == formats.ZSTD:
        yield from zstandard.ZstdDecompressor().read_to_iter(source, write_size=_PIECE)
        return
    decompressor = lz4_frame().LZ4FrameDecompressor()
    while not decompressor.eof:
        data = b""
        if decompressor.needs_input:
            data = source.read(_PIECE)
            if not data:
                return
        yield decompressor.decompress(data, max_length=_PIECE)


def _read_at_most(reader: Any, most: int) -> bytes:
    pieces, size = [], 0
    while piece := reader.read(_PIECE):
        size += len(piece)
        if size > most:
            raise CompressionError(f"more than {most} bytes uncompressed")
        pieces.append(piece)
    return b"".join(pieces)
