"""The effort that a controller adds so that friction does not act: published for each sample."""

from __future__ import annotations

import math

import numpy as np
from rclpy.lifecycle import LifecycleNode
from sensor_msgs.msg import JointState

from cylconn_ros.connector.feed_forward import feed_forward
from cylconn_ros.core import layout
from cylconn_ros.messages import topic_names
from cylconn_ros.messages.cdr_encoder import JointStateWriter
from cylconn_ros.messages.commands import joint_command
from cylconn_ros.ros import qos
from cylconn_ros.scene.scene import Scene

REFERENCE = "~/reference"
TOPIC = "~/feed_forward"
_ZERO = (0.0, 0.0)


class FeedForward:
    """Publisher of ``~/feed_forward`` and subscription of ``~/reference``, both JointState.

    The reference is the velocity that the controller wants next, by name of slide and spin; it
    holds until the next one. Position and velocity of the output are those of ``~/joint_state``.
    """

    def __init__(self, node: LifecycleNode, connector: str, scene: Scene) -> None:
        """``connector``: prefix of the topics."""
        self._node, self._names = node, joint_command.names(scene)
        self._writer = JointStateWriter(scene.body_a.frame, self._names)
        self._wanted = dict.fromkeys(self._names, 0.0)
        self._publisher = node.create_lifecycle_publisher(
            JointState, topic_names.topic(connector, TOPIC), qos.samples()
        )
        self._subscription = node.create_subscription(
            JointState, topic_names.topic(connector, REFERENCE), self._take, qos.samples()
        )

    def _take(self, message: JointState) -> None:
        """Take the velocities of slide and spin; a value that is not finite is zero."""
        for name, velocity in zip(message.name, message.velocity, strict=False):
            if name in self._wanted:
                self._wanted[name] = velocity if math.isfinite(velocity) else 0.0

    def publish(self, stamp: int, out: np.ndarray, scene: Scene) -> None:
        """Publish the effort after a sample with the outputs ``out``; ``stamp`` in ns."""
        effort = _ZERO
        if scene.friction.on and out[layout.STATUS] == layout.OK:
            slide, spin = self._names
            effort = feed_forward(
                int(out[layout.REGIME]),
                (float(out[layout.FORCE_FRICTION]), float(out[layout.MOMENT_FRICTION])),
                float(out[layout.FRICTION_LIMIT]),
                scene.friction.radius,
                (self._wanted[slide], self._wanted[spin]),
                scene.feed_forward.share,
            )
        position = float(out[layout.LENGTH]), float(out[layout.ANGLE])
        velocity = float(out[layout.VELOCITY]), float(out[layout.ANGULAR_VELOCITY])
        self._publisher.publish(self._writer.write(stamp, position, velocity, effort))

    def publish_zero(self, stamp: int) -> None:
        """Publish no effort, and no motion, as there is no sample."""
        nothing = (math.nan, math.nan)
        self._publisher.publish(self._writer.write(stamp, nothing, nothing, _ZERO))

    def close(self) -> None:
        """Destroy publisher and subscription."""
        self._node.destroy_lifecycle_publisher(self._publisher)
        self._node.destroy_subscription(self._subscription)
