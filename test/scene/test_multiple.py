"""Several connectors in one file: whose parameter is whose, what is refused; and who rings."""

import os
import select
from pathlib import Path

import pytest

from cylconn_ros.scene import multiple
from cylconn_ros.scene.parameter_file import dump, dump_several, parameters_of
from cylconn_ros.scene.scene import SceneError, load, several

LEAST = {
    "node_a": {"orientation": [0.0, 0.0, 0.0, 1.0]},
    "body_b": {"mass": 1.0, "inertia": [0.002, 0.0, 0.0, 0.003, 0.0, 0.004]},
}


def make(**changes):
    return several({"connectors": ["front", "rear"], **LEAST, **changes})


def test_without_names_there_is_one_as_ever():
    (name,) = scenes = several(LEAST)
    assert name == multiple.ONE
    assert scenes[name].body_b.frame == "body_b"
    assert parameters_of(dump(scenes[name])) == parameters_of(dump_several(scenes))


def test_a_block_overrules_what_holds_for_all():
    scenes = make(period=0.002, rear={"period": 0.004, "body_b": {"mass": 3.0}})
    assert {name: scene.period for name, scene in scenes.items()} == {"front": 0.002, "rear": 0.004}
    assert {name: scene.body_b.mass for name, scene in scenes.items()} == {
        "front": 1.0,
        "rear": 3.0,
    }


def test_bodies_are_not_in_common_unless_somebody_says_so():
    scenes = make(rear={"body_a": {"frame": "rail"}})
    frames = [body.frame for scene in scenes.values() for body in scene.bodies]
    assert frames == ["front/body_a", "front/body_b", "rail", "rear/body_b"]


def test_what_is_written_is_read_again():
    scenes = make(record={"directory": "elsewhere"}, rear={"friction.radius": 0.01})
    again = several(parameters_of(dump_several(scenes)))
    assert dump_several(again) == dump_several(scenes)
    assert {scene.record.directory for scene in again.values()} == {"elsewhere"}


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"connectors": []}, "connectors = []: must be a list of names"),
        ({"connectors": "front"}, "connectors = 'front': must be a list of names"),
        ({"connectors": ["a", "b", "a"]}, "'a' is given twice"),
        ({"connectors": ["a__b"]}, "'a__b' is not"),
        ({"connectors": ["1st"]}, "'1st' is not"),
        ({"connectors": [1]}, "1 is not"),
        ({"connectors": ["friction"]}, "'friction' is the name of a parameter"),
        ({"front": 3}, "front = 3: must be a block with the parameters of this connector"),
        ({"front": {"record": {"enabled": True}}}, "give record.enabled outside the block front"),
        ({"front": {"period": -1}}, "front.period = -1: must be a number >= 0 s and <= 1e+06 s"),
        ({"rear": {"friction": {"coefficient": 0.3}}}, "rear.friction.radius"),
        ({"side": {"period": 0.1}}, "side.period = 0.1: no such parameter"),
    ],
)
def test_what_cannot_be_is_refused_by_name(changes, text):
    with pytest.raises(SceneError) as caught:
        make(**changes)
    assert text in str(caught.value)


def test_one_of_a_file_is_chosen_by_name(tmp_path: Path):
    file = tmp_path / "scene.yaml"
    file.write_text(dump_several(make(rear={"period": 0.004})), encoding="utf-8")
    assert load(file, connector="rear").period == 0.004
    with pytest.raises(SceneError, match="several connectors, front, rear: choose one"):
        load(file)
    with pytest.raises(SceneError, match="side is none of them"):
        load(file, connector="side")
    file.write_text(dump(several(LEAST)[multiple.ONE]), encoding="utf-8")
    with pytest.raises(SceneError, match="there is only one, without a name"):
        load(file, connector="rear")


def test_every_ringing_is_heard_though_no_counter_is_read():
    """What ros/executor/new_message_event.py relies on: an edge for each write to an eventfd."""
    descriptor = os.eventfd(0, os.EFD_NONBLOCK)
    with select.epoll() as poll:
        poll.register(descriptor, select.EPOLLIN | select.EPOLLET)
        for _ in range(3):
            os.eventfd_write(descriptor, 1)
            assert poll.poll(1.0)
            assert not poll.poll(0.0)
    os.close(descriptor)
