"""Executor that takes serialized messages on its own thread, woken by message events.

rclpy's executor rebuilds its wait set for every message and deserializes the message. Here every
subscription has an event, which the middleware signals (ros/executor/new_message_event.py), and
messages stay serialized.

The messages of a sample usually arrive in the same order. Between samples, the thread is therefore
woken only by the stream whose message came last (the completing one), and the other messages of the
sample are taken with it: it wakes once per sample instead of once per message. A stream of loads
that come with every sample is treated in the same way; other loads, and commands, wake the thread
when they arrive and cost nothing while they are idle. Samples that are queued together are
processed one by one if there are loads or commands, which are taken before each. In a fast closed
loop, in which each sample follows the wrench of the previous one, the thread polls for the next
sample instead of sleeping.

No complete sample is left in a queue:

- The thread sleeps only if every armed stream was taken until its queue was empty after its last
  event, and to arm a stream raises its event once more.
- Only the completing stream is armed only if no message of a next sample is received yet. As long
  as a sample is partly received, all streams are armed: any of them may complete it.

A sample that waits for its load (connector/load_history.py) is checked every 5 ms until it is
processed. For the first 0.1 s of a partly received sample the queues are taken in the same
interval without an event, too, which no middleware that reports its messages needs.

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
from cylconn_ros.ros.executor.new_message_event import EventPoller, MessageEvent
from cylconn_ros.ros.executor.sequence_numbers import SequenceNumbers

_IDLE = 0.05  # s, greatest wait while no sample is due; also limits the delay of close()
_CHECK = 0.005  # s between checks whether a sample is overdue
_OVERDUE = 4.0  # sample intervals after which a group is taken without an event
_LEAST, _MOST = 0.005, 1.0  # s, bounds of that time
_CLOSE = 0.0003  # s between samples, up to which polling is better than sleeping
_IN_A_ROW = 8  # such intervals before the thread polls; fewer may be a short backlog
_PARTIAL = 0.1  # s for which a partly received sample is checked without an event
_REGULAR = 2  # consecutive samples with loads after which their stream is a regular one
_MANY = 1000  # messages of one stream taken in a row

_INTERNAL = {
    "Subscription": ("take_message", "pointer"),
    "Publisher": ("publish_raw", "pointer", "get_subscription_count"),
}
"""Classes and methods of rclpy's extension module that are used here and are not public."""

Receive = Callable[[bytes], bool]
"""Process a serialized message; return True if it completed a sample."""


Take = Callable[[int | None, Callable[[Exception], object], bool], tuple[bool, int | None]]
"""Take and process queued messages as ``FusedPath.take`` does."""


def missing(node: Node) -> str:
    """Return the name of the missing interface, or '' if ``node`` can have a SampleExecutor."""
    try:
        from rclpy.impl.implementation_singleton import rclpy_implementation
    except ImportError:
        return "rclpy.impl.implementation_singleton"
    for owner, names in _INTERNAL.items():
        for name in names:
            if not hasattr(getattr(rclpy_implementation, owner, None), name):
                return f"{owner}.{name}"
    if not isinstance(getattr(node, "_subscriptions", None), list):
        return "Node._subscriptions"
    return new_message_event.missing()


class InputSubscription(NamedTuple):
    """A subscription made with ``raw=True`` and the handler of its messages.

    ``lost`` gets the number of messages that were lost. ``triggering``: its messages are parts of
    samples; the others are taken before them.
    """

    subscription: Subscription
    receive: Receive
    lost: Callable[[int], object] = lambda _: None
    triggering: bool = True


class InputGroup(NamedTuple):
    """Subscriptions whose messages form samples together.

    ``take``, if given, takes and processes the messages of the triggering subscriptions in place of
    the group (ros/executor/fused.py).
    ``is_partial``: whether messages of a sample that is not processed are received.
    ``end_waits``: called with the time (s, steady clock) while a sample is partly received;
    processes a sample that has waited for its load long enough.
    """

    entries: Sequence[InputSubscription]
    take: Take | None = None
    is_partial: Callable[[], bool] = lambda: False
    end_waits: Callable[[float], object] = lambda _: None


def merge_groups(groups: Sequence[InputGroup]) -> InputGroup:
    """Merge groups whose messages form samples only together."""
    if len(groups) == 1:
        return groups[0]

    def end_waits(now: float) -> None:
        for group in groups:
            group.end_waits(now)

    return InputGroup(
        [entry for group in groups for entry in group.entries],
        is_partial=lambda: any(group.is_partial() for group in groups),
        end_waits=end_waits,
    )


class _Stream:
    """A subscription with its event; ``take`` returns None if the queue is empty."""

    def __init__(self, entry: InputSubscription) -> None:
        handle = entry.subscription.handle
        self.take = functools.partial(handle.take_message, entry.subscription.msg_type, True)
        self.receive, self.numbers = entry.receive, SequenceNumbers(entry.lost)
        self.triggering = entry.triggering
        self.event = MessageEvent(entry.subscription)
        self.armed = True
        self.arrived = False  # a message was taken since the last sample
        self.in_a_row = 0  # consecutive samples with a message

    @property
    def regular(self) -> bool:
        """Whether its messages come with every sample: it need not wake the thread."""
        return self.triggering or self.in_a_row >= _REGULAR


_Key = tuple[int, int]
"""Number of a group, and of a stream in it."""


class Group:
    """Subscriptions whose messages form samples together, in the order in which they are taken.

    Attributes
    ----------
        due: when to check it without an event (s, steady clock), 0: not at all.
        poll_until: until when to poll for the next sample.
    """

    def __init__(
        self,
        inputs: InputGroup,
        on_error: Callable[[Exception], object],
        poller: EventPoller[_Key],
        number: int,
    ) -> None:
        """``number``: of the group in the keys of ``poller``."""
        self._streams = [_Stream(entry) for entry in inputs.entries]
        self._triggering = [stream for stream in self._streams if stream.triggering]
        self._others = [stream for stream in self._streams if not stream.triggering]
        self._inputs, self._on_error, self._poller = inputs, on_error, poller
        for k, stream in enumerate(self._streams):
            poller.register(stream.event, (number, k))
        self._completing: _Stream | None = None  # the armed stream; None: all are armed
        self._newest: _Stream | None = None  # the triggering stream of the last message
        self._completed = 0.0
        self._partial_since = 0.0  # since when a sample is partly received; 0: none is
        self.due = 0.0
        self.poll_until = 0.0
        self._close = 0  # short sample intervals in a row

    def process(self, now: float, ready: Sequence[int]) -> None:
        """Take the queued messages, and arm the streams that may complete the next sample.

        ``ready``: numbers of the streams whose events were reported.
        """
        signalled = [self._streams[k] for k in ready]
        complete, goes_on = False, True
        while goes_on:
            in_use = False
            for stream in self._others:  # loads and commands first: they act on this sample
                # in use, or its first message
                if stream.numbers.expected >= 0 or stream in signalled:
                    in_use = True
                    taken, completed = self._take(stream)
                    complete |= completed
                    if taken == _MANY:  # more may be queued: raise the event again
                        self._poller.arm(stream.event, True)
            goes_on = False
            if self._completing is None or self._completing in signalled:
                found = self._take_triggering(in_use)
                complete |= found
                goes_on = found and in_use  # with the loads that have come since then
        self._finish(now, complete)

    def check(self, now: float) -> None:
        """Take all messages without an event if the next sample is overdue or partly received."""
        if not 0.0 < self.due < now:
            return
        before = self._completed
        self.process(now, range(len(self._streams)))
        if self._completed == before and not self._partial_since:
            self._completing, self.due = None, 0.0
            self._arm()

    def _finish(self, now: float, complete: bool) -> None:
        """End a round; ``complete``: a sample was."""
        partial = self._inputs.is_partial()
        if partial:
            self._inputs.end_waits(now)
            partial = self._inputs.is_partial()
        if partial:
            if complete or not self._partial_since:
                self._partial_since = now
            self._completing = None
            self.due = now + _CHECK if now - self._partial_since < _PARTIAL else 0.0
        elif complete:
            if self._completing is None:
                self._completing = self._newest
            self._note_interval(now)
        elif self._partial_since:
            self._partial_since = self.due = 0.0
        self._arm()

    def _arm(self) -> None:
        """Arm the streams that may complete the next sample, and those of loads and commands."""
        completing = self._completing
        for stream in self._streams:
            armed = completing is None or stream is completing or not stream.regular
            if armed != stream.armed:
                stream.armed = armed
                self._poller.arm(stream.event, armed)

    def _note_interval(self, now: float) -> None:
        """Take note of the time since the sample before."""
        for stream in self._others:
            stream.in_a_row = stream.in_a_row + 1 if stream.arrived else 0
            stream.arrived = False
        since = now - self._completed
        self._completed, self._partial_since = now, 0.0
        self.due = now + min(max(_OVERDUE * since, _LEAST), _MOST)
        self._close = self._close + 1 if since < _CLOSE else 0
        self.poll_until = now + _CLOSE if self._close >= _IN_A_ROW else 0.0

    def _take_triggering(self, one: bool) -> bool:
        """Take messages of each stream in turn; return True if a sample was complete.

        With ``one``, ends with that sample. Ends if the completing stream has no more messages
        and a sample was complete, or if no stream has any.
        """
        triggering, completing = self._triggering, self._completing
        first = None if completing is None else triggering.index(completing)
        if self._inputs.take is not None:
            complete, newest = self._inputs.take(first, self._on_error, one)
            if newest is not None:
                self._newest = triggering[newest]
            return complete
        complete, messages = False, 1
        while messages:
            messages = 0
            for stream in (*triggering[first or 0 :], *triggering[: first or 0]):
                taken, completed = self._take(stream, 1)
                messages += taken
                complete |= completed
                if taken:
                    self._newest = stream
                elif complete and stream is completing:
                    return True
                if one and complete:
                    return True
        return complete

    def _take(self, stream: _Stream, most: int = _MANY) -> tuple[int, bool]:
        """Take up to ``most`` messages; return their number and whether a sample was complete."""
        numbers, complete = stream.numbers, False
        for k in range(most):
            taken = stream.take()
            if taken is None:
                return k, complete
            stream.arrived = True
            data, info = taken
            number = info["publication_sequence_number"]
            if number == numbers.expected:
                numbers.expected = number + 1
            else:
                numbers.out_of_sequence(number)
            try:
                complete |= stream.receive(data)
            except Exception as error:
                self._on_error(error)
        return most, complete

    def close(self) -> None:
        """Close the events."""
        for stream in self._streams:
            stream.event.close()


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
        self._groups: list[Group] = []
        self._poller: EventPoller[_Key] | None = None
        self._ending = False
        self._thread: threading.Thread | None = None

    def open(self, groups: Sequence[InputGroup]) -> None:
        """Take the subscriptions over from the node's executor and start the thread."""
        self._entries = [entry for group in groups for entry in group.entries]
        for entry in self._entries:
            self._node._subscriptions.remove(entry.subscription)
        self._poller = poller = EventPoller[_Key]()
        self._groups = [Group(one, self._on_error, poller, k) for k, one in enumerate(groups)]
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
        if self._poller is not None:
            self._poller.close()
            self._poller = None
        self._groups = []
        self._node._subscriptions.extend(entry.subscription for entry in self._entries)
        self._entries = []

    def _run(self) -> None:
        assert self._poller is not None
        groups, poller = self._groups, self._poller
        checked, patience, due = 0.0, _IDLE, 0.0
        now = time.monotonic()
        while not self._ending:
            # With several groups events are frequent anyway: no polling.
            poll_until = groups[0].poll_until if len(groups) == 1 else 0.0
            ready = poller.wait(max(0.0, min(patience, due - now)), poll_until)
            now = time.monotonic()
            if ready:
                self.process(now, ready)
                patience = _CHECK
            if now - checked >= _CHECK:
                checked, patience = now, _IDLE
                for group in groups:
                    with self._lock:
                        group.check(now)
                    if group.due > 0.0:
                        patience = _CHECK
            if now >= due:
                due = self._next_check(now)

    def process(self, now: float, ready: Sequence[_Key]) -> None:
        """Process the groups of the events reported, at the time ``now`` (s, steady clock)."""
        by_group: dict[int, list[int]] = {}
        for group, stream in ready:
            by_group.setdefault(group, []).append(stream)
        for number, streams in by_group.items():
            with self._lock:
                self._groups[number].process(now, streams)

    def _next_check(self, now: float) -> float:
        try:
            return self._check(now)
        except Exception as error:
            self._on_error(error)
            return now + _IDLE
