"""The node that serves connector computations; see docs and ``connector --help``."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.task import Future
from std_srvs.srv import Trigger

from cylconn_ros.errors import RecordingError, SceneError
from cylconn_ros.messages.topic_names import said
from cylconn_ros.methods.coupled import answer as answer_together
from cylconn_ros.methods.dispatch import step
from cylconn_ros.ros import run_node
from cylconn_ros.ros.arguments import Arguments
from cylconn_ros.ros.connector.diagnostics import OK
from cylconn_ros.ros.connector.diagnostics_encoder import Part, written
from cylconn_ros.ros.connector.endpoint import Served
from cylconn_ros.ros.connector.open_recording import open_run
from cylconn_ros.ros.connector.parameters import SceneParameters, differences, ros_part
from cylconn_ros.ros.connector.recorder import Recorder
from cylconn_ros.ros.connector.shared_bodies import share_topics, solve_together
from cylconn_ros.ros.connector.topics import check_qos_overrides
from cylconn_ros.ros.executor import executor, fused
from cylconn_ros.scene.parameter_file import scene_part
from cylconn_ros.scene.scene import Scene, several

USAGE = """\
usage: connector [--version] --ros-args [--params-file FILE] [-p NAME:=VALUE] [-r FROM:=TO] ...

Serve a cylindrical connector between two bodies: read their poses and twists, answer each sample
with the wrenches on both. Needs a scene, at least node_a.orientation and the moving bodies' mass
and inertia, from a parameter file or -p. connectors: [NAME, ...] serves several, each with its
parameters and topics below its name. Stop with Ctrl-C.
Parameters: docs/parameters.md; an example with all of them: config/connector.yaml.
Exit codes: 0 stopped, 2 arguments or parameters that cannot be used, 130 interrupted while
compiling."""


_LOOK, _TURN = 0.02, 0.1  # s between looks at the clock, least and most
_OVERDUE = 0.5  # s without a look before it is taken out of the loop's hands
_REPORTS = 1.0  # s between reports on a connector
_TURNS, _MOST = 10, 16  # turns in which they are reported on; connectors in a message
_GRAPH = 2.5  # s between looks at the graph
_TAKING = 0.2  # s for the last wrenches to be acknowledged


class ConnectorNode(LifecycleNode):
    """Serve connectors: the one of its parameters, or as many as they name.

    Raises SceneError at construction for parameters that cannot be used.
    """

    def __init__(self, parameters: Mapping[str, Any], **node_arguments: Any) -> None:
        """Take dotted parameters; ``node_arguments`` go to the ROS node (namespace, context …)."""
        scenes = several(scene_part(parameters))
        super().__init__("connector", parameter_overrides=ros_part(parameters), **node_arguments)
        self.done = Future()
        self.failure = ""  # why a transition failed
        self.parameters = SceneParameters(self, scenes, self._prepare, self._apply)
        self._lock = threading.RLock()  # of all that answering a sample changes
        self.recorder = Recorder(Path(self.scene.record.directory), self._lock)
        lacking = executor.missing(self)
        if lacking:
            self.get_logger().warning(
                f"this rclpy has no {lacking}: samples are served by its executor, which is slower"
            )
        elif fused.missing():
            self.get_logger().warning(
                f"{fused.missing()} is missing: samples are served in Python, which is slower"
            )
        self._loop = None if lacking else executor.Loop(self, self._lock, self.caught, self._look)
        self._connectors = [self._serving(name) for name in scenes]
        self._groups = share_topics(self._connectors, scenes)
        self._said: dict[str, str] = {}  # what the log has last said of each part of diagnostics
        check_qos_overrides(
            self, parameters, {one.topics: scenes[one.name] for one in self._connectors}
        )
        self.state = "unconfigured"  # of the lifecycle
        self._next_report = 0
        self._graph_due = 0.0
        self._due = 0.0  # when to look at the clock (s, steady)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._at_once = min(math.ceil(len(scenes) / _TURNS), _MOST)
        turns = math.ceil(len(scenes) / self._at_once)
        self.create_timer(_REPORTS / turns, self._diagnose, clock=self._steady)
        if self._loop is None:
            self.create_timer(_LOOK, lambda: self._look_for(0.0), clock=self._steady)
        for name, serve in (
            ("~/start_recording", self._start_recording),
            ("~/stop_recording", self._stop_recording),
            ("~/reset", self._reset),
        ):
            self.create_service(Trigger, name, serve)

    def _serving(self, name: str) -> Served:
        """A connector, with what all of them have in common."""
        fused_path = self._loop is not None
        return Served(
            self, name, lambda: self.parameters.scenes[name], self.recorder, self._lock, fused_path
        )

    @property
    def scene(self) -> Scene:
        """The scene in force of the first connector; what is the node's is the same in all."""
        return next(iter(self.parameters.scenes.values()))

    # --- watching --------------------------------------------------------------------------------

    def _look(self, now: float) -> float:
        """Watch timeouts; when to look again."""
        if now >= self._due:
            first = min(connector.look(now) for connector in self._connectors)
            self._due = max(first, now + _LOOK)
        return min(self._due, now + _TURN)

    def _look_for(self, overdue: float) -> None:
        """Look on the executor, if whoever should have looked has not for ``overdue`` s."""
        now = time.monotonic()
        if self.state == "active" and now >= self._due + overdue:
            self._look(now)

    def _diagnose(self) -> None:
        """Report on some connectors after the others, each once a second, and on the recording."""
        self._look_for(_OVERDUE)
        first = self._next_report
        those = self._connectors[first : first + self._at_once]
        self._next_report = (first + len(those)) % len(self._connectors)
        if not first:
            self._look_for_types()
        parts: list[Part] = []
        for connector in those:
            recorder = self.recorder if connector is self._connectors[0] else None
            parts += connector.report(recorder)
        self._diagnostics.publish(written(self.get_clock().now().nanoseconds, parts))
        for part in parts:  # the log says what is new; how often it was is in the report
            bad = part.level != OK
            if bad and self._said.get(part.name) != part.message:
                self.get_logger().warning(f"{part.name}: {part.message}")
            self._said[part.name] = part.message if bad else ""

    def _look_for_types(self) -> None:
        """Ask the graph, now and then, who publishes other messages on an input."""
        now = time.monotonic()
        if now >= self._graph_due:
            self._graph_due = now + _GRAPH
            graph = dict(self.get_topic_names_and_types())
            for connector in self._connectors:
                connector.topics.look_for_types(graph)

    def caught(self, error: Exception) -> bool:
        """Count and report what a callback raised; the node goes on."""
        links = self._connectors[0].links
        links.caught += 1
        links.caught_text = f"{type(error).__name__}: {error}"
        self.get_logger().error(links.caught_text, throttle_duration_sec=1.0)
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
        """Make the connectors and their publishers."""
        return self._transition("inactive", state, self._configure, super().on_configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin a new history: subscribe, and record if asked to."""
        return self._transition("active", state, super().on_activate, self._activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Send last zero wrenches, unsubscribe, close the recording."""
        return self._transition("inactive", state, self._deactivate, super().on_deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release connectors and publishers."""
        return self._transition("unconfigured", state, super().on_cleanup, self._clean)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate if active, and release everything; the process ends."""
        result = self._transition(
            "finalized", state, self._deactivate, super().on_shutdown, self._clean
        )
        if not self.done.done():
            self.done.set_result(run_node.OK)
        return result

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release everything, to be configured anew."""
        return self._transition("unconfigured", state, self._deactivate, self._clean)

    def finish(self) -> None:
        """Shut down in order: zero wrenches, recording, publishers."""
        if self.state != "finalized":
            self.trigger_shutdown()

    def _transition(self, to: str, state: LifecycleState, *steps: Any) -> TransitionCallbackReturn:
        """Take steps; a failure is logged and leaves the node where it was."""
        try:
            for step in steps:
                step(state)
        except Exception as error:
            self.failure = str(error) or type(error).__name__
            self.get_logger().error(self.failure)
            return TransitionCallbackReturn.FAILURE
        self.state = to
        for connector in self._connectors:
            connector.links.state = to
        return TransitionCallbackReturn.SUCCESS

    def _configure(self, _state: LifecycleState) -> None:
        run_node.announce_compiling(step, self.get_logger().info)
        alike: dict[str, list[str]] = {}
        for connector in self._connectors:
            alike.setdefault(connector.configure(), []).append(connector.name)
        if len(self._groups) < len(self._connectors):
            run_node.announce_compiling(answer_together, self.get_logger().info)
        for group in self._groups:
            text = solve_together(group)
            if text:
                self.get_logger().info(text)
        for model, names in alike.items():
            self.get_logger().info(said(", ".join(names), model))

    def _activate(self, _state: LifecycleState) -> None:
        for connector in self._connectors:
            connector.activate()
        if self.scene.record.enabled:
            try:
                self.get_logger().info(self._open_recording())
            except RecordingError as error:
                self.get_logger().error(f"{error}; serving without a recording")
        groups = [executor.joined([one.open_inputs() for one in group]) for group in self._groups]
        if self._loop is not None:
            self._loop.open(groups)

    def _deactivate(self, _state: LifecycleState) -> None:
        if self.state != "active":
            return
        if self._loop is not None:
            self._loop.close()
        for connector in self._connectors:
            connector.deactivate()
        end = time.monotonic() + _TAKING
        for connector in self._connectors:
            connector.wait_until_taken(Duration(seconds=max(0.0, end - time.monotonic())))
        if self.recorder.running:
            try:
                self.get_logger().info(self.recorder.stop())
            except RecordingError as error:
                self.get_logger().error(str(error))

    def _clean(self, _state: LifecycleState) -> None:
        for connector in self._connectors:
            connector.clean()

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
        directory = open_run(self.recorder, self, self.scene.record, self._connectors)
        return f"recording to {directory}"

    def _start_anew(self) -> str:
        """Forget all history; a recording goes on in a new run, as a run is one history."""
        if self._connectors[0].answering is None:
            raise SceneError(f"the node is {self.state}: nothing to reset")
        with self._lock:
            for connector in self._connectors:
                connector.forget()
            if not self.recorder.running:
                return "reset: the next sample is the reference configuration"
            return f"reset; {self.recorder.stop()}; {self._open_recording()}"

    def _prepare(self, scenes: Mapping[str, Scene]) -> None:
        """Make the connectors of changed scenes before the change is accepted."""
        for scene in scenes.values():
            self.recorder.check(scene.record.directory)
        if self.recorder.running:
            raise SceneError("parameters cannot change during a recording; call ~/stop_recording")
        for connector in self._connectors:
            if connector.name in scenes:
                connector.prepare(scenes[connector.name])

    def _apply(self, scenes: Mapping[str, Scene], before: Mapping[str, Scene]) -> None:
        for connector in self._connectors:
            name = connector.name
            if name in scenes:
                changes = ", ".join(
                    f"{n}: {old} -> {new}"
                    for n, old, new in differences(before[name], scenes[name])
                )
                self.get_logger().info(said(name, f"parameters changed: {changes or 'nothing'}"))
        with self._lock:
            for connector in self._connectors:
                if connector.name in scenes:
                    connector.apply()
            for group in self._groups:
                solve_together(group)
            self._due = 0.0  # the timeout may be another


def _make(arguments: Arguments) -> ConnectorNode:
    node = ConnectorNode(arguments.parameters)
    node.start()
    return node


def main(argv: list[str] | None = None) -> int:
    """Run the executable ``connector``; return its exit code."""
    return run_node.run("connector", _make, USAGE, argv)


if __name__ == "__main__":
    raise SystemExit(main())
