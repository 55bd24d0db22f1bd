"""The simulator of the tutorial: free running, in a real process, between stops with friction."""

import sys

from cylconn_ros.msg import ConnectorState
from paths import ROOT
from ros_processes import Peer, module, program

TUTORIAL = ROOT / "docs" / "tutorial"
TOPICS = {"body_b/pose": "pose", "body_b/twist": "twist", "body_b/wrench": "external_wrench"}


def test_the_drawer_of_the_tutorial_stays_on_its_rail_and_between_its_stops(tmp_path):
    remap = [part for name, to in TOPICS.items() for part in ("-r", f"{name}:=/drawer/{to}")]
    scene = ["--ros-args", "--params-file", str(TUTORIAL / "drawer.yaml"), *remap]
    peer = Peer()
    states = peer.collect(ConnectorState, "/connector/state")
    try:
        with (
            program([*module("connector.node"), *scene], tmp_path) as connector,
            program([sys.executable, TUTORIAL / "drawer_simulator.py"], tmp_path),
        ):
            peer.spin_until(lambda: any(s.length > 0.39 for s in states), "the upper stop")
            peer.spin_until(lambda: states[-1].length < 0.1, "the way back")
            assert connector.stop() == 0
    finally:
        peer.close()
    assert all(-0.1 < s.length < 0.5 for s in states)  # a stall lets it pass a stop
    assert max(s.offset_violation for s in states) < 5e-3
    assert max(s.angular_violation for s in states) < 5e-2
