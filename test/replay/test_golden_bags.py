"""Golden bags: the recordings in bags/ replay to their outputs, offline and live."""

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
TOLERANCE = 1e-9  # of a field's largest value, for other machines; on one machine: identical


def text_of(topics: list[Topic]) -> str:
    """The differences, for the message of a failure."""
    lines = []
    for topic in topics:
        if not topic.well:
            lines.append(f"{topic.name}: {topic.different} differ, {topic.only_recorded} missing")
        lines += [
            f"  {d.field}: first at {d.first} ns, recorded {d.recorded}, replayed {d.replayed}, "
            f"up to {d.worst:.3g}, {d.relative:.1e} of its largest value"
            for d in topic.differences
            if d.beyond
        ]
    return "\n".join(lines)


def compared(bag: Bag, replay: Replay) -> Comparison:
    kinds = {topic: replay.outputs[name] for name, topic in replay.names.items()}
    types = {topic: kind for topic, kind in kinds.items() if topic in bag.types}
    return Comparison(types, replay.timing, TOLERANCE, bag.definitions)


def recorded_scene(bag: Bag) -> Scene:
    return Scene.from_parameters(parameter_file.parameters_of(bag.metadata["parameters"]))


def of_bag(name: str) -> tuple[Bag, Replay]:
    bag = Bag(BAGS / name)
    return bag, Replay(bag, recorded_scene(bag))


def test_every_bag_is_in_the_table_of_the_readme() -> None:
    """Name, provenance and checksum in the table; each below 1 MB."""
    assert sorted(NAMES) == sorted(path.name for path in BAGS.iterdir() if path.is_dir())
    for name, digest in ROWS:
        (file,) = (BAGS / name).glob("*.mcap")
        assert hashlib.sha256(file.read_bytes()).hexdigest() == digest
        assert sum(path.stat().st_size for path in (BAGS / name).iterdir()) < 1_000_000
        assert read_run(BAGS / name).incomplete is None


@pytest.mark.parametrize("name", NAMES)
def test_whole_trajectories_are_reproduced(name: str) -> None:
    """Every field of every output of every sample, not only the last."""
    bag, replay = of_bag(name)
    comparison = compared(bag, replay)
    for item in replay.messages():
        if item.topic in comparison.topics:
            side = comparison.replayed if item.replayed else comparison.recorded
            side(item.topic, item.data)
    topics = comparison.result()
    assert all(topic.well for topic in topics), text_of(topics)
    assert all(topic.same + topic.different >= 100 for topic in topics)


def test_a_failure_states_stamp_and_size_of_the_difference() -> None:
    """A friction coefficient changed in its fifth digit is found and reported."""
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
    assert re.search(
        r"force_friction: first at \d+ ns, recorded .*, replayed .*, up to", text_of(topics)
    )


@pytest.mark.parametrize("name", ["stop_impact", "two_free_bodies"])
def test_the_node_publishes_the_same_outputs_for_played_inputs(name: str, tmp_path: Path) -> None:
    """Player and node as processes; the recording of the node is compared."""
    bag, replay = of_bag(name)
    scene = tmp_path / "scene.yaml"
    scene.write_text(bag.metadata["parameters"])
    with program([*module("connector.node"), "--ros-args", "--params-file", scene,
                  "-p", "record.enabled:=true"], tmp_path) as node:  # fmt: skip
        node.wait_for("recording to")  # it is ready
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
    assert all(topic.well for topic in topics), text_of(topics)
    assert replay.names[STATE_TOPIC] in comparison.topics


def test_other_parameters_tell_no_latency() -> None:
    """The recorded motion does not follow from their wrenches, which act with their samples."""
    wrenches = []
    for latency in (0, -1):
        bag = Bag(BAGS / "slide_and_spin")
        changes = {"latency": latency, "friction.coefficient": 0.4}
        replay = Replay(bag, recorded_scene(bag).replace(changes))
        state = replay.names["~/state"]
        items = [item for item in replay.messages() if item.replayed]
        wrenches.append([item.data for item in items if item.topic != state])
    assert wrenches[0]
    assert wrenches[0] == wrenches[1]
