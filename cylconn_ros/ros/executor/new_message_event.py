"""One eventfd per group of subscriptions: written by rcl's on_new_message callback, read by epoll.

A wait set costs time for every entity in it, at every wait. A message event costs nothing until a
message arrives: the middleware's thread calls rcl's on_new_message callback, here the C function
``eventfd_write`` itself with the event's file descriptor, and one thread waits for all descriptors
with ``epoll``. No Python runs in the middleware's threads, and the cost of a wait does not depend
on the number of events.

``rcl_subscription_set_on_new_message_callback`` is public in rcl, but rclpy does not expose it. It
is called through ctypes with the subscription's address, which rclpy provides.
"""

from __future__ import annotations

import ctypes
import functools
import os
import select
import time
from collections.abc import Sequence
from typing import Any

from cylconn_ros.errors import CylconnError


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
    """An eventfd that becomes readable when a message arrives for an armed subscription."""

    def __init__(self, subscriptions: Sequence[Any]) -> None:
        """``subscriptions``: of rclpy; they must outlive the event."""
        self._set_callback, self._callback = _callback_functions()
        self._addresses = [subscription.handle.pointer for subscription in subscriptions]
        self._armed: set[int] = set()
        self.descriptor = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)

    def arm(self, indices: Sequence[int]) -> None:
        """Register the callback on these subscriptions only.

        The callback fires at once if messages are already queued. Raises
        MiddlewareError if the middleware does not support it.
        """
        for k in self._armed.difference(indices):
            self._set_callback(self._addresses[k], None, None)
        for k in indices:
            if k not in self._armed and self._set_callback(
                self._addresses[k], self._callback, self.descriptor
            ):
                raise MiddlewareError("the middleware does not support the on_new_message callback")
        self._armed = set(indices)

    def close(self) -> None:
        """Unregister the callbacks and close the file descriptor."""
        self.arm(())
        os.close(self.descriptor)


class EventPoller:
    """Wait for message events with epoll; each event has a number."""

    def __init__(self) -> None:
        self._epoll = select.epoll()
        self._numbers: dict[int, int] = {}

    def register(self, event: MessageEvent, number: int) -> None:
        """Add ``event``, edge-triggered: its counter need not be read."""
        self._numbers[event.descriptor] = number
        self._epoll.register(event.descriptor, select.EPOLLIN | select.EPOLLET)

    def wait(self, timeout: float, poll_until: float = 0.0) -> list[int]:
        """Return the numbers of the events since the previous call; wait up to ``timeout`` s.

        Until ``poll_until`` (s, steady clock) it polls and yields the processor in between, before
        it blocks: waking a thread on an idle processor takes longer than a short wait.
        """
        poll = self._epoll.poll
        ready: list[tuple[int, int]] = []
        while not ready and time.monotonic() < poll_until:
            os.sched_yield()
            ready = poll(0.0)
        numbers = self._numbers
        return [numbers[descriptor] for descriptor, _ in ready or poll(timeout)]

    def close(self) -> None:
        """Close epoll."""
        self._epoll.close()
