"""One node in a process: signals that end it, and teardown that hangs."""

import signal
import subprocess
import sys

from cylconn_ros.ros import run_node

HANGS = """
import ctypes
from rclpy.node import Node
from rclpy.task import Future
from cylconn_ros.ros import run_node

class Hanging(Node):
    def __init__(self):
        super().__init__("hanging")
        self.done = Future()
        self.done.set_result(run_node.OK)
    def finish(self):
        print("finished", flush=True)
    def destroy_node(self):
        ctypes.PyDLL(None).sleep(100)  # holding the GIL, as the middleware would

run_node._TEARDOWN = 0.2
run_node.run("hanging", lambda arguments: Hanging(), "", [])
"""


def test_sighup_ends_a_node_unless_it_is_ignored(monkeypatch):
    assert signal.SIGHUP in run_node._termination_signals()
    monkeypatch.setattr(signal, "getsignal", lambda _: signal.SIG_IGN)
    assert signal.SIGHUP not in run_node._termination_signals()


def test_process_exits_if_teardown_of_the_middleware_hangs():
    ended = subprocess.run(
        [sys.executable, "-c", HANGS], capture_output=True, text=True, timeout=90, check=False
    )
    assert ended.stdout == "finished\n"
    assert ended.returncode == 1
    assert "in destroy_node" in ended.stderr
