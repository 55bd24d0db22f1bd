"""Text about a frame_id that is no frame of the scene: the topic, the frame, the expected ones."""

from __future__ import annotations

from cylconn_ros.connector.synchronized_sample import UnknownFrame
from cylconn_ros.scene.inputs import BODIES, carrier
from cylconn_ros.scene.scene import Scene


def text_of(scene: Scene, seen: UnknownFrame) -> str:
    """Return topic, frame and expected frames, and how the message was treated."""
    odometry = scene.input == "odometry" and seen.quantity != "load"
    expected = [scene.world_frame]
    if seen.quantity != "pose":
        expected.append(scene.bodies[seen.body].frame)
    field = "child_frame_id" if odometry and seen.quantity == "twist" else "frame_id"
    kind = seen.quantity if seen.quantity == "load" else carrier(scene.input, seen.quantity).topic
    return (
        f"{BODIES[seen.body]}/{kind}: unknown {field} {seen.frame!r}, expected "
        f"{' or '.join(repr(frame) for frame in expected)}; treated as {seen.axes} axes"
    )
