"""Replay of recordings, also of other software; comparison with the recorded outputs."""

from __future__ import annotations

import re
import sqlite3
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from odometry_bag import odometry_bag
from scenes import bundled

from cylconn_ros.cli import main as cylconn
from cylconn_ros.core import layout
from cylconn_ros.errors import RecordingError
from cylconn_ros.messages.cdr_encoder import StampedWriter, StateWriter
from cylconn_ros.recording import writer as writer_module
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.message_definitions import Interface, interface
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.recording.run import read_run
from cylconn_ros.recording.writer import RunWriter
from cylconn_ros.reference.library import LIBRARY
from cylconn_ros.replay.compare import Comparison
from cylconn_ros.replay.replay import Replay
from cylconn_ros.scene.resources import shipped
from cylconn_ros.simulation.simulate import simulate

Result = tuple[int, str, str]
Command = Callable[..., Result]
STEPS = 200


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str]) -> Command:
    def run(*arguments: object) -> Result:
        code = cylconn.main(["replay", *map(str, arguments)])
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return run


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated run, recorded as by the node."""
    path = tmp_path_factory.mktemp("runs") / "demo"
    code = cylconn.main(["simulate", "demo", "--steps", str(STEPS - 1), "-o", str(path)])
    assert code == 0
    return path


@pytest.mark.parametrize("method", ["auto", "minimal"])
@pytest.mark.parametrize("name", sorted(LIBRARY))
def test_a_simulated_run_replays_identically(
    name: str, method: str, tmp_path: Path, command: Command
) -> None:
    """With its constant loads; a motion computed offline tells no latency."""
    out, given = tmp_path / "run", ["--set", f"method={method}"] if method != "auto" else []
    assert cylconn.main(["simulate", name, *given, "--duration", "0.05", "-o", str(out)]) == 0
    code, printed, _ = command(out, "--compare")
    assert (code, "\noutputs identical\n" in printed) == (0, True)


def test_a_replay_is_identical(recorded: Path, command: Command) -> None:
    code, out, _ = command(recorded, "--compare")
    assert code == 0
    assert f"/connector/state: {STEPS} compared, identical" in out
    assert "\noutputs identical\n" in out


def test_the_replay_is_a_run(recorded: Path, command: Command, tmp_path: Path) -> None:
    """The output of a replay is a recording that can be read and replayed."""
    code, out, _ = command(recorded, "-o", tmp_path / "again")
    assert code == 0
    assert "next: cylconn info" in out
    old, new = read_run(recorded), read_run(tmp_path / "again")
    assert new.incomplete is None
    assert old.counts == {t: n for t, n in new.counts.items() if n}
    for topic in ("/body_b/wrench", "/connector/joint_state", "/body_b/pose"):
        assert [m[2] for m in old.raw(topic)] == [m[2] for m in new.raw(topic)]
    assert command(tmp_path / "again", "--compare")[0] == 0
    code, _, err = command(recorded, "-o", tmp_path / "again")
    assert code == 2
    assert "never overwritten" in err


def test_other_parameters_give_differences(
    recorded: Path, command: Command, tmp_path: Path
) -> None:
    """With other parameters, single or from a file, the first differences are reported."""
    code, out, _ = command(recorded, "--compare", "--set", "friction.coefficient=0.4")
    assert code == 1
    assert "BEYOND  force_friction: at most" in out
    assert "OUTPUTS DIFFER" in out
    assert command(recorded, "--compare", "--set", "friction.coefficient=0.4",
                   "--tolerance", 10.0)[0] == 0  # fmt: skip
    other = tmp_path / "other.yaml"
    other.write_text("/**:\n  ros__parameters:\n    method: baumgarte\n")
    code, out, _ = command(recorded, "--params", other)
    assert code == 0
    assert "model       method baumgarte" in out
    assert command(recorded, "--set", "friction.coefficient=-1")[0] == 2
    assert command(recorded, "--set", "friction")[0] == 2


def test_one_changed_byte_is_found(recorded: Path, command: Command, tmp_path: Path) -> None:
    """A wrench that differs in its last bit, at one sample, is reported."""
    changed, run = tmp_path / "changed", Bag(recorded)
    topics = Replay(run, bundled("demo")).topics()
    with RunWriter(changed, topics, run.metadata) as writer:
        for k, (topic, log_time, data) in enumerate(run.messages()):
            if topic == "/body_b/wrench" and 500 < k < 507:
                data = data[:-8] + bytes([data[-8] ^ 1]) + data[-7:]
            writer.write(topic, data, log_time, log_time)
    code, out, _ = command(changed, "--compare")
    assert code == 1
    assert "/body_b/wrench: 200 compared, 1 differ" in out
    assert "wrench.torque.z" in out
    assert command(changed, "--compare", "--tolerance", 1e-12)[0] == 0


@pytest.mark.parametrize("uneven", [False, True])
def test_odometry_of_other_software(uneven: bool, command: Command, tmp_path: Path) -> None:
    odometry_bag(tmp_path / "bag", uneven)
    scene = tmp_path / "scene.yaml"
    from cylconn_ros.scene.parameter_file import dump

    scene.write_text(dump(bundled("demo")))
    asked = (tmp_path / "bag", "--params", scene, "--set", "input=odometry",
             "--remap", "body_b/odom:=/robot/sleeve", "--set", "body_b.frame=sleeve")  # fmt: skip
    code, out, _ = command(*asked, "-o", tmp_path / "out")
    assert code == 0
    state = read_run(tmp_path / "out").state
    exact = simulate(bundled("demo"), samples=STEPS).outs
    if uneven:
        assert 0.8 * STEPS < len(state) < STEPS
        assert "not one period apart" in out
        assert np.isfinite(state["force"]).all()
    else:
        np.testing.assert_allclose(state["force"], exact[:, layout.FORCE : layout.FORCE + 3],
                                   rtol=1e-9, atol=1e-9)  # fmt: skip
    assert "of other topics" in out
    code, _, err = command(*asked[:3], "--set", "input=odometry", "--set", "body_b.frame=sleeve")
    assert code == 2, "topics are not guessed"
    assert "/robot/sleeve (nav_msgs/msg/Odometry)" in err


def with_other_schema(recorded: Path, path: Path, field: str, line: str, change: int) -> Path:
    """A copy of a recording, its ConnectorState with another schema and 8 bytes more or less.

    ``line`` replaces the definition of ``field``, the first of the block of numbers.
    """
    run, kind = Bag(recorded), "cylconn_ros/msg/ConnectorState"
    topics = Replay(run, bundled("demo")).topics()
    interfaces = {topic.type: interface(topic.type) for topic in topics}
    known = interfaces[kind]
    definition = re.sub(rf"(?m)^float64 {field} .*$", line, known.definition)
    interfaces[kind] = Interface(kind, definition, known.type_hash)
    (at, _) = StateWriter(bundled("demo").body_a.frame, "impulse").blocks
    with RunWriter(path, topics, run.metadata, interfaces=interfaces) as writer:
        for topic, log_time, data in run.messages():
            if run.types[topic] == kind:
                data = data[:at] + bytes(max(change, 0)) + data[at + max(-change, 0) :]
            writer.write(topic, data, log_time, log_time)
    return path


def test_a_recording_is_decoded_by_its_own_schema(
    recorded: Path, command: Command, tmp_path: Path
) -> None:
    """Fields of both schemas are compared; fields of one schema are reported."""
    lacking = with_other_schema(recorded, tmp_path / "lacking", "length", "", -8)
    code, out, _ = command(lacking, "--compare")
    assert code == 0
    assert f"/connector/state: {STEPS} compared, identical" in out
    assert "not compared: fields only in the replay: length" in out
    assert "\noutputs identical\n" in out
    extended = with_other_schema(
        recorded, tmp_path / "extended", "length", "float64 temperature\nfloat64 length", 8
    )
    code, out, _ = command(extended, "--compare")
    assert code == 0
    assert "not compared: fields only in the recording: temperature" in out
    code, out, _ = command(extended, "--compare", "--set", "friction.coefficient=0.4")
    assert code == 1
    assert "BEYOND  force_friction: at most" in out
    assert command(lacking)[0] == 0


def test_sqlite_bags(recorded: Path, command: Command, tmp_path: Path) -> None:
    """SQLite storage, the default before Jazzy."""
    file = tmp_path / "old.db3"
    bag = Bag(recorded)
    with sqlite3.connect(file) as database:
        database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT)")
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INT, timestamp INT, data BLOB)"
        )
        ids = {name: k for k, name in enumerate(bag.types)}
        rows = [(k, name, bag.types[name]) for name, k in ids.items()]
        database.executemany("INSERT INTO topics VALUES(?,?,?)", rows)
        found = [(ids[topic], when, data) for topic, when, data in bag.messages()]
        database.executemany("INSERT INTO messages VALUES(NULL,?,?,?)", found)
    database.close()
    assert command(file, "--params", shipped("demo"), "--compare")[0] == 0


def test_damaged_bags_are_replayed_as_far_as_readable(
    recorded: Path, command: Command, tmp_path: Path
) -> None:
    whole = next(recorded.glob("*.mcap")).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    code, out, _ = command(cut, "--compare")
    assert code == 1
    assert "DAMAGED" in out
    assert "identical" in out
    for content, text in (
        (b"", "contains no readable message"),
        (b"hello, this is text" * 9, "contains no readable message"),
        (whole[:100], "contains no readable message"),
    ):
        cut.write_bytes(content)
        code, _, err = command(cut)
        assert code == 2
        assert text in err


def test_errors_name_the_missing_input(recorded: Path, command: Command, tmp_path: Path) -> None:
    for arguments, text in (
        ((tmp_path / "none",), "No such file or directory"),
        ((tmp_path,), "not a recording"),
        ((recorded, "--set", "input=odometry"), "lacks body_b/odom (nav_msgs/msg/Odometry"),
        ((recorded, "--remap", "odom:=/x"), "odom: is no input of this scene; its inputs are"),
        ((recorded, "--remap", "body_b/pose:=/body_b/twist"), "body_b/pose must be geometry"),
        ((recorded, "--remap", "x"), "must be INPUT:=TOPIC"),
    ):
        code, _, err = command(*arguments)
        assert code == 2
        assert text in err


def test_topics_of_two_types_are_left_out(recorded: Path, tmp_path: Path) -> None:
    both = tmp_path / "both"
    both.mkdir()
    (both / "0.mcap").write_bytes(next(recorded.glob("*.mcap")).read_bytes())
    with sqlite3.connect(both / "1.db3") as database:
        database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT)")
        database.execute("INSERT INTO topics VALUES(1, '/body_b/pose', 'std_msgs/msg/String')")
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INT, timestamp INT, data BLOB)"
        )
    database.close()
    bag = Bag(both)
    assert "/body_b/pose" not in bag.types
    assert "std_msgs/msg/String" in bag.source.left_out["/body_b/pose"]
    with pytest.raises(RecordingError, match="lacks body_b/pose"):
        Replay(bag, bundled("demo"))


def long_bag(path: Path, count: int) -> Path:
    """Poses and twists of ``count`` samples, without outputs."""
    run = simulate(bundled("demo"), samples=50)
    places = {"/body_b/pose": (layout.B_POSE, 7), "/body_b/twist": (layout.B_TWIST, 6)}
    kinds = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TwistStamped")
    topics = [TopicInfo(name, kind) for name, kind in zip(places, kinds, strict=True)]
    writers = {name: StampedWriter("world", number) for name, (_, number) in places.items()}
    with RunWriter(path, topics, {}, "none") as writer:
        for k in range(count):
            for name, (at, number) in places.items():
                values = np.ascontiguousarray(run.states[k % 50, at : at + number])
                data = writers[name].write(k * 1_000_000, values)
                writer.write(name, data, k * 1_000_000, 0)
    return path


@pytest.mark.parametrize("iterator", ["messages", "parts"])
def test_memory_does_not_grow_with_the_bag(
    iterator: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bag four times as long needs the same memory, apart from the sizes of chunks."""
    monkeypatch.setattr(
        writer_module, "INTERVAL", 60.0
    )  # chunks of one size, also on a busy machine
    peaks = []
    for count in (20_000, 80_000):
        replay = Replay(Bag(long_bag(tmp_path / str(count), count)), bundled("demo"))
        replay.pipeline.wanted = lambda _: False
        tracemalloc.start()
        for _ in getattr(replay, iterator)():
            pass
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert replay.counts.responses == count
    assert peaks[1] < 2.0 * peaks[0]


def test_arrays_of_messages_are_compared_as_single_messages() -> None:
    """With missing, duplicate and different messages, in one call or message by message."""
    rng = np.random.default_rng(3)
    kind, topic = "geometry_msgs/msg/WrenchStamped", "/w"
    for _ in range(50):
        stamps = np.sort(rng.choice(60, 40, replace=bool(rng.integers(2)))) * 1000 + 10**9
        values = rng.normal(size=(40, 6))
        recorded = StampedWriter("a").rows(stamps, values)
        values[rng.integers(0, 40, 3), rng.integers(0, 6, 3)] += 1e-3
        replayed = StampedWriter("a").rows(stamps, values)
        recorded = np.delete(recorded, rng.integers(0, 40, rng.integers(0, 4)), axis=0)
        replayed = np.delete(replayed, rng.integers(0, 40, rng.integers(0, 4)), axis=0)
        one, many = (Comparison({topic: kind}, {}, 1e-5) for _ in range(2))
        edges = sorted(rng.integers(0, 37, 2).tolist())
        for old, new in zip(np.split(recorded, edges), np.split(replayed, edges), strict=True):
            many.both(topic, old, new)
            for row in old:
                one.recorded(topic, row.tobytes())
            for row in new:
                one.replayed(topic, row.tobytes())
        assert many.result() == one.result()


def test_the_first_difference_above_the_tolerance_is_found_in_a_long_bag() -> None:
    """Increasing differences, first below the tolerance, in several lots of messages."""
    kind, topic, count = "geometry_msgs/msg/WrenchStamped", "/w", 10_000
    stamps = np.arange(count) * 1000
    values = np.ones((count, 6))
    recorded = StampedWriter("a").rows(stamps, values)
    values[:, 2] += 1e-8 * np.arange(count)
    values[77, 4] = 3.0
    comparison = Comparison({topic: kind}, {}, 0.5e-4)
    comparison.both(topic, recorded, StampedWriter("a").rows(stamps, values))
    (found,) = comparison.result()
    assert (found.same, found.different) == (1, count - 1)
    torque, force = found.differences
    assert (torque.field, torque.first, torque.recorded, torque.replayed) == (
        "wrench.torque.y", 77_000, 1.0, 3.0,
    )  # fmt: skip
    assert force.field == "wrench.force.z"
    assert 5000 < force.first / 1000 < 5060
    assert force.worst == pytest.approx(1e-8 * (count - 1))
