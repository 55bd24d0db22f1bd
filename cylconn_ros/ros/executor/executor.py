"""A thread that waits for messages as bytes and hands them on: the short way from the network.

The ordinary executor builds what it waits on anew for every message, and makes message objects of
what comes. Here the middleware rings a bell (ros/executor/new_message_event.py), one for every group of subscriptions
whose messages make samples together, and bytes stay bytes. And as the messages of a sample mostly
come in one order, a group's bell is tied to the one that completed its last sample, and the others
are taken with it: the thread wakes once a sample instead of once a message. What comes seldom, and
completes no sample, has a bell of its own, so that nobody asks for it in vain. In a loop closed as
fast as it goes, where one sample follows the other's answer, the thread stays awake for the next.

This needs interfaces of rclpy that are not public. Where one is missing (:func:`missing` says
which), the node's executor has to serve the subscriptions.
"""

from __future__ import annotations

import functools
import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.subscription import Subscription

from cylconn_ros.ros.executor import new_message_event
from cylconn_ros.ros.executor.sequence_numbers import Gaps

_IDLE = 0.05  # s between looks whether to end, while nothing is expected
_LOOK = 0.005  # s between looks whether what is expected has come
_PATIENCE = 4.0  # of the time between samples: then others may not pile up any more
_LEAST, _MOST = 0.005, 1.0  # s, of that time
_CLOSE = 0.0003  # s between samples, up to which sleeping in between is not worth it
_IN_A_ROW = 8  # of them, or it was a few that had piled up
_THOROUGH = 16  # once in so many rounds everything that waits is taken, not one of each
_ALL = 1000

Receive = Callable[[bytes], bool]


def missing(node: Node) -> str:
    """What this rclpy lacks for a :class:`Loop` to serve inputs of ``node``; mostly nothing."""
    try:
        from rclpy.impl.implementation_singleton import rclpy_implementation
    except ImportError:
        return "rclpy.impl.implementation_singleton"
    for name in ("take_message", "pointer"):
        if not hasattr(getattr(rclpy_implementation, "Subscription", None), name):
            return f"Subscription.{name}"
    if not isinstance(getattr(node, "_subscriptions", None), list):
        return "Node._subscriptions"
    return new_message_event.missing()


class Entry(NamedTuple):
    """A subscription, made with ``raw=True``, and what takes its messages.

    ``receive`` returns whether the message completed a sample; ``lost`` is told how many messages
    never came; ``seldom``: it never completes one.
    """

    subscription: Subscription
    receive: Receive
    lost: Callable[[int], object] = lambda _: None
    seldom: bool = False


class Inputs(NamedTuple):
    """Subscriptions whose messages make samples together.

    ``take``, where there is one, takes all messages of those that are not ``seldom`` and has them
    served; it returns which of these completed the last sample, and gives what serving raises to
    its argument.
    """

    entries: Sequence[Entry]
    take: Callable[[Callable[[Exception], object]], int | None] | None = None


def joined(several: Sequence[Inputs]) -> Inputs:
    """Inputs whose messages make samples together only with the others'."""
    if len(several) == 1:
        return several[0]
    return Inputs([entry for inputs in several for entry in inputs.entries])


_Stream = tuple[int, Callable[[], Any], Receive, Gaps]


def _streams(entries: Sequence[Entry]) -> list[_Stream]:
    """Number, what takes a message (None where there is none), what receives it, its gaps."""
    return [
        (k, functools.partial(handle.take_message, entry.subscription.msg_type, True),
         entry.receive, Gaps(entry.lost))
        for k, entry in enumerate(entries) for handle in (entry.subscription.handle,)
    ]  # fmt: skip


class _Group:
    """Subscriptions whose messages make samples together, in the order in which they are taken."""

    def __init__(self, inputs: Inputs, caught: Callable[[Exception], object]) -> None:
        often = [entry for entry in inputs.entries if not entry.seldom]
        seldom = [entry for entry in inputs.entries if entry.seldom]
        self._take_often = inputs.take or self._take_queued
        self.bell, self.seldom_bell = (
            new_message_event.Bell([entry.subscription for entry in some])
            for some in (often, seldom)
        )
        self.seldom_bell.tie(range(len(seldom)))
        self._streams, self._seldom = _streams(often), _streams(seldom)
        self._caught = caught
        self._last: int | None = None  # who completed the last sample
        self._rounds = 0
        self._expected = False  # whether it rings for what comes next alone, and that is in time
        self._completed = 0.0
        self.due = 0.0  # when to look, though the bell has not rung; 0: it rings for all of them
        self.awake = 0.0  # until when to wait for the next sample without sleeping
        self._close = 0  # samples in a row that followed closely
        self._tie(None)

    def _tie(self, last: int | None) -> None:
        self._last = last
        self.bell.tie(range(len(self._streams)) if last is None else (last,))

    def serve(self, now: float) -> None:
        """Take what has come, and say to the bell what comes next."""
        self._expected = self._last is not None and now < self.due
        last = self._take_often(self._caught)
        if last != self._last:
            self._tie(last)
        if last is None:
            self.due = self.awake = 0.0  # part of a sample: what is close is not the next one
        else:
            since = now - self._completed
            self._completed = now
            self.due = now + min(max(_PATIENCE * since, _LEAST), _MOST)
            self._close = self._close + 1 if since < _CLOSE else 0
            self.awake = now + _CLOSE if self._close >= _IN_A_ROW else 0.0

    def _take_queued(self, _caught: Callable[[Exception], object]) -> int | None:
        """Take what has come message by message; who completed the last sample."""
        self._rounds += 1
        most = 1 if self._expected and self._rounds % _THOROUGH else _ALL
        last = self._take(self._streams, most)
        if last is None and most == 1:  # what was not taken has rung already
            last = self._take(self._streams, _ALL)
        return last

    def serve_seldom(self) -> None:
        """Take all that has come of what completes no sample."""
        self._take(self._seldom, _ALL)

    def _take(self, streams: Sequence[_Stream], most: int) -> int | None:
        """Take up to ``most`` messages of each; who completed a sample last."""
        last: int | None = None
        for k, take, receive, gaps in streams:
            for _ in range(most):
                taken = take()
                if taken is None:
                    break
                data, info = taken
                number = info["publication_sequence_number"]
                if number == gaps.expected:
                    gaps.expected = number + 1
                else:
                    gaps.apart(number)
                try:
                    if receive(data):
                        last = k
                except Exception as error:
                    self._caught(error)
        return last

    def close(self) -> None:
        """Hear nothing any more."""
        self.bell.close()
        self.seldom_bell.close()


class Loop:
    """Serve groups of subscriptions of a node on a thread of its own.

    ``lock`` is held while messages are handed on. ``caught`` gets what receiving raises. ``look``
    watches the clock: it gets the time (s, steady) and says when it wants to look again. It does so
    here, as this thread wakes for samples anyhow, and one of its own would have to be woken for it.
    """

    def __init__(
        self,
        node: Node,
        lock: Any,
        caught: Callable[[Exception], object],
        look: Callable[[float], float] = lambda _: math.inf,
    ) -> None:
        self._node, self._lock, self._caught, self._look = node, lock, caught, look
        self._entries: list[Entry] = []
        self._groups: list[_Group] = []
        self._ending = False
        self._thread: threading.Thread | None = None

    def open(self, groups: Sequence[Inputs]) -> None:
        """Take subscriptions over from the node's executor and begin."""
        self._entries = [entry for group in groups for entry in group.entries]
        for entry in self._entries:
            self._node._subscriptions.remove(entry.subscription)
        self._groups = [_Group(inputs, self._caught) for inputs in groups]
        self._ending = False
        self._thread = threading.Thread(target=self._run, name="samples", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End, and give the subscriptions back to the node; not to be called by its own thread."""
        self._ending = True
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        for group in self._groups:
            group.close()
        self._groups = []
        self._node._subscriptions.extend(entry.subscription for entry in self._entries)
        self._entries = []

    def _run(self) -> None:
        groups, lock = self._groups, self._lock
        ear = new_message_event.Ear()
        for number, group in enumerate(groups):
            ear.listen(group.bell, number)
            ear.listen(group.seldom_bell, ~number)
        looked, patience, due = 0.0, _IDLE, 0.0
        now = time.monotonic()
        while not self._ending:
            awake = groups[0].awake if len(groups) == 1 else 0.0  # several ring often, close or not
            rung = ear.wait(max(0.0, min(patience, due - now)), awake)
            now = time.monotonic()
            for number in sorted(rung):  # what comes seldom first: it acts on the sample with it
                with lock:
                    if number < 0:
                        groups[~number].serve_seldom()
                    else:
                        groups[number].serve(now)
            if rung:
                patience = _LOOK
            if now - looked >= _LOOK:
                looked, patience = now, _IDLE
                for group in groups:
                    if 0.0 < group.due < now:
                        with lock:
                            group.serve(now)
                    if group.due > 0.0:
                        patience = _LOOK
            if now >= due:
                due = self._looked(now)
        ear.close()

    def _looked(self, now: float) -> float:
        try:
            return self._look(now)
        except Exception as error:
            self._caught(error)
            return now + _IDLE
