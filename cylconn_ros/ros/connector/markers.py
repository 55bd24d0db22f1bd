"""For RViz and Foxglove: markers of shaft, sleeve and force; transforms of the bodies' frames.

The ROS package tf2_msgs is imported only if a connector broadcasts transforms (``tf: true``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point, Pose, Quaternion, Transform, TransformStamped, Vector3
from rclpy.qos import QoSProfile
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from cylconn_ros.connector.frames import into_world
from cylconn_ros.core import layout
from cylconn_ros.ros.message_types import message_class
from cylconn_ros.scene.scene import Scene

RATE = 30.0  # 1/s, greatest rate of markers and transforms
TF_TYPE = "tf2_msgs/msg/TFMessage"
TF_TOPIC = "/tf"
TF_PROFILE = QoSProfile(depth=100)  # as tf2_ros: reliable, volatile
_POSES = (layout.A_POSE, layout.B_POSE)
_COLOURS = {  # distinguishable for colour-blind users
    layout.FRICTIONLESS: (0.6, 0.6, 0.6),
    layout.STICK: (0.0, 0.45, 0.7),
    layout.SLIP: (0.9, 0.6, 0.0),
}
_ARROW = 0.2  # m, length of the arrow at the largest force so far


class Markers:
    """Draw samples and connector forces in the world frame."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        radius = scene.friction.radius
        self._radius = radius if math.isfinite(radius) else 0.02
        stops = scene.stops
        low = stops.l_min if math.isfinite(stops.l_min) else -0.5
        high = stops.l_max if math.isfinite(stops.l_max) else 0.5
        self._slot = (low, high)
        self._largest = 1e-9

    def draw(self, stamp: int, sample: np.ndarray, out: np.ndarray) -> MarkerArray:
        """Draw a sample (38,) and its output (NOUT,), see core/layout.py; ``stamp`` in ns."""
        pose = sample[layout.A_POSE : layout.A_POSE + 7].tolist()
        node = self._scene.node_a
        offset = into_world(pose, (*node.position, 0.0, 0.0, 0.0))[:3]
        start = np.array(pose[:3]) + np.array(offset)
        orientation = _product(pose[3:], node.orientation)
        axes = [np.array(_turn(orientation, unit)) for unit in np.eye(3)]
        y, z = out[layout.OFFSET : layout.OFFSET + 2]
        length = float(out[layout.LENGTH])
        low, high = (min(self._slot[0], length), max(self._slot[1], length))
        node_b = start + length * axes[0] + y * axes[1] + z * axes[2]
        sleeve = node_b + float(out[layout.CONTACT_CENTRE]) * axes[0]
        overlap = float(out[layout.OVERLAP]) or 4.0 * self._radius
        force = sum(f * e for f, e in zip(out[layout.FORCE : layout.FORCE + 3], axes, strict=True))
        self._largest = max(self._largest, float(np.linalg.norm(force)))
        tip = node_b + _ARROW / self._largest * force

        markers = [
            self._cylinder(0, start + 0.5 * (low + high) * axes[0], orientation, high - low, 1.0),
            self._cylinder(1, sleeve, orientation, overlap, 1.6),
            self._arrow(2, node_b, tip, int(out[layout.REGIME])),
            self._stripe(3, sleeve, axes, orientation, float(out[layout.ANGLE]), overlap),
        ]
        seconds, nanoseconds = divmod(stamp, 1_000_000_000)
        for marker in markers:
            marker.header.frame_id = self._scene.world_frame
            marker.header.stamp = Time(sec=seconds, nanosec=nanoseconds)
            marker.ns = "cylindrical_connector"
            marker.lifetime = Duration(sec=1)
        return MarkerArray(markers=markers)

    def _cylinder(
        self, number: int, centre: np.ndarray, orientation: list[float], length: float, width: float
    ) -> Marker:
        """A cylinder along the slot axis; the marker's own axis is z."""
        marker = Marker(id=number, type=Marker.CYLINDER)
        half = math.sqrt(0.5)
        _set_pose(marker.pose, centre, _product(orientation, (0.0, half, 0.0, half)))
        marker.scale.x = marker.scale.y = 2.0 * self._radius * width
        marker.scale.z = length
        grey = 0.5 if number == 0 else 0.8
        marker.color = ColorRGBA(r=grey, g=grey, b=grey, a=1.0 if number == 0 else 0.5)
        return marker

    def _stripe(
        self,
        number: int,
        sleeve: np.ndarray,
        axes: list[np.ndarray],
        orientation: list[float],
        angle: float,
        overlap: float,
    ) -> Marker:
        """A bar on the sleeve's surface that shows its rotation."""
        marker = Marker(id=number, type=Marker.CUBE)
        outside = math.cos(angle) * axes[1] + math.sin(angle) * axes[2]
        turned = _product(orientation, (math.sin(angle / 2), 0.0, 0.0, math.cos(angle / 2)))
        _set_pose(marker.pose, sleeve + 1.6 * self._radius * outside, turned)
        marker.scale.x = overlap
        marker.scale.y, marker.scale.z = 0.2 * self._radius, 0.3 * self._radius
        marker.color = ColorRGBA(r=0.2, g=0.2, b=0.2, a=1.0)
        return marker

    def _arrow(self, number: int, start: np.ndarray, tip: np.ndarray, regime: int) -> Marker:
        marker = Marker(id=number, type=Marker.ARROW)
        marker.points = [Point(x=p[0], y=p[1], z=p[2]) for p in (start.tolist(), tip.tolist())]
        marker.scale.x, marker.scale.y = 0.4 * self._radius, 0.8 * self._radius
        red, green, blue = _COLOURS[regime]
        marker.color = ColorRGBA(r=red, g=green, b=blue, a=1.0)
        return marker


class Transforms:
    """Transforms from the world frame to body frames."""

    def __init__(self, world: str, frames: Mapping[int, str]) -> None:
        """``frames``: name of the frame by body, 0 or 1."""
        self._world, self._frames = world, dict(frames)
        self._message = message_class(TF_TYPE)

    def message(self, stamp: int, sample: np.ndarray) -> Any:
        """TFMessage of a sample (38,), see core/layout.py; ``stamp`` in ns.

        Poses that are no rotation and translation are left out: tf2 would refuse them.
        """
        found = []
        for body, frame in self._frames.items():
            x, y, z, *q = sample[_POSES[body] : _POSES[body] + 7].tolist()
            norm = math.hypot(*q)
            if not (0.0 < norm < math.inf and math.isfinite(x + y + z)):
                continue
            qx, qy, qz, qw = (component / norm for component in q)
            transform = TransformStamped(child_frame_id=frame)
            transform.header.frame_id = self._world
            seconds, nanoseconds = divmod(stamp, 1_000_000_000)
            transform.header.stamp = Time(sec=seconds, nanosec=nanoseconds)
            transform.transform = Transform(
                translation=Vector3(x=x, y=y, z=z), rotation=Quaternion(x=qx, y=qy, z=qz, w=qw)
            )
            found.append(transform)
        return self._message(transforms=found)


def _set_pose(pose: Pose, position: np.ndarray, orientation: list[float]) -> None:
    point, q = pose.position, pose.orientation
    point.x, point.y, point.z = position.tolist()
    q.x, q.y, q.z, q.w = orientation


def _product(p: list[float] | tuple[float, ...], q: list[float] | tuple[float, ...]) -> list[float]:
    """Rotation q followed by p, as a unit quaternion x, y, z, w."""
    x, y, z, w = p
    a, b, c, d = q
    product = (
        w * a + x * d + y * c - z * b,
        w * b - x * c + y * d + z * a,
        w * c + x * b - y * a + z * d,
        w * d - x * a - y * b - z * c,
    )
    length = math.hypot(*product)
    return [component / length for component in product]


def _turn(orientation: list[float], vector: np.ndarray) -> tuple[float, ...]:
    return into_world([0.0] * 3 + orientation, [*vector.tolist(), 0.0, 0.0, 0.0])[:3]
