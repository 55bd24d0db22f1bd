"""Transforms of the bodies' frames: content, one broadcaster a frame, and a missing tf2_msgs."""

import importlib.util
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from ros_processes import Listener, Source, parameters

from cylconn_ros.core import layout
from cylconn_ros.errors import SceneError
from cylconn_ros.ros.connector import markers, node
from cylconn_ros.ros.connector import topics as topics_module
from cylconn_ros.scene.scene import Scene

MS = 1_000_000
INSTALLED = importlib.util.find_spec("tf2_msgs") is not None
HALF = 0.5**0.5


@dataclass
class TFMessage:
    """Stands in for tf2_msgs/msg/TFMessage, of which PyPI has no wheel."""

    transforms: list[Any] = field(default_factory=list)


class Topics:
    """What assign_frames needs of a connector."""

    transforms: Any = None


def scene(**values: Any) -> Scene:
    return Scene.from_parameters({
        "node_a.orientation": [0, 0, 0, 1], "body_b.mass": 1.0,
        "body_b.inertia": [0.01, 0, 0, 0.01, 0, 0.01], "tf": True, **values,
    })  # fmt: skip


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (markers, topics_module):
        monkeypatch.setattr(module, "message_class", lambda _: TFMessage)


@pytest.mark.usefixtures("stand_in")
def test_poses_become_transforms_and_unusable_ones_are_left_out() -> None:
    made = markers.Transforms("world", {0: "rail", 1: "drawer"})
    sample = np.zeros(layout.NSAMPLE)
    sample[layout.B_POSE : layout.B_POSE + 7] = 1.0, 2.0, 3.0, 0.0, 2 * HALF, 0.0, 2 * HALF
    (one,) = made.message(1_500_000_000, sample).transforms  # body A's quaternion is zero
    assert (one.header.frame_id, one.child_frame_id) == ("world", "drawer")
    assert (one.header.stamp.sec, one.header.stamp.nanosec) == (1, 500_000_000)
    place, turn = one.transform.translation, one.transform.rotation
    assert (place.x, place.y, place.z) == (1.0, 2.0, 3.0)
    assert (turn.x, turn.y, turn.z, turn.w) == pytest.approx((0.0, HALF, 0.0, HALF))
    sample[layout.B_POSE] = np.nan
    assert made.message(0, sample).transforms == []


@pytest.mark.usefixtures("stand_in")
def test_a_shared_body_is_broadcast_once() -> None:
    left, right, silent = Topics(), Topics(), Topics()
    shared = {"body_a.frame": "rail", "body_b.frame": "left"}
    scenes: Any = {
        left: scene(**shared),
        right: scene(**{**shared, "body_b.frame": "right"}),
        silent: scene(tf=False),
    }
    topics_module.assign_frames(scenes)
    sample = np.zeros(layout.NSAMPLE)
    sample[[layout.A_POSE + 6, layout.B_POSE + 6]] = 1.0
    names = [
        [found.child_frame_id for found in one.transforms.message(0, sample).transforms]
        for one in (left, right)
    ]
    assert names == [["rail", "left"], ["right"]]
    assert silent.transforms is None


@pytest.mark.skipif(INSTALLED, reason="tf2_msgs is installed")
def test_without_tf2_msgs_the_start_is_refused(capfd: pytest.CaptureFixture[str]) -> None:
    assert node.main([*parameters("tf:=true")]) == 2
    line = capfd.readouterr().err.splitlines()[-1]
    assert line.startswith("connector: tf = true: needs the ROS package tf2_msgs")
    with pytest.raises(SceneError, match="tf2_msgs"):
        topics_module.assign_frames({Topics(): scene()})  # type: ignore[dict-item]


@pytest.mark.skipif(not INSTALLED, reason="tf2_msgs is not installed; PyPI has no wheel of it")
def test_transforms_of_a_running_node(connector: Any, peer: Any) -> None:
    message = markers.message_class(markers.TF_TYPE)
    with connector("tf:=true"):
        listener, source = Listener(peer), Source(peer)
        heard = peer.collect(message, "/tf")
        peer.spin_until(lambda: peer.node.count_publishers("/tf"))
        for k in range(1, 4):
            listener.exchange(source, k * MS, position=(0.2, 0.0, 0.0))
        peer.spin_until(lambda: heard)
        frames = {one.child_frame_id: one.transform for one in heard[-1].transforms}
        assert set(frames) == {"body_a", "body_b"}
        assert frames["body_b"].translation.x == pytest.approx(0.2)
