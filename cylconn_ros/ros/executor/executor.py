"""Executor that takes serialized messages on its own thread, woken by message events.

rclpy's executor rebuilds its wait set for every message and deserializes the message. Here the
middleware signals an event (ros/executor/new_message_event.py), one for every group of
subscriptions whose messages form samples together, and messages stay serialized.

The messages of a sample usually arrive in the same order. The event of a group is therefore armed
for the subscription that completed the last sample only, and the other subscriptions are taken
with it: the thread wakes once per sample instead of once per message. Subscriptions that never
complete a sample (loads, commands: non-triggering) have an event of their own, so that they cost
nothing while they are idle. In a fast closed loop, in which each sample follows the wrench of the
previous one, the thread polls for the next sample instead of sleeping.

This needs interfaces of rclpy that are not public. If one is missing (:func:`missing` names it),
the node's own executor has to process the subscriptions.
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
from cylconn_ros.ros.executor.sequence_numbers import SequenceNumbers

_IDLE = 0.05  # s, greatest wait while no sample is due; also limits the delay of close()
_CHECK = 0.005  # s between checks whether a sample is overdue
_OVERDUE = 4.0  # sample intervals after which a group is taken without an event
_LEAST, _MOST = 0.005, 1.0  # s, bounds of that time
_CLOSE = 0.0003  # s between samples, up to which polling is better than sleeping
_IN_A_ROW = 8  # such intervals before the thread polls; fewer may be a short backlog
_THOROUGH = 16  # once in this many rounds all queued messages are taken, not one of each
_ALL = 1000

Receive = Callable[[bytes], bool]
"""Process a serialized message; return True if it completed a sample."""


def missing(node: Node) -> str:
    """Return the name of the missing interface, or '' if ``node`` can have a SampleExecutor."""
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


class InputSubscription(NamedTuple):
    """A subscription made with ``raw=True`` and the handler of its messages.

    ``lost`` gets the number of messages that were lost. ``triggering``: its messages can complete
    a sample.
    """

    subscription: Subscription
    receive: Receive
    lost: Callable[[int], object] = lambda _: None
    triggering: bool = True


class InputGroup(NamedTuple):
    """Subscriptions whose messages form samples together.

    ``take``, if given, takes and processes all queued messages of the triggering subscriptions. It
    returns the index of the subscription that completed the last sample and passes exceptions to
    its argument.
    """

    entries: Sequence[InputSubscription]
    take: Callable[[Callable[[Exception], object]], int | None] | None = None


def merge_groups(groups: Sequence[InputGroup]) -> InputGroup:
    """Merge groups whose messages form samples only together."""
    if len(groups) == 1:
        return groups[0]
    return InputGroup([entry for group in groups for entry in group.entries])


_Stream = tuple[int, Callable[[], Any], Receive, SequenceNumbers]


def _streams(entries: Sequence[InputSubscription]) -> list[_Stream]:
    """Index, take function (None if the queue is empty), handler and sequence numbers of each."""
    return [
        (k, functools.partial(handle.take_message, entry.subscription.msg_type, True),
         entry.receive, SequenceNumbers(entry.lost))
        for k, entry in enumerate(entries) for handle in (entry.subscription.handle,)
    ]  # fmt: skip


class _Group:
    """Subscriptions whose messages form samples together, in the order in which they are taken."""

    def __init__(self, inputs: InputGroup, on_error: Callable[[Exception], object]) -> None:
        triggering = [entry for entry in inputs.entries if entry.triggering]
        others = [entry for entry in inputs.entries if not entry.triggering]
        self._take_triggering = inputs.take or self._take_queued
        self.event, self.non_triggering_event = (
            new_message_event.MessageEvent([entry.subscription for entry in entries])
            for entries in (triggering, others)
        )
        self.non_triggering_event.arm(range(len(others)))
        self._streams, self._non_triggering = _streams(triggering), _streams(others)
        self._on_error = on_error
        self._last: int | None = None  # stream that completed the last sample
        self._rounds = 0
        self._expected = False  # the event is armed for the completing stream, which is in time
        self._completed = 0.0
        self.due = 0.0  # when to take messages without an event; 0: armed for all streams
        self.poll_until = 0.0  # until when to poll for the next sample
        self._close = 0  # short sample intervals in a row
        self._arm(None)

    def _arm(self, last: int | None) -> None:
        self._last = last
        self.event.arm(range(len(self._streams)) if last is None else (last,))

    def process(self, now: float) -> None:
        """Take the queued messages and arm the event for the next sample."""
        self._expected = self._last is not None and now < self.due
        last = self._take_triggering(self._on_error)
        if last != self._last:
            self._arm(last)
        if last is None:
            self.due = self.poll_until = 0.0  # part of a sample: a short interval means nothing
        else:
            since = now - self._completed
            self._completed = now
            self.due = now + min(max(_OVERDUE * since, _LEAST), _MOST)
            self._close = self._close + 1 if since < _CLOSE else 0
            self.poll_until = now + _CLOSE if self._close >= _IN_A_ROW else 0.0

    def _take_queued(self, _on_error: Callable[[Exception], object]) -> int | None:
        """Take the queue message by message; return the stream that completed the last sample."""
        self._rounds += 1
        most = 1 if self._expected and self._rounds % _THOROUGH else _ALL
        last = self._take(self._streams, most)
        if last is None and most == 1:  # the event of the messages left queued has already fired
            last = self._take(self._streams, _ALL)
        return last

    def process_non_triggering(self) -> None:
        """Take all queued messages that cannot complete a sample."""
        self._take(self._non_triggering, _ALL)

    def _take(self, streams: Sequence[_Stream], most: int) -> int | None:
        """Take up to ``most`` messages of each; return the last stream that completed a sample."""
        last: int | None = None
        for k, take, receive, numbers in streams:
            for _ in range(most):
                taken = take()
                if taken is None:
                    break
                data, info = taken
                number = info["publication_sequence_number"]
                if number == numbers.expected:
                    numbers.expected = number + 1
                else:
                    numbers.out_of_sequence(number)
                try:
                    if receive(data):
                        last = k
                except Exception as error:
                    self._on_error(error)
        return last

    def close(self) -> None:
        """Close both events."""
        self.event.close()
        self.non_triggering_event.close()


class SampleExecutor:
    """Process groups of subscriptions of a node on a thread of its own.

    ``lock`` is held while messages are processed. ``on_error`` gets exceptions of handlers.
    ``check`` is called with the time (s, steady clock) and returns the time of its next call. It
    runs on this thread, which wakes for samples anyway; a separate timer would need wake-ups of its
    own.
    """

    def __init__(
        self,
        node: Node,
        lock: Any,
        on_error: Callable[[Exception], object],
        check: Callable[[float], float] = lambda _: math.inf,
    ) -> None:
        self._node, self._lock, self._on_error, self._check = node, lock, on_error, check
        self._entries: list[InputSubscription] = []
        self._groups: list[_Group] = []
        self._ending = False
        self._thread: threading.Thread | None = None

    def open(self, groups: Sequence[InputGroup]) -> None:
        """Take the subscriptions over from the node's executor and start the thread."""
        self._entries = [entry for group in groups for entry in group.entries]
        for entry in self._entries:
            self._node._subscriptions.remove(entry.subscription)
        self._groups = [_Group(inputs, self._on_error) for inputs in groups]
        self._ending = False
        self._thread = threading.Thread(target=self._run, name="samples", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread (called from another one) and return the subscriptions to the node."""
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
        poller = new_message_event.EventPoller()
        for number, group in enumerate(groups):
            poller.register(group.event, number)
            poller.register(group.non_triggering_event, ~number)
        checked, patience, due = 0.0, _IDLE, 0.0
        now = time.monotonic()
        while not self._ending:
            # With several groups events are frequent anyway: no polling.
            poll_until = groups[0].poll_until if len(groups) == 1 else 0.0
            ready = poller.wait(max(0.0, min(patience, due - now)), poll_until)
            now = time.monotonic()
            for number in sorted(ready):  # loads and commands first: they act on this sample
                with lock:
                    if number < 0:
                        groups[~number].process_non_triggering()
                    else:
                        groups[number].process(now)
            if ready:
                patience = _CHECK
            if now - checked >= _CHECK:
                checked, patience = now, _IDLE
                for group in groups:
                    if 0.0 < group.due < now:
                        with lock:
                            group.process(now)
                    if group.due > 0.0:
                        patience = _CHECK
            if now >= due:
                due = self._next_check(now)
        poller.close()

    def _next_check(self, now: float) -> float:
        try:
            return self._check(now)
        except Exception as error:
            self._on_error(error)
            return now + _IDLE
