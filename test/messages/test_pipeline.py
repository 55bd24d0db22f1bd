"""The message pipeline without processes: outputs, duplicates, zero wrenches, scene changes."""

import numpy as np
import pytest
from pipelines import MS, Loop, make

from cylconn_ros.connector.connector import Connector
from cylconn_ros.connector.frames import into_world
from cylconn_ros.core import layout
from cylconn_ros.errors import RecordingError
from cylconn_ros.messages import cdr_decoder
from cylconn_ros.messages.cdr_encoder import StampedWriter
from cylconn_ros.messages.pipeline import MessagePipeline
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.ros.connector.recorder import Recorder
from cylconn_ros.ros.plant.exchange import Exchange, PlantCounts
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.plant import Plant


@pytest.mark.parametrize("mode", ["pose_twist", "odometry"])
def test_outputs_are_those_of_the_connector(mode):
    scene = make(input=mode, friction__coefficient=0.2)
    loop, connector = Loop(scene), Connector(scene)
    sample = np.zeros(layout.NSAMPLE)
    for k in range(5):
        sample[layout.MOTION] = loop.plant.state
        out = connector.step(sample)
        response = loop.step()
        assert response.stamp == k * MS
        for data, at in ((response.wrench_a, layout.FORCE_A), (response.wrench_b, layout.FORCE_B)):
            read = cdr_decoder.read_wrench(data)
            assert read.stamp == k * MS
            np.testing.assert_allclose(read.values, out[at : at + 6], rtol=1e-9, atol=1e-9)
        joints = cdr_decoder.read_joint_state(response.joint_state)
        assert joints.positions == pytest.approx((out[layout.LENGTH], out[layout.ANGLE]))
        assert joints.velocities == pytest.approx(
            (out[layout.VELOCITY], out[layout.ANGULAR_VELOCITY])
        )
        assert joints.efforts == pytest.approx((out[layout.FORCE], out[layout.MOMENT]))
    assert out[layout.FORCE] != 0.0
    assert loop.pipeline.health.regime == layout.SLIP
    assert 0.0 < loop.pipeline.health.worst_time < 1.0


@pytest.mark.parametrize(
    ("axes", "frames"), [("body", ("body_a", "body_b")), ("world", ("world", "world"))]
)
def test_the_frame_of_a_wrench_names_its_axes(axes, frames):
    response = Loop(make(wrench__axes=axes)).sample()
    assert response is not None
    assert (
        cdr_decoder.read_wrench(response.wrench_a).frame,
        cdr_decoder.read_wrench(response.wrench_b).frame,
    ) == frames


def test_a_duplicate_sample_gets_the_same_bytes():
    loop = Loop(make())
    loop.step()
    first = loop.sample()
    memory = loop.pipeline.connector.memory
    assert loop.sample() == first
    assert np.array_equal(loop.pipeline.connector.memory, memory, equal_nan=True)


def test_zero_wrenches_have_a_newer_stamp_than_the_last_sample():
    loop = Loop(make())
    assert loop.pipeline.zero() is None
    loop.step()
    response = loop.sample()
    zero = loop.pipeline.zero()
    assert response is not None
    assert zero is not None
    assert zero.stamp == response.stamp + 1
    for data in (zero.wrench_a, zero.wrench_b):
        assert cdr_decoder.read_wrench(data)[0:3:2] == (zero.stamp, (0.0,) * 6)
    assert zero.state is None
    loop.exchange.receive(1, zero.wrench_b, loop.plant.time_ns)  # lock step does not take it
    assert not loop.exchange.complete


def test_undecodable_and_unusable_messages_are_counted_and_give_no_wrench():
    loop = Loop(make())
    receive = loop.pipeline.inputs["body_b/pose"].receive
    assert receive(b"") is None
    assert receive(b"\x00\x01\x00\x00" + bytes(7)) is None
    assert loop.pipeline.health.undecodable == 2
    loop.plant.state[layout.B_POSE + 3 : layout.B_POSE + 7] = 0.0
    response = loop.sample()
    assert cdr_decoder.read_wrench(response.wrench_b).values == (0.0,) * 6
    assert loop.pipeline.health.bad_quaternion == 1


def test_a_failing_step_gives_zero_wrenches_and_a_text(monkeypatch):
    loop = Loop(make())

    def fail(*_):
        raise ZeroDivisionError("broken")

    monkeypatch.setattr(loop.pipeline.connector, "step", fail)
    response = loop.sample()
    assert cdr_decoder.read_wrench(response.wrench_a).values == (0.0,) * 6
    assert response.state is None
    assert loop.pipeline.health.failure == "ZeroDivisionError: broken"


def test_a_change_of_friction_keeps_the_history():
    loop = Loop(make())
    for _ in range(10):
        loop.step()
    before = loop.sample()
    loop.pipeline = MessagePipeline(make(friction__coefficient=0.3), loop.pipeline)
    assert loop.pipeline.continues
    assert loop.sample() == before  # a duplicate
    loop.exchange.receive(0, before.wrench_a, loop.plant.time_ns)
    loop.exchange.receive(1, before.wrench_b, loop.plant.time_ns)
    loop.plant.step(*loop.exchange.wrenches)
    loop.step()
    out = loop.pipeline.out
    assert out[layout.DISPLACEMENT] == pytest.approx(0.5 * 0.011, rel=0.01)
    assert out[layout.FRICTION_COEFFICIENT] == pytest.approx(0.3)
    assert loop.pipeline.matcher.counts.samples == 12


@pytest.mark.parametrize(
    "change",
    [{"node_b__position": [0.1, 0, 0]}, {"reference__offsets": "zero"}, {"body_a__mass": 2}],
)
def test_a_change_of_geometry_or_inertia_starts_a_new_history(change):
    loop = Loop(make())
    for _ in range(10):
        loop.step()
    parameters = make().parameters() | {k.replace("__", "."): v for k, v in change.items()}
    loop.pipeline = MessagePipeline(Scene.from_parameters(parameters), loop.pipeline)
    assert not loop.pipeline.continues
    loop.step()
    assert loop.pipeline.out[layout.DISPLACEMENT] == 0.0
    assert loop.pipeline.matcher.counts.samples == 11


def test_a_recorder_counts_and_reports_errors_of_the_disk(tmp_path):
    recorder = Recorder()
    topics = [TopicInfo("/body_b/pose", "geometry_msgs/msg/PoseStamped")]
    recorder.write("/body_b/pose", b"", 0)  # ignored: not recording
    with pytest.raises(RecordingError, match="not recording"):
        recorder.stop()
    first = recorder.start(tmp_path, "joint", topics, {}, "zstd")
    with pytest.raises(RecordingError, match="already recording"):
        recorder.start(tmp_path, "joint", topics, {}, "zstd")
    recorder.write("/body_b/pose", b"\x00\x01\x00\x00", 5)
    recorder.write("/unknown", b"", 6)
    assert (recorder.recorded, recorder.lost) == (1, 1)
    assert "/unknown" in recorder.failure
    assert recorder.stop() == f"recorded 1 messages in {first}"
    second = recorder.start(tmp_path, "joint", topics, {}, "zstd")  # within the same second
    assert second != first
    recorder.stop()
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError):
        recorder.start(tmp_path / "file", "joint", topics, {}, "zstd")
    assert not recorder.running


def test_stamps_that_go_back_start_a_new_history():
    scene = make()
    loop = Loop(scene)
    for _ in range(30):
        loop.step()
    assert loop.pipeline.out[layout.DISPLACEMENT] > 0.01
    loop.plant = Plant(scene)
    response = loop.sample()
    assert response is not None
    assert response.stamp == 0
    assert loop.pipeline.out[layout.DISPLACEMENT] == 0.0
    assert loop.pipeline.matcher.counts.restarts == 1


@pytest.mark.parametrize("frame", ["world", "body_b"])
def test_a_load_that_arrives_after_its_wrench_is_no_latency(frame: str) -> None:
    """Lock step, each load newer than its wrench at every third sample: no bit but its own."""
    rng, writer = np.random.default_rng(3), StampedWriter(frame)
    loops = [Loop(make(latency=latency)) for latency in (0, -1)]
    for k in range(120):
        load = np.array([0.0, *rng.uniform(-5.0, 5.0, 2), 0.0, 0.0, 0.0])
        for loop in loops:
            late, sent = k % 3 == 2, writer.write(loop.plant.time_ns, load)
            receive = loop.pipeline.inputs["body_b/load"].receive
            if not late:
                assert receive(sent) is None
            response = loop.sample()
            if response is None:  # it waits for the load
                response = loop.pipeline.give_up()
            assert response is not None
            if late:
                receive(sent)
            pose = loop.plant.state[13:20].tolist()
            acting = load if frame == "world" else into_world(pose, load.tolist())
            loop.plant.loads[6:] = acting
            loop.exchange.receive(0, response.wrench_a, loop.plant.time_ns)
            loop.exchange.receive(1, response.wrench_b, loop.plant.time_ns)
            loop.plant.step(*loop.exchange.wrenches)
            loop.exchange.begin_sample()
        exact, measured = loops[0].pipeline, loops[1].pipeline
        np.testing.assert_array_equal(
            measured.out[: layout.COMPUTING_TIME], exact.out[: layout.COMPUTING_TIME]
        )
    assert measured.matcher.counts.late_loads == 40
    assert measured.connector.measured_latency == 0.0


def wrench(stamp: int, force: float) -> bytes:
    return StampedWriter("body_b").write(stamp, np.array([force, 0.0, 0.0, 0.0, 0.0, 0.0]))


def test_a_plant_in_lock_step_uses_wrenches_with_its_own_stamp_only():
    counts = PlantCounts()
    exchange = Exchange(make(), counts)
    exchange.receive(1, wrench(4 * MS, 1.0), 5 * MS)
    exchange.receive(1, wrench(6 * MS, 1.0), 5 * MS)
    exchange.receive(1, b"garbage", 5 * MS)
    assert not exchange.wrenches[1].any()
    exchange.receive(1, wrench(5 * MS, 2.0), 5 * MS)
    exchange.receive(1, wrench(5 * MS, 3.0), 5 * MS)
    assert exchange.wrenches[1][0] == 2.0
    assert exchange.missing == ["body_a/wrench"]
    assert (counts.ignored, counts.repeated, counts.undecodable) == (2, 1, 1)


def test_a_free_running_plant_uses_the_newest_wrench():
    counts = PlantCounts()
    exchange = Exchange(make(plant__lock_step=False), counts)
    for stamp, force in ((4, 1.0), (3, 2.0), (6, 3.0)):
        exchange.receive(1, wrench(stamp * MS, force), 5 * MS)
    assert exchange.wrenches[1][0] == 3.0
    assert counts.ignored == 1
    assert not exchange.complete
