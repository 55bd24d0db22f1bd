"""One node in a process: signals that end it, what hangs, closed streams, few descriptors."""

import resource
import signal
import subprocess
import sys

import pytest
from ros_processes import module, parameters, program

from cylconn_ros.ros import run_node

HANGING = """
import ctypes, signal
from rclpy.node import Node
from rclpy.task import Future
from cylconn_ros.ros import run_node

def hang():
    ctypes.PyDLL(None).sleep(100)  # holding the GIL, as the middleware would

class Hanging(Node):
    def __init__(self):
        super().__init__("hanging")
        self.done = Future()
        self.create_timer(0.01, self.begin)
    def begin(self):
        signal.raise_signal(signal.SIGINT)
        {in_callback}
    def finish(self):
        print("finished", flush=True)
        {in_finish}
    def destroy_node(self):
        {in_destroy_node}
        super().destroy_node()

assert run_node._ENDING <= 3.0  # ros2 launch sends SIGTERM after 5 s
run_node._ENDING = 0.2
run_node.run("hanging", lambda arguments: Hanging(), "", [])
"""
PLACES = ("in_callback", "in_finish", "in_destroy_node")


def test_sighup_ends_a_node_unless_it_is_ignored(monkeypatch):
    monkeypatch.setattr(signal, "getsignal", lambda _: signal.SIG_DFL)
    assert signal.SIGHUP in run_node._termination_signals()
    monkeypatch.setattr(signal, "getsignal", lambda _: signal.SIG_IGN)
    assert signal.SIGHUP not in run_node._termination_signals()


@pytest.mark.parametrize("place", PLACES)
def test_process_exits_if_something_hangs_after_a_signal(place):
    code = HANGING.format(**{one: "hang()" if one == place else "pass" for one in PLACES})
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=90, check=False
    )
    assert ended.stdout == ("" if place == "in_callback" else "finished\n")
    assert ended.returncode == 1
    function = {"in_callback": "begin", "in_finish": "finish", "in_destroy_node": "destroy_node"}
    assert f"in {function[place]}" in ended.stderr


def shell(text):
    """A shell command that runs the connector with the arguments "$@"."""
    return ["/bin/sh", "-c", text, *module("connector.node"), *parameters()]


def test_a_node_runs_with_closed_standard_streams(peer, tmp_path):
    with program(shell('exec "$0" "$@" <&- >&- 2>&-'), tmp_path) as running:
        peer.spin_until(lambda: peer.node.count_subscribers("/body_b/pose"), "the connector")
        assert running.running
        assert running.stop() == 0


def test_too_few_file_descriptors_end_a_node_with_one_line(tmp_path):
    with program(shell('ulimit -n 20; exec "$0" "$@"'), tmp_path) as running:
        assert running.wait() == 1
        assert running.output == (
            "connector: too few file descriptors: the limit is 20, a node needs at least "
            f"{run_node._DESCRIPTORS}; raise it (ulimit -n 1024)"
        )


def test_the_descriptors_asked_for_suffice(tmp_path, peer):
    assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] > run_node._DESCRIPTORS
    text = f'ulimit -n {run_node._DESCRIPTORS}; exec "$0" "$@" -p record.enabled:=true'
    with program(shell(text), tmp_path) as running:
        peer.spin_until(lambda: peer.node.count_subscribers("/body_b/pose"), "the connector")
        running.wait_for("recording to ")
        assert running.stop() == 0
