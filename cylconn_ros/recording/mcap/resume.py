"""Search for the next chunk of a damaged MCAP file, by what its header must satisfy.

The length of a chunk record equals that of its parts. So a header is recognised without any index:
by chance, 8 bytes agree once in 2^64 places.
"""

from __future__ import annotations

import struct
from typing import IO

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

MAX_NAME = 32
"""Bytes of the name of a compression at most."""
_HEADER = struct.Struct("<BQQQQII")  # opcode, length, start, end, size, CRC, length of the name
_UINT64 = struct.Struct("<Q")
_LONGEST = _HEADER.size + MAX_NAME + 8
_PIECE = 1 << 20


def next_chunk(stream: IO[bytes], size: int, begin: int) -> int:
    """Return the first byte of the next chunk of a file of ``size`` bytes; ``size`` if none."""
    at = begin
    while at < size:
        stream.seek(at)
        piece = stream.read(_PIECE + _LONGEST)
        for offset in _candidates(piece[:_PIECE]).tolist():
            if _is_chunk(piece[offset : offset + _LONGEST], size - at - offset):
                return at + int(offset)
        at += _PIECE
    return size


def _candidates(piece: bytes) -> NDArray[np.intp]:
    """Places of the opcode, followed by a length below 2^40."""
    codes = np.frombuffer(piece, np.uint8)
    if len(codes) < 9:
        return np.zeros(0, np.intp)
    marks = codes[:-8] == int(Opcode.CHUNK)
    for k in (6, 7, 8):
        marks &= codes[k : len(codes) - 8 + k] == 0
    return np.flatnonzero(marks)


def _is_chunk(head: bytes, available: int) -> bool:
    if len(head) < _HEADER.size + 8:
        return False
    _, length, *_, name = _HEADER.unpack_from(head)
    if name > MAX_NAME or 9 + length > available or len(head) < _HEADER.size + name + 8:
        return False
    (stored,) = _UINT64.unpack_from(head, _HEADER.size + name)
    return bool(length == _HEADER.size - 9 + name + 8 + stored)
