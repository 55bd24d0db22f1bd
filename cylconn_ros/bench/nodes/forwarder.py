"""Baseline of the node benchmark: a node that forwards bytes on the connector's executor.

``python -m cylconn_ros.bench.nodes.forwarder --ros-args -r __ns:=/forwarder`` takes four messages
and publishes three for each sample. It is compiled like the connector node, but reads only the
bytes of the stamp and computes nothing. Its outputs have the size of the connector's.
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
from cylconn_ros.messages import pipeline
from cylconn_ros.messages.cdr_encoder import StampedWriter, StateWriter
from cylconn_ros.messages.templates import STAMP, TemplateBuffer
from cylconn_ros.ros import qos, run_node
from cylconn_ros.ros.executor import rcl
from cylconn_ros.ros.executor.executor import InputGroup, InputSubscription, SampleExecutor
from cylconn_ros.ros.message_types import message_class
from cylconn_ros.scene.inputs import WRENCH

_STAMP_SIZE: Final = 8


@kernel
def _forward(
    taken: Any, addresses: Any, subscriptions: Any, memory: Any, receive: Any, publishers: Any,
    bodies: Any, send: Any,
) -> int:  # fmt: skip
    """Take a message of each subscription, publish one on each publisher; return the samples.

    ``taken``: (1,) number of messages taken for the sample in progress. ``memory``, ``receive``:
    the receive buffers. ``bodies``, ``send``: addresses of the outputs and their send buffers.
    """
    count, last, forwarded = len(subscriptions), len(subscriptions) - 1, 0
    while count:
        for k in range(taken[0], count):
            if call(addresses[rcl.TAKE], subscriptions[k], receive[k], addresses[rcl.INFO], 0) != 0:
                return forwarded
            taken[0] = k + 1
        taken[0] = 0
        stamp = memory[rcl.MESSAGE * last + rcl.BYTES] + STAMP
        for k in range(len(publishers)):
            call(addresses[rcl.COPY], bodies[k] + STAMP, stamp, _STAMP_SIZE, 0)
            call(addresses[rcl.PUBLISH], publishers[k], send[k], 0, 0)
        forwarded += 1
    return forwarded


class _Forwarder:
    """Own the memory and the arguments of :func:`_forward`."""

    def __init__(self, subscriptions: list[Any], publishers: list[Any]) -> None:
        templates = {
            WRENCH: StampedWriter("body_b").write(0, np.zeros(6)),
            pipeline.STATE: StateWriter("body_a", "impulse").write(0, np.zeros(layout.NOUT)),
        }
        self._table, self._receive = rcl.CallTable(), rcl.ReceiveBuffers(len(subscriptions))
        self._laid = TemplateBuffer([templates[kind] for kind in OUTPUTS.values()])
        self._send = rcl.SendBuffers(self._laid.addresses, self._laid.sizes.tolist())
        self._arguments = (
            np.zeros(1, np.int64),
            self._table.addresses,
            np.array([one.handle.pointer for one in subscriptions]),
            self._receive.memory,
            self._receive.addresses,
            np.array([one.handle.pointer for one in publishers]),
            np.array(self._laid.addresses),
            self._send.addresses,
        )
        taken, table, _, *rest = self._arguments
        _forward(taken, table, np.zeros(0, np.int64), *rest)  # compiles

    def take(
        self, _first: int | None, _on_error: Callable[[Exception], object], _one: bool = False
    ) -> tuple[bool, int | None]:
        """Forward all queued messages, as ``FusedPath.take`` processes them."""
        return _forward(*self._arguments) > 0, len(INPUTS) - 1

    def is_partial(self) -> bool:
        """Whether messages of a sample that is not forwarded are taken."""
        return bool(self._arguments[0][0])


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
    entries = [InputSubscription(one, lambda _: False) for one in subscriptions]
    forwarder = _Forwarder(subscriptions, publishers)
    executor = SampleExecutor(
        node, threading.Lock(), lambda error: print(error, file=sys.stderr, flush=True)
    )
    executor.open([InputGroup(entries, forwarder.take, forwarder.is_partial)])
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        executor.close()
        rclpy.try_shutdown()
    return run_node.OK


if __name__ == "__main__":
    sys.exit(main())
