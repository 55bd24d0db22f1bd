"""Commands: accepted or refused, time of action and duration; without and with processes."""

import math

import numpy as np
import pytest
from cylconn_ros.msg import ConnectorState
from pipelines import MS, Loop, make
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.serialization import serialize_message
from recorded_loops import assert_replayed
from ros_processes import Listener, Source, reported
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from cylconn_ros.connector.connector import Connector
from cylconn_ros.core import layout
from cylconn_ros.errors import SceneError
from cylconn_ros.messages import cdr_decoder
from cylconn_ros.messages.commands import joint_command
from cylconn_ros.messages.pipeline import COMMAND, MessagePipeline
from cylconn_ros.recording.run import read_run
from cylconn_ros.ros.connector.diagnostics import ConnectionStatus, Monitor
from cylconn_ros.ros.connector.recorder import Recorder
from cylconn_ros.scene.scene import Scene, load

NAN = math.nan


def command(*names: str, position=(), velocity=(), effort=()) -> bytes:
    message = JointState(name=names, position=position, velocity=velocity, effort=effort)
    return serialize_message(message)


def send(loop: Loop, *names: str, **arrays) -> None:
    assert loop.pipeline.inputs[COMMAND].receive(command(*names, **arrays)) is None


def read(data: bytes) -> dict[str, joint_command.Imposition]:
    return joint_command.read(cdr_decoder.read_joint_state(data))


def test_names_in_any_order_and_alone():
    both = read(command("spin", "slide", position=(1.0, 2.0), velocity=(3.0, 4.0)))
    assert both["slide"][:2] == (2.0, 4.0)
    assert both["spin"][:2] == (1.0, 3.0)
    assert math.isnan(both["slide"].force)
    alone = read(command("spin", effort=(5.0,)))
    assert list(alone) == ["spin"]
    assert alone["spin"].force == 5.0
    assert math.isnan(alone["spin"].position)
    mixed = read(command("slide", "spin", velocity=(0.1, NAN), effort=(NAN, 7.0)))
    assert mixed["slide"].velocity == 0.1
    assert mixed["spin"].force == 7.0
    assert str(mixed["slide"]) == "velocity 0.1"
    assert str(read(command("slide"))["slide"]) == "free"


def test_joints_have_the_names_of_the_robot_model():
    loop = Loop(make(joint_names={"slide": "rail", "spin": "axle"}))
    send(loop, "axle", "rail", effort=(0.5, 1.5))
    response = loop.step()
    assert loop.pipeline.out[layout.FORCE_ACTUATION] == 1.5
    assert loop.pipeline.out[layout.MOMENT_ACTUATION] == 0.5
    assert cdr_decoder.read_joint_state(response.joint_state).names == ("rail", "axle")
    send(loop, "slide", effort=(3.0,))
    assert loop.pipeline.health.refusal == "name = 'slide': must be rail or axle"


@pytest.mark.parametrize(
    ("slide", "spin", "text"),
    [("", "spin", "joint_names.slide = '': must"), ("a", "a", "joint_names: slide and spin must")],
)
def test_joint_names_that_are_none_are_refused(slide, spin, text):
    with pytest.raises(SceneError, match=text):
        make(joint_names={"slide": slide, "spin": spin})


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (command(effort=(1.0,)), r"name = \[\]: must name slide, spin or both"),
        (command("slide", "tilt"), "name = 'tilt': must be slide or spin"),
        (command("slide", "slide"), "name = 'slide': must not be given twice"),
        (command("slide", "spin", position=(1.0,)), "position: 1 numbers for 2 names"),
        (command("slide", velocity=(1.0, 2.0)), "velocity: 2 numbers for 1 names"),
        (command("spin", effort=(math.inf,)), "effort of spin = inf: must be finite"),
        (
            command("slide", "spin", velocity=(1.0, 1.0), effort=(NAN, -2.0)),
            "effort of spin = -2: must be > 0 with a motion",
        ),
    ],
    ids=["no name", "unknown", "twice", "too few", "too many", "infinite", "negative"],
)
def test_invalid_command_is_refused_counted_and_diagnosed(data, text):
    loop = Loop(make())
    send(loop, "slide", effort=(1.5,))
    with pytest.raises(joint_command.JointCommandError, match=text):
        read(data)
    assert loop.pipeline.inputs[COMMAND].receive(data) is None
    assert (loop.pipeline.health.commands, loop.pipeline.health.refused) == (1, 1)
    loop.step()
    assert loop.pipeline.out[layout.FORCE_ACTUATION] == 1.5  # as before
    (samples, *_) = reported(Monitor("c"), loop.pipeline, Recorder(), ConnectionStatus())
    assert "command refused: " in samples.message
    assert {pair.key: pair.value for pair in samples.values}["commands refused"] == "1"


def test_truncated_message_is_undecodable():
    loop = Loop(make())
    assert loop.pipeline.inputs[COMMAND].receive(command("slide")[:20]) is None
    assert loop.pipeline.health.undecodable == 1


def test_command_acts_from_the_next_sample_on():
    """A command between the messages of a sample acts on that sample."""
    scene = make(friction__coefficient=0.2)
    loop, connector = Loop(scene), Connector(scene)
    sent = {
        2: ("slide", {"effort": (4.0,)}, (NAN, NAN, 4.0)),
        4: ("slide", {"position": (0.004,), "velocity": (0.1,)}, (0.004, 0.1, NAN)),
        7: ("spin", {"velocity": (1.0,)}, (NAN, 1.0, NAN)),
        9: ("slide", {}, (NAN, NAN, NAN)),
    }
    for k in range(12):
        if k in sent:
            name, _, imposed = sent[k]
            connector.impose(name, *imposed)
        response = None
        for name, data in loop.exchange.messages(loop.plant.time_ns, loop.plant.state):
            response = loop.pipeline.inputs[name].receive(data)
            if k in sent and name == "body_a/pose":
                send(loop, sent[k][0], **sent[k][1])
        out = connector.step(np.concatenate([loop.plant.state, loop.plant.loads]))
        assert response is not None
        assert cdr_decoder.read_wrench(response.wrench_b).values == tuple(
            out[layout.FORCE_B : layout.FORCE_B + 6]
        )
        loop.plant.step(out[layout.FORCE_A : layout.FORCE_B], out[layout.FORCE_B : layout.STATE0])
    assert out[layout.MOMENT_REACTION] != 0.0
    assert out[layout.FORCE_REACTION] == 0.0


def test_repeated_sample_gets_the_same_output_after_a_command():
    loop = Loop(make())
    first = loop.sample()
    send(loop, "slide", effort=(4.0,))
    assert loop.sample() == first


def test_command_holds_after_parameter_change_reset_and_restart():
    loop = Loop(make())
    loop.step()
    send(loop, "slide", "spin", position=(0.1, NAN), velocity=(0.5, NAN), effort=(NAN, 3.0))
    for _ in range(5):
        loop.step()
    memory = loop.pipeline.connector.memory
    loop.pipeline = MessagePipeline(make(friction__coefficient=0.3), loop.pipeline)
    assert np.array_equal(loop.pipeline.connector.memory, memory, equal_nan=True)  # the ramp, too
    loop.step()
    assert loop.pipeline.out[layout.MOMENT_ACTUATION] == 3.0
    assert loop.pipeline.out[layout.FORCE_REACTION] != 0.0
    loop.pipeline.reset()
    loop.step()
    assert loop.pipeline.out[layout.MOMENT_ACTUATION] == 3.0
    loop.pipeline.commands.release()
    loop.step()
    assert loop.pipeline.out[layout.MOMENT_ACTUATION] == 0.0


def test_parameter_acts_as_a_command_and_the_newest_takes_precedence():
    loop = Loop(make())
    for _ in range(3):
        loop.step()
    send(loop, "spin", effort=(3.0,))
    send(loop, "slide", effort=(1.0,))
    loop.pipeline = MessagePipeline(make(command__slide__force=2.0), loop.pipeline)
    assert loop.pipeline.continues
    loop.step()
    assert loop.pipeline.out[layout.DISPLACEMENT] > 0.0  # the history continues
    assert loop.pipeline.out[layout.FORCE_ACTUATION] == 2.0  # the parameter changed
    assert loop.pipeline.out[layout.MOMENT_ACTUATION] == 3.0  # this one did not
    send(loop, "slide")
    loop.step()
    assert loop.pipeline.out[layout.FORCE_ACTUATION] == 0.0


def test_changed_position_starts_the_imposed_motion_there():
    def scene(position: float) -> Scene:
        motion = {"command__slide__position": position, "command__slide__velocity": 0.5}
        return make(command__slide__approach_speed=10.0, **motion)

    loop = Loop(scene(0.0))
    for _ in range(20):
        loop.step()
    assert loop.pipeline.out[layout.LENGTH] == pytest.approx(0.5 * 0.019, abs=1e-4)
    loop.pipeline = MessagePipeline(scene(0.02), loop.pipeline)
    for _ in range(21):
        loop.step()
    assert loop.pipeline.out[layout.LENGTH] == pytest.approx(0.02 + 0.5 * 0.020, abs=1e-4)


def test_scene_in_force_gives_the_same_outputs_from_the_start():
    """A recording that starts after a command holds this scene."""
    loop = Loop(make(friction__coefficient=0.2))
    send(loop, "slide", position=(0.01,), velocity=(0.2,))
    again = Loop(loop.pipeline.commands.scene_in_force)
    for _ in range(5):
        assert loop.step().wrench_b == again.step().wrench_b
    assert again.pipeline.scene.command.slide.position == 0.01


def test_stops_and_locks_are_diagnosed():
    stopping = {"l_max": 0.001, "restitution": 0.5}
    loop = Loop(make(stops=stopping, lock={"component": "spin", "position": 0.004}))
    monitor, seen = Monitor("c"), set()
    messages = []
    for _ in range(8):
        loop.step()
        seen.add((int(loop.pipeline.out[layout.STOP]), int(loop.pipeline.out[layout.LOCK])))
        status = reported(monitor, loop.pipeline, Recorder(), ConnectionStatus())[1]
        messages.append((status.message, {pair.key: pair.value for pair in status.values}))
    assert (2, 0) in seen or (2, 2) in seen
    assert any("at stop: length max" in message for message, _ in messages)
    message, values = messages[-1]
    assert "locked: spin" in message
    assert values["locked"] == "spin"
    assert values["stops touched"] == "none"  # since the last report
    assert values["imposed on slide"] == "free"
    assert loop.plant.time_ns == 8 * MS


def solution_value(listener: Listener, name: str) -> str | None:
    """A value in the newest diagnostics of the solution."""
    return listener.status("solution")[2].get(name)


def solution_values(listener: Listener, name: str) -> set[str]:
    """A value in all diagnostics of the solution so far: an event is in one of them only."""
    pairs = (
        pair
        for report in listener.diagnostics
        for status in report.status
        for pair in status.values
    )
    return {pair.value for pair in pairs if pair.key == name}


def test_recording_that_starts_after_a_command_contains_it(connector, peer, tmp_path):
    with connector("timeout:=.inf", "record.directory:=kept", "latency:=0"):
        listener, source = Listener(peer), Source(peer)
        publisher = peer.node.create_publisher(JointState, "/connector/command", 10)
        listener.exchange(source, 1 * MS)
        peer.spin_until(publisher.get_subscription_count)
        publisher.publish(JointState(name=["spin", "slide"], effort=[0.5, 4.0]))
        peer.spin_until(lambda: solution_value(listener, "imposed on slide") == "force 4")
        listener.clear()
        listener.exchange(source, 2 * MS)
        peer.spin_until(lambda: listener.states)
        state = listener.states[-1]
        assert (state.force_actuation, state.moment_actuation) == (4.0, 0.5)
        publisher.publish(JointState(name=["tilt"], effort=[1.0]))
        listener.wait_for_status("samples", "command refused: name = 'tilt'")
        assert peer.call(Trigger, "/connector/reset").success
        assert peer.call(Trigger, "/connector/start_recording").success
        for k in range(3, 6):
            listener.exchange(source, k * MS)
        publisher.publish(JointState(name=["slide"], velocity=[0.2]))
        peer.spin_until(lambda: solution_value(listener, "imposed on slide") == "velocity 0.2")
        for k in range(6, 9):
            listener.exchange(source, k * MS)
        assert listener.states[-1].force_reaction != 0.0
        assert listener.states[-1].moment_actuation == 0.5  # not named: as it was
        assert peer.call(Trigger, "/connector/stop_recording").success
    run = read_run(next((tmp_path / "kept").iterdir()))
    assert len(list(run.raw("/connector/command"))) == 1
    (tmp_path / "scene.yaml").write_text(run.metadata["parameters"])
    assert_replayed(run, load(tmp_path / "scene.yaml"))


def test_parameter_commands_a_force(connector, peer):
    with connector("timeout:=.inf"):
        listener, source = Listener(peer), Source(peer)
        listener.exchange(source, 1 * MS)
        force = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=3.0)
        request = SetParameters.Request(
            parameters=[Parameter(name="command.slide.force", value=force)]
        )
        assert peer.call(SetParameters, "/connector/set_parameters", request).results[0].successful
        listener.clear()
        listener.exchange(source, 2 * MS, position=(0.001, 0.0, 0.0))
        peer.spin_until(lambda: listener.states)
        assert listener.states[-1].force_actuation == 3.0
        assert listener.states[-1].displacement == pytest.approx(0.001)  # the history continues


def test_stops_and_locks_of_the_node_are_diagnosed(connector, peer):
    rules = ["stops.l_min:=0.05", "stops.restitution:=0.5"]
    rules += ["lock.component:=slide", "lock.position:=0.2", "timeout:=.inf"]
    with connector(*rules):
        listener, source = Listener(peer), Source(peer)
        listener.exchange(source, 1 * MS, position=(0.051, 0.0, 0.0), velocity=(-1.0, 0.0, 0.0))
        peer.spin_until(lambda: listener.states)
        state = listener.states[-1]
        assert (state.stop, state.lock) == (ConnectorState.LENGTH_MIN, ConnectorState.UNLOCKED)
        assert state.restitution == pytest.approx(0.5)
        assert state.force_reaction > 0.0
        peer.spin_until(lambda: "length min" in solution_values(listener, "stops touched"))
        assert peer.call(Trigger, "/connector/reset").success
        listener.clear()
        listener.exchange(source, 2 * MS, position=(0.1999, 0.0, 0.0), velocity=(1.0, 0.0, 0.0))
        peer.spin_until(lambda: listener.states)
        assert listener.states[-1].lock == ConnectorState.LENGTH_LOCKED
        assert listener.states[-1].stop == ConnectorState.NO_STOP
        peer.spin_until(lambda: solution_value(listener, "locked") == "slide")
        assert "locked: slide" in listener.status("solution")[1]


def test_a_drive_that_a_stop_holds_is_diagnosed_with_both_names():
    loop = Loop(make(stops__l_max=0.005))
    send(loop, "slide", velocity=(1.0,), effort=(500.0,))
    for _ in range(40):
        loop.step()
    assert int(loop.pipeline.out[layout.FLAGS]) & layout.DRIVE_BLOCKED
    statuses = reported(Monitor("c"), loop.pipeline, Recorder(), ConnectionStatus())
    text = " ".join(status.message for status in statuses)
    assert "the motion imposed on slide (command.slide: velocity 1) is held by stops.l_max" in text


def test_a_position_beyond_a_stop_is_refused():
    loop = Loop(make(stops__l_max=0.305))
    send(loop, "slide", position=(0.4,))
    assert loop.pipeline.health.refused == 1
    assert "position of slide = 0.4: must be <= stops.l_max (0.305)" in loop.pipeline.health.refusal
