"""The feed-forward effort on its topic: the drive of the guide, refusals, timeout; processes."""

import math
import sys

import pytest
from paths import ROOT
from ros_processes import Listener, Source, module, parameters, program, stamp_of
from sensor_msgs.msg import JointState

GUIDE = ROOT / "docs" / "how_to"
FRICTION = (
    "feed_forward.enabled:=true", "friction.coefficient:=0.5", "friction.radius:=0.02",
    "friction.preload:=10.0", "latency:=0", "gravity:=[0.0, 0.0, 0.0]",
)  # fmt: skip


def test_a_drive_follows_its_reference_over_topics(tmp_path):
    """Without it: at least the friction over the gain, 0.3 * 19.6 N / 800 N/m = 7.4 mm."""
    scene = ["--ros-args", "--params-file", str(GUIDE / "feed_forward_drive.yaml")]
    with program([*module("connector.node"), *scene], tmp_path) as connector:
        with program([sys.executable, GUIDE / "feed_forward_drive.py"], tmp_path) as drive:
            assert drive.wait() == 0
            drive.wait_for("greatest error with feed-forward")
            lines = list(drive.lines)
        assert connector.stop() == 0
    errors = [float(line.split()[-2]) for line in lines if line.startswith("greatest error")]
    assert errors[0] > 7.4
    assert errors[1] < 0.1 * errors[0]


def test_it_is_towards_the_reference_while_the_joint_sticks(tmp_path, peer):
    """At rest without load: the given share of 0.5 * 10 N, signed; 0 for no or a bad reference."""
    efforts = peer.collect(JointState, "/connector/feed_forward")
    send = peer.node.create_publisher(JointState, "/connector/reference", 10)
    rules = parameters(*FRICTION, "feed_forward.share:=0.8", "timeout:=2.0")
    with program([*module("connector.node"), *rules], tmp_path):
        source, listener = Source(peer), Listener(peer)
        peer.spin_until(lambda: send.get_subscription_count(), "the subscription")
        stamp = 0
        for velocity, effort in ((0.0, 0.0), (0.1, 4.0), (-2.0, -4.0), (math.inf, 0.0)):
            send.publish(JointState(name=["slide", "elbow"], velocity=[velocity, 1.0]))

            def arrives(effort=effort):
                nonlocal stamp
                stamp += 1_000_000
                listener.exchange(source, stamp)
                peer.spin_until(lambda: efforts[-1:] and stamp_of(efforts[-1]) == stamp)
                return efforts[-1].effort[0] == pytest.approx(effort)

            peer.spin_until(arrives, f"{effort} N")
            assert list(efforts[-1].name) == ["slide", "spin"]
        send.publish(JointState(name=["slide"], velocity=[0.1]))
        peer.spin_until(lambda: math.isnan(efforts[-1].position[0]), "the input timeout")
        assert list(efforts[-1].effort) == [0.0, 0.0]
