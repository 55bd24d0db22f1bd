"""A bell for every connector: rung by the middleware when a message comes, heard by one thread.

A wait set costs time for everything that is in it, at every wait. A bell costs nothing until it
rings: the middleware calls a C function when a message has come for a subscription, here
``eventfd_write`` itself with the bell's file descriptor, and ``epoll`` says which bells have rung.
No Python runs in the middleware's threads, and how many bells there are does not matter.

``rcl_subscription_set_on_new_message_callback`` is rcl's public interface, which rclpy does not
pass on; it is reached with the address that rclpy gives of a subscription.
"""

from __future__ import annotations

import ctypes
import functools
import os
import select
import time
from collections.abc import Sequence
from typing import Any


@functools.cache
def _interface() -> tuple[Any, Any]:
    """The function of rcl that sets what is called, and the address of what is to be called."""
    setter = ctypes.CDLL("librcl.so").rcl_subscription_set_on_new_message_callback
    setter.argtypes = [ctypes.c_void_p] * 3
    setter.restype = ctypes.c_int
    ring = ctypes.cast(ctypes.CDLL(None).eventfd_write, ctypes.c_void_p)
    return setter, ring


def missing() -> str:
    """What this machine lacks for bells; mostly nothing."""
    if not (hasattr(os, "eventfd") and hasattr(select, "epoll")):
        return "eventfd"
    try:
        _interface()
    except (OSError, AttributeError):
        return "rcl_subscription_set_on_new_message_callback"
    return ""


class Bell:
    """Rings when a message comes for one of the subscriptions that it is tied to."""

    def __init__(self, subscriptions: Sequence[Any]) -> None:
        """``subscriptions``: of rclpy; they must live as long as the bell is open."""
        self._set, self._ring = _interface()
        self._addresses = [subscription.handle.pointer for subscription in subscriptions]
        self._tied: set[int] = set()
        self.descriptor = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)

    def tie(self, wanted: Sequence[int]) -> None:
        """Tie it to these subscriptions alone; it rings for messages that already wait there."""
        for k in self._tied.difference(wanted):
            self._set(self._addresses[k], None, None)
        for k in wanted:
            if k not in self._tied and self._set(self._addresses[k], self._ring, self.descriptor):
                raise RuntimeError("this middleware does not say when a message has come")
        self._tied = set(wanted)

    def close(self) -> None:
        """Ring no more."""
        self.tie(())
        os.close(self.descriptor)


class Ear:
    """Waits for bells; each is known by a number."""

    def __init__(self) -> None:
        self._poll = select.epoll()
        self._numbers: dict[int, int] = {}

    def listen(self, bell: Bell, number: int) -> None:
        """Wait for ``bell``, too; as every ringing is an edge, its counter need not be read."""
        self._numbers[bell.descriptor] = number
        self._poll.register(bell.descriptor, select.EPOLLIN | select.EPOLLET)

    def wait(self, timeout: float, awake: float = 0.0) -> list[int]:
        """Numbers of the bells that have rung since the last time; waits up to ``timeout`` s.

        Until ``awake`` (s, steady clock) it looks again and again, giving way to others in between,
        before it sleeps: to be woken on an idle processor takes longer than a short wait.
        """
        poll = self._poll.poll
        rung: list[tuple[int, int]] = []
        while not rung and time.monotonic() < awake:
            os.sched_yield()
            rung = poll(0.0)
        numbers = self._numbers
        return [numbers[descriptor] for descriptor, _ in rung or poll(timeout)]

    def close(self) -> None:
        """Wait no more."""
        self._poll.close()
