"""Helpers of the live tests: programs as processes, and a ROS node as their peer."""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from cylconn_ros.msg import ConnectorState
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from cylconn_ros.messages.pipeline import MessagePipeline
from cylconn_ros.process.child import Child
from cylconn_ros.ros.connector.diagnostics import ConnectionStatus, Monitor
from cylconn_ros.ros.connector.diagnostics_encoder import encode_diagnostics
from cylconn_ros.ros.connector.recorder import Recorder

PATIENCE = 180.0  # s of wall clock, long enough for compiling: no test depends on speed
LEAST = (
    "node_a.orientation:=[0, 0, 0, 1]",
    "body_b.mass:=2.0",
    "body_b.inertia:=[0.002, 0, 0, 0.003, 0, 0.004]",
)


def parameters(*rules: str, least: bool = True) -> list[str]:
    """Arguments that set parameters, in addition to the smallest scene if ``least``."""
    arguments = ["--ros-args"]
    for rule in (*(LEAST if least else ()), *rules):
        arguments += ["-p", rule]
    return arguments


class Program(Child):
    """A running program; ``lines`` holds its output."""

    def __init__(self, command: Sequence[str | Path], directory: Path) -> None:
        environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
        super().__init__(
            str(command[0]), [str(part) for part in command], environment, folder=directory
        )

    def wait_for(self, text: str, timeout: float = PATIENCE) -> str:
        """Wait until it prints a line with ``text``, and return the line."""
        return super().wait_for(text, timeout)

    def wait(self, timeout: float = PATIENCE) -> int | None:
        """Wait for its end and return the exit code."""
        return super().wait(timeout)

    def stop(self, number: int = signal.SIGINT) -> int | None:
        """Send a signal and return the exit code."""
        self.signal(number)
        return self.wait()


@contextmanager
def program(command: Sequence[str | Path], directory: Path) -> Iterator[Program]:
    """Run a program during a block; it ends with the block."""
    running = Program(command, directory)
    with running:
        try:
            yield running
        except BaseException:
            print(f"{running.name} (exit code {running.exit_code}) printed:\n{running.output}")
            raise


def installed(prefix: Path, name: str) -> list[str | Path]:
    """Command of an installed executable, as found by `ros2 run`."""
    return [prefix / "lib" / "cylconn_ros" / name]


def module(name: str) -> list[str | Path]:
    """The same program run as a module."""
    return [sys.executable, "-m", f"cylconn_ros.ros.{name}"]


class Peer:
    """A node that uses message objects and an executor of rclpy."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node("peer", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def collect(self, kind: Any, topic: str, qos: QoSProfile | int = 50) -> list[Any]:
        """Subscribe; received messages are appended to the returned list."""
        received: list[Any] = []
        self.node.create_subscription(kind, topic, received.append, qos)
        return received

    def spin_until(self, condition: Callable[[], Any], what: str = "") -> Any:
        """Spin until the condition is true and return its value."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if result := condition():
                return result
            self.executor.spin_once(timeout_sec=0.05)
        raise AssertionError(f"timeout after {PATIENCE} s{': ' if what else ''}{what}")

    def spin_for(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)

    def call(self, kind: Any, name: str, request: Any = None) -> Any:
        """Call a service and return its response."""
        client = self.node.create_client(kind, name)
        self.spin_until(client.service_is_ready, f"service {name}")
        future = client.call_async(request or kind.Request())
        self.spin_until(future.done, f"response of {name}")
        self.node.destroy_client(client)
        return future.result()


class Source:
    """Publish the motion of body B, as pose and twist or as odometry."""

    def __init__(
        self, peer: Peer, form: str = "pose_twist", prefix: str = "", qos: Any = 50
    ) -> None:
        self.peer = peer
        self.form = form
        create = peer.node.create_publisher
        if form == "odometry":
            self.publishers = [create(Odometry, f"{prefix}/body_b/odom", qos)]
        else:
            self.publishers = [
                create(PoseStamped, f"{prefix}/body_b/pose", qos),
                create(TwistStamped, f"{prefix}/body_b/twist", qos),
            ]

    def wait(self) -> None:
        """Wait for the subscriptions."""
        self.peer.spin_until(
            lambda: all(p.get_subscription_count() for p in self.publishers), "a subscriber"
        )

    def send(
        self,
        stamp: int,
        position: Sequence[float] = (0.0, 0.0, 0.0),
        orientation: Sequence[float] = (0.0, 0.0, 0.0, 1.0),
        velocity: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Publish a sample with a stamp in ns; the velocity is in world axes."""
        if self.form == "odometry":
            message = Odometry(child_frame_id="body_b")
            parts = [(message, message.pose.pose, message.twist.twist)]
        else:
            pose, twist = PoseStamped(), TwistStamped()
            parts = [(pose, pose.pose, None), (twist, None, twist.twist)]
        for publisher, (message, pose, twist) in zip(self.publishers, parts, strict=True):
            message.header.frame_id = "world"
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
            if pose is not None:
                point, q = pose.position, pose.orientation
                point.x, point.y, point.z = map(float, position)
                q.x, q.y, q.z, q.w = map(float, orientation)
            if twist is not None:
                linear = twist.linear
                linear.x, linear.y, linear.z = map(float, velocity)
            publisher.publish(message)


class Listener:
    """Subscriptions to all outputs of a connector."""

    def __init__(self, peer: Peer, prefix: str = "", name: str = "connector") -> None:
        self.peer = peer
        self.a = peer.collect(WrenchStamped, f"{prefix}/body_a/wrench")
        self.b = peer.collect(WrenchStamped, f"{prefix}/body_b/wrench")
        self.states = peer.collect(ConnectorState, f"{prefix}/{name}/state")
        self.joints = peer.collect(JointState, f"{prefix}/{name}/joint_state")
        self.diagnostics = peer.collect(DiagnosticArray, "/diagnostics")

    def clear(self) -> None:
        for received in (self.a, self.b, self.states, self.joints):
            received.clear()

    def exchange(self, source: Source, stamp: int, **motion) -> WrenchStamped:
        """Publish a sample until its wrench arrives; return the wrench on B."""
        source.wait()

        def received():
            found = [wrench for wrench in self.b if stamp_of(wrench) == stamp]
            if not found:
                source.send(stamp, **motion)
                self.peer.spin_for(0.05)
            return found

        return self.peer.spin_until(received, f"wrench for {stamp}")[0]

    def status(self, part: str) -> tuple[int, str, dict[str, str]]:
        """Level, message and values of a part in the newest diagnostics."""
        for array in reversed(self.diagnostics):
            for status in array.status:
                if status.name.endswith(part):
                    values = {pair.key: pair.value for pair in status.values}
                    return ord(status.level), status.message, values
        return -1, "", {}

    def wait_for_status(self, part: str, text: str) -> dict[str, str]:
        """Wait until the message of a part contains ``text``; return the values."""
        self.peer.spin_until(lambda: text in self.status(part)[1], f"diagnostics: {text}")
        return self.status(part)[2]


def reported(
    monitor: Monitor,
    pipeline: MessagePipeline | None,
    recorder: Recorder | None,
    status: ConnectionStatus,
) -> list[DiagnosticStatus]:
    """Report of a monitor as decoded by a subscriber."""
    data = encode_diagnostics(0, monitor.report(pipeline, recorder, status))
    return list(deserialize_message(data, DiagnosticArray).status)


def stamp_of(message: Any) -> int:
    """Stamp of a message in ns."""
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def wrench_of(message: Any) -> list[float]:
    """Force and torque of a WrenchStamped."""
    f, t = message.wrench.force, message.wrench.torque
    return [f.x, f.y, f.z, t.x, t.y, t.z]
