"""The preload by topic: a brake, its refusals, its recording; without and with processes."""

import math

import numpy as np
import pytest
from pipelines import Loop
from rclpy.serialization import serialize_message
from recorded_loops import assert_replayed
from ros_processes import Listener, Source
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from cylconn_ros.core import layout
from cylconn_ros.laws.runs import check_recording
from cylconn_ros.messages.commands.commands import PRELOAD
from cylconn_ros.messages.pipeline import MessagePipeline
from cylconn_ros.recording.run import read_run
from cylconn_ros.scene.scene import Scene, load

MS = 1_000_000


def brake(**changes: object) -> Scene:
    """A mass of 1 kg that slides at 1 m/s, whose brake is open."""
    return Scene.from_parameters(
        {
            "period": 1e-3,
            "gravity": [0.0, 0.0, 0.0],
            "node_a.orientation": [0.0, 0.0, 0.0, 1.0],
            "body_a": {"kind": "free", "mass": 1e12, "inertia": [1e12, 0.0, 0.0, 1e12, 0.0, 1e12]},
            "body_b": {"kind": "free", "mass": 1.0, "inertia": [1.0, 0.0, 0.0, 1.0, 0.0, 1.0]},
            "friction": {"coefficient": 0.5, "radius": 0.01, "preload": 0.0},
            "plant.body_b.twist": [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            **changes,
        }
    )


def send(loop: Loop, preload: float) -> None:
    data = serialize_message(Float64(data=preload))
    assert loop.pipeline.inputs[PRELOAD].receive(data) is None


def test_a_brake_stops_the_mass_where_it_must() -> None:
    """2 N from 0.1 s on, mu 0.5: 1 m/s^2, at rest at 1.1 s and 0.6 m (Modelica's Brake)."""
    loop, stopped = Loop(brake()), []
    for k in range(1200):
        if k == 100:
            send(loop, 2.0)
        loop.step()
        if loop.pipeline.out[layout.STOP_TIME] >= 0.0:
            stopped.append(1e-3 * k + loop.pipeline.out[layout.STOP_TIME])
        if k == 600:
            assert loop.pipeline.out[layout.VELOCITY] == pytest.approx(0.5, abs=1e-9)
    assert loop.pipeline.out[layout.VELOCITY] == pytest.approx(0.0, abs=1e-12)
    assert loop.pipeline.out[layout.LENGTH] == pytest.approx(0.6, abs=1e-6)
    assert stopped == [pytest.approx(1.1, abs=1e-6)]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_preload_that_is_not_finite_is_refused(value: float) -> None:
    loop = Loop(brake())
    send(loop, value)
    assert loop.pipeline.health.refused == 1
    assert loop.pipeline.health.refusal == f"preload = {value}: must be finite"
    assert loop.pipeline.commands.preload == 0.0


def test_a_preload_without_friction_is_refused_with_the_parameter() -> None:
    loop = Loop(brake(friction={}))
    send(loop, 2.0)
    assert "give friction.coefficient" in loop.pipeline.health.refusal


def test_frozen_access_and_damaged_messages() -> None:
    loop = Loop(brake(**{"access.frozen": True}))
    send(loop, 2.0)
    assert "access.frozen = true" in loop.pipeline.health.refusal
    assert loop.pipeline.inputs[PRELOAD].receive(b"\x00\x01\x00\x00\x00") is None
    assert loop.pipeline.health.undecodable == 1


def test_the_preload_stays_until_its_parameter_changes() -> None:
    loop = Loop(brake())
    send(loop, 2.0)
    loop.step()
    loop.pipeline = MessagePipeline(brake(**{"limits.force": 100.0}), loop.pipeline)
    assert loop.pipeline.commands.preload == 2.0
    loop.step()
    assert loop.pipeline.out[layout.NORMAL_FORCE] == pytest.approx(2.0)
    loop.pipeline = MessagePipeline(
        brake(friction={"coefficient": 0.5, "radius": 0.01, "preload": 3.0}), loop.pipeline
    )
    loop.step()
    assert loop.pipeline.out[layout.NORMAL_FORCE] == pytest.approx(3.0)
    loop.pipeline.commands.release()
    assert loop.pipeline.commands.scene_in_force.friction.preload == 3.0


def test_a_stick_stiffness_from_the_elastic_slip_follows() -> None:
    loop = Loop(
        brake(method="penalty", penalty={"stiffness": 1e4, "damping": 10.0, "elastic_slip": 1e-4})
    )
    send(loop, 2.0)
    same = Loop(
        brake(
            method="penalty",
            penalty={"stiffness": 1e4, "damping": 10.0, "elastic_slip": 1e-4},
            friction={"coefficient": 0.5, "radius": 0.01, "preload": 2.0},
        )
    )
    np.testing.assert_array_equal(loop.pipeline.connector.par, same.pipeline.connector.par)


def test_a_run_with_a_brake_is_recorded_and_replayed(connector, peer, tmp_path):
    with connector(
        "timeout:=.inf", "record.directory:=kept", "latency:=0", "friction.coefficient:=0.5",
        "friction.radius:=0.02",
    ):  # fmt: skip
        listener, source = Listener(peer), Source(peer)
        clamp = peer.node.create_publisher(Float64, "/connector/preload", 10)
        peer.spin_until(clamp.get_subscription_count)
        assert peer.call(Trigger, "/connector/start_recording").success
        for k in range(1, 4):
            listener.exchange(source, k * MS, position=(1e-3 * k, 0.0, 0.0))
        clamp.publish(Float64(data=7.0))
        peer.spin_until(lambda: listener.status("solution")[2].get("preload [N]") == "7")
        for k in range(4, 9):
            listener.exchange(source, k * MS, position=(1e-3 * k, 0.0, 0.0))
        peer.spin_until(lambda: listener.states)
        assert peer.call(Trigger, "/connector/stop_recording").success
        second = peer.node.create_publisher(Float64, "/connector/preload", 10)
        listener.wait_for_status("topics", "/connector/preload has 2 publishers, expected one")
        peer.node.destroy_publisher(second)
    run = read_run(next((tmp_path / "kept").iterdir()))
    state = run.state
    normal = state["normal_force"] - state["radial_force"] - state["bending_force"]
    before = state.stamp <= 3 * MS
    assert normal[before] == pytest.approx(0.0, abs=1e-9)
    assert normal[~before] == pytest.approx(7.0)
    (tmp_path / "scene.yaml").write_text(run.metadata["parameters"])
    assert_replayed(run, load(tmp_path / "scene.yaml"))
    _, checked = check_recording(run.path, lambda *_: None)
    assert checked.laws["friction_limit"].samples >= 5
    assert all(law.holds for law in checked.laws.values())
