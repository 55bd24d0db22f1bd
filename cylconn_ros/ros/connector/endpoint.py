"""One connector of a node: topics, message pipeline, timeout and diagnostics.

A node has one endpoint for each connector that its parameters name. All endpoints are processed by
one thread, recorded in one run and moved through the lifecycle together.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode

from cylconn_ros.messages.coupled_pipeline import CoupledPipeline
from cylconn_ros.messages.pipeline import OUTPUTS, MessagePipeline, Response
from cylconn_ros.messages.topic_names import prefix_log
from cylconn_ros.recording.writer import RunWriter
from cylconn_ros.ros.connector.diagnostics import ConnectionStatus, Monitor, timeout_text
from cylconn_ros.ros.connector.diagnostics_encoder import EncodedStatus
from cylconn_ros.ros.connector.recorder import Recorder, now
from cylconn_ros.ros.connector.topics import Topics, is_triggering
from cylconn_ros.ros.connector.watchdog import IncompleteSamples, Watchdog, WatchdogEvent
from cylconn_ros.ros.executor import fused
from cylconn_ros.ros.executor.executor import InputGroup, Receive
from cylconn_ros.ros.executor.fused import FusedPath
from cylconn_ros.ros.executor.sequence_numbers import SequenceNumbers
from cylconn_ros.scene.inputs import STREAM_NUMBER
from cylconn_ros.scene.scene import Scene


class ConnectorEndpoint:
    """A connector; ``name`` is the prefix of its parameters and topics, empty for a single one.

    Attributes
    ----------
        pipeline: processes the messages, from configuration to clean-up.
        topics: publishers and subscriptions. status: their connection status.
        history: samples processed since the last reset.
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
    ) -> None:
        """``scene`` returns the scene in force; ``lock`` protects the pipeline.

        ``own_thread``: a :class:`~cylconn_ros.ros.executor.executor.SampleExecutor` takes the
        inputs, not the node's executor.
        """
        self.name = name
        self._node, self._scene, self._recorder, self._lock = node, scene, recorder, lock
        self.status = ConnectionStatus()
        self.topics = Topics(node, name, self.status, own_thread)
        self._own_thread = own_thread
        self._fused: FusedPath | None = None  # while inputs are open, if it is supported
        self.coupled: CoupledPipeline | None = None
        self.partners: list[ConnectorEndpoint] = []  # in the order of the members of ``coupled``
        self.forwards: dict[str, list[tuple[ConnectorEndpoint, str]]] = {}
        self.pipeline: MessagePipeline | None = None
        self._prepared: MessagePipeline | None = None
        self._processed_at = 0.0  # s, steady clock
        self._incomplete, self._watchdog = IncompleteSamples(), Watchdog()
        self._drawing = scene().markers  # fixed when the node starts
        self.history = 0
        own_name = node.get_fully_qualified_name().strip("/")
        self._monitor = Monitor(f"{own_name}/{name}" if name else own_name)

    # --- samples ---------------------------------------------------------------------------------

    def open_inputs(self) -> InputGroup:
        """Subscribe; return the subscriptions for a SampleExecutor."""
        pipeline = self.pipeline
        assert pipeline is not None
        entries = self.topics.open_inputs(pipeline, self._receiver)
        if not self._can_fuse():
            return InputGroup(entries)
        names = [name for name in pipeline.inputs if is_triggering(name)]
        triggering = [entry for entry in entries if entry.triggering]
        inputs = [
            fused.Input(
                entry.subscription, STREAM_NUMBER[name], entry.receive, SequenceNumbers(entry.lost)
            )
            for name, entry in zip(names, triggering, strict=True)
        ]
        self._fused = FusedPath(inputs, self.topics.publishers, pipeline.parts, self._on_fused)
        return InputGroup(entries, self._take_fused)

    def _can_fuse(self) -> bool:
        """Return True if this connector can use the fused path: alone, compiled, own thread."""
        alone = self.coupled is None and not self.forwards and not self.topics.remote
        return self._own_thread and alone and not fused.missing()

    def _take_fused(self, on_error: Callable[[Exception], object]) -> int | None:
        assert self._fused is not None
        writer = self._recorder.writer
        if writer is not self._fused.writer:
            self._fused.record(writer, [] if writer is None else self._channels(writer))
        return self._fused.take(on_error)

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
        recorder = self._recorder
        receivers = [(self, name), *self.forwards.get(name, ())]

        def receive(data: bytes) -> bool:
            """Process, publish, record; return True if a sample was complete."""
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
        pipeline = self.pipeline
        assert pipeline is not None
        outputs = pipeline.inputs[name].receive(data)
        if outputs is None:
            return
        self._publish(outputs)
        processed.append((self, outputs))
        if self.coupled is not None:
            for k, other in self.coupled.take_responses().items():
                self.partners[k]._publish(other)
                processed.append((self.partners[k], other))

    def _publish(self, outputs: Response) -> None:
        self.topics.publish(outputs)
        self._published(outputs.stamp, 1)

    def _published(self, stamp: int, samples: int) -> None:
        self._processed_at = time.monotonic()
        self.history += samples
        if self._drawing and self.pipeline is not None:
            self.topics.draw(stamp, self.pipeline)

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
                self.record(outputs)

    def report(self, recorder: Recorder | None) -> list[EncodedStatus]:
        """Diagnostics of the connector, and of the recording if ``recorder`` is given."""
        with self._lock:  # events during the report belong to the next one
            health = None if self.pipeline is None else self.pipeline.health.report()
        return self._monitor.report(self.pipeline, recorder, self.status, health)

    # --- lifecycle and parameters ----------------------------------------------------------------

    def configure(self) -> tuple[str, str]:
        """Create pipeline and publishers; return what is modelled, and what is not."""
        self.pipeline = MessagePipeline(self._scene())
        self.pipeline.wanted = self._wanted
        self.topics.open_outputs(self._scene())
        if self._can_fuse():
            fused.prepare(self.pipeline.parts)
        connector = self.pipeline.connector
        return connector.model, connector.not_modelled

    def activate(self) -> None:
        """Start a new history."""
        assert self.pipeline is not None
        self.pipeline.release()  # a command received before deactivation may be out of date
        self.reset()

    def deactivate(self) -> None:
        """Unsubscribe, and send a last zero wrench."""
        self.topics.close_inputs()
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
        assert self.pipeline is not None
        self.pipeline.reset()
        if self.coupled is not None:
            self.coupled.reset()
        self.history = 0
        self._watchdog.reset()
        self.status.timed_out = False

    def prepare(self, scene: Scene) -> None:
        """Create the pipeline of a changed scene; raise SceneError if it cannot be used."""
        if self.pipeline is not None:
            self._prepared = MessagePipeline(scene)
            self._prepared.keep_imposed(self.pipeline)

    def apply(self) -> None:
        """Put the prepared pipeline in force."""
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


def log_model(logger: Any, connectors: Sequence[str], model: str, not_modelled: str) -> None:
    """Log what is modelled, at info level, and what is not, at debug level."""
    names = ", ".join(connectors)
    logger.info(prefix_log(names, model))
    if not_modelled:
        logger.debug(prefix_log(names, f"not modelled: {not_modelled}"))
