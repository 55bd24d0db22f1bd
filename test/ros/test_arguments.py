"""Command line of a node: parameters are read, other arguments are passed to ROS."""

import math

import pytest

from cylconn_ros.errors import SceneError
from cylconn_ros.ros.arguments import UsageError, read_arguments


def read(*arguments, node="connector"):
    return read_arguments(["--ros-args", *arguments], node)


def test_no_arguments():
    arguments = read_arguments([], "connector")
    assert (arguments.name, arguments.namespace) == ("connector", "/")
    assert (arguments.parameters, arguments.ros, arguments.help) == ({}, [], False)


def test_values_are_yaml():
    found = read(
        "-p", "a.b:=1", "--param", "c:=[1, 2.5]", "-p", "d:=.inf", "-p", "e:=1e-3"
    ).parameters
    assert found == {"a.b": 1, "c": [1, 2.5], "d": math.inf, "e": 0.001}


def test_last_file_or_value_takes_precedence(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("/**: {ros__parameters: {period: 1, timeout: 1}}")
    found = read("-p", "period:=2", "--params-file", str(path), "-p", "timeout:=3").parameters
    assert found == {"period": 1, "timeout": 3}
    assert read(f"--params-file={path}").parameters == {"period": 1, "timeout": 1}


def test_parameters_of_other_nodes_are_ignored():
    assert read("-p", "connector:period:=1", "-p", "plant:timeout:=2").parameters == {"period": 1}


def test_name_and_namespace_follow_remapping(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("""
connector: {ros__parameters: {period: 1}}
/arm/joint: {ros__parameters: {period: 2}}
""")
    rules = ("-r", "__node:=joint", "--remap", "__ns:=/arm", "-r", "plant:__node:=other")
    arguments = read(*rules, "--params-file", str(path), "-p", "joint:timeout:=5")
    assert (arguments.name, arguments.namespace) == ("joint", "/arm")
    assert arguments.parameters == {"period": 2, "timeout": 5}
    assert arguments.ros == ["--ros-args", *rules]
    assert read("-r", "connector:__name:=b").name == "b"


def test_other_arguments_are_passed_to_ros():
    rest = ["--log-level", "warn", "-r", "a:=b", "--disable-rosout-logs"]
    assert read(*rest).ros == ["--ros-args", *rest]
    assert read_arguments(["--ros-args", "-r", "a:=b", "--", "--help"], "connector").help


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--verbose"], "--verbose: unknown argument; ROS arguments come after --ros-args"),
        (["--ros-args", "-p", "period=1"], "-p period=1: must be name:=value"),
        (["--ros-args", "--params-file"], "--params-file: a value must follow"),
        (["--ros-args", "-r"], "-r: a value must follow"),
    ],
)
def test_invalid_arguments_are_refused(arguments, text):
    with pytest.raises(UsageError) as caught:
        read_arguments(arguments, "connector")
    assert str(caught.value) == text


def test_value_that_is_not_yaml_is_refused_with_its_name():
    with pytest.raises(SceneError, match=r"gravity = \[0, 0: line 1: "):
        read("-p", "gravity:=[0, 0")
