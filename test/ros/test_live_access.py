"""``access.frozen`` on a running node: what the network may no longer change, and the answers."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from ros_processes import Listener, Peer, Source, module, parameters, program
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

REASON = "access.frozen = true: nothing can be changed since the node was first active"


@pytest.mark.parametrize("frozen", [True, False])
def test_a_frozen_node_refuses_changes_in_words(frozen, tmp_path):
    rules = parameters(f"access.frozen:={str(frozen).lower()}", "timeout:=60.0")
    peer = Peer()
    diagnostics = peer.collect(DiagnosticArray, "/diagnostics")
    publisher = peer.node.create_publisher(JointState, "/connector/command", 10)
    try:
        with program([*module("connector.node"), *rules], tmp_path):
            listener, source = Listener(peer), Source(peer)
            listener.exchange(source, 1_000_000)
            change = Parameter("friction.preload", value=3.0).to_parameter_msg()
            answer = peer.call(
                SetParameters, "/connector/set_parameters",
                SetParameters.Request(parameters=[change]),
            ).results[0]  # fmt: skip
            assert answer.successful is not frozen
            for name in ("reset", "start_recording", "stop_recording"):
                response = peer.call(Trigger, f"/connector/{name}")
                assert response.success is not frozen
                assert response.message.startswith(REASON) is frozen
            assert answer.reason.startswith(REASON) is frozen
            if frozen:
                peer.spin_until(publisher.get_subscription_count, "the command's subscriber")
                publisher.publish(JointState(name=["slide"], effort=[1.0]))
                text = "command refused: access.frozen = true: commands are not followed"
                peer.spin_until(
                    lambda: any(text in s.message for d in diagnostics for s in d.status), text
                )
    finally:
        peer.close()
