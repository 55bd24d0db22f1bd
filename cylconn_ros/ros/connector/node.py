"""Lifecycle node of the executable ``connector``; see ``connector --help``."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger

from cylconn_ros.errors import RecordingError, SceneError
from cylconn_ros.messages.pipeline import MessagePipeline
from cylconn_ros.messages.topic_names import prefix_log
from cylconn_ros.ros import run_node
from cylconn_ros.ros.arguments import Arguments
from cylconn_ros.ros.connector.diagnostics_encoder import EncodedStatus, encode_diagnostics
from cylconn_ros.ros.connector.endpoint import ConnectorEndpoint
from cylconn_ros.ros.connector.held_messages import HeldMessages
from cylconn_ros.ros.connector.loading import KernelLoader, Samples, input_groups
from cylconn_ros.ros.connector.open_recording import open_recording
from cylconn_ros.ros.connector.parameters import FROZEN, SceneParameters, differences, ros_part
from cylconn_ros.ros.connector.problems import log_model
from cylconn_ros.ros.connector.recorder import Recorder
from cylconn_ros.ros.connector.shared_bodies import couple_connectors, share_body_topics
from cylconn_ros.ros.connector.topics import assign_frames, check_qos_overrides
from cylconn_ros.ros.executor import executor, fused
from cylconn_ros.ros.lifecycle import answer_unavailable_transitions
from cylconn_ros.scene.parameter_file import scene_part
from cylconn_ros.scene.scene import Scene, several

USAGE = """\
usage: connector [--version] --ros-args [--params-file FILE] [-p NAME:=VALUE] [-r FROM:=TO] ...

Cylindrical connector between two bodies: subscribe to their poses and twists, and publish the
wrenches on both for each sample. Needs a scene, at least node_a.orientation and the moving bodies'
mass and inertia, from a parameter file or -p. connectors: [NAME, ...] runs several, each with its
parameters and topics below its name. Stop with Ctrl-C.
Parameters: docs/reference/parameters.md; an example with all of them: config/connector.yaml.
Exit codes: 0 stopped, 2 invalid arguments or parameters, 130 interrupted while compiling."""


_CHECK_LEAST, _CHECK_MOST = 0.02, 0.1  # s between checks of the timeouts
_OVERDUE = 0.5  # s without a check after which the node's executor checks instead
_REPORTS = 1.0  # s between diagnostics of a connector
_ROUNDS, _MOST = 10, 16  # diagnostics messages per second; connectors in a message
_GRAPH = 2.5  # s between queries of the graph
_ACKNOWLEDGE = 0.2  # s for the last wrenches to be acknowledged


class ConnectorNode(LifecycleNode):
    """Node with one connector, or with each connector that the parameters name.

    Raises SceneError at construction if the parameters are invalid.
    """

    def __init__(self, parameters: Mapping[str, Any], **node_arguments: Any) -> None:
        """Take dotted parameters; ``node_arguments`` go to the ROS node (namespace, context …)."""
        scenes = several(scene_part(parameters))
        super().__init__("connector", parameter_overrides=ros_part(parameters), **node_arguments)
        answer_unavailable_transitions(self)
        self.done = Future()
        self.failure = self._frozen = ""  # reasons: of the last failed transition, of refusals
        self.parameters = SceneParameters(self, scenes, self._prepare, self._apply)
        self._lock = threading.RLock()  # protects pipelines and recording
        self.recorder = Recorder(Path(self.scene.record.directory), self._lock)
        missing = executor.missing(self)
        if missing:
            self.get_logger().warning(
                f"rclpy has no {missing}: samples are processed by its own executor, which is "
                "slower"
            )
        elif fused.missing():
            self.get_logger().warning(
                f"{fused.missing()} is missing: samples are processed in Python, which is slower"
            )
        self._executor = (
            None
            if missing
            else executor.SampleExecutor(self, self._lock, self.handle_error, self._check)
        )
        self._held = HeldMessages()
        self._connectors = [self._endpoint(name) for name in scenes]
        self._groups = share_body_topics(self._connectors, scenes)
        topics = {one.topics: scenes[one.name] for one in self._connectors}
        check_qos_overrides(self, parameters, topics)
        assign_frames(topics)
        self.state = "unconfigured"  # of the lifecycle
        self._next_report = 0
        self._graph_due = 0.0
        self._due = 0.0  # time of the next check (s, steady clock)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._loader = KernelLoader(
            self, self._steady, Samples(self._groups, self._executor, self._lock, self._held),
            lambda: self.parameters.scenes, self._put_in_force,
        )  # fmt: skip
        self._made: list[tuple[ConnectorEndpoint, MessagePipeline | None]] = []
        self._per_round = min(math.ceil(len(scenes) / _ROUNDS), _MOST)
        rounds = math.ceil(len(scenes) / self._per_round)
        self.create_timer(_REPORTS / rounds, self._diagnose, clock=self._steady)
        if self._executor is None:
            self.create_timer(_CHECK_LEAST, lambda: self._check_if_due(0.0), clock=self._steady)
        for name, handler in (
            ("~/start_recording", self._start_recording),
            ("~/stop_recording", self._stop_recording),
            ("~/reset", self._reset),
        ):
            self.create_service(Trigger, name, handler)

    def _endpoint(self, name: str) -> ConnectorEndpoint:
        own_thread = self._executor is not None
        return ConnectorEndpoint(
            self, name, lambda: self.parameters.scenes[name], self.recorder, self._lock, own_thread,
            self._held,
        )  # fmt: skip

    @property
    def scene(self) -> Scene:
        """Scene in force of the first connector; parameters of the node are the same in all."""
        return next(iter(self.parameters.scenes.values()))

    # --- checks and diagnostics ------------------------------------------------------------------

    def _check(self, now: float) -> float:
        """Check the timeouts at ``now``; return the time of the next check (s, steady clock)."""
        if now >= self._due:
            first = min(connector.check(now) for connector in self._connectors)
            self._due = max(first, now + _CHECK_LEAST)
        return min(self._due, now + _CHECK_MOST)

    def _check_if_due(self, overdue: float) -> None:
        """Check on the node's executor if the check is more than ``overdue`` s late."""
        now = time.monotonic()
        if self.state == "active" and now >= self._due + overdue:
            self._check(now)

    def _diagnose(self) -> None:
        """Report on the next connectors, each once per second, and on the recording."""
        self._check_if_due(_OVERDUE)
        first = self._next_report
        those = self._connectors[first : first + self._per_round]
        self._next_report = (first + len(those)) % len(self._connectors)
        if not first:
            self._check_types()
        parts: list[EncodedStatus] = []
        for connector in those:
            recorder = self.recorder if connector is self._connectors[0] else None
            connector.status.compiling = self._loader.progress
            parts += connector.report(recorder)
        self._diagnostics.publish(encode_diagnostics(self.get_clock().now().nanoseconds, parts))
        for connector in those:
            connector.log_new_problems()

    def _check_types(self) -> None:
        """Query the graph for peers of another message type or with incompatible QoS."""
        now = time.monotonic()
        if now >= self._graph_due:
            self._graph_due = now + _GRAPH
            graph = dict(self.get_topic_names_and_types())
            for connector in self._connectors:
                connector.topics.check_types(graph)
                connector.topics.withdraw_incompatible()
                connector.topics.count_commanders()

    def handle_error(self, error: Exception) -> bool:
        """Count and log an exception of a callback; return True: the node continues."""
        status = self._connectors[0].status
        status.failed_callbacks += 1
        status.callback_error = f"{type(error).__name__}: {error}"
        self.get_logger().error(status.callback_error, throttle_duration_sec=1.0)
        return True

    # --- lifecycle -------------------------------------------------------------------------------

    def start(self) -> None:
        """Configure and activate, unless ``autostart`` is false; raise SceneError on failure."""
        if not self.scene.autostart:
            self.get_logger().info("waiting for configure and activate (autostart is false)")
            return
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() != TransitionCallbackReturn.SUCCESS:
                raise SceneError(self.failure)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Create the pipelines and publishers."""
        return self._transition("inactive", state, self._configure, super().on_configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start a new history: subscribe, and record if ``record.enabled``."""
        return self._transition("active", state, super().on_activate, self._activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Unsubscribe, send zero wrenches, close the recording."""
        return self._transition("inactive", state, self._deactivate, super().on_deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release pipelines and publishers."""
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
        """Release everything; the node can be configured again."""
        return self._transition("unconfigured", state, self._deactivate, self._clean)

    def finish(self) -> None:
        """Shut down in order: zero wrenches, recording, publishers."""
        self._loader.close()
        if self.state != "finalized":
            self.trigger_shutdown()

    def _transition(self, to: str, state: LifecycleState, *steps: Any) -> TransitionCallbackReturn:
        """Run the steps of a transition; a failure is logged and the state does not change."""
        try:
            for step in steps:
                step(state)
        except Exception as error:
            self.failure = str(error) or type(error).__name__
            self.get_logger().error(self.failure)
            return TransitionCallbackReturn.FAILURE
        self.state = to
        if to == "active" and self.scene.access.frozen:
            self._frozen = FROZEN
        for connector in self._connectors:
            connector.status.state = to
        return TransitionCallbackReturn.SUCCESS

    def _configure(self, _state: LifecycleState) -> None:
        by_model: dict[tuple[str, str], list[str]] = {}
        for connector in self._connectors:
            by_model.setdefault(connector.configure(), []).append(connector.name)
        for model, names in by_model.items():
            log_model(self.get_logger(), names, *model)
        self._held.active = not self._loader.load()

    def _activate(self, _state: LifecycleState) -> None:
        for connector in self._connectors:
            connector.activate()
        if self.scene.record.enabled:
            try:
                self.get_logger().info(self._open_recording())
            except RecordingError as error:
                self.get_logger().error(f"{error}; running without a recording")
        for connector in self._connectors:
            connector.open_inputs()
        if self._executor is not None:
            self._executor.open(input_groups(self._groups))

    def _deactivate(self, _state: LifecycleState) -> None:
        if self.state != "active":
            return
        if self._executor is not None:
            self._executor.close()
        self._loader.drop_samples()
        for connector in self._connectors:
            connector.deactivate()
        end = time.monotonic() + _ACKNOWLEDGE
        for connector in self._connectors:
            connector.wait_for_acknowledgement(Duration(seconds=max(0.0, end - time.monotonic())))
        if self.recorder.running:
            try:
                self.get_logger().info(self.recorder.stop())
            except RecordingError as error:
                self.get_logger().error(str(error))

    def _clean(self, _state: LifecycleState) -> None:
        for connector in self._connectors:
            connector.clean_up()

    # --- services and parameters -----------------------------------------------------------------

    def _start_recording(self, _request: Any, response: Any) -> Any:
        with self._lock:
            return self._respond(response, self._begin_recording)

    def _stop_recording(self, _request: Any, response: Any) -> Any:
        return self._respond(response, self.recorder.stop)

    def _reset(self, _request: Any, response: Any) -> Any:
        return self._respond(response, self._restart)

    def _respond(self, response: Any, act: Any) -> Any:
        try:
            if self._frozen:
                raise SceneError(self._frozen)
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

    def _begin_recording(self) -> str:
        if not self._held.active and any(one.has_prepared for one in self._connectors):
            raise RecordingError(
                "parameters are not in force yet, because their method is being compiled "
                f"({self._loader.progress}); call again when it is"
            )
        return self._open_recording()

    def _open_recording(self) -> str:
        directory = open_recording(self.recorder, self, self.scene.record, self._connectors)
        return f"recording to {directory}"

    def _restart(self) -> str:
        """Forget all history; a recording continues in a new run, because a run is one history."""
        if self._connectors[0].pipeline is None:
            raise SceneError(f"the node is {self.state}: nothing to reset")
        with self._lock:
            for connector in self._connectors:
                connector.reset()
            if not self.recorder.running:
                return "reset: the next sample is the reference configuration"
            return f"reset; {self.recorder.stop()}; {self._open_recording()}"

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters; one that keeps its value changes nothing, even if it is read-only."""
        changes = self.parameters.changes(parameter_list)
        if parameter_list and not changes:
            return SetParametersResult(successful=True)
        if self._frozen:
            return SetParametersResult(successful=False, reason=self._frozen)
        return super().set_parameters_atomically(changes)

    def _prepare(self, scenes: Mapping[str, Scene]) -> None:
        """Create the pipelines of changed scenes before the change is accepted."""
        for scene in scenes.values():
            self.recorder.check(scene.record.directory)
        if self.recorder.running:
            raise SceneError("parameters cannot change during a recording; call ~/stop_recording")
        self._made = [
            (connector, connector.make(scenes[connector.name]))
            for connector in self._connectors
            if connector.name in scenes
        ]

    def _apply(self, scenes: Mapping[str, Scene], before: Mapping[str, Scene]) -> None:
        for connector in self._connectors:
            name = connector.name
            if name in scenes:
                changes = ", ".join(
                    f"{n}: {old} -> {new}"
                    for n, old, new in differences(before[name], scenes[name])
                )
                self.get_logger().info(
                    prefix_log(name, f"parameters changed: {changes or 'nothing'}")
                )
        for connector, made in self._made:
            connector.prepare(made)
        if self._loader.load() or self._held.active:
            self._put_in_force()
        elif any(connector.has_prepared for connector in self._connectors):
            self.get_logger().info("the parameters are in force when their method is compiled")

    def _put_in_force(self) -> None:
        """Use the parameters that have been accepted from the next sample on."""
        with self._lock:
            for connector in self._connectors:
                connector.apply()
            if not self._held.active:
                for group in self._groups:
                    couple_connectors(group)
            self._due = 0.0  # the timeout may have changed


def _make(arguments: Arguments) -> ConnectorNode:
    node = ConnectorNode(arguments.parameters)
    node.start()
    return node


def main(argv: list[str] | None = None) -> int:
    """Run the executable ``connector``; return its exit code."""
    return run_node.run("connector", _make, USAGE, argv)


if __name__ == "__main__":
    raise SystemExit(main())
