"""A process with one node: what ends it, and that it ends."""

import signal
import subprocess
import sys

from cylconn_ros.ros import run_node

HANGS = """
import ctypes
from rclpy.node import Node
from rclpy.task import Future
from cylconn_ros.ros import process

class Hanging(Node):
    def __init__(self):
        super().__init__("hanging")
        self.done = Future()
        self.done.set_result(process.OK)
    def finish(self):
        print("said its last", flush=True)
    def destroy_node(self):
        ctypes.PyDLL(None).sleep(100)  # with the interpreter held, as the middleware would

process._LETTING_GO = 0.2
process.run("hanging", lambda arguments: Hanging(), "", [])
"""


def test_a_closed_terminal_ends_a_node_unless_it_is_ignored(monkeypatch):
    assert signal.SIGHUP in run_node._ending()
    monkeypatch.setattr(signal, "getsignal", lambda _: signal.SIG_IGN)
    assert signal.SIGHUP not in run_node._ending()


def test_a_middleware_that_hangs_does_not_keep_the_process():
    ended = subprocess.run(
        [sys.executable, "-c", HANGS], capture_output=True, text=True, timeout=90, check=False
    )
    assert ended.stdout == "said its last\n"
    assert ended.returncode == 1
    assert "in destroy_node" in ended.stderr
