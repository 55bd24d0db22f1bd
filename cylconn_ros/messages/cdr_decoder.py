"""Decode serialized messages (CDR) into numbers and texts.

The nodes exchange serialized messages because message objects cost more than everything else that
the nodes do. Numbers are read in place: alignment counts from the end of the four-byte
encapsulation header, and offsets follow from the lengths of the strings before a field.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from cylconn_ros.errors import CylconnError
from cylconn_ros.scene.inputs import ABSENT, INPUTS, ODOMETRY, POSE, TWIST, WRENCH, InputType

_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}  # plain CDR, big and little endian
_HEADER = 4  # bytes of the encapsulation header
_PADDING = 3  # bytes that an encoder may append to fill a word of four bytes
_EMPTY_ARRAYS = 24  # bytes that Fast DDS appends for three empty arrays of float64

_SEVEN = {order: struct.Struct(f"{order}7d") for order in "<>"}
_SIX = {order: struct.Struct(f"{order}6d") for order in "<>"}
_STAMP = {order: struct.Struct(f"{order}iII") for order in "<>"}
_COUNT = {order: struct.Struct(f"{order}I") for order in "<>"}
_KINDS = {kind.type: kind for kind in INPUTS}


class CdrError(CylconnError, ValueError):
    """The bytes are not a message of the expected type."""


class Stamped(NamedTuple):
    """Content of a PoseStamped (7 numbers), TwistStamped or WrenchStamped (6 numbers)."""

    stamp: int  # ns
    frame: str
    values: tuple[float, ...]


class Odometry(NamedTuple):
    """Content of an Odometry message, without covariances."""

    stamp: int  # ns
    frame: str
    child_frame: str
    pose: tuple[float, ...]  # (7,) position, quaternion x y z w
    twist: tuple[float, ...]  # (6,) linear, angular velocity


class BodyInput(NamedTuple):
    """Content of a message of any input type; quantities that the type does not carry are empty."""

    stamp: int  # ns
    frame: str
    child_frame: str | None  # None: the type has no child frame
    pose: tuple[float, ...]  # (7,) position, quaternion x y z w
    pair: tuple[float, ...]  # (6,) twist or load


class JointState(NamedTuple):
    """Content of a JointState message."""

    stamp: int  # ns
    frame: str
    names: tuple[str, ...]
    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    efforts: tuple[float, ...]


def read_input(kind: InputType, data: bytes) -> BodyInput:
    """Decode a message of an input type; raises :class:`CdrError`."""
    order, stamp, frame, at = _read_header(data)
    child = None
    if kind.has_child_frame:
        child, at = _read_string(data, order, at)
    at = _align(at, 8)
    _check_end(data, at + kind.size)
    pair_offset = kind.twist if kind.twist != ABSENT else kind.load
    pose = _SEVEN[order].unpack_from(data, at + kind.pose) if kind.pose != ABSENT else ()
    pair = _SIX[order].unpack_from(data, at + pair_offset) if pair_offset != ABSENT else ()
    return BodyInput(stamp, frame, child, pose, pair)


def read_pose(data: bytes) -> Stamped:
    """Decode a geometry_msgs/PoseStamped; raises :class:`CdrError`."""
    found = read_input(_KINDS[POSE], data)
    return Stamped(found.stamp, found.frame, found.pose)


def read_twist(data: bytes) -> Stamped:
    """Decode a geometry_msgs/TwistStamped; raises :class:`CdrError`."""
    found = read_input(_KINDS[TWIST], data)
    return Stamped(found.stamp, found.frame, found.pair)


def read_wrench(data: bytes) -> Stamped:
    """Decode a geometry_msgs/WrenchStamped; raises :class:`CdrError`."""
    found = read_input(_KINDS[WRENCH], data)
    return Stamped(found.stamp, found.frame, found.pair)


def read_odometry(data: bytes) -> Odometry:
    """Decode a nav_msgs/Odometry; raises :class:`CdrError`."""
    stamp, frame, child, pose, twist = read_input(_KINDS[ODOMETRY], data)
    return Odometry(stamp, frame, child or "", pose, twist)


def read_joint_state(data: bytes) -> JointState:
    """Decode a sensor_msgs/JointState; raises :class:`CdrError`."""
    order, stamp, frame, at = _read_header(data)
    count, at = _read_count(data, order, at, 4)
    names = []
    for _ in range(count):
        name, at = _read_string(data, order, at)
        names.append(name)
    arrays = []
    for _ in range(3):
        count, at = _read_count(data, order, at, 8)
        if count:
            at = _align(at, 8)
            _check_room(data, at + 8 * count)
        arrays.append(struct.unpack_from(f"{order}{count}d", data, at) if count else ())
        at += 8 * count
    _check_end(data, at, _EMPTY_ARRAYS)
    return JointState(stamp, frame, tuple(names), *arrays)


def read_float64(data: bytes) -> float:
    """Decode a std_msgs/Float64; raises :class:`CdrError`."""
    order = _byte_order(data)
    _check_room(data, _HEADER + 8)
    _check_end(data, _HEADER + 8)
    return float(struct.unpack_from(f"{order}d", data, _HEADER)[0])


def read_stamp(data: bytes) -> int:
    """Decode the stamp in ns of a message that begins with a header; raises :class:`CdrError`."""
    return _read_header(data)[1]


def _byte_order(data: bytes) -> str:
    order = _ORDERS.get(bytes(data[:2]))
    if order is None:
        raise CdrError(f"encapsulation {bytes(data[:2]).hex() or 'missing'} is not plain CDR")
    return order


def _read_header(data: bytes) -> tuple[str, int, str, int]:
    """Byte order, stamp in ns, frame, and the offset of the byte after the frame."""
    order = _byte_order(data)
    _check_room(data, _HEADER + 12)
    seconds, nanoseconds, _ = _STAMP[order].unpack_from(data, _HEADER)
    if nanoseconds >= 1_000_000_000:
        raise CdrError(f"stamp has {nanoseconds} nanoseconds")
    frame, at = _read_string(data, order, _HEADER + 8)
    return order, seconds * 1_000_000_000 + nanoseconds, frame, at


def _read_string(data: bytes, order: str, at: int) -> tuple[str, int]:
    length, at = _read_count(data, order, at, 1)
    if not length:  # some encoders omit the terminating zero of an empty string
        return "", at
    end = at + length
    if data[end - 1]:
        raise CdrError("string without a terminating zero")
    return str(data[at : end - 1], "utf-8", "replace"), end


def _read_count(data: bytes, order: str, at: int, size: int) -> tuple[int, int]:
    """Read the length of a sequence whose items take at least ``size`` bytes."""
    at = _align(at, 4)
    _check_room(data, at + 4)
    (count,) = _COUNT[order].unpack_from(data, at)
    _check_room(data, at + 4 + size * count)
    return count, at + 4


def _align(at: int, size: int) -> int:
    return at + (_HEADER - at) % size


def _check_room(data: bytes, end: int) -> None:
    if len(data) < end:
        raise CdrError(f"{len(data)} bytes, at least {end} needed")


def _check_end(data: bytes, end: int, padding: int = _PADDING) -> None:
    _check_room(data, end)
    if len(data) > end + padding:
        raise CdrError(f"{len(data)} bytes, {end} expected")
