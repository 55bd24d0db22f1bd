"""Access to rcl from compiled code: addresses of its functions, and serialized messages in memory.

The signatures and the first members of the structures are those of Jazzy, and of Humble before it.
rclpy provides the addresses of its publishers and subscriptions (``handle.pointer``). A message is
an ``rcl_serialized_message_t``: buffer, length, capacity, allocator.
"""

from __future__ import annotations

import ctypes
import functools
import struct
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

# Indices of the addresses.
TAKE: Final = 0  # rcl_take_serialized_message(subscription, message, info, NULL)
PUBLISH: Final = 1  # rcl_publish_serialized_message(publisher, message, NULL)
SUBSCRIBERS: Final = 2  # rcl_publisher_get_subscription_count(publisher, count)
COPY: Final = 3  # memcpy(to, from, size)
CLOCK: Final = 4  # clock_gettime(clock, time)
INFO: Final = 5  # an rmw_message_info_t, written by TAKE
NUMBERS: Final = 6  # memory for a count or a time
NADDRESS: Final = 7

MESSAGE: Final = 8  # words of a serialized message
BYTES: Final = 0  # address of its buffer
LENGTH: Final = 1
_CAPACITY: Final = 2
_ALLOCATOR: Final = 3

SEQUENCE: Final = 2  # word of INFO: the publisher's sequence number of the message
_INFO_WORDS = 32  # more than the structure has


class _Allocator(ctypes.Structure):
    _fields_ = (("members", ctypes.c_void_p * 5),)


@functools.cache
def _libraries() -> tuple[Any, Any]:
    return ctypes.CDLL("librcl.so"), ctypes.CDLL("librcutils.so")


def missing() -> str:
    """Return the missing prerequisite, or '' if compiled code can call rcl."""
    if struct.calcsize("P") != 8:
        return "addresses of 64 bits"
    try:
        rcl, rcutils = _libraries()
        for library, names in (
            (rcl, ("rcl_take_serialized_message", "rcl_publish_serialized_message")),
            (rcl, ("rcl_publisher_get_subscription_count",)),
            (rcutils, ("rcutils_get_default_allocator", "rcutils_uint8_array_fini")),
        ):
            for name in names:
                getattr(library, name)
    except (OSError, AttributeError) as error:
        return str(error)
    return ""


def _address(function: Any) -> int:
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)


class CallTable:
    """Addresses of functions and memory that compiled code needs.

    Attributes
    ----------
        addresses: (NADDRESS,). info, numbers: the memory at INFO and NUMBERS.
    """

    def __init__(self) -> None:
        rcl, _ = _libraries()
        libc = ctypes.CDLL(None)
        self.info = np.zeros(_INFO_WORDS, np.int64)
        self.numbers = np.zeros(2, np.int64)
        self.addresses = np.array(
            [
                _address(rcl.rcl_take_serialized_message),
                _address(rcl.rcl_publish_serialized_message),
                _address(rcl.rcl_publisher_get_subscription_count),
                _address(libc.memcpy),
                _address(libc.clock_gettime),
                self.info.ctypes.data,
                self.numbers.ctypes.data,
            ]
        )


class SerializedMessages:
    """An array of ``rcl_serialized_message_t``.

    Attributes
    ----------
        memory: (n MESSAGE,) the structures. addresses: (n,) of each.
    """

    def __init__(self, count: int) -> None:
        _, rcutils = _libraries()
        rcutils.rcutils_get_default_allocator.restype = _Allocator
        self.memory = np.zeros(MESSAGE * count, np.int64)
        self.addresses = self.memory.ctypes.data + 8 * MESSAGE * np.arange(count)
        members = rcutils.rcutils_get_default_allocator().members
        for k in range(count):
            at = MESSAGE * k + _ALLOCATOR
            self.memory[at : at + 5] = [member or 0 for member in members]


class ReceiveBuffers(SerializedMessages):
    """Messages that rcl writes; it allocates their buffers as needed."""

    def message(self, k: int) -> bytes:
        """Return a copy of message ``k``."""
        at = MESSAGE * k
        return ctypes.string_at(int(self.memory[at + BYTES]), int(self.memory[at + LENGTH]))

    def close(self) -> None:
        """Free the buffers."""
        _, rcutils = _libraries()
        for address in self.addresses.tolist():
            rcutils.rcutils_uint8_array_fini(ctypes.c_void_p(address))


class SendBuffers(SerializedMessages):
    """Messages in memory that the caller owns."""

    def __init__(self, addresses: Sequence[int], sizes: Sequence[int]) -> None:
        super().__init__(len(sizes))
        at = MESSAGE * np.arange(len(sizes))
        self.memory[at + BYTES] = addresses
        self.memory[at + LENGTH] = self.memory[at + _CAPACITY] = sizes


def take_error() -> str:
    """Return rcl's text of the last error on this thread, and reset it."""
    _, rcutils = _libraries()

    class Text(ctypes.Structure):
        _fields_ = (("text", ctypes.c_char * 1024),)

    rcutils.rcutils_get_error_string.restype = Text
    text = bytes(rcutils.rcutils_get_error_string().text).decode(errors="replace")
    rcutils.rcutils_reset_error()
    return text
