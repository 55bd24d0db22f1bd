"""Encode messages (CDR): the constant bytes are laid out once, then only the numbers change.

Frames, names and the method do not change from one message to the next. An encoder lays them out at
construction, in the byte order of the machine; a message is then a stamp, the numbers and one copy.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Sequence

import numpy as np

from cylconn_ros.core import layout
from cylconn_ros.scene.inputs import ABSENT, INPUTS, ODOMETRY, InputType

ENCAPSULATION = b"\x00\x01\x00\x00" if sys.byteorder == "little" else b"\x00\x00\x00\x00"
_HEADER = 4  # bytes of the encapsulation header
_AFTER_STAMP = 12  # offset of the first byte after the stamp
_SECOND = 1_000_000_000
_STAMP = struct.Struct("=iI")
_INTEGERS = struct.Struct("=4BI")  # regime, stop, lock, status, flags of ConnectorState
_KINDS = {kind.type: kind for kind in INPUTS}


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
        """Append ``size`` zero bytes and return their offset."""
        at = self.align(align)
        self.data += bytes(size)
        return at


def stamp_bytes(stamp: int) -> bytes:
    """A stamp in ns as encoded in a message."""
    return _STAMP.pack(*divmod(stamp, _SECOND))


def _write_stamp(data: bytearray, stamp: int) -> None:
    _STAMP.pack_into(data, _HEADER, *divmod(stamp, _SECOND))


def _rows(message: bytes, stamps: np.ndarray) -> np.ndarray:
    """(n, bytes) uint8: copies of a message with (n,) stamps in ns."""
    rows = np.empty((len(stamps), len(message)), np.uint8)
    rows[:] = np.frombuffer(message, np.uint8)
    times = np.stack(np.divmod(stamps, _SECOND), axis=1).astype("=i4")
    rows[:, _HEADER:_AFTER_STAMP] = times.view(np.uint8)
    return rows


def _write_numbers(rows: np.ndarray, at: int, numbers: np.ndarray) -> None:
    """Write (n, k) numbers into messages (n, bytes) at an offset."""
    block = np.ascontiguousarray(numbers).view(np.uint8)
    rows[:, at : at + block.shape[1]] = block


def float64_bytes(value: float) -> bytes:
    """Encode a std_msgs/Float64."""
    return ENCAPSULATION + struct.pack("=d", value)


class StampedWriter:
    """Encode PoseStamped (``count`` 7), TwistStamped or WrenchStamped (6) messages of one frame."""

    def __init__(self, frame: str, count: int = 6) -> None:
        message = _Message(frame)
        at = message.block(8 * count)
        self._constant = bytes(message.data[_AFTER_STAMP:at])

    def write(self, stamp: int, values: np.ndarray) -> bytes:
        """Encode ``values`` ((count,) float64) with a stamp in ns."""
        return b"".join((ENCAPSULATION, stamp_bytes(stamp), self._constant, values.tobytes()))

    @property
    def blocks(self) -> list[int]:
        """The offset of the numbers in a message."""
        return [_AFTER_STAMP + len(self._constant)]

    def rows(self, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
        """(n, bytes) uint8: as :meth:`write`, for (n,) stamps and (n, count) values."""
        found = _rows(self.write(0, np.zeros(values.shape[1])), stamps)
        _write_numbers(found, self.blocks[0], values)
        return found


class InputWriter:
    """Encode messages of an input type; covariances are zero, which means unknown."""

    def __init__(self, kind: InputType, frame: str, child_frame: str = "") -> None:
        message = _Message(frame)
        if kind.has_child_frame:
            message.string(child_frame)
        block = message.block(kind.size)
        self._pose = block + kind.pose if kind.pose != ABSENT else ABSENT
        pair = kind.twist if kind.twist != ABSENT else kind.load
        self._pair = block + pair if pair != ABSENT else ABSENT
        self._data = message.data

    def write(self, stamp: int, pose: np.ndarray, pair: np.ndarray) -> bytes:
        """Encode a pose (7,) and a twist or load (6,) with a stamp in ns.

        A quantity that the type does not carry is not used.
        """
        _write_stamp(self._data, stamp)
        if self._pose != ABSENT:
            self._data[self._pose : self._pose + 56] = pose.tobytes()
        if self._pair != ABSENT:
            self._data[self._pair : self._pair + 48] = pair.tobytes()
        return bytes(self._data)


class OdometryWriter(InputWriter):
    """Encode Odometry messages: the pose in the frame, the twist in the child frame."""

    def __init__(self, frame: str, child_frame: str) -> None:
        super().__init__(_KINDS[ODOMETRY], frame, child_frame)


class JointStateWriter:
    """Encode JointState messages with position, velocity and effort of named joints."""

    def __init__(self, frame: str, names: Sequence[str]) -> None:
        message = _Message(frame)
        message.count(len(names))
        for name in names:
            message.string(name)
        self.blocks: list[int] = []  # offsets of positions, velocities, efforts
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
        """Encode three numbers per joint, in the order of the names; stamp in ns."""
        _write_stamp(self._data, stamp)
        for at, values in zip(self.blocks, (positions, velocities, efforts), strict=True):
            self._numbers.pack_into(self._data, at, *values)
        return bytes(self._data)

    def rows(self, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
        """(n, bytes) uint8: as :meth:`write`, for (n,) stamps and (n, 3, joints) values."""
        found = _rows(bytes(self._data), stamps)
        for k, at in enumerate(self.blocks):
            _write_numbers(found, at, values[:, k])
        return found


class StateWriter:
    """Encode ConnectorState messages from the connector's outputs."""

    def __init__(self, frame: str, method: str) -> None:
        message = _Message(frame)
        self._block = block = message.block(8 * layout.NSTATE)
        integers = message.block(_INTEGERS.size, 4)
        message.string(method)
        self._constant = bytes(message.data[_AFTER_STAMP:block])
        self._end = bytes(message.data[integers + _INTEGERS.size :])

    @property
    def timing(self) -> slice:
        """The bytes of ``computing_time``, which differ in every run."""
        at = self._block + 8 * (layout.COMPUTING_TIME - layout.STATE0)
        return slice(at, at + 8)

    def write(self, stamp: int, out: np.ndarray) -> bytes:
        """Encode ``out`` ((NOUT,) float64, core/layout.py) with a stamp in ns."""
        integers = _INTEGERS.pack(*(int(number) for number in out[layout.REGIME : layout.NOUT]))
        numbers = out[layout.STATE].tobytes()
        stamped = stamp_bytes(stamp)
        return b"".join((ENCAPSULATION, stamped, self._constant, numbers, integers, self._end))

    @property
    def blocks(self) -> list[int]:
        """The offsets of the state block and of the integers in a message."""
        return [self._block, self._block + 8 * layout.NSTATE]

    def rows(self, stamps: np.ndarray, outs: np.ndarray) -> np.ndarray:
        """(n, bytes) uint8: as :meth:`write`, for (n,) stamps and (n, NOUT) outputs."""
        found = _rows(self.write(0, np.zeros(layout.NOUT)), stamps)
        _write_numbers(found, self._block, outs[:, layout.STATE])
        integers = outs[:, layout.REGIME : layout.NOUT]
        at = self._block + 8 * layout.NSTATE
        found[:, at : at + 4] = integers[:, :4]
        _write_numbers(found, at + 4, integers[:, 4:].astype("=u4"))
        return found
