"""One connector of a node: topics, message pipeline, timeout and diagnostics.

A node has one endpoint for each connector that its parameters name. All endpoints are processed by
one thread, recorded in one run and moved through the lifecycle together.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode

from cylconn_ros.messages.coupled_pipeline import CoupledPipeline
from cylconn_ros.messages.pipeline import OUTPUTS, MessagePipeline, Response
from cylconn_ros.messages.topic_names import prefix_log
from cylconn_ros.ros.connector.diagnostics import ConnectionStatus, Monitor
from cylconn_ros.ros.connector.diagnostics_encoder import EncodedStatus
from cylconn_ros.ros.connector.held_messages import HeldMessages
from cylconn_ros.ros.connector.problems import OK, log_model, timeout_text
from cylconn_ros.ros.connector.recorder import Recorder, now
from cylconn_ros.ros.connector.topics import Topics, is_triggering
from cylconn_ros.ros.connector.watchdog import (
    IncompleteSamples,
    LoadWait,
    Watchdog,
    WatchdogEvent,
)
from cylconn_ros.ros.executor import fused
from cylconn_ros.ros.executor.executor import InputGroup, InputSubscription, Receive
from cylconn_ros.ros.executor.fused import FusedPath
from cylconn_ros.ros.executor.sequence_numbers import SequenceNumbers
from cylconn_ros.scene.inputs import STREAM_NUMBER
from cylconn_ros.scene.scene import Scene

if TYPE_CHECKING:
    from cylconn_ros.recording.writer import RunWriter


class ConnectorEndpoint:
    """A connector; ``name`` is the prefix of its parameters and topics, empty for a single one.

    Attributes
    ----------
        pipeline: processes the messages, from configuration to clean-up.
        topics: publishers and subscriptions. status: their connection status.
        history, remembered: samples since the last reset; since the memory was empty.
        coupled, partners: solver of connectors that share bodies, and its endpoints in order.
        forwards: by input, the endpoints and inputs that receive the same messages.
    """

    def __init__(
        self,
        node: LifecycleNode,
        name: str,
        scene: Callable[[], Scene],
        recorder: Recorder,
        lock: Any,
        own_thread: bool,
        held: HeldMessages,
    ) -> None:
        """``scene`` returns the scene in force; ``lock`` protects the pipeline.

        ``held``: takes the messages while the physics is being compiled.

        ``own_thread``: a :class:`~cylconn_ros.ros.executor.executor.SampleExecutor` takes the
        inputs, not the node's executor.
        """
        self.name = name
        self._node, self._scene, self._recorder, self._lock = node, scene, recorder, lock
        self.status = ConnectionStatus()
        self.topics = Topics(node, name, self.status, own_thread)
        self._own_thread, self._held = own_thread, held
        self._entries: list[InputSubscription] = []  # while inputs are open
        self._fused: FusedPath | None = None  # while inputs are open, if it is supported
        self.coupled: CoupledPipeline | None = None
        self.partners: list[ConnectorEndpoint] = []  # in the order of the members of ``coupled``
        self.forwards: dict[str, list[tuple[ConnectorEndpoint, str]]] = {}
        self.pipeline: MessagePipeline | None = None
        self._prepared: MessagePipeline | None = None  # of parameters that are not yet in force
        self._processed_at = 0.0  # s, steady clock
        self._load_wait = LoadWait()
        self._incomplete, self._watchdog = IncompleteSamples(), Watchdog()
        one = scene()  # fixed when the node starts
        self._requested = one.markers or one.tf or one.feed_forward.enabled
        self.history = 0
        self.remembered = 0
        own_name = node.get_fully_qualified_name().strip("/")
        self._monitor = Monitor(f"{own_name}/{name}" if name else own_name)

    # --- samples ---------------------------------------------------------------------------------

    def open_inputs(self) -> InputGroup:
        """Subscribe; return the subscriptions for a SampleExecutor."""
        assert self.pipeline is not None
        self._entries = self.topics.open_inputs(self.pipeline, self._receiver)
        return self.input_group()

    def input_group(self) -> InputGroup:
        """The open subscriptions for a SampleExecutor, on the fused path if it can be used now."""
        pipeline, entries = self.pipeline, self._entries
        assert pipeline is not None
        if self._own_thread:  # it checks often enough to end a wait
            pipeline.matcher.expects = self.topics.expects_load
        if self._held.active or not self._can_fuse():
            return InputGroup(entries, None, self._is_partial, self.end_waits)
        names = [name for name in pipeline.inputs if is_triggering(name)]
        triggering = [entry for entry in entries if entry.triggering]
        inputs = [
            fused.Input(
                entry.subscription, STREAM_NUMBER[name], entry.receive, SequenceNumbers(entry.lost)
            )
            for name, entry in zip(names, triggering, strict=True)
        ]
        self._fused = FusedPath(inputs, self.topics.publishers, pipeline.parts, self._on_fused)
        return InputGroup(entries, self._take_fused, self._is_partial, self.end_waits)

    def _can_fuse(self) -> bool:
        """Return True if this connector can use the fused path: alone, compiled, own thread."""
        alone = self.coupled is None and not self.forwards and not self.topics.remote
        return self._own_thread and alone and not fused.missing()

    def _is_partial(self) -> bool:
        """Return True if messages of a sample that is not processed are received."""
        pipeline, coupled = self.pipeline, self.coupled
        partial = pipeline is not None and pipeline.decoder.is_partial
        return partial or (coupled is not None and coupled.is_partial)

    def end_waits(self, now: float) -> None:
        """Process a sample that has waited for its load long enough at ``now`` (steady clock)."""
        assert self.pipeline is not None
        if self._load_wait.is_over(self.pipeline, now):
            self._publish_all(self.pipeline.give_up())

    def _publish_all(self, outputs: Response | None) -> None:
        """Publish and record the outputs of a sample, and of those that are complete after it."""
        processed: list[tuple[ConnectorEndpoint, Response]] = []
        self._respond(outputs, processed)
        if self._recorder.running:
            for endpoint, outputs in processed:
                endpoint.record(outputs)

    def _take_fused(
        self, first: int | None, on_error: Callable[[Exception], object], one: bool
    ) -> tuple[bool, int | None]:
        assert self._fused is not None
        writer = self._recorder.writer
        if writer is not self._fused.writer:
            self._fused.record(writer, [] if writer is None else self._channels(writer))
        return self._fused.take(first, on_error, one)

    def _channels(self, writer: RunWriter) -> list[int]:
        """Channel numbers of the fused path's inputs and outputs in the recording."""
        assert self.pipeline is not None
        inputs = [name for name in self.pipeline.inputs if is_triggering(name)]
        names = [*inputs, *(name for name, _ in OUTPUTS)]
        return [writer.channels[self.topics.resolved(name)] for name in names]

    def _on_fused(self, samples: int) -> None:
        """Take over stamps and counts of samples that the fused path computed and published."""
        assert self.pipeline is not None
        assert self._fused is not None
        status = self._fused.status
        stamp, previous, has_previous, unpublished = status[fused.STAMP : fused.UNPUBLISHED + 1]
        self.pipeline.advance(stamp, previous if has_previous else None, samples)
        if unpublished:
            status[fused.UNPUBLISHED] = 0
            self.topics.count_unpublished(unpublished)
        self._published(stamp, samples)

    def _receiver(self, name: str, topic: str) -> Receive:
        """Make the handler of messages of input ``name``, received on ``topic``."""
        recorder, held = self._recorder, self._held
        receivers = [(self, name), *self.forwards.get(name, ())]

        def receive(data: bytes) -> bool:
            """Process, publish, record; return True if a sample was complete."""
            if held.active:
                held.add((self.name, name), receive, data)
                return False
            recording = recorder.running
            received_at = now() if recording else 0
            processed: list[tuple[ConnectorEndpoint, Response]] = []
            for endpoint, input_name in receivers:
                endpoint.receive(input_name, data, processed)
            if recording:
                recorder.write(topic, data, received_at)
                for endpoint, outputs in processed:
                    endpoint.record(outputs)
            return bool(processed)

        return receive

    def receive(
        self, name: str, data: bytes, processed: list[tuple[ConnectorEndpoint, Response]]
    ) -> None:
        """Process a message of an input; publish the outputs and append them to ``processed``."""
        assert self.pipeline is not None
        self._respond(self.pipeline.inputs[name].receive(data), processed)

    def _respond(
        self, outputs: Response | None, processed: list[tuple[ConnectorEndpoint, Response]]
    ) -> None:
        """Publish the outputs of a sample, and of those that are complete after it."""
        assert self.pipeline is not None
        while outputs is not None:
            self._publish(outputs)
            processed.append((self, outputs))
            if self.coupled is not None:
                for k, other in self.coupled.take_responses().items():
                    self.partners[k]._publish(other)
                    processed.append((self.partners[k], other))
            outputs = self.pipeline.next()

    def _publish(self, outputs: Response) -> None:
        self.topics.publish(outputs)
        self._published(outputs.stamp, 1)

    def _published(self, stamp: int, samples: int) -> None:
        self._processed_at = time.monotonic()
        self.history += samples
        self.remembered += samples
        if self._requested and self.pipeline is not None:
            self.topics.publish_requested(stamp, self.pipeline)

    def record(self, outputs: Response) -> None:
        """Record the outputs of a sample, after the message that completed it."""
        published_at = now()
        for topic, data in self.topics.outgoing(outputs):
            self._recorder.write(topic, data, published_at)

    def _wanted(self, name: str) -> bool:
        """Return True if an output is needed: it has subscribers, or it is recorded."""
        return self._recorder.running or self.topics.has_subscribers(name)

    def check(self, now: float) -> float:
        """Check the inputs at ``now``; return the time of the next check (s, steady clock)."""
        pipeline, watchdog = self.pipeline, self._watchdog
        if pipeline is None or now < watchdog.due:
            return watchdog.due
        with self._lock:
            pipeline.flush()
            self._publish_all(pipeline.next())
            self.end_waits(now)
            scene, last = self._scene(), self._processed_at if self.history else None
        logger = self._node.get_logger()
        warning = self._incomplete.check(pipeline.matcher, scene, now)
        if warning:
            logger.warning(prefix_log(self.name, warning))
        event = watchdog.check(now, last, scene.timeout)
        self.status.timed_out = watchdog.timed_out
        if event is WatchdogEvent.RESUMED:
            logger.info(prefix_log(self.name, "input resumed"))
        elif event is WatchdogEvent.TIMEOUT:
            self.status.timeouts += 1
            logger.warning(prefix_log(self.name, timeout_text(scene.timeout)))
            self.send_zero()
        return watchdog.due

    def send_zero(self) -> None:
        """Publish zero wrenches, if any sample was processed before."""
        with self._lock:
            outputs = None if self.pipeline is None else self.pipeline.zero()
            if outputs is not None:
                self.topics.publish(outputs)
                self.topics.end_feed_forward(outputs.stamp)
                self.record(outputs)

    def report(self, recorder: Recorder | None) -> list[EncodedStatus]:
        """Diagnostics of the connector, and of the recording if ``recorder`` is given."""
        self.status.not_processed, self.status.new_parameters = (
            self.not_processed,
            self.has_prepared,
        )
        with self._lock:  # events during the report belong to the next one
            health = None if self.pipeline is None else self.pipeline.health.report()
        return self._monitor.report(self.pipeline, recorder, self.status, health)

    def log_new_problems(self) -> None:
        """Log each problem once: when it is new (:class:`Monitor`)."""
        logger = self._node.get_logger()
        for level, text in self._monitor.take_log():
            if level == OK:
                logger.info(text)
            else:
                logger.warning(text)

    # --- lifecycle and parameters ----------------------------------------------------------------

    def configure(self) -> tuple[str, str]:
        """Create pipeline and publishers; return what is modelled, and what is not.

        The kernels of the pipeline are not loaded yet (:meth:`load_kernels`).
        """
        self.pipeline, self.coupled = MessagePipeline(self._scene(), load=False), None
        self.pipeline.wanted = self._wanted
        self.topics.open_outputs(self._scene())
        connector = self.pipeline.connector
        return connector.model, connector.not_modelled

    def load_kernels(self) -> None:
        """Load or compile the kernels for the scene in force, and for the one to come."""
        for pipeline in (self.pipeline, self._prepared):
            if pipeline is not None and not pipeline.is_loaded:
                pipeline.load_kernels()
                if self._can_fuse():
                    fused.prepare(pipeline.parts)

    @property
    def is_open(self) -> bool:
        """Whether the inputs are open."""
        return bool(self._entries)

    @property
    def not_processed(self) -> int:
        """Samples that have arrived and wait until the physics is compiled."""
        inputs = () if self.pipeline is None else self.pipeline.inputs
        own = [name for name in inputs if is_triggering(name) and name not in self.topics.remote]
        return self._held.samples((self.name, name) for name in own) if self._held.active else 0

    def activate(self) -> None:
        """Start a new history."""
        assert self.pipeline is not None
        self._monitor.forget()
        self.pipeline.commands.release()  # those from before deactivation may be out of date
        self.reset()

    def deactivate(self) -> None:
        """Unsubscribe, and send a last zero wrench."""
        self.topics.close_inputs()
        self._entries = []
        if self._fused is not None:
            self._fused.close()
            self._fused = None
        self.send_zero()

    def clean_up(self) -> None:
        """Release pipeline and publishers."""
        self.topics.close_outputs()
        self.pipeline = None

    def wait_for_acknowledgement(self, timeout: Duration) -> None:
        """Wait until subscribers have acknowledged the wrenches, at most ``timeout``."""
        self.topics.wait_for_acknowledgement(timeout)

    def reset(self) -> None:
        """Forget the reference configuration and all history."""
        pipeline = self.pipeline
        assert pipeline is not None
        while pipeline.decoder.waiting is not None:  # it belongs to the history that ends
            self._publish_all(pipeline.give_up())
        pipeline.reset()
        if self.coupled is not None:
            self.coupled.reset()
        self.history = 0
        if pipeline.scene.latency == 0:
            self.remembered = 0
        self._watchdog.reset()
        self.status.timed_out = False

    def make(self, scene: Scene) -> MessagePipeline | None:
        """The pipeline of a changed scene; raises SceneError if it cannot be used."""
        if self.pipeline is None:
            return None
        made = MessagePipeline(scene, load=False)
        made.commands.keep(self.pipeline.commands)
        return made

    def prepare(self, made: MessagePipeline | None) -> None:
        """Let :meth:`apply` put a pipeline in force, in place of one prepared before."""
        self._prepared = made

    @property
    def has_prepared(self) -> bool:
        """Whether parameters have been accepted that are not in force yet."""
        return self._prepared is not None

    def apply(self) -> None:
        """Put the prepared pipeline in force; its kernels have been loaded."""
        prepared, previous, self._prepared = self._prepared, self.pipeline, None
        if prepared is None or previous is None:
            return
        with self._lock:
            prepared.restore_from(previous)
            self.pipeline = prepared
            self._watchdog.due = 0.0
            if self._fused is not None:
                self._fused.use(prepared.parts)
            if not prepared.continues:
                self.reset()
        logger = self._node.get_logger()
        model, before = (
            (one.connector.model, one.connector.not_modelled) for one in (prepared, previous)
        )
        if model != before:
            log_model(logger, [self.name], *model)
        if not prepared.continues:
            logger.info(prefix_log(self.name, "the next sample is the reference configuration"))
