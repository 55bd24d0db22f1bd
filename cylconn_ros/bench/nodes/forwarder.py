"""The least a node of this kind does, on the same loop as ours: take four, publish three.

``python -m cylconn_ros.bench.nodes.forwarder --ros-args -r __ns:=/bare``. Compiled as ours is, but
nothing is looked at beyond the bytes of the stamp and nothing is computed; what is published has
the size of a real answer.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import rclpy

from cylconn_ros.bench.nodes.topics import INPUTS, OUTPUTS
from cylconn_ros.core import layout
from cylconn_ros.core.jit import call, kernel
from cylconn_ros.messages import pipeline as messages
from cylconn_ros.messages.cdr_encoder import StampedWriter, StateWriter
from cylconn_ros.messages.templates import STAMP, Laid
from cylconn_ros.ros import qos, run_node
from cylconn_ros.ros.executor import rcl
from cylconn_ros.ros.executor.executor import Entry, Inputs, Loop
from cylconn_ros.ros.message_types import message_class

_STAMP_SIZE: Final = 8


@kernel
def _forward(
    taken: Any, addresses: Any, subscriptions: Any, boxes: Any, inbox: Any, publishers: Any,
    bodies: Any, outbox: Any,
) -> int:  # fmt: skip
    """Take a message of each, publish one on each; the samples that were answered.

    ``taken``: (1,) how many of them have been taken for the sample under way.
    """
    count, last, answered = len(subscriptions), len(subscriptions) - 1, 0
    while count:
        for k in range(taken[0], count):
            if call(addresses[rcl.TAKE], subscriptions[k], inbox[k], addresses[rcl.INFO], 0) != 0:
                return answered
            taken[0] = k + 1
        taken[0] = 0
        stamp = boxes[rcl.MESSAGE * last + rcl.BYTES] + STAMP
        for k in range(len(publishers)):
            call(addresses[rcl.COPY], bodies[k] + STAMP, stamp, _STAMP_SIZE, 0)
            call(addresses[rcl.PUBLISH], publishers[k], outbox[k], 0, 0)
        answered += 1
    return answered


class _Forwarder:
    """Hold what :func:`_forward` works on."""

    def __init__(self, subscriptions: list[Any], publishers: list[Any]) -> None:
        blank = {
            messages.WRENCH: StampedWriter("body_b").write(0, np.zeros(6)),
            messages.STATE: StateWriter("body_a", "impulse").write(0, np.zeros(layout.NOUT)),
        }
        self._memory, self._inbox = rcl.Memory(), rcl.Inbox(len(subscriptions))
        self._laid = Laid([blank[kind] for kind in OUTPUTS.values()])
        self._outbox = rcl.Outbox(self._laid.addresses, self._laid.sizes.tolist())
        addresses = [one.handle.pointer for one in subscriptions]
        whole = np.int64
        self._arguments = (
            np.zeros(1, whole),
            self._memory.addresses,
            np.array(addresses),
            self._inbox.memory,
            self._inbox.addresses,
            np.array([one.handle.pointer for one in publishers]),
            np.array(self._laid.addresses),
            self._outbox.addresses,
        )
        taken, first, _, *rest = self._arguments
        _forward(taken, first, np.zeros(0, whole), *rest)  # compiled now

    def take(self, _caught: Callable[[Exception], object]) -> int | None:
        """Forward all that has come."""
        return len(INPUTS) - 1 if _forward(*self._arguments) else None


def main() -> int:
    """Forward until interrupted."""
    rclpy.init()
    node = rclpy.create_node("connector")
    publishers = [
        node.create_publisher(message_class(kind), name, qos.samples())
        for name, kind in OUTPUTS.items()
    ]
    subscriptions = [
        node.create_subscription(message_class(kind), name, lambda _: None, qos.samples(), raw=True)
        for name, kind in INPUTS.items()
    ]
    entries = [Entry(one, lambda _: False) for one in subscriptions]
    forwarder = _Forwarder(subscriptions, publishers)
    loop = Loop(node, threading.Lock(), lambda error: print(error, file=sys.stderr, flush=True))
    loop.open([Inputs(entries, forwarder.take)])
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        loop.close()
        rclpy.try_shutdown()
    return run_node.OK


if __name__ == "__main__":
    sys.exit(main())
