"""Golden bags: real recordings in bags/, whose outputs must come out again, offline and live."""

from __future__ import annotations

import dataclasses
import hashlib
import re
from pathlib import Path

import pytest
from paths import BAGS
from ros_processes import module, program

from cylconn_ros.messages.pipeline import STATE_TOPIC, MessagePipeline
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.run import read_run
from cylconn_ros.replay.compare import Comparison, Topic
from cylconn_ros.replay.replay import Replay
from cylconn_ros.scene import parameter_file
from cylconn_ros.scene.scene import Scene

ROW = re.compile(r"^\| `(\w+)` \|.*\| `([0-9a-f]{64})` \|$", re.MULTILINE)
ROWS = ROW.findall((BAGS / "README.md").read_text())
NAMES = [name for name, _ in ROWS]
TOLERANCE = 1e-9  # of a field's greatest size, for other machines; on one they are identical


def told(topics: list[Topic]) -> str:
    """Where the outputs first part, for the message of a failure."""
    lines = []
    for topic in topics:
        if not topic.well:
            lines.append(f"{topic.name}: {topic.different} differ, {topic.only_recorded} missing")
        lines += [
            f"  {d.field}: first at {d.first} ns, recorded {d.recorded}, now {d.replayed}, "
            f"up to {d.worst:.3g}, {d.relative:.1e} of its size"
            for d in topic.differences
            if d.beyond
        ]
    return "\n".join(lines)


def compared(bag: Bag, replay: Replay) -> Comparison:
    kinds = {topic: replay.outputs[name] for name, topic in replay.names.items()}
    return Comparison({t: k for t, k in kinds.items() if t in bag.types}, replay.timing, TOLERANCE)


def recorded_scene(bag: Bag) -> Scene:
    return Scene.from_parameters(parameter_file.parameters_of(bag.metadata["parameters"]))


def of_bag(name: str) -> tuple[Bag, Replay]:
    bag = Bag(BAGS / name)
    return bag, Replay(bag, recorded_scene(bag))


def test_every_bag_is_described() -> None:
    """Name, provenance and checksum in the table; each below 1 MB."""
    assert sorted(NAMES) == sorted(path.name for path in BAGS.iterdir() if path.is_dir())
    for name, digest in ROWS:
        (file,) = (BAGS / name).glob("*.mcap")
        assert hashlib.sha256(file.read_bytes()).hexdigest() == digest
        assert sum(path.stat().st_size for path in (BAGS / name).iterdir()) < 1_000_000
        assert read_run(BAGS / name).incomplete is None


@pytest.mark.parametrize("name", NAMES)
def test_whole_trajectories_come_out_again(name: str) -> None:
    """Every field of every output of every sample, not only where it ends."""
    bag, replay = of_bag(name)
    comparison = compared(bag, replay)
    for item in replay.messages():
        if item.topic in comparison.topics:
            side = comparison.replayed if item.replayed else comparison.recorded
            side(item.topic, item.data)
    topics = comparison.result()
    assert all(topic.well for topic in topics), told(topics)
    assert all(topic.same + topic.different >= 100 for topic in topics)


def test_the_failure_says_where_and_by_how_much() -> None:
    """A friction coefficient changed in its fifth digit is found, and told."""
    bag, replay = of_bag("slide_and_spin")
    friction = dataclasses.replace(replay.scene.friction, coefficient=0.200002)
    replay.pipeline = MessagePipeline(dataclasses.replace(replay.scene, friction=friction))
    comparison = compared(bag, replay)
    for item in replay.messages():
        if item.topic not in comparison.topics:
            continue
        (comparison.replayed if item.replayed else comparison.recorded)(item.topic, item.data)
    topics = comparison.result()
    assert not all(topic.well for topic in topics)
    assert re.search(r"force_friction: first at \d+ ns, recorded .*, now .*, up to", told(topics))


@pytest.mark.parametrize("name", ["stop_impact", "two_free_bodies"])
def test_played_onto_live_topics_the_node_answers_the_same(name: str, tmp_path: Path) -> None:
    """The other way round: our player, the real node, and what it records."""
    bag, replay = of_bag(name)
    scene = tmp_path / "scene.yaml"
    scene.write_text(bag.metadata["parameters"])
    with program([*module("connector.node"), "--ros-args", "--params-file", scene,
                  "-p", "record.enabled:=true"], tmp_path) as node:  # fmt: skip
        node.wait_for("recording to")  # it listens, and is ready to answer
        with program([*module("player"), BAGS / name, "--rate", "0.4"], tmp_path) as player:
            assert player.wait() == 0, player.output
            assert "played" in player.output
        assert node.stop() == 0
    (again,) = (tmp_path / "runs").iterdir()
    comparison = compared(bag, replay)
    for topic, _, data in bag.messages():
        if topic in comparison.topics:
            comparison.recorded(topic, data)
    for topic, _, data in Bag(again).messages():
        if topic in comparison.topics:
            comparison.replayed(topic, data)
    topics = comparison.result()
    assert all(topic.well for topic in topics), told(topics)
    assert replay.names[STATE_TOPIC] in comparison.topics
