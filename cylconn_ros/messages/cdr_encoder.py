"""Messages to CDR: writers that keep a message's bytes and change only its numbers.

Everything that stays the same from one message to the next (frame, names, method) is laid out once,
in the machine's own byte order; writing is then a stamp, a block of numbers and one copy.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Sequence

import numpy as np

from cylconn_ros.core import layout

ENCAPSULATION = b"\x00\x01\x00\x00" if sys.byteorder == "little" else b"\x00\x00\x00\x00"
_HEADER = 4
_WORDS = 12  # what follows the stamp
_SECOND = 1_000_000_000
_STAMP = struct.Struct("=iI")
_NUMBERS = struct.Struct("=4BI")


class _Message:
    """The bytes of a message under construction."""

    def __init__(self, frame: str) -> None:
        self.data = bytearray(ENCAPSULATION + bytes(8))
        self.string(frame)

    def align(self, size: int) -> int:
        self.data += bytes((_HEADER - len(self.data)) % size)
        return len(self.data)

    def count(self, count: int) -> None:
        self.align(4)
        self.data += struct.pack("=I", count)

    def string(self, text: str) -> None:
        encoded = text.encode() + b"\x00"
        self.count(len(encoded))
        self.data += encoded

    def block(self, size: int, align: int = 8) -> int:
        """Room for ``size`` bytes; where it begins."""
        at = self.align(align)
        self.data += bytes(size)
        return at


def stamp_bytes(stamp: int) -> bytes:
    """A stamp in ns as it stands in a message."""
    return _STAMP.pack(*divmod(stamp, _SECOND))


def _stamp(data: bytearray, stamp: int) -> None:
    _STAMP.pack_into(data, _HEADER, *divmod(stamp, _SECOND))


def _rows(message: bytes, stamps: np.ndarray) -> np.ndarray:
    """(n, bytes) uint8: a message once for each of (n,) stamps in ns."""
    rows = np.empty((len(stamps), len(message)), np.uint8)
    rows[:] = np.frombuffer(message, np.uint8)
    times = np.stack(np.divmod(stamps, _SECOND), axis=1).astype("=i4")
    rows[:, _HEADER:_WORDS] = times.view(np.uint8)
    return rows


def _put(rows: np.ndarray, at: int, numbers: np.ndarray) -> None:
    """Write (n, k) numbers into messages (n, bytes)."""
    block = np.ascontiguousarray(numbers).view(np.uint8)
    rows[:, at : at + block.shape[1]] = block


class StampedWriter:
    """Write PoseStamped (``count`` 7), TwistStamped or WrenchStamped (6) messages of one frame."""

    def __init__(self, frame: str, count: int = 6) -> None:
        message = _Message(frame)
        at = message.block(8 * count)
        self._words = bytes(message.data[_WORDS:at])

    def write(self, stamp: int, values: np.ndarray) -> bytes:
        """Write ``values`` ((count,) float64) with a stamp in ns."""
        return b"".join((ENCAPSULATION, stamp_bytes(stamp), self._words, values.tobytes()))

    @property
    def blocks(self) -> list[int]:
        """Where the numbers begin."""
        return [_WORDS + len(self._words)]

    def rows(self, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
        """(n, bytes) uint8: what :meth:`write` gives for (n,) stamps and (n, count) values."""
        found = _rows(self.write(0, np.zeros(values.shape[1])), stamps)
        _put(found, self.blocks[0], values)
        return found


class OdometryWriter:
    """Write Odometry messages; covariances are zero, which means unknown."""

    def __init__(self, frame: str, child_frame: str) -> None:
        message = _Message(frame)
        message.string(child_frame)
        self._pose = message.block(56)
        message.block(36 * 8)
        self._twist = message.block(48)
        message.block(36 * 8)
        self._data = message.data

    def write(self, stamp: int, pose: np.ndarray, twist: np.ndarray) -> bytes:
        """Write a pose (7,) in the frame and a twist (6,) in the child frame; stamp in ns."""
        _stamp(self._data, stamp)
        self._data[self._pose : self._pose + 56] = pose.tobytes()
        self._data[self._twist : self._twist + 48] = twist.tobytes()
        return bytes(self._data)


class JointStateWriter:
    """Write JointState messages with position, velocity and effort of named joints."""

    def __init__(self, frame: str, names: Sequence[str]) -> None:
        message = _Message(frame)
        message.count(len(names))
        for name in names:
            message.string(name)
        self.blocks: list[int] = []  # where each kind of numbers begins
        for _ in range(3):
            message.count(len(names))
            self.blocks.append(message.block(8 * len(names)))
        self._numbers = struct.Struct(f"={len(names)}d")
        self._data = message.data

    def write(
        self,
        stamp: int,
        positions: Sequence[float],
        velocities: Sequence[float],
        efforts: Sequence[float],
    ) -> bytes:
        """Write three numbers a joint, in the order of the names; stamp in ns."""
        _stamp(self._data, stamp)
        for at, values in zip(self.blocks, (positions, velocities, efforts), strict=True):
            self._numbers.pack_into(self._data, at, *values)
        return bytes(self._data)

    def rows(self, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
        """(n, bytes) uint8: the same for (n,) stamps and (n, 3, joints) values."""
        found = _rows(bytes(self._data), stamps)
        for k, at in enumerate(self.blocks):
            _put(found, at, values[:, k])
        return found


class StateWriter:
    """Write ConnectorState messages from the connector's OUT array."""

    def __init__(self, frame: str, method: str) -> None:
        message = _Message(frame)
        self._block = block = message.block(8 * layout.NSTATE)
        numbers = message.block(_NUMBERS.size, 4)
        message.string(method)
        self._words = bytes(message.data[_WORDS:block])
        self._end = bytes(message.data[numbers + _NUMBERS.size :])

    @property
    def timing(self) -> slice:
        """The bytes of ``computing_time``, which no other machine, nor run, will repeat."""
        at = self._block + 8 * (layout.COMPUTING_TIME - layout.STATE0)
        return slice(at, at + 8)

    def write(self, stamp: int, out: np.ndarray) -> bytes:
        """Write ``out`` ((NOUT,) float64, core/layout.py) with a stamp in ns."""
        small = _NUMBERS.pack(*(int(number) for number in out[layout.REGIME : layout.NOUT]))
        numbers = out[layout.STATE].tobytes()
        stamped = stamp_bytes(stamp)
        return b"".join((ENCAPSULATION, stamped, self._words, numbers, small, self._end))

    @property
    def blocks(self) -> list[int]:
        """Where the state block begins, and the whole numbers."""
        return [self._block, self._block + 8 * layout.NSTATE]

    def rows(self, stamps: np.ndarray, outs: np.ndarray) -> np.ndarray:
        """(n, bytes) uint8: what :meth:`write` gives for (n,) stamps and (n, NOUT) answers."""
        found = _rows(self.write(0, np.zeros(layout.NOUT)), stamps)
        _put(found, self._block, outs[:, layout.STATE])
        whole = outs[:, layout.REGIME : layout.NOUT]
        at = self._block + 8 * layout.NSTATE
        found[:, at : at + 4] = whole[:, :4]
        _put(found, at + 4, whole[:, 4:].astype("=u4"))
        return found
