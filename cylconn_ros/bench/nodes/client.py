"""Compiled client of a node: publishes samples and takes the outputs through rcl.

Compiled, so that the client's own cost does not hide that of the node.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile

from cylconn_ros.core.jit import call, kernel
from cylconn_ros.errors import ProcessError
from cylconn_ros.messages.cdr_encoder import StampedWriter
from cylconn_ros.messages.templates import STAMP, TemplateBuffer
from cylconn_ros.ros.executor import rcl
from cylconn_ros.ros.executor.new_message_event import MessageEvent
from cylconn_ros.ros.message_types import message_class
from cylconn_ros.scene.inputs import POSE

PERIOD = 1_000_000  # ns between stamps, at every rate
QUEUE = QoSProfile(depth=2000)  # reliable and long: the client itself loses no message
_SPEED = 1e-4  # m per sample: body B slides steadily
_DISCOVERY = 300.0  # s until a node must have appeared; its first start compiles the physics
_MUTUAL_DISCOVERY = 1.0  # s until the node has discovered the client, too


@kernel
def _send(
    stamp: int, addresses: Any, clock: Any, words: Any, stamps: Any, publishers: Any, buffers: Any
) -> int:
    """Publish messages with a stamp in ns; return the time before the last one, ns, steady clock.

    ``words``: memory of the messages. ``stamps``: indices of their stamps in it. ``addresses`` and
    ``buffers``: see :mod:`cylconn_ros.ros.executor.rcl`.
    """
    last, sent = len(publishers) - 1, 0
    for k in range(last + 1):
        words[stamps[k]] = stamp // 1_000_000_000
        words[stamps[k] + 1] = stamp % 1_000_000_000
        if k == last:
            call(addresses[rcl.CLOCK], 1, addresses[rcl.NUMBERS], 0, 0)
            sent = clock[0] * 1_000_000_000 + clock[1]
        call(addresses[rcl.PUBLISH], publishers[k], buffers[k], 0, 0)
    return sent


@kernel
def _take(
    addresses: Any, scratch: Any, subscriptions: Any, memory: Any, buffers: Any, found: Any
) -> int:
    """Take all queued messages; write their stamps into ``found`` and return their number.

    ``scratch``: the memory at NUMBERS as int32. ``memory``, ``buffers``: the receive buffers.
    """
    count = 0
    for k in range(len(subscriptions)):
        while count < len(found):
            if call(addresses[rcl.TAKE], subscriptions[k], buffers[k], addresses[rcl.INFO], 0) != 0:
                break
            at = memory[rcl.MESSAGE * k + rcl.BYTES] + STAMP
            call(addresses[rcl.COPY], addresses[rcl.NUMBERS], at, 8, 0)
            found[count] = scratch[0] * 1_000_000_000 + scratch[1]
            count += 1
    return count


class Client:
    """The topics of one node, seen from the simulator.

    Attributes
    ----------
        event: set when a message arrives on the last of the outputs.
    """

    def __init__(
        self, node: Node, prefix: str, inputs: Mapping[str, str], outputs: Mapping[str, str]
    ) -> None:
        """``inputs``, ``outputs``: topics below ``prefix`` and their types; body B slides."""
        publishers = {
            topic: node.create_publisher(message_class(kind), f"{prefix}/{topic}", QUEUE)
            for topic, kind in inputs.items()
        }
        self._publishers = list(publishers.values())
        self._subscriptions = [
            node.create_subscription(
                message_class(kind), f"{prefix}/{topic}", lambda _: None, QUEUE, raw=True
            )
            for topic, kind in outputs.items()
        ]
        table = rcl.CallTable()
        laid = TemplateBuffer([_template(topic, kind) for topic, kind in inputs.items()])
        self._numbers = laid.numbers
        pose = next(k for k, (topic, kind) in enumerate(inputs.items())
                    if kind == POSE and topic.startswith("body_b"))  # fmt: skip
        self._x = (laid.begins[pose] + laid.sizes[pose]) // 8 - 7
        send_buffers = rcl.SendBuffers(laid.addresses, laid.sizes.tolist())
        receive_buffers = rcl.ReceiveBuffers(len(outputs))
        self._keep_alive = table, laid, send_buffers, receive_buffers
        self._sending = (
            table.addresses, table.numbers, laid.words, laid.stamps,
            np.array([one.handle.pointer for one in self._publishers]), send_buffers.addresses,
        )  # fmt: skip
        self._found = np.zeros(QUEUE.depth, np.int64)
        self._taking = (
            table.addresses, table.numbers.view(np.int32),
            np.array([one.handle.pointer for one in self._subscriptions]),
            receive_buffers.memory, receive_buffers.addresses, self._found,
        )  # fmt: skip
        self._sent = 0
        self.event = MessageEvent(self._subscriptions[-1])
        self.take()  # compiles

    def connected(self) -> bool:
        """Whether every topic has its counterpart in the node."""
        return all(one.get_subscription_count() for one in self._publishers) and all(
            one.get_publisher_count() for one in self._subscriptions
        )

    def send(self) -> tuple[int, int]:
        """Publish the next sample; return its stamp and the time of its last message, ns each."""
        self._sent += 1
        self._numbers[self._x] += _SPEED
        stamp = self._sent * PERIOD
        return stamp, _send(stamp, *self._sending)

    def take(self) -> list[int]:
        """Take all queued outputs and return their stamps, ns."""
        return self._found[: _take(*self._taking)].tolist()


def connect(clients: Sequence[Client], name: str) -> None:
    """Wait until all clients are connected. Raises ProcessError after 300 s."""
    end = time.monotonic() + _DISCOVERY
    while not all(client.connected() for client in clients):
        if time.monotonic() > end:
            raise ProcessError(f"{name} did not appear within {_DISCOVERY:g} s")
        time.sleep(0.05)
    time.sleep(_MUTUAL_DISCOVERY)


def _template(topic: str, kind: str) -> bytes:
    """The serialized message of a topic; sending changes its stamp, and the x of body B's pose."""
    values = np.zeros(7 if kind == POSE else 6)
    if kind == POSE:
        values[6] = 1.0
    elif topic.startswith("body_b"):
        values[0] = _SPEED / (PERIOD * 1e-9)
    return StampedWriter("world", len(values)).write(0, values)
