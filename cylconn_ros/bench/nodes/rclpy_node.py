"""Baseline of the node benchmark: the node as usually written with rclpy.

``python -m cylconn_ros.bench.nodes.rclpy_node SCENE --ros-args -r __ns:=/rclpy`` uses message
objects, callbacks and ``rclpy.spin``, as tutorials do. Its physics is the connector's compiled
step. It has no statistics and checks nothing.
"""

from __future__ import annotations

import contextlib
import functools
import sys
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.msg import ConnectorState
from cylconn_ros.ros import qos, run_node
from cylconn_ros.scene.scene import load


class RclpyNode(Node):
    """Process the samples of two moving bodies."""

    def __init__(self, scene_file: str) -> None:
        super().__init__("connector")
        self.scene = load(scene_file)
        self.connector = Connector(self.scene)
        self.sample = np.zeros(layout.NSAMPLE)
        self.incomplete: dict[tuple[int, int], dict[str, Any]] = {}
        self.connector.step(self.sample)  # compiles
        self.connector.reset()
        for body in ("body_a", "body_b"):
            for name, kind in (("pose", PoseStamped), ("twist", TwistStamped)):
                topic = f"{body}/{name}"
                callback = functools.partial(self.receive, topic)
                self.create_subscription(kind, topic, callback, qos.samples())
        self.wrench_a = self.create_publisher(WrenchStamped, "body_a/wrench", qos.samples())
        self.wrench_b = self.create_publisher(WrenchStamped, "body_b/wrench", qos.samples())
        self.state = self.create_publisher(ConnectorState, "~/state", qos.samples())

    def receive(self, topic: str, message: Any) -> None:
        """Store a message; process the sample when its four messages have arrived."""
        stamp = (message.header.stamp.sec, message.header.stamp.nanosec)
        messages = self.incomplete.setdefault(stamp, {})
        messages[topic] = message
        if len(messages) == 4:
            del self.incomplete[stamp]
            self.process(messages)

    def process(self, messages: dict[str, Any]) -> None:
        """Compute the wrenches and the state and publish them."""
        header = messages["body_a/pose"].header
        for at, body in ((0, "body_a"), (13, "body_b")):
            pose, twist = messages[f"{body}/pose"].pose, messages[f"{body}/twist"].twist
            p, q, v, w = pose.position, pose.orientation, twist.linear, twist.angular
            self.sample[at : at + 13] = (
                p.x, p.y, p.z, q.x, q.y, q.z, q.w, v.x, v.y, v.z, w.x, w.y, w.z,
            )  # fmt: skip
        out = self.connector.step(self.sample)
        for publisher, frame, at in (
            (self.wrench_a, "body_a", layout.FORCE_A),
            (self.wrench_b, "body_b", layout.FORCE_B),
        ):
            wrench = WrenchStamped()
            wrench.header.stamp, wrench.header.frame_id = header.stamp, frame
            force, torque = wrench.wrench.force, wrench.wrench.torque
            force.x, force.y, force.z, torque.x, torque.y, torque.z = out[at : at + 6].tolist()
            publisher.publish(wrench)
        state = ConnectorState(method=self.connector.method)
        state.header.stamp, state.header.frame_id = header.stamp, "body_a"
        at = layout.STATE0
        for name, width in layout.STATE_FIELDS:
            setattr(state, name, float(out[at]) if width == 1 else out[at : at + width])
            at += width
        state.regime, state.stop, state.lock, state.status, state.flags = map(
            int, out[layout.REGIME : layout.NOUT]
        )
        self.state.publish(state)


def main() -> int:
    """Run until interrupted."""
    scene = sys.argv[1]
    rclpy.init()
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(RclpyNode(scene))
    rclpy.try_shutdown()
    return run_node.OK


if __name__ == "__main__":
    sys.exit(main())
