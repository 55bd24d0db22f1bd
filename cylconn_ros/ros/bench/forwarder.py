"""The least a node of this kind does, on the same loop as ours: take four, publish three.

``python -m cylconn_ros.ros.bench.forwarder --ros-args -r __ns:=/bare``. Nothing is decoded beyond
the bytes of the stamp and nothing is computed; what is published has the size of a real answer.
"""

from __future__ import annotations

import sys
import threading
import time

import numpy as np
import rclpy

from cylconn_ros.core import layout
from cylconn_ros.ros import answering as messages
from cylconn_ros.ros import process, qos
from cylconn_ros.ros.bench.topics import INPUTS, OUTPUTS
from cylconn_ros.ros.cdr_writers import StampedWriter, StateWriter
from cylconn_ros.ros.loop import Entry, Loop
from cylconn_ros.ros.message_types import message_class

_STAMP = slice(4, 12)  # of a message with a header


def main() -> int:
    """Forward until interrupted."""
    rclpy.init()
    node = rclpy.create_node("connector")
    publishers = [
        node.create_publisher(message_class(kind), name, qos.samples()).handle
        for name, kind in OUTPUTS.items()
    ]
    bodies = {
        messages.WRENCH: StampedWriter("body_b").write(0, np.zeros(6)),
        messages.STATE: StateWriter("body_a", "impulse").write(0, np.zeros(layout.NOUT)),
    }
    answers = [(bodies[kind][:4], bodies[kind][12:]) for kind in OUTPUTS.values()]
    came: dict[bytes, int] = {}

    def receive(data: bytes) -> bool:
        stamp = data[_STAMP]
        count = came.pop(stamp, 0) + 1
        if count < len(INPUTS):
            came[stamp] = count
            return False
        for publisher, (head, rest) in zip(publishers, answers, strict=True):
            publisher.publish_raw(head + stamp + rest)
        return True

    entries = [
        Entry(
            node.create_subscription(
                message_class(kind), name, lambda _: None, qos.samples(), raw=True
            ),
            receive,
        )
        for name, kind in INPUTS.items()
    ]
    loop = Loop(node, threading.Lock(), lambda error: print(error, file=sys.stderr, flush=True))
    loop.open([entries])
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        loop.close()
        rclpy.try_shutdown()
    return process.OK


if __name__ == "__main__":
    sys.exit(main())
