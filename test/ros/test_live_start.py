"""Start of a node: one-line errors for invalid arguments, help, and compiling."""

import os
import shutil
import signal
import time
from pathlib import Path

import pytest
from lifecycle_msgs.srv import GetState
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from ros_processes import (
    PATIENCE,
    Listener,
    Source,
    installed,
    module,
    parameters,
    program,
    stamp_of,
)
from std_srvs.srv import Trigger

from cylconn_ros.core.jit import CACHE_DIRECTORY
from cylconn_ros.ros import compiling
from cylconn_ros.ros.arguments import read_arguments
from cylconn_ros.ros.connector import node as connector_node
from cylconn_ros.ros.plant import node as plant_node
from cylconn_ros.scene.parameter_file import scene_part
from cylconn_ros.scene.scene import Scene

MAINS = {"connector": connector_node.main, "plant": plant_node.main}
REFUSED = [
    (["-p", "period:=-1"], "period = -1: must be a number >= 0 s"),
    (["-p", "friction.coefficient:=0.1"], "friction.radius = .nan: must be given with friction"),
    (["-p", "fricton.radius:=1"], "did you mean friction.radius?"),
    (["-p", "gravity:=[0, 0, x]"], "gravity = [0, 0, 'x']: must be 3 numbers"),
    (["-p", "gravity:=[0, 0"], "gravity = [0, 0: line 1"),
    (["--params-file", "missing.yaml"], "missing.yaml: cannot be read"),
    (["-p"], "-p: a value must follow"),
    (["-r", "__node:=not a name"], "not a name"),
    (["--", "--verbose"], "--verbose: unknown argument"),
]


@pytest.mark.parametrize(
    ("name", "arguments", "text"),
    [("connector", *case) for case in REFUSED] + [("plant", *case) for case in REFUSED[:2]],
)
def test_invalid_arguments_are_refused_in_one_line(name, arguments, text, capfd):
    assert MAINS[name]([*parameters(), *arguments]) == 2
    printed = capfd.readouterr()
    line = printed.err.splitlines()[-1]
    assert line.startswith(f"{name}: ")
    assert text in line
    assert "Traceback" not in printed.err
    assert printed.out == ""


@pytest.mark.parametrize("name", ["connector", "plant"])
def test_installed_program_refuses_invalid_parameters_and_prints_help(
    name, installed_prefix, tmp_path
):
    command = installed(installed_prefix, name)
    with program([*command, *parameters("period:=-1")], tmp_path) as running:
        assert running.wait() == 2
        rule = "must be a number >= 0 s and <= 1e+06 s, finite"
        assert running.output == f"{name}: period = -1: {rule}"
    with program([*command, "--help"], tmp_path) as running:
        assert running.wait() == 0
        assert running.output.startswith(f"usage: {name} ")


def test_missing_parameter_is_named(tmp_path):
    with program(module("connector.node"), tmp_path) as running:
        assert running.wait() == 2
        assert running.output == (
            "connector: node_a.orientation: is required and not given; "
            "must be 4 numbers x, y, z, w, finite"
        )


ANSWER = 5.0  # s, within which services answer while a child process compiles
GAINS = (
    "penalty.stiffness:=1.0e5",
    "penalty.damping:=100.0",
    "penalty.rotational_stiffness:=1.0e3",
    "penalty.rotational_damping:=1.0",
)


def timed_call(peer, kind, name, request=None):
    """Response of a service of the connector, which answers within ANSWER seconds."""
    client = peer.node.create_client(kind, f"/connector/{name}")
    peer.spin_until(client.service_is_ready, name)
    begin = time.monotonic()
    future = client.call_async(request or kind.Request())
    peer.spin_until(future.done, name)
    assert time.monotonic() - begin < ANSWER, name
    peer.node.destroy_client(client)
    return future.result()


def set_parameter(peer, name, value):
    parameter = Parameter(name, value=value).to_parameter_msg()
    request = SetParameters.Request(parameters=[parameter])
    return timed_call(peer, SetParameters, "set_parameters", request).results[0]


def get_parameter(peer, name):
    request = GetParameters.Request(names=[name])
    return timed_call(peer, GetParameters, "get_parameters", request).values[0]


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    """An empty cache of compiled code, for processes that a test starts."""
    monkeypatch.setenv("CYLCONN_CACHE_DIR", str(tmp_path / "cache"))


@pytest.fixture
def without(tmp_path, monkeypatch):
    """Function that provides a cache with all that the least scene needs, but not one method."""
    compiling.load_kernels(
        {
            "": Scene.from_parameters(
                scene_part(read_arguments(parameters(), "connector").parameters)
            )
        }
    )
    directory = tmp_path / "cache" / Path(CACHE_DIRECTORY).name
    shutil.copytree(CACHE_DIRECTORY, directory)
    monkeypatch.setenv("CYLCONN_CACHE_DIR", str(tmp_path / "cache"))

    def remove(method):
        for path in directory.glob(f"dispatch.{method}_step-*"):
            path.unlink()
        return directory

    return remove


def test_services_answer_while_the_physics_is_compiled(peer, tmp_path, empty_cache):
    """Samples sent meanwhile are counted and processed afterwards, though never sent again."""
    source, listener = Source(peer), Listener(peer)
    with program([*module("connector.node"), *parameters()], tmp_path) as running:
        running.wait_for("compiling the physics")
        source.wait()
        for k in range(3):
            source.send(k * 10**6, velocity=(0.1, 0.0, 0.0))
        values = listener.wait_for_status("samples", "the physics is being compiled")
        while values["samples not yet processed"] != "3":
            values = listener.wait_for_status("samples", "the physics is being compiled")
        assert values["samples processed"] == "0"
        assert get_parameter(peer, "timeout").double_value == 0.1
        assert set_parameter(peer, "timeout", 5.0).successful  # longer than between two reports
        assert not set_parameter(peer, "timeout", -1.0).successful
        assert get_parameter(peer, "timeout").double_value == 5.0
        state = timed_call(peer, GetState, "get_state").current_state
        assert state.label == "active"
        assert timed_call(peer, Trigger, "start_recording").success
        assert timed_call(peer, Trigger, "stop_recording").success
        assert timed_call(peer, Trigger, "reset").success
        assert listener.b == []
        assert "compiled in" not in running.output
        assert "3 samples not yet processed" in running.wait_for("compiled in")
        peer.spin_until(lambda: len(listener.b) == 3, "answers to all samples")
        assert [stamp_of(wrench) for wrench in listener.b] == [0, 10**6, 2 * 10**6]
        listener.exchange(source, 3 * 10**6)
        listener.wait_for_status("samples", "samples/s")
        assert running.stop() == 0
    with program([*module("connector.node"), *parameters()], tmp_path) as running:  # loaded
        listener.clear()
        listener.exchange(source, 0)
        assert "compil" not in running.output
        assert running.stop() == 0


def test_a_method_that_must_be_compiled_is_in_force_afterwards(peer, tmp_path, without):
    """Until then the previous method answers samples, and services answer."""
    without("penalty")
    source, listener = Source(peer), Listener(peer)
    with program([*module("connector.node"), *parameters(*GAINS)], tmp_path) as running:
        listener.exchange(source, 0)
        assert "compil" not in running.output
        assert set_parameter(peer, "method", "penalty").successful
        running.wait_for("in force when")
        assert get_parameter(peer, "method").string_value == "penalty"
        listener.exchange(source, 10**6)
        peer.spin_until(lambda: listener.states and listener.states[-1].method == "impulse")
        listener.wait_for_status("samples", "in force when their method is compiled")
        recording = timed_call(peer, Trigger, "start_recording")
        assert not recording.success
        assert "not in force yet" in recording.message
        peer.spin_until(lambda: "compiled in" in running.output, "the compilation")
        listener.exchange(source, 2 * 10**6)
        peer.spin_until(lambda: listener.states[-1].method == "penalty", "the new method")
        assert timed_call(peer, Trigger, "start_recording").success
        assert running.stop() == 0


def child_of(running):
    """Process id of the compiler that a node has started."""
    return int(Path(f"/proc/{running.pid}/task/{running.pid}/children").read_text())


def wait_until_gone(pid):
    end = time.monotonic() + PATIENCE
    while Path(f"/proc/{pid}").exists():
        assert time.monotonic() < end, f"process {pid} has not ended"
        time.sleep(0.05)


def test_a_node_ends_while_it_compiles(tmp_path, without):
    """The child process ends with it."""
    without("impulse")
    with program([*module("connector.node"), *parameters()], tmp_path) as running:
        running.wait_for("compiling the physics")
        child = child_of(running)
        assert running.stop() == 0
        wait_until_gone(child)
    with program([*module("connector.node"), *parameters()], tmp_path) as running:
        running.wait_for("compiling the physics")
        child = child_of(running)
        running.kill()  # the node cannot end it
        wait_until_gone(child)


def test_a_compiler_that_fails_is_replaced_by_the_node_itself(peer, tmp_path, without):
    without("impulse")
    source, listener = Source(peer), Listener(peer)
    with program([*module("connector.node"), *parameters()], tmp_path) as running:
        running.wait_for("compiling the physics")
        os.kill(child_of(running), signal.SIGKILL)
        running.wait_for("compiling in this process")
        running.wait_for("compiled in")
        listener.exchange(source, 0)
        assert running.stop() == 0


def test_damaged_code_is_compiled_again(peer, tmp_path, without):
    """One line in the log names the file; the node answers."""
    source, listener = Source(peer), Listener(peer)
    command = [*module("connector.node"), *parameters()]
    (path,) = without("").glob("dispatch.impulse_step-*.kernel")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with program(command, tmp_path) as running:
        listener.exchange(source, 0)
        assert running.output.count("is damaged: removed") == 1
        assert str(path) in running.output
        assert running.stop() == 0
    with program(command, tmp_path) as running:
        listener.exchange(source, 0)
        assert "is damaged" not in running.output
        assert running.stop() == 0
