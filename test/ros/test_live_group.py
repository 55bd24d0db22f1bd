"""Two bearings of one shaft in one process, with the shaft's simulator in another."""

import numpy as np
from bearings import parameters
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from ros_processes import Peer, module, program, stamp_of, wrench_of

from cylconn_ros.cli import main
from cylconn_ros.core import layout
from cylconn_ros.recording.run import read_run
from cylconn_ros.scene.parameter_file import dump_several
from cylconn_ros.scene.scene import several
from cylconn_ros.simulation.group import Bodies, simulate_group

MS = 1_000_000
NAMES = ("at0", "at1")


class Shaft:
    """A simulator of the shaft: one pose and one twist, two wrenches."""

    def __init__(self, peer: Peer) -> None:
        create = peer.node.create_publisher
        self.peer = peer
        self.senders = [
            create(PoseStamped, "/shaft/pose", 50),
            create(TwistStamped, "/shaft/twist", 50),
        ]
        self.wrenches = [peer.collect(WrenchStamped, f"/{n}/body_b/wrench") for n in NAMES]

    def wait(self) -> None:
        """Wait for the connector process; it subscribes to the motion once."""
        self.peer.spin_until(lambda: all(s.get_subscription_count() for s in self.senders))
        assert [s.get_subscription_count() for s in self.senders] == [1, 1]
        assert self.peer.node.count_subscribers("/at1/body_b/pose") == 0

    def send(self, stamp: int, state: np.ndarray) -> None:
        pose, twist = PoseStamped(), TwistStamped()
        for message in (pose, twist):
            message.header.frame_id = "world"
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        values = state[layout.B_POSE :].tolist()
        for name, value in zip("xyz", values[:3], strict=True):
            setattr(pose.pose.position, name, value)
        for name, value in zip("xyzw", values[3:7], strict=True):
            setattr(pose.pose.orientation, name, value)
        for name, value in zip("xyz", values[7:10], strict=True):
            setattr(twist.twist.linear, name, value)
        for name, value in zip("xyz", values[10:13], strict=True):
            setattr(twist.twist.angular, name, value)
        self.senders[0].publish(pose)
        self.senders[1].publish(twist)

    def exchange(self, stamp: int, state: np.ndarray) -> list[np.ndarray]:
        """Send a sample and return the wrenches on the shaft."""

        def received():
            found = [[w for w in topic if stamp_of(w) == stamp] for topic in self.wrenches]
            return found if all(found) else None

        self.send(stamp, state)
        found = self.peer.spin_until(received, f"wrenches for {stamp}")
        return [np.array(wrench_of(wrenches[0])) for wrenches in found]


def test_loop_over_topics_gives_the_same_numbers_as_in_process(tmp_path, capsys):
    scenes = several(parameters((-0.3, 0.4), com=0.05, twist=(0.5, 0.0, 0.0, 20.0, 0.0, 0.0)))
    recorded = several(
        {**parameters((-0.3, 0.4), com=0.05), "record": {"enabled": True}, "timeout": 60.0}
    )
    file = tmp_path / "scene.yaml"
    file.write_text(dump_several(recorded), encoding="utf-8")
    steps = 60
    expected = simulate_group(list(scenes.values()), steps)
    bodies, nothing = Bodies(list(scenes.values())), np.zeros(6)
    peer = Peer()
    try:
        command = [*module("connector.node"), "--ros-args", "--params-file", str(file)]
        with program(command, tmp_path) as connecting:
            shaft = Shaft(peer)
            shaft.wait()
            assert "at0, at1: shared bodies, coupled solution" in connecting.output
            for k in range(steps):
                np.testing.assert_array_equal(bodies.states[0], expected.samples[k, 0, :26])
                wrenches = shaft.exchange(k * MS, bodies.states[0])
                for c in (0, 1):
                    np.testing.assert_array_equal(wrenches[c], expected.outs[k, c, 6:12])
                bodies.step([(nothing, wrench) for wrench in wrenches])
            assert connecting.stop() == 0, connecting.output
    finally:
        peer.close()
    (run,) = (tmp_path / "runs").iterdir()
    for c, name in enumerate(NAMES):
        state = read_run(run, name).state
        assert len(state) == steps
        np.testing.assert_array_equal(
            state["normal_force"], expected.outs[:, c, layout.NORMAL_FORCE]
        )
    assert main.main(["replay", str(run), "--connector", "at0"]) != 0
    assert "at0 was solved together with at1" in capsys.readouterr().err
