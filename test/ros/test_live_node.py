"""Connector process with other nodes: topics, bad input, lifecycle, services, QoS."""

import signal
import sys
from pathlib import Path

import pytest
from cylconn_ros.msg import ConnectorState
from geometry_msgs.msg import PoseStamped, WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from ros_processes import Listener, Source, parameters, program, stamp_of, wrench_of
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

MS = 1_000_000
WEIGHT = 2.0 * 9.81
NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize("form", ["pose_twist", "odometry"])
def test_simulator_gets_wrench_state_and_joint_state(connector, peer, form):
    with connector(f"input:={form}", "wrench.axes:=world"):
        listener, source = Listener(peer), Source(peer, form)
        wrench = listener.exchange(source, 5 * MS, position=(0.1, 0.0, 0.0))
        assert wrench_of(wrench)[:3] == pytest.approx([0.0, 0.0, WEIGHT], abs=1e-9)
        peer.spin_until(lambda: listener.a and listener.states and listener.joints)
        assert wrench.header.frame_id == "world"
        assert stamp_of(listener.a[0]) == 5 * MS
        assert wrench_of(listener.a[0])[:3] == pytest.approx([0.0, 0.0, -WEIGHT], abs=1e-9)
        state, joints = listener.states[0], listener.joints[0]
        assert (stamp_of(state), state.header.frame_id, state.method) == (
            5 * MS,
            "body_a",
            "impulse",
        )
        assert state.length == pytest.approx(0.1)
        assert state.status == ConnectorState.OK
        assert 0.0 < state.computing_time < 1.0
        assert (stamp_of(joints), list(joints.name)) == (5 * MS, ["slide", "spin"])
        assert joints.position[0] == pytest.approx(0.1)
        listener.exchange(source, 6 * MS, position=(0.1, 0.0, 0.0), velocity=(0.7, 0.0, 0.0))
        peer.spin_until(lambda: stamp_of(listener.joints[-1]) == 6 * MS)
        assert listener.joints[-1].velocity[0] == pytest.approx(0.7)


def test_repeated_stamp_gets_the_same_output(connector, peer):
    with connector("timeout:=.inf"):
        listener, source = Listener(peer), Source(peer)
        first = listener.exchange(source, 5 * MS)
        peer.spin_for(0.2)
        listener.clear()
        source.send(5 * MS, velocity=(9.0, 0.0, 0.0))
        peer.spin_until(lambda: listener.b and listener.states)
        assert listener.b[0] == first
        assert listener.states[0].velocity[0] == 0.0
        values = listener.wait_for_status("samples", "samples/s")
        assert values["samples processed"] == "1"


def test_bad_input_never_becomes_a_wrench(connector, peer):
    with connector("timeout:=.inf"):
        listener, source = Listener(peer), Source(peer)
        listener.exchange(source, 1 * MS)
        for stamp, motion, text, count in (
            (2 * MS, {"position": (NAN, 0.0, 0.0)}, "body_b/pose is not finite", "non-finite"),
            (3 * MS, {"velocity": (0.0, INF, 0.0)}, "body_b/twist is not finite", "non-finite"),
            (4 * MS, {"orientation": (0.0,) * 4}, "cannot be normalised", "bad quaternion"),
        ):
            wrench = listener.exchange(source, stamp, **motion)
            assert wrench_of(wrench) == [0.0] * 6
            values = listener.wait_for_status("samples", text)
            assert int(values[count]) >= 1
        source.publishers[0].publish(b"\x00\x01\x00\x00 not a pose")
        values = listener.wait_for_status("samples", "cannot be decoded")
        assert listener.status("samples")[1].startswith("body_b/pose: stamp has ")
        assert values["undecodable"] == "1"
        source.publishers[1].publish(b"")  # the middleware does not deliver it
        wrench = listener.exchange(source, 5 * MS)
        assert wrench_of(wrench)[2] == pytest.approx(WEIGHT)  # the node continues
        values = listener.wait_for_status(
            "topics", "/body_b/twist: messages were dropped (1 so far"
        )
        assert values["dropped messages"] == "1"
        values = listener.wait_for_status("samples", "samples/s")
        assert (values["non-finite"], values["bad quaternion"]) == ("2", "1")


def test_zero_wrench_after_input_timeout_has_a_new_stamp(connector, peer):
    with connector("timeout:=0.3") as running:
        listener, source = Listener(peer), Source(peer)
        listener.exchange(source, 5 * MS)
        peer.spin_until(lambda: stamp_of(listener.b[-1]) == 5 * MS + 1, "the zero wrench")
        assert wrench_of(listener.b[-1]) == [0.0] * 6
        values = listener.wait_for_status(
            "samples", "input timeout (0.3 s): commanding zero wrench"
        )
        assert values["timeouts"] == "1"
        count = len(listener.b)
        peer.spin_for(0.5)
        assert len(listener.b) == count  # once
        assert wrench_of(listener.exchange(source, 6 * MS))[2] == pytest.approx(WEIGHT)
        assert "input resumed" in running.output


NO_CHECKS = """
from cylconn_ros.ros.connector import node as connector_node
from cylconn_ros.ros.executor import executor
executor.SampleExecutor._next_check = lambda self, now: now + 0.05
raise SystemExit(connector_node.main())
"""


def test_node_executor_checks_the_timeout_if_the_sample_executor_does_not(peer, tmp_path):
    with program(
        [sys.executable, "-c", NO_CHECKS, *parameters("timeout:=0.1")], tmp_path
    ) as running:
        listener, source = Listener(peer), Source(peer)
        listener.exchange(source, 5 * MS)
        peer.spin_until(lambda: stamp_of(listener.b[-1]) == 5 * MS + 1, "the zero wrench")
        assert running.stop() == 0


def test_load_is_balanced_by_the_wrench(connector, peer):
    with connector("wrench.axes:=world"):
        listener, source = Listener(peer), Source(peer)
        publisher = peer.node.create_publisher(WrenchStamped, "/body_b/load", 10)
        listener.exchange(source, 1 * MS)
        load = WrenchStamped()
        load.header.frame_id = "body_b"
        load.wrench.force.y = 3.0
        peer.spin_until(publisher.get_subscription_count)
        publisher.publish(load)
        peer.spin_for(0.3)
        wrench = listener.exchange(source, 2 * MS)
        assert wrench_of(wrench)[1] == pytest.approx(-3.0)


def test_incompatible_qos_is_diagnosed_with_the_remedy(connector, peer):
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    with connector() as running:
        listener = Listener(peer)
        publisher = peer.node.create_publisher(PoseStamped, "/body_b/pose", best_effort)
        text = "/body_b/pose: a publisher is best_effort (expected reliable), its messages are not"
        values = listener.wait_for_status("topics", text)
        assert values["incompatible QoS"] == "1"
        assert publisher.get_subscription_count() == 0
        assert running.wait_for(text).endswith("set qos.reliability: best_effort")
        peer.node.destroy_publisher(publisher)
        peer.spin_until(lambda: text not in listener.status("topics")[1], "withdrawal")
        assert listener.status("topics")[2]["incompatible QoS"] == "0"


def test_best_effort_inputs_receive_publishers_of_both_kinds(connector, peer):
    with connector("qos.reliability:=best_effort"):
        listener = Listener(peer)
        for stamp, qos in ((1, qos_profile_sensor_data), (2, 10)):
            source = Source(peer, qos=qos)
            wrench = listener.exchange(source, stamp * MS)
            assert wrench_of(wrench)[2] == pytest.approx(WEIGHT)
            for publisher in source.publishers:
                peer.node.destroy_publisher(publisher)
        assert listener.wait_for_status("topics", "connected")["incompatible QoS"] == "0"


def test_qos_overrides_apply_and_unknown_ones_are_refused(connector, peer):
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    override = "qos_overrides./body_b/{}.subscription.reliability:=best_effort"
    with connector(override.format("pose"), override.format("twist")):
        listener, source = Listener(peer), Source(peer, qos=best_effort)
        listener.exchange(source, 1 * MS)
    with connector(override.format("poses")) as running:
        assert running.wait() == 2
        assert "qos_overrides./body_b/poses.subscription.reliability = " in running.output


def test_lifecycle_by_services(connector, peer):
    def change(transition: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=transition))
        return peer.call(ChangeState, "/connector/change_state", request).success

    def state() -> str:
        return peer.call(GetState, "/connector/get_state").current_state.label

    with connector("autostart:=false") as running:
        listener, source = Listener(peer), Source(peer)
        assert state() == "unconfigured"
        assert not change(Transition.TRANSITION_ACTIVATE)  # not available: refused at once
        assert not change(99)
        line = (
            "transition 3 refused: the node is unconfigured; it allows configure (1), shutdown (5)"
        )
        assert line in running.output
        assert change(Transition.TRANSITION_CONFIGURE)
        assert state() == "inactive"
        assert not any(publisher.get_subscription_count() for publisher in source.publishers)
        listener.wait_for_status("samples", "the node is inactive")
        assert change(Transition.TRANSITION_ACTIVATE)
        listener.exchange(source, 5 * MS)
        assert change(Transition.TRANSITION_DEACTIVATE)
        peer.spin_until(lambda: wrench_of(listener.b[-1]) == [0.0] * 6, "the last zero wrench")
        assert change(Transition.TRANSITION_ACTIVATE)
        listener.clear()
        assert listener.exchange(source, 2 * MS)  # a new history: an older stamp is the first
        assert change(Transition.TRANSITION_DEACTIVATE)
        assert change(Transition.TRANSITION_CLEANUP)
        assert state() == "unconfigured"
        assert change(Transition.TRANSITION_CONFIGURE)
        assert change(Transition.TRANSITION_INACTIVE_SHUTDOWN)
        assert running.wait() == 0


def test_recording_and_reset_by_service(connector, peer, tmp_path):
    with connector("record.directory:=kept") as running:
        listener, source = Listener(peer), Source(peer)
        listener.exchange(source, 1 * MS, position=(0.1, 0.0, 0.0))
        assert not peer.call(Trigger, "/connector/stop_recording").success
        response = peer.call(Trigger, "/connector/start_recording")
        assert response.success
        first = Path(response.message.removeprefix("recording to "))
        assert first.parent == tmp_path / "kept"
        assert first.name.startswith("connector_2")
        response = peer.call(Trigger, "/connector/start_recording")
        assert not response.success
        assert "already recording" in response.message
        listener.exchange(source, 2 * MS, position=(0.2, 0.0, 0.0))
        response = peer.call(Trigger, "/connector/reset")
        assert response.success, response.message
        assert sorted(path.name for path in first.iterdir())[1] == "metadata.yaml"
        listener.clear()
        listener.exchange(source, 1 * MS, position=(0.3, 0.0, 0.0))
        peer.spin_until(lambda: listener.states)
        assert listener.states[-1].displacement == 0.0  # the reference configuration
        response = peer.call(Trigger, "/connector/stop_recording")
        assert response.success
        second = Path(response.message.rpartition(" in ")[2])
        assert second.parent == first.parent
        assert second != first
        assert (second / "metadata.yaml").is_file()
        assert running.stop() == 0


def test_parameters_at_run_time(connector, peer):
    def setting(name: str, value: ParameterValue):
        request = SetParameters.Request(parameters=[Parameter(name=name, value=value)])
        return peer.call(SetParameters, "/connector/set_parameters", request).results[0]

    def number(value: float) -> ParameterValue:
        return ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)

    with connector("friction.radius:=0.02") as running:
        listener, source = Listener(peer), Source(peer)
        listener.exchange(source, 1 * MS, position=(0.1, 0.0, 0.0))
        result = setting("friction.coefficient", number(-1.0))
        assert not result.successful
        assert "friction.coefficient = -1.0: must be a number >= 0" in result.reason
        result = setting("world_frame", ParameterValue(type=4, string_value="map"))
        assert not result.successful
        assert setting("friction.coefficient", number(0.5)).successful
        whole = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=1)
        assert setting("timeout", whole).successful
        velocity = (0.5, 0.0, 0.0)
        listener.exchange(source, 2 * MS, position=(0.15, 0.0, 0.0), velocity=velocity)
        peer.spin_until(lambda: stamp_of(listener.states[-1]) == 2 * MS)
        state = listener.states[-1]
        assert state.friction_coefficient == pytest.approx(0.5)
        assert state.displacement == pytest.approx(0.05)  # the history continues
        assert setting(
            "node_a.position", ParameterValue(type=8, double_array_value=[0.0] * 3)
        ).successful
        assert (
            "next sample is the reference" not in running.output
        )  # the same value changes nothing
        moved = ParameterValue(type=8, double_array_value=[0.05, 0.0, 0.0])
        assert setting("node_a.position", moved).successful
        listener.clear()
        listener.exchange(source, 3 * MS, position=(0.2, 0.0, 0.0))
        peer.spin_until(lambda: listener.states)
        assert listener.states[-1].displacement == 0.0
        assert peer.call(Trigger, "/connector/start_recording").success
        result = setting("friction.coefficient", number(0.1))
        assert not result.successful
        assert "during a recording" in result.reason
        request = GetParameters.Request(names=["friction.coefficient", "body_a.inertia"])
        values = peer.call(GetParameters, "/connector/get_parameters", request).values
        assert values[0].double_value == 0.5
        assert values[1].type == ParameterType.PARAMETER_DOUBLE_ARRAY
        assert not values[1].double_array_value  # [], not set
        request = DescribeParameters.Request(names=["friction.radius"])
        found = peer.call(DescribeParameters, "/connector/describe_parameters", request)
        assert found.descriptors[0].additional_constraints.startswith("a number > 0 m")


def test_remapped_name_and_namespace_apply_to_topics_and_parameters(connector, peer, tmp_path):
    (tmp_path / "scene.yaml").write_text("""
/**: {ros__parameters: {body_b: {frame: wrong}}}
/arm/joint: {ros__parameters: {body_b: {frame: sleeve}}}
connector: {ros__parameters: {body_b: {frame: wrong}}}
""")
    extra = ("-r", "__node:=joint", "-r", "__ns:=/arm", "--params-file", "scene.yaml")
    with connector(extra=(*extra, "-r", "body_a/wrench:=elsewhere")):
        listener, source = Listener(peer, "/arm", "joint"), Source(peer, prefix="/arm")
        elsewhere = peer.collect(WrenchStamped, "/arm/elsewhere")
        wrench = listener.exchange(source, 1 * MS)
        assert wrench.header.frame_id == "sleeve"
        peer.spin_until(lambda: listener.states and listener.joints and elsewhere)
        assert peer.call(GetState, "/arm/joint/get_state").current_state.label == "active"
        assert peer.call(Trigger, "/arm/joint/reset").success
        assert not listener.a


def test_markers_on_request(connector, peer):
    with connector("markers:=true"):
        listener, source = Listener(peer), Source(peer)
        pictures = peer.collect(MarkerArray, "/connector/markers")
        peer.spin_until(lambda: peer.node.count_publishers("/connector/markers"))
        for k in range(1, 4):
            listener.exchange(source, k * MS, position=(0.2, 0.0, 0.0))
        peer.spin_until(lambda: pictures)
        shaft, sleeve, force, stripe = pictures[-1].markers
        assert shaft.header.frame_id == "world"
        assert sleeve.pose.position.x == pytest.approx(0.2)
        start, tip = force.points
        assert (tip.z - start.z) == pytest.approx(0.2)  # the weight is held up
        assert (stripe.pose.position.x, stripe.pose.position.z) == (pytest.approx(0.2), 0.0)
        assert stripe.pose.position.y > 0.0  # on the sleeve's surface


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_shuts_down_in_order(connector, peer, tmp_path, number):
    with connector("record.enabled:=true", "timeout:=.inf") as running:
        listener, source = Listener(peer), Source(peer)
        listener.exchange(source, 5 * MS)
        assert running.stop(number) == 0, running.output
        peer.spin_until(lambda: stamp_of(listener.b[-1]) == 5 * MS + 1, "the last zero wrench")
        assert wrench_of(listener.b[-1]) == [0.0] * 6
        (run,) = (tmp_path / "runs").iterdir()
        assert (run / "metadata.yaml").is_file()
        assert "Traceback" not in running.output


FAULTY = """
from cylconn_ros.ros.connector import node as connector_node
from cylconn_ros.messages.pipeline import MessagePipeline

def once(method):
    calls = []
    def faulty(*arguments):
        calls.append(arguments)
        if len(calls) == 1:
            raise ArithmeticError(f"injected into {method.__name__}")
        return method(*arguments)
    return faulty

MessagePipeline.finish = once(MessagePipeline.finish)
connector_node.ConnectorNode._check = once(connector_node.ConnectorNode._check)
raise SystemExit(connector_node.main())
"""


def test_internal_error_stops_neither_the_node_nor_the_samples(peer, tmp_path):
    with program([sys.executable, "-c", FAULTY, *parameters("timeout:=.inf")], tmp_path) as running:
        listener, source = Listener(peer), Source(peer)
        wrench = listener.exchange(source, 1 * MS)
        assert wrench_of(wrench) == [0.0] * 6
        assert wrench_of(listener.exchange(source, 2 * MS))[2] == pytest.approx(WEIGHT)
        peer.spin_until(lambda: listener.diagnostics)
        text = str(listener.diagnostics)
        assert "computing a sample failed: ArithmeticError: injected into finish" in text
        assert "injected into _check" in running.output
        assert running.stop() == 0
