"""Samples sent and answers taken in compiled code, so that who asks does not hide what it costs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cylconn_ros.core.jit import call, kernel
from cylconn_ros.messages.cdr_encoder import StampedWriter
from cylconn_ros.messages.templates import STAMP, Laid
from cylconn_ros.ros.executor import rcl

PERIOD = 1_000_000  # ns between stamps, whatever the rate is
_SPEED = 1e-4  # m a sample: the sleeves slide steadily


@kernel
def _send(
    stamp: int, addresses: Any, clock: Any, words: Any, places: Any, publishers: Any, outbox: Any
) -> int:
    """Publish messages with a stamp in ns; when the last one went, ns on the steady clock.

    ``words``: their memory. ``places``: of their stamps in it. The rest as in ``rcl``.
    """
    last, went = len(publishers) - 1, 0
    for k in range(last + 1):
        words[places[k]] = stamp // 1_000_000_000
        words[places[k] + 1] = stamp % 1_000_000_000
        if k == last:
            call(addresses[rcl.CLOCK], 1, addresses[rcl.NUMBERS], 0, 0)
            went = clock[0] * 1_000_000_000 + clock[1]
        call(addresses[rcl.PUBLISH], publishers[k], outbox[k], 0, 0)
    return went


@kernel
def _take(
    addresses: Any, scratch: Any, subscriptions: Any, boxes: Any, inbox: Any, found: Any
) -> int:
    """Take what has come; how many messages, their stamps in ``found``.

    ``scratch``: what stands at NUMBERS, in words of four bytes.
    """
    count = 0
    for k in range(len(subscriptions)):
        while count < len(found):
            if call(addresses[rcl.TAKE], subscriptions[k], inbox[k], addresses[rcl.INFO], 0) != 0:
                break
            at = boxes[rcl.MESSAGE * k + rcl.BYTES] + STAMP
            call(addresses[rcl.COPY], addresses[rcl.NUMBERS], at, 8, 0)
            found[count] = scratch[0] * 1_000_000_000 + scratch[1]
            count += 1
    return count


class Motion(NamedTuple):
    """A body's pose or twist, and whether it is the one that slides."""

    publisher: Any  # of rclpy
    is_pose: bool
    slides: bool


class Exchange:
    """Who is sent samples, and whose answers come back."""

    def __init__(self, motions: Sequence[Motion], answers: Sequence[Any], most: int) -> None:
        """``answers``: subscriptions of rclpy, raw. ``most``: messages that are taken at once."""
        memory, laid = rcl.Memory(), Laid([_blank(motion) for motion in motions])
        self._numbers = laid.numbers
        place = next(k for k, one in enumerate(motions) if one.is_pose and one.slides)
        self._x = (laid.begins[place] + laid.sizes[place]) // 8 - 7
        outbox = rcl.Outbox(laid.addresses, laid.sizes.tolist())
        inbox = rcl.Inbox(len(answers))
        self._keep = memory, inbox, outbox
        self._sending = (
            memory.addresses, memory.numbers, laid.words, laid.stamps,
            np.array([motion.publisher.handle.pointer for motion in motions]), outbox.addresses,
        )  # fmt: skip
        self._found = np.zeros(most, np.int64)
        self._taking = (
            memory.addresses, memory.numbers.view(np.int32),
            np.array([one.handle.pointer for one in answers]),
            inbox.memory, inbox.addresses, self._found,
        )  # fmt: skip
        self._sent = 0
        self.take()  # compiled now

    def send(self) -> tuple[int, int]:
        """Send the next sample; its stamp, and when the message that completed it went (ns)."""
        self._sent += 1
        self._numbers[self._x] += _SPEED
        stamp = self._sent * PERIOD
        return stamp, _send(stamp, *self._sending)

    def take(self) -> list[int]:
        """The stamps of the messages that have come."""
        return self._found[: _take(*self._taking)].tolist()


def _blank(motion: Motion) -> bytes:
    """A message, the last one's numbers to be changed."""
    values = np.zeros(7 if motion.is_pose else 6)
    if motion.is_pose:
        values[6] = 1.0
    elif motion.slides:
        values[0] = _SPEED / (PERIOD * 1e-9)
    return StampedWriter("world", len(values)).write(0, values)
