"""DiagnosticArray to CDR: what a part says, of which mostly little changes between reports.

Every string of CDR begins on a multiple of four bytes after the header and there is nothing else of
more than a byte in a DiagnosticStatus but counts: so a key with its value, filled up to a multiple
of four, is the same bytes wherever it stands, and is kept until the value is another.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from cylconn_ros.messages.cdr_encoder import ENCAPSULATION, stamp_bytes

_COUNT = struct.Struct("=I")
_NO_FRAME = _COUNT.pack(1) + bytes(4)  # an empty string, filled up


def _string(text: str) -> bytes:
    """A string as CDR has it, filled up to a multiple of four."""
    encoded = text.encode(errors="replace") + b"\x00"
    return _COUNT.pack(len(encoded)) + encoded + bytes(-len(encoded) % 4)


class Part(NamedTuple):
    """A DiagnosticStatus: what it says, and as bytes from its name on."""

    level: int
    name: str
    message: str
    data: bytes


class PartWriter:
    """Write one part of what diagnostics say."""

    def __init__(self, name: str, hardware: str) -> None:
        self._name, self._named, self._hardware = name, _string(name), _string(hardware)
        self._kept: dict[str, tuple[str, bytes]] = {}  # values as text and their pairs, by key

    def write(self, level: int, message: str, values: Mapping[str, object]) -> Part:
        """A part with ``values``, of which there is at least one, as ``str`` shows them."""
        kept, pieces = self._kept, [self._named, _string(message), self._hardware]
        pieces.append(_COUNT.pack(len(values)))
        text = ""
        for key, value in values.items():
            text = str(value)  # equal values may be other texts: 0, 0.0, -0.0, False
            before = kept.get(key)
            if before is None or before[0] != text:
                kept[key] = before = text, _string(key) + _string(text)
            pieces.append(before[1])
        filling = -(len(text.encode(errors="replace")) + 1) % 4
        data = b"".join(pieces)
        return Part(level, self._name, message, data[: len(data) - filling])


def written(stamp: int, parts: Sequence[Part]) -> bytes:
    """A DiagnosticArray with a stamp in ns."""
    header = len(ENCAPSULATION)
    data = bytearray(ENCAPSULATION + stamp_bytes(stamp) + _NO_FRAME + _COUNT.pack(len(parts)))
    for part in parts:
        data.append(part.level)  # where the last string has ended
        data += bytes((header - len(data)) % 4)
        data += part.data
    return bytes(data)
