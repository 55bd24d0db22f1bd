"""Simulated time: the node follows /clock in its reports and not in its timeout."""

import pytest
from ros_processes import Listener, Source, stamp_of, wrench_of
from rosgraph_msgs.msg import Clock

MS = 1_000_000


@pytest.mark.parametrize("published", [True, False])
def test_reports_follow_the_clock_and_the_timeout_does_not(published, connector, peer):
    with connector("use_sim_time:=true", "timeout:=0.3") as running:
        listener, source = Listener(peer), Source(peer)
        clock = peer.node.create_publisher(Clock, "/clock", 10)
        message = Clock()
        message.clock.sec = 77
        listener.exchange(source, 5 * MS)
        peer.spin_until(lambda: stamp_of(listener.b[-1]) == 5 * MS + 1, "the zero wrench")
        assert wrench_of(listener.b[-1]) == [0.0] * 6
        listener.wait_for_status("samples", "input timeout")
        assert {array.header.stamp.sec for array in listener.diagnostics} == {0}  # no time yet

        def follows_the_clock():
            clock.publish(message)
            return listener.diagnostics[-1].header.stamp.sec == 77

        if published:
            peer.spin_until(follows_the_clock, "the clock")
        assert running.stop() == 0
        assert "Traceback" not in running.output
