"""The node that serves connector computations; see docs and ``connector --help``."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.task import Future
from std_srvs.srv import Trigger

from cylconn_ros import __version__
from cylconn_ros.connector.parameters import SceneError
from cylconn_ros.connector.scene import Scene
from cylconn_ros.connector.scene_file import dump, scene_part
from cylconn_ros.methods.step import step
from cylconn_ros.recording.errors import RecordingError
from cylconn_ros.ros import loop, process
from cylconn_ros.ros.answering import Answer, Answering
from cylconn_ros.ros.arguments import Arguments
from cylconn_ros.ros.diagnostics import Links, Monitor
from cylconn_ros.ros.parameters import SceneParameters, differences, ros_part
from cylconn_ros.ros.recording import Recorder, now
from cylconn_ros.ros.topics import Topics, check_qos_overrides
from cylconn_ros.ros.waiting import Waiting

USAGE = """\
usage: connector [--version] --ros-args [--params-file FILE] [-p NAME:=VALUE] [-r FROM:=TO] ...

Serve a cylindrical connector between two bodies: read their poses and twists, answer each sample
with the wrenches on both. Needs a scene, at least node_a.orientation and the moving bodies' mass
and inertia, from a parameter file or -p. Stop with Ctrl-C.
Parameters: docs/parameters.md; an example with all of them: config/connector.yaml.
Exit codes: 0 stopped, 2 arguments or parameters that cannot be used, 130 interrupted while
compiling."""


_LOOK = 0.02  # s between looks at the clock


class ConnectorNode(LifecycleNode):
    """Serve one connector.

    Raises SceneError at construction for parameters that cannot be used.
    """

    def __init__(self, parameters: Mapping[str, Any], **node_arguments: Any) -> None:
        """Take dotted parameters; ``node_arguments`` go to the ROS node (namespace, context …)."""
        scene = Scene.from_parameters(scene_part(parameters))
        super().__init__("connector", parameter_overrides=ros_part(parameters), **node_arguments)
        self.done = Future()
        self.failure = ""  # why a transition failed
        self.parameters = SceneParameters(self, scene, self._prepare, self._apply)
        self._lock = threading.RLock()  # of all that answering a sample changes
        self.recorder = Recorder(Path(scene.record.directory), self._lock)
        self.links = Links()
        self.answering: Answering | None = None
        self._prepared: Answering | None = None
        lacking = loop.missing(self)
        if lacking:
            self.get_logger().warning(
                f"this rclpy has no {lacking}: samples are served by its executor, which is slower"
            )
        serving = None if lacking else loop.Loop(self, self._lock, self.caught)
        self._topics = Topics(self, self.links, serving)
        self._said: dict[str, str] = {}  # what the log has last said of each part of diagnostics
        check_qos_overrides(self, parameters, scene)
        self._answered_at = 0.0
        self._waiting = Waiting()
        self._history = 0  # samples answered since the connector last forgot everything
        self._monitor = Monitor(self.get_fully_qualified_name().strip("/"))
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0, self._diagnose, clock=self._steady)
        self.create_timer(_LOOK, self._look, clock=self._steady)
        for name, serve in (
            ("~/start_recording", self._start_recording),
            ("~/stop_recording", self._stop_recording),
            ("~/reset", self._reset),
        ):
            self.create_service(Trigger, name, serve)

    @property
    def scene(self) -> Scene:
        """The scene in force."""
        return self.parameters.scene

    # --- samples ---------------------------------------------------------------------------------

    def _receiver(self, name: str, topic: str) -> loop.Receive:
        """What takes the messages of input ``name``, received on ``topic``."""
        recorder, topics = self.recorder, self._topics
        drawing = self.scene.markers

        def receive(data: bytes) -> bool:
            """Answer, publish, record; whether a sample was complete."""
            answering = self.answering
            assert answering is not None
            recording = recorder.running
            came = now() if recording else 0
            answer = answering.inputs[name].receive(data)
            if answer is not None:
                topics.publish(answer)
                self._answered_at = time.monotonic()
                self._history += 1
            if recording:
                recorder.keep(topic, data, came)
            if answer is None:
                return False
            if recording:
                self._record(answer)
            if drawing:
                topics.draw(answer.stamp, answering)
            return True

        return receive

    def _record(self, answer: Answer) -> None:
        went = now()
        for topic, data in self._topics.outgoing(answer):
            self.recorder.keep(topic, data, went)
        self.recorder.flush()

    def _wanted(self, name: str) -> bool:
        """Whether an output is to be made: somebody listens, or it is recorded."""
        return self.recorder.running or self._topics.wanted(name)

    def _look(self) -> None:
        """Watch the timeout; on the steady clock, since simulated time stops with the samples."""
        if self.answering is None or self.links.state != "active":
            return
        with self._lock:
            self.answering.settle()
            self.recorder.flush()  # what no answer has followed
        reason = self._waiting.look(self.answering.matcher, self.scene, time.monotonic())
        if reason:
            self.get_logger().warning(reason)
        if not self._history:
            return
        silent = time.monotonic() - self._answered_at > self.scene.timeout
        if silent and not self.links.silent:
            self.links.timeouts += 1
            self.get_logger().warning(
                f"no complete sample for {self.scene.timeout:g} s: zero wrench until the next"
            )
            self._send_zero()
        elif self.links.silent and not silent:
            self.get_logger().info("samples are back")
        self.links.silent = silent

    def _send_zero(self) -> None:
        with self._lock:
            answer = None if self.answering is None else self.answering.zero()
            if answer is not None:
                self._topics.publish(answer)
                self._record(answer)

    def _diagnose(self) -> None:
        stamp = self.get_clock().now().to_msg()
        with self._lock:  # what happens meanwhile belongs into the next report
            health = None if self.answering is None else self.answering.health.taken()
        report = self._monitor.report(stamp, self.answering, self.recorder, self.links, health)
        self._diagnostics.publish(report)
        for status in report.status:  # the log says what is new; how often it was is in the report
            bad = status.level != DiagnosticStatus.OK
            if bad and self._said.get(status.name) != status.message:
                self.get_logger().warning(f"{status.name}: {status.message}")
            self._said[status.name] = status.message if bad else ""

    def caught(self, error: Exception) -> bool:
        """Count and report what a callback raised; the node goes on."""
        self.links.caught += 1
        self.links.caught_text = f"{type(error).__name__}: {error}"
        self.get_logger().error(self.links.caught_text, throttle_duration_sec=1.0)
        return True

    # --- lifecycle -------------------------------------------------------------------------------

    def start(self) -> None:
        """Configure and activate, unless ``autostart`` is off; raises SceneError."""
        if not self.scene.autostart:
            self.get_logger().info("waiting to be configured and activated (autostart is false)")
            return
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() != TransitionCallbackReturn.SUCCESS:
                raise SceneError(self.failure)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make the connector and its publishers."""
        return self._transition("inactive", state, self._configure, super().on_configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin a new history: subscribe, and record if asked to."""
        return self._transition("active", state, super().on_activate, self._activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Send a last zero wrench, unsubscribe, close the recording."""
        return self._transition("inactive", state, self._deactivate, super().on_deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release connector and publishers."""
        return self._transition("unconfigured", state, super().on_cleanup, self._clean)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate if active, and release everything; the process ends."""
        result = self._transition(
            "finalized", state, self._deactivate, super().on_shutdown, self._clean
        )
        if not self.done.done():
            self.done.set_result(process.OK)
        return result

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release everything, to be configured anew."""
        return self._transition("unconfigured", state, self._deactivate, self._clean)

    def finish(self) -> None:
        """Shut down in order: zero wrench, recording, publishers."""
        if self.links.state != "finalized":
            self.trigger_shutdown()
        self.destroy_node()

    def _transition(self, to: str, state: LifecycleState, *steps: Any) -> TransitionCallbackReturn:
        """Take steps; a failure is logged and leaves the node where it was."""
        try:
            for step in steps:
                step(state)
        except Exception as error:
            self.failure = str(error) or type(error).__name__
            self.get_logger().error(self.failure)
            return TransitionCallbackReturn.FAILURE
        self.links.state = to
        return TransitionCallbackReturn.SUCCESS

    def _configure(self, _state: LifecycleState) -> None:
        process.announce_compiling(step, self.get_logger().info)
        self.answering = Answering(self.scene)
        self.answering.wanted = self._wanted
        self._topics.open_outputs(self.scene)
        self.get_logger().info(self.answering.connector.model)

    def _activate(self, _state: LifecycleState) -> None:
        assert self.answering is not None
        self.answering.release()  # a command that came before deactivation may be out of date
        self._forget()
        if self.scene.record.enabled:
            try:
                self.get_logger().info(self._open_recording())
            except RecordingError as error:
                self.get_logger().error(f"{error}; serving without a recording")
        self._topics.open_inputs(self.answering, self._receiver)

    def _deactivate(self, _state: LifecycleState) -> None:
        if self.links.state != "active":
            return
        self._topics.close_inputs()
        self._send_zero()
        self._topics.wait_until_taken(Duration(nanoseconds=200_000_000))
        if self.recorder.running:
            try:
                self.get_logger().info(self.recorder.stop())
            except RecordingError as error:
                self.get_logger().error(str(error))

    def _clean(self, _state: LifecycleState) -> None:
        self._topics.close_outputs()
        self.answering = None

    # --- services and parameters -----------------------------------------------------------------

    def _start_recording(self, _request: Any, response: Any) -> Any:
        with self._lock:
            return self._respond(response, self._open_recording)

    def _stop_recording(self, _request: Any, response: Any) -> Any:
        return self._respond(response, self.recorder.stop)

    def _reset(self, _request: Any, response: Any) -> Any:
        return self._respond(response, self._start_anew)

    def _respond(self, response: Any, act: Any) -> Any:
        try:
            response.message = str(act())
            response.success = True
        except Exception as error:
            response.message = str(error) or type(error).__name__
            response.success = False
        if response.success:
            self.get_logger().info(response.message)
        else:
            self.get_logger().error(response.message)
        return response

    def _open_recording(self) -> str:
        if self.answering is None:
            raise RecordingError(f"the node is {self.links.state}: nothing to record")
        scene = self.scene
        metadata = {
            "version": __version__,
            "node": self.get_fully_qualified_name(),
            "method": self.answering.connector.method,
            "model": self.answering.connector.model,
            "parameters": dump(self.answering.scene_in_force),
            "samples_before": str(self._history),  # 0: the whole history, fit for replay
        }
        directory = self.recorder.start(
            scene.record.directory,
            self.get_name(),
            self._topics.recorded(self.answering),
            metadata,
            scene.record.compression,
        )
        for name, data in self.answering.held.items():  # what acts from the first sample on
            self.recorder.write(self.resolve_topic_name(name), data, now())
        return f"recording to {directory}"

    def _start_anew(self) -> str:
        """Forget all history; a recording goes on in a new run, as a run is one history."""
        if self.answering is None:
            raise SceneError(f"the node is {self.links.state}: nothing to reset")
        with self._lock:
            self._forget()
            if not self.recorder.running:
                return "reset: the next sample is the reference configuration"
            return f"reset; {self.recorder.stop()}; {self._open_recording()}"

    def _forget(self) -> None:
        assert self.answering is not None
        self.answering.reset()
        self._history = 0
        self.links.silent = False

    def _prepare(self, scene: Scene) -> None:
        """Make the connector of a changed scene before the change is accepted."""
        self.recorder.check(scene.record.directory)
        if self.recorder.running:
            raise SceneError("parameters cannot change during a recording; call ~/stop_recording")
        if self.answering is not None:
            self._prepared = Answering(scene)
            self._prepared.keep_imposed(self.answering)

    def _apply(self, scene: Scene, before: Scene) -> None:
        changes = ", ".join(f"{n}: {old} -> {new}" for n, old, new in differences(before, scene))
        self.get_logger().info(f"parameters changed: {changes or 'nothing'}")
        prepared, previous, self._prepared = self._prepared, self.answering, None
        if prepared is None or previous is None:
            return
        with self._lock:
            prepared.take_over(previous)
            self.answering = prepared
            if not prepared.continues:
                self._forget()
        if prepared.connector.model != previous.connector.model:
            self.get_logger().info(prepared.connector.model)
        if not prepared.continues:
            self.get_logger().info("the next sample is the reference configuration")


def _make(arguments: Arguments) -> ConnectorNode:
    node = ConnectorNode(arguments.parameters)
    node.start()
    return node


def main(argv: list[str] | None = None) -> int:
    """Run the executable ``connector``; return its exit code."""
    return process.run("connector", _make, USAGE, argv)


if __name__ == "__main__":
    raise SystemExit(main())
