"""One eventfd per subscription: written by rcl's on_new_message callback, watched with epoll.

A wait set costs time for every entity in it, at every wait. A message event costs nothing until a
message arrives: the middleware's thread calls rcl's on_new_message callback, here the C function
``eventfd_write`` itself with the event's file descriptor, and one thread waits for all descriptors
with ``epoll``. No Python runs in the middleware's threads, and the cost of a wait does not depend
on the number of events.

No message may be left behind without an event. rmw_fastrtps registers a callback in two steps:
``set_on_new_message_callback`` counts the unread messages, and later switches the listener's
data_available status on. A message that arrives between the two raises no event. A callback is
therefore registered once, for the life of the subscription, and which events wake the thread is
selected in epoll (:meth:`EventPoller.arm`). The kernel then gives two guarantees (epoll(7)):

- A descriptor is registered edge-triggered (EPOLLET). Every write to an armed one is reported by
  the next wait, also if its counter was never read.
- To arm a descriptor (``epoll_ctl`` with EPOLL_CTL_MOD) reports it at the next wait if it was
  written before. Nothing reads the counter, so that this is the case after the first message, and
  always after :class:`MessageEvent` was made, which writes once.

A subscription that is armed is thus taken once more before the thread sleeps, whenever its messages
arrived. The caller takes the messages of a reported event until the queue is empty.

``rcl_subscription_set_on_new_message_callback`` is public in rcl, but rclpy does not expose it. It
is called through ctypes with the subscription's address, which rclpy provides.
"""

from __future__ import annotations

import ctypes
import functools
import os
import select
import time
from typing import Any, Generic, TypeVar

from cylconn_ros.errors import CylconnError

Key = TypeVar("Key")


@functools.cache
def _callback_functions() -> tuple[Any, Any]:
    """Return rcl's function that registers the callback, and the address of the callback."""
    setter = ctypes.CDLL("librcl.so").rcl_subscription_set_on_new_message_callback
    setter.argtypes = [ctypes.c_void_p] * 3
    setter.restype = ctypes.c_int
    callback = ctypes.cast(ctypes.CDLL(None).eventfd_write, ctypes.c_void_p)
    return setter, callback


def missing() -> str:
    """Return the name of the missing prerequisite, or '' if message events are supported."""
    if not (hasattr(os, "eventfd") and hasattr(select, "epoll")):
        return "eventfd"
    try:
        _callback_functions()
    except (OSError, AttributeError):
        return "rcl_subscription_set_on_new_message_callback"
    return ""


class MiddlewareError(CylconnError, RuntimeError):
    """The middleware lacks a required feature."""


class MessageEvent:
    """An eventfd that is written when a message arrives for a subscription.

    Attributes
    ----------
        descriptor: the eventfd. It is readable from the begin, as messages may be queued.
    """

    def __init__(self, subscription: Any) -> None:
        """Register the callback; ``subscription``: of rclpy, must outlive the event.

        Raises MiddlewareError if the middleware does not support it.
        """
        set_callback, callback = _callback_functions()
        self._set_callback, self._address = set_callback, subscription.handle.pointer
        self.descriptor = os.eventfd(1, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        if set_callback(self._address, callback, self.descriptor):
            os.close(self.descriptor)
            raise MiddlewareError("the middleware does not support the on_new_message callback")

    def close(self) -> None:
        """Unregister the callback and close the file descriptor."""
        self._set_callback(self._address, None, None)
        os.close(self.descriptor)


class EventPoller(Generic[Key]):
    """Wait for message events with epoll; each event has a key."""

    def __init__(self) -> None:
        self._epoll = select.epoll()
        self._flags = select.EPOLLET, select.EPOLLET | select.EPOLLIN  # by whether it is armed
        self._keys: dict[int, Key] = {}

    def register(self, event: MessageEvent, key: Key) -> None:
        """Add ``event``, armed."""
        self._keys[event.descriptor] = key
        self._epoll.register(event.descriptor, self._flags[True])

    def arm(self, event: MessageEvent, armed: bool) -> None:
        """Let ``event`` wake the thread, or not; if it does, :meth:`wait` reports it once."""
        self._epoll.modify(event.descriptor, self._flags[armed])

    def wait(self, timeout: float, poll_until: float = 0.0) -> list[Key]:
        """Return the keys of the armed events since the previous call; wait up to ``timeout`` s.

        Until ``poll_until`` (s, steady clock) it polls and yields the processor in between, before
        it blocks: waking a thread on an idle processor takes longer than a short wait.
        """
        poll = self._epoll.poll
        ready: list[tuple[int, int]] = []
        while not ready and time.monotonic() < poll_until:
            os.sched_yield()
            ready = poll(0.0)
        keys = self._keys
        return [keys[descriptor] for descriptor, _ in ready or poll(timeout)]

    def close(self) -> None:
        """Close epoll."""
        self._epoll.close()
