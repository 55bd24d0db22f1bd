"""Messages from CDR, the bytes that ROS 2 nodes exchange.

The nodes take and give bytes because building message objects costs more than everything else they
do. Numbers are read where they stand: alignment is relative to the end of the four-byte
encapsulation header, and offsets follow from the lengths of the strings before them.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}  # plain CDR, big and little endian
_HEADER = 4
_PADDING = 3  # bytes a writer may append to fill a word
_EMPTY_ARRAYS = 24  # and what Fast DDS appends for three empty arrays of doubles

_POSE = {order: struct.Struct(f"{order}7d") for order in "<>"}
_SIX = {order: struct.Struct(f"{order}6d") for order in "<>"}
_STAMP = {order: struct.Struct(f"{order}iII") for order in "<>"}
_COUNT = {order: struct.Struct(f"{order}I") for order in "<>"}
_COVARIANCE = 36 * 8


class CdrError(ValueError):
    """Bytes that are not the message they are said to be."""


class Stamped(NamedTuple):
    """A PoseStamped (7 numbers), TwistStamped or WrenchStamped (6)."""

    stamp: int  # ns
    frame: str
    values: tuple[float, ...]


class Odometry(NamedTuple):
    """An Odometry, without covariances."""

    stamp: int  # ns
    frame: str
    child_frame: str
    pose: tuple[float, ...]  # (7,) position, quaternion x y z w
    twist: tuple[float, ...]  # (6,) linear, angular


class JointState(NamedTuple):
    """A JointState."""

    stamp: int  # ns
    frame: str
    names: tuple[str, ...]
    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    efforts: tuple[float, ...]


def read_pose(data: bytes) -> Stamped:
    """Read a geometry_msgs/PoseStamped; raises :class:`CdrError`."""
    return _read_stamped(data, _POSE, 56)


def read_twist(data: bytes) -> Stamped:
    """Read a geometry_msgs/TwistStamped; raises :class:`CdrError`."""
    return _read_stamped(data, _SIX, 48)


def read_wrench(data: bytes) -> Stamped:
    """Read a geometry_msgs/WrenchStamped; raises :class:`CdrError`."""
    return _read_stamped(data, _SIX, 48)


def read_odometry(data: bytes) -> Odometry:
    """Read a nav_msgs/Odometry; raises :class:`CdrError`."""
    order, stamp, frame, at = _read_header(data)
    child, at = _read_string(data, order, at)
    at = _align(at, 8)
    end = at + 56 + _COVARIANCE + 48 + _COVARIANCE
    _check_end(data, end)
    pose = _POSE[order].unpack_from(data, at)
    twist = _SIX[order].unpack_from(data, at + 56 + _COVARIANCE)
    return Odometry(stamp, frame, child, pose, twist)


def read_joint_state(data: bytes) -> JointState:
    """Read a sensor_msgs/JointState; raises :class:`CdrError`."""
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


def read_stamp(data: bytes) -> int:
    """Read the stamp in ns of any message that begins with a header; raises :class:`CdrError`."""
    return _read_header(data)[1]


def _read_stamped(data: bytes, numbers: dict[str, struct.Struct], size: int) -> Stamped:
    order, stamp, frame, at = _read_header(data)
    at = _align(at, 8)
    _check_end(data, at + size)
    return Stamped(stamp, frame, numbers[order].unpack_from(data, at))


def _read_header(data: bytes) -> tuple[str, int, str, int]:
    """Byte order, stamp in ns, frame and where the next field may begin."""
    order = _ORDERS.get(bytes(data[:2]))
    if order is None:
        raise CdrError(f"encapsulation {bytes(data[:2]).hex() or 'missing'} is not plain CDR")
    _check_room(data, _HEADER + 12)
    seconds, nanoseconds, _ = _STAMP[order].unpack_from(data, _HEADER)
    if nanoseconds >= 1_000_000_000:
        raise CdrError(f"stamp has {nanoseconds} nanoseconds")
    frame, at = _read_string(data, order, _HEADER + 8)
    return order, seconds * 1_000_000_000 + nanoseconds, frame, at


def _read_string(data: bytes, order: str, at: int) -> tuple[str, int]:
    length, at = _read_count(data, order, at, 1)
    if not length:  # some writers leave out the terminating zero of an empty string
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
