"""DiagnosticArray to CDR; strings that have not changed since the last report are not re-encoded.

In CDR every string after the header starts at a multiple of four bytes, and apart from the level a
DiagnosticStatus holds only strings and counts. A key with its value, padded to a multiple of four
bytes, therefore has the same bytes at any position and is cached until the value changes.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from cylconn_ros.messages.cdr_encoder import ENCAPSULATION, stamp_bytes

_COUNT = struct.Struct("=I")
_NO_FRAME = _COUNT.pack(1) + bytes(4)  # an empty string, padded


def _string(text: str) -> bytes:
    """Encode a string, padded to a multiple of four bytes."""
    encoded = text.encode(errors="replace") + b"\x00"
    return _COUNT.pack(len(encoded)) + encoded + bytes(-len(encoded) % 4)


class EncodedStatus(NamedTuple):
    """A DiagnosticStatus: level, name and message, and its bytes from the name on."""

    level: int
    name: str
    message: str
    data: bytes


class StatusEncoder:
    """Encode one DiagnosticStatus of each report."""

    def __init__(self, name: str, hardware: str) -> None:
        self._name, self._encoded_name, self._hardware = name, _string(name), _string(hardware)
        self._cache: dict[str, tuple[str, bytes]] = {}  # value as text and encoded pair, by key

    def encode(self, level: int, message: str, values: Mapping[str, object]) -> EncodedStatus:
        """Encode ``values`` (at least one), formatted with ``str``."""
        cache, pieces = self._cache, [self._encoded_name, _string(message), self._hardware]
        pieces.append(_COUNT.pack(len(values)))
        text = ""
        for key, value in values.items():
            text = str(value)  # equal values may have different texts: 0, 0.0, -0.0, False
            before = cache.get(key)
            if before is None or before[0] != text:
                cache[key] = before = text, _string(key) + _string(text)
            pieces.append(before[1])
        padding = -(len(text.encode(errors="replace")) + 1) % 4
        data = b"".join(pieces)
        return EncodedStatus(level, self._name, message, data[: len(data) - padding])


def encode_diagnostics(stamp: int, parts: Sequence[EncodedStatus]) -> bytes:
    """Encode a DiagnosticArray with a stamp in ns."""
    header = len(ENCAPSULATION)
    data = bytearray(ENCAPSULATION + stamp_bytes(stamp) + _NO_FRAME + _COUNT.pack(len(parts)))
    for part in parts:
        data.append(part.level)  # no padding: a byte follows the last string
        data += bytes((header - len(data)) % 4)
        data += part.data
    return bytes(data)
