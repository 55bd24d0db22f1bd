"""A thread that waits for messages as bytes and hands them on: the short way from the network.

The ordinary executor builds what it waits on anew for every message, and makes message objects of
what comes. Here a wait set is kept, and bytes stay bytes. And as the messages of a sample mostly
come in one order, the thread waits for the one that completed the last sample, and takes the others
with it: it wakes once a sample instead of once a message.

This needs interfaces of rclpy that are not public. Where one is missing (:func:`missing` says
which), the node's executor has to serve the subscriptions.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from rclpy.context import Context
from rclpy.node import Node
from rclpy.subscription import Subscription

_IDLE = 50_000_000  # ns between looks whether to end, while nothing comes
_EXPECTED = 5_000_000  # ns to wait for one message alone: others may not pile up meanwhile
_THOROUGH = 16  # once in so many rounds everything that waits is taken, not one of each
_ALL = 1000

Receive = Callable[[bytes], bool]


def missing(node: Node) -> str:
    """What this rclpy lacks for a :class:`Loop` to serve inputs of ``node``; mostly nothing."""
    try:
        from rclpy.impl.implementation_singleton import rclpy_implementation
    except ImportError:
        return "rclpy.impl.implementation_singleton"
    wanted = {
        "WaitSet": ("clear_entities", "add_subscription", "wait", "get_ready_entities"),
        "Subscription": ("take_message",),
    }
    for kind, names in wanted.items():
        for name in names:
            if not hasattr(getattr(rclpy_implementation, kind, None), name):
                return f"{kind}.{name}"
    return "" if isinstance(getattr(node, "_subscriptions", None), list) else "Node._subscriptions"


class Entry(NamedTuple):
    """A subscription, made with ``raw=True``, and what takes its messages.

    ``receive`` returns whether the message completed a sample.
    """

    subscription: Subscription
    receive: Receive


class Loop:
    """Serve subscriptions of a node on a thread of its own, in their order where several wait.

    ``lock`` is held while messages are handed on. ``caught`` gets what receiving raises.
    """

    def __init__(self, node: Node, lock: Any, caught: Callable[[Exception], object]) -> None:
        self._node, self._lock, self._caught = node, lock, caught
        self._entries: list[Entry] = []
        self._ending = False
        self._thread: threading.Thread | None = None

    def open(self, entries: Sequence[Entry]) -> None:
        """Take subscriptions over from the node's executor and begin."""
        self._entries = list(entries)
        for subscription, _ in self._entries:
            self._node._subscriptions.remove(subscription)
        self._ending = False
        self._thread = threading.Thread(target=self._run, name="samples", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End, and give the subscriptions back to the node; not to be called by its own thread."""
        self._ending = True
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        self._node._subscriptions.extend(entry.subscription for entry in self._entries)
        self._entries = []

    def _run(self) -> None:
        handles = [entry.subscription.handle for entry in self._entries]
        every = WaitSet(handles, self._node.context)
        alone = [WaitSet([handle], self._node.context) for handle in handles]
        streams = [
            (k, functools.partial(handle.take_message, entry.subscription.msg_type, True),
             entry.receive)
            for k, (handle, entry) in enumerate(zip(handles, self._entries, strict=True))
        ]  # fmt: skip
        last: int | None = None  # who completed the last sample
        rounds = 0
        while not self._ending:
            rounds += 1
            if last is None:
                if not every.wait(_IDLE):
                    continue
                most = _ALL
            else:
                alone[last].wait_only(_EXPECTED)
                most = 1 if rounds % _THOROUGH else _ALL
            last = None
            with self._lock:
                for k, take, receive in streams:
                    for _ in range(most):
                        taken = take()
                        if taken is None:
                            break
                        try:
                            if receive(taken[0]):
                                last = k
                        except Exception as error:
                            self._caught(error)


class WaitSet:
    """Subscriptions to be waited for again and again."""

    def __init__(self, handles: Sequence[Any], context: Context) -> None:
        from rclpy.impl.implementation_singleton import rclpy_implementation

        self._handles = list(handles)
        self._set = rclpy_implementation.WaitSet(len(handles), 0, 0, 0, 0, 0, context.handle)

    def wait(self, timeout: int) -> bool:
        """Wait up to ``timeout`` ns; whether anything has come."""
        self.wait_only(timeout)
        return bool(self._set.get_ready_entities("subscription"))

    def wait_only(self, timeout: int) -> None:
        """Wait up to ``timeout`` ns, for who looks himself what has come."""
        waiting = self._set
        waiting.clear_entities()
        for handle in self._handles:
            waiting.add_subscription(handle)
        waiting.wait(timeout)
