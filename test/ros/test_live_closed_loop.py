"""Plant and connector as processes: the same numbers as in one process, and end of the plant."""

import re

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from paths import CONFIG
from recorded_loops import assert_replayed, scene_arguments, states
from ros_processes import Peer, installed, module, parameters, program, stamp_of

from cylconn_ros.core import layout
from cylconn_ros.recording.run import read_run
from cylconn_ros.scene.scene import Scene, load
from cylconn_ros.simulation.simulate import simulate

MS = 1_000_000


LOADS = {
    "plant.body_a.load": [0.1, -0.2, 0.3, 0.01, 0.02, -0.03],
    "plant.body_b.load": [1.0, 2.0, -3.0, 0.1, -0.2, 0.3],
}


DELAYED = {"latency": 2}


@pytest.mark.parametrize(
    ("name", "loads"), [("demo", {}), ("free_flight", LOADS), ("demo", DELAYED)]
)
def test_two_processes_give_the_same_numbers_as_one(name, loads, installed_prefix, tmp_path):
    steps = 300
    scene = Scene.from_parameters(load(CONFIG / f"{name}.yaml").parameters() | loads)
    rules = [f"plant.duration:={steps / 1000}", "record.enabled:=true"]
    rules += [f"{key}:={value}" for key, value in loads.items()]
    connector = [*installed(installed_prefix, "connector"), *scene_arguments(name, *rules)]
    plant = [*installed(installed_prefix, "plant"), *scene_arguments(name, *rules)]
    with program(connector, tmp_path) as connecting, program(plant, tmp_path) as moving:
        assert moving.wait() == 0, moving.output
        assert connecting.stop() == 0, connecting.output
    assert re.match(rf"plant: {steps} steps, 0\.3 s simulated in ", moving.lines[-1])
    assert "samples retransmitted 0;" in moving.lines[-1]

    run = read_run(next((tmp_path / "runs").iterdir()))
    stamp, found = states(run)
    expected = simulate(scene, samples=steps)
    assert np.array_equal(np.unique(stamp), np.arange(steps) * MS)
    _, first = np.unique(stamp, return_index=True)
    kept = [i for i in range(layout.NSTATE) if i + layout.STATE0 != layout.COMPUTING_TIME]
    np.testing.assert_array_equal(found[first][:, kept], expected.outs[:, layout.STATE][:, kept])
    assert_replayed(run, scene)
    poses = run.table(run.topic("body_b/pose"))
    _, first = np.unique(poses.stamp, return_index=True)
    height = np.column_stack([poses[key] for key in poses.columns if key.endswith("position.z")])
    np.testing.assert_array_equal(height[first][:, 0], expected.states[:, layout.B_POSE + 2])


def test_odometry_gives_the_same_numbers(installed_prefix, tmp_path):
    rules = ["plant.duration:=0.2", "record.enabled:=true", "input:=odometry"]
    connector = [*module("connector.node"), *scene_arguments("demo", *rules)]
    plant = [*module("plant.node"), *scene_arguments("demo", *rules)]
    with program(connector, tmp_path) as connecting, program(plant, tmp_path) as moving:
        assert moving.wait() == 0, moving.output
        assert "samples retransmitted 0;" in moving.lines[-1]
        assert connecting.stop() == 0
    stamp, found = states(read_run(next((tmp_path / "runs").iterdir())))
    expected = simulate(load(CONFIG / "demo.yaml"), samples=200).outs[:, layout.STATE]
    _, first = np.unique(stamp, return_index=True)
    for name in ("length", "angle", "normal_force", "force_friction"):
        at = layout.STATE_INDEX[name] - layout.STATE0
        np.testing.assert_allclose(found[first][:, at], expected[:, at], rtol=1e-6, atol=1e-9)


def test_restarted_plant_starts_a_new_history(installed_prefix, tmp_path):
    plant = [*installed(installed_prefix, "plant"), *scene_arguments("coast")]
    rules = ["record.enabled:=true", "timeout:=.inf"]
    connector = [*installed(installed_prefix, "connector"), *scene_arguments("coast", *rules)]
    short = ["-p", "plant.duration:=0.05", "-p", "plant.progress:=true"]
    with program(connector, tmp_path) as connecting:
        for _ in range(2):
            with program([*plant, *short], tmp_path) as moving:
                assert moving.wait() == 0, moving.output
                assert "progress 50 50" in moving.lines
                assert "samples retransmitted 0;" in moving.lines[-1]
        assert connecting.stop() == 0
    stamp, found = states(read_run(next((tmp_path / "runs").iterdir())))
    displacement = found[:, layout.DISPLACEMENT - layout.STATE0]
    starts = np.flatnonzero(stamp == 0)
    assert displacement[starts[-1]] == 0.0
    assert displacement[stamp == 49 * MS][0] == displacement[stamp == 49 * MS][-1] > 0.0


@pytest.mark.parametrize("rate", [0.0, 200.0])
def test_free_running_plant_keeps_its_rate(rate, installed_prefix, tmp_path):
    rules = ["plant.lock_step:=false", f"plant.rate:={rate}", "plant.duration:=0.5"]
    rules.append("period:=0.005")
    connector = [*installed(installed_prefix, "connector"), *scene_arguments("coast", *rules)]
    plant = [*installed(installed_prefix, "plant"), *scene_arguments("coast", *rules)]
    with program(connector, tmp_path), program(plant, tmp_path) as moving:
        assert moving.wait() == 0, moving.output
    summary = re.match(
        r"plant: 100 steps, 0\.5 s simulated in ([0-9.]+) s .*, (\d+) steps without a new wrench",
        moving.lines[-1],
    )
    assert summary, moving.output
    assert float(summary[1]) >= 0.49
    assert int(summary[2]) < 100


class FakeConnector:
    """A connector that sends only the wrenches of the test."""

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self.poses = peer.collect(PoseStamped, "/body_b/pose")
        self.twists = peer.collect(TwistStamped, "/body_b/twist")
        self.publisher = peer.node.create_publisher(WrenchStamped, "/body_b/wrench", 50)

    def send(self, stamp: int, force: float = 0.0) -> None:
        message = WrenchStamped()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        message.wrench.force.x = force
        self.publisher.publish(message)

    def wait_for(self, stamp: int) -> PoseStamped:
        """Wait for the sample with a stamp."""
        found = self.peer.spin_until(
            lambda: [pose for pose in self.poses if stamp_of(pose) == stamp], f"sample {stamp}"
        )
        return found[0]


def test_lock_step_accepts_only_the_wrench_of_the_sample(installed_prefix, tmp_path):
    peer = Peer()
    try:
        fake = FakeConnector(peer)
        rules = ["gravity:=[0, 0, 0]", "plant.duration:=0.003"]
        command = [*installed(installed_prefix, "plant"), *parameters(*rules)]
        with program(command, tmp_path) as moving:
            fake.wait_for(0)
            fake.send(7 * MS, 1000.0)  # not of this sample
            peer.spin_for(0.2)
            assert {stamp_of(pose) for pose in fake.poses} == {0}
            fake.send(0, 4.0)
            fake.wait_for(1 * MS)
            fake.send(0, 1000.0)  # the previous wrench again
            fake.send(1 * MS, 4.0)
            pose = fake.wait_for(2 * MS)
            assert pose.pose.position.x == pytest.approx(2.0 * 0.002**2 / 2.0)  # 4 N on 2 kg
            peer.spin_until(
                lambda: sum(stamp_of(p) == 2 * MS for p in fake.poses) > 1, "a retransmission"
            )
            fake.send(2 * MS)
            assert moving.wait() == 0, moving.output
        assert "3 steps, 0.003 s simulated" in moving.lines[-1]
        assert "wrenches repeated 1, ignored 1, undecodable 0" in moving.lines[-1]
    finally:
        peer.close()


def test_lock_step_without_wrench_ends_with_one_line(installed_prefix, tmp_path):
    peer = Peer()
    try:
        fake = FakeConnector(peer)
        command = [*installed(installed_prefix, "plant"), *parameters("plant.timeout:=0.6")]
        with program(command, tmp_path) as moving:
            fake.wait_for(0)
            assert moving.wait() == 1
        text = "plant: no wrench for the sample at 0 s on /body_b/wrench within 0.6 s"
        assert any(line.startswith(text) for line in moving.lines), moving.output
        again = re.search(r"samples retransmitted (\d+)", moving.lines[-1])
        assert again, moving.output
        assert int(again[1]) == 0
        assert "Traceback" not in moving.output
    finally:
        peer.close()


def test_plant_needs_a_period(installed_prefix, tmp_path):
    command = [*installed(installed_prefix, "plant"), *parameters("period:=0.0")]
    with program(command, tmp_path) as moving:
        assert moving.wait() == 2
        assert list(moving.lines) == [
            "plant: period = 0.0: must be > 0 s for a plant, which creates the stamps"
        ]


def test_plant_waits_for_a_connector_and_ends_in_order(installed_prefix, tmp_path):
    command = [*installed(installed_prefix, "plant"), *parameters()]
    with program(command, tmp_path) as moving:
        moving.wait_for("plant: waiting for a connector on /body_b/pose, /body_b/twist")
        assert moving.stop() == 0
        assert moving.lines[-1].startswith("plant: 0 steps, 0 s simulated")
