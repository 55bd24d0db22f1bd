"""Several connectors in one process: separate numbers, one run, diagnostics in turns."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from paths import CONFIG
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from recorded_loops import states
from ros_processes import Peer, Source, module, program, stamp_of
from std_srvs.srv import Trigger

from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.nodes import connectors
from cylconn_ros.cli import main
from cylconn_ros.core import layout
from cylconn_ros.errors import RecordingError
from cylconn_ros.process.child import private_environment
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.run import read_run
from cylconn_ros.scene.scene import load
from cylconn_ros.simulation.simulate import simulate

STEPS = 200
SCENE = """
/**:
  ros__parameters:
    connectors: [front, rear]
    node_a: {orientation: [0.0, 0.0, 0.0, 1.0]}
    body_b: {mass: 2.0, inertia: [0.01, 0.0, 0.0, 0.02, 0.0, 0.02]}
    friction: {coefficient: 0.2, radius: 0.02, overlap: 0.1}
    plant: {duration: 0.2, body_b: {twist: [0.3, 0.0, 0.0, 4.0, 0.0, 0.0]}}
    record: {enabled: true}
    rear: {friction: {coefficient: 0.4}, body_b: {mass: 3.0}}
"""


@pytest.fixture
def scene(tmp_path):
    file = tmp_path / "scene.yaml"
    file.write_text(SCENE, encoding="utf-8")
    return file


def ros(scene: Path, *more: str) -> list[str]:
    return ["--ros-args", "--params-file", str(scene), *more]


def command(*words: object) -> int:
    """Run a command of cylconn in this process; return the exit code."""
    return main.main([str(word) for word in words])


def test_each_connector_has_its_own_numbers_in_one_run(scene, tmp_path, capsys):
    with program([*module("connector.node"), *ros(scene)], tmp_path) as connecting:
        plants = [
            program([*module("plant.node"), *ros(scene, "-r", f"__ns:=/{name}")], tmp_path)
            for name in ("front", "rear")
        ]
        with plants[0] as front, plants[1] as rear:
            assert front.wait() == 0, front.output
            assert rear.wait() == 0, rear.output
        assert connecting.stop() == 0, connecting.output
    (run,) = (tmp_path / "runs").iterdir()
    assert read_run(run).connectors == ["front", "rear"]
    for name in ("front", "rear"):
        stamp, found = states(read_run(run, name))
        expected = simulate(load(scene, connector=name), samples=STEPS).outs[:, layout.STATE]
        _, first = np.unique(stamp, return_index=True)
        kept = [k for k in range(layout.NSTATE) if k + layout.STATE0 != layout.COMPUTING_TIME]
        np.testing.assert_array_equal(found[first][:, kept], expected[:, kept])
        assert command("replay", run, "--connector", name, "--compare") == 0
        assert "outputs identical" in capsys.readouterr().out
        assert command("info", run, "--connector", name) == 0
        assert "samples     20" in capsys.readouterr().out  # the last ones may be retransmitted
    kept = tmp_path / "rear_alone"
    assert command("replay", run, "--connector", "rear", "-o", kept) == 0
    assert command("replay", kept, "--compare") == 0
    assert command("laws", "--run", run, "--connector", "rear") == 0
    assert command("report", run, "--connector", "rear", "-o", tmp_path / "rear.html") == 0
    capsys.readouterr()
    assert command("info", run) == 0
    assert "2 connectors; details of one with --connector NAME" in capsys.readouterr().out
    assert command("replay", run, "--compare") == 0
    found = capsys.readouterr().out
    assert "front:\n" in found
    assert "outputs identical" in found
    assert command("replay", run, "--closed-loop") == 2
    assert "several connectors, front, rear: --closed-loop needs one" in capsys.readouterr().err
    with pytest.raises(RecordingError, match="has front, rear"):
        Bag(run, "side")


def test_connector_without_input_does_not_delay_the_other(scene, tmp_path):
    peer = Peer()
    try:
        reports = peer.collect(DiagnosticArray, "/diagnostics")
        with program([*module("connector.node"), *ros(scene)], tmp_path):
            wrenches = {
                name: peer.collect(WrenchStamped, f"/{name}/body_b/wrench")
                for name in ("front", "rear")
            }
            source = Source(peer, prefix="/rear")
            source.wait()

            def received():
                source.send(1_000_000)
                peer.spin_for(0.05)
                return wrenches["rear"]

            assert stamp_of(peer.spin_until(received)[0]) == 1_000_000
            assert not wrenches["front"]
            peer.spin_until(
                lambda: (
                    {status.name for array in reports for status in array.status}
                    >= {f"connector/{name}: samples" for name in ("front", "rear")}
                    | {"connector/front: recording"}
                ),
                "a report on both",
            )
            change(peer)
    finally:
        peer.close()


def test_many_connectors_are_reported_in_turns(tmp_path):
    names = [f"c{k}" for k in range(23)]
    scene = tmp_path / "scene.yaml"
    text = SCENE.replace("[front, rear]", f"[{', '.join(names)}]").replace("true", "false")
    scene.write_text(text.partition("    rear:")[0], encoding="utf-8")
    peer = Peer()
    try:
        reports = peer.collect(DiagnosticArray, "/diagnostics")
        with program([*module("connector.node"), *ros(scene)], tmp_path):
            wrong = peer.node.create_publisher(WrenchStamped, "/c22/body_b/pose", 10)
            peer.spin_until(
                lambda: "/c22/body_b/pose: a publisher has message type" in str(reports), "the type"
            )
            assert wrong.get_subscription_count() == 0
            peer.spin_until(lambda: len(reports) >= 8, "a report on all connectors")
    finally:
        peer.close()
    names_of = [[status.name for status in array.status] for array in reports]
    assert {len(one) for one in names_of} <= {
        9,
        10,
        6,
    }  # three connectors, the last two; the recording
    assert sum("connector/c22: samples" in one for one in names_of[-8:]) == 1
    every = {f"connector/{name}: {part}" for name in names for part in ("samples", "topics")}
    assert {name for one in names_of for name in one} >= every


def test_profile_for_many_messages_enlarges_the_socket_buffer(tmp_path):
    """On the loopback interface, without shared memory, which killed processes leave behind."""
    text = (CONFIG / "fastdds_many.xml").read_text(encoding="utf-8")
    kept, dropped = (
        "<type>UDPv4</type>",
        "<transport_id>memory_with_room</transport_id>\n          <",
    )
    assert text.count(kept) == text.count(dropped) == 1
    own = "<interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>"
    profile = tmp_path / "profile.xml"
    profile.write_text(text.replace(kept, kept + own).replace(dropped, "<"), encoding="utf-8")
    script = """
import os, socket, rclpy
rclpy.init()
node = rclpy.create_node("receives")
room = []
for name in os.listdir("/proc/self/fd"):
    try:
        with socket.socket(fileno=os.dup(int(name))) as one:
            if one.type == socket.SOCK_DGRAM:
                room.append(one.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF))
    except OSError:
        pass
print("room", max(room))
"""
    environment = {**os.environ, "FASTRTPS_DEFAULT_PROFILES_FILE": str(profile)}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, timeout=60
    )
    most = int(Path("/proc/sys/net/core/rmem_max").read_text())
    assert "XML" not in done.stdout + done.stderr
    assert int(done.stdout.partition("room")[2]) >= min(most, 4 << 20), done.stderr


def change(peer: Peer) -> None:
    """Assert that parameters have the prefix of their connector, also in error messages."""

    def set_parameter(name: str, value: float) -> tuple[bool, str]:
        number = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
        request = SetParameters.Request(parameters=[Parameter(name=name, value=number)])
        result = peer.call(SetParameters, "/connector/set_parameters", request).results[0]
        return result.successful, result.reason

    assert set_parameter("rear.friction.coefficient", 0.5) == (
        False,
        "parameters cannot change during a recording; call ~/stop_recording",
    )
    assert peer.call(Trigger, "/connector/stop_recording").success
    assert set_parameter("rear.friction.coefficient", 0.5)[0]
    refused = set_parameter("rear.friction.radius", -1.0)
    assert not refused[0]
    assert "rear.friction.radius = -1.0: must be" in refused[1]
    names = [f"{name}.friction.coefficient" for name in ("front", "rear")]
    request = GetParameters.Request(names=names)
    values = peer.call(GetParameters, "/connector/get_parameters", request).values
    assert [value.double_value for value in values] == [0.2, 0.5]


def test_plant_needs_a_namespace_that_names_a_connector(scene, tmp_path):
    with program([*module("plant.node"), *ros(scene, "-r", "__ns:=/side")], tmp_path) as moving:
        assert moving.wait() == 2
        assert "the plant's namespace must end with one of these names" in moving.output


def test_quick_connectors_benchmark(monkeypatch):
    monkeypatch.setattr(connectors, "_NUMBERS", (1, 3))
    monkeypatch.setattr(
        connectors, "_CAPACITIES", [connectors.Capacity(3, 50.0, ("body_a", "body_b"))]
    )
    found = connectors.measure(Settings.short(load), private_environment())
    lost = [m for m in found.measurements if m.quantity == "lost"]
    assert {m.subject for m in lost} == {
        "1 connector",
        "3 connectors",
        "3 at 50 Hz, both bodies free",
    }
    assert len([t for t in found.targets if "3 connectors to 1" in t.name]) == 2
