"""One connector of a node: its topics, its answers, its timeout and its report.

A node has as many as its parameters name, all of them served by one thread, recorded in one run and
moved through the lifecycle together.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode

from cylconn_ros.messages.coupled_pipeline import Together
from cylconn_ros.messages.pipeline import OUTPUTS, Answer, Answering
from cylconn_ros.messages.prefix import STREAM_OF
from cylconn_ros.messages.topic_names import said
from cylconn_ros.recording.writer import RunWriter
from cylconn_ros.ros.connector.diagnostics import Links, Monitor
from cylconn_ros.ros.connector.diagnostics_encoder import Part
from cylconn_ros.ros.connector.incomplete import Waiting
from cylconn_ros.ros.connector.recorder import Recorder, now
from cylconn_ros.ros.connector.topics import Topics, is_seldom
from cylconn_ros.ros.connector.watchdog import News, Silence
from cylconn_ros.ros.executor import fused
from cylconn_ros.ros.executor.executor import Inputs, Receive
from cylconn_ros.ros.executor.fused import Straight
from cylconn_ros.ros.executor.sequence_numbers import Gaps
from cylconn_ros.scene.scene import Scene


class Served:
    """A connector by the name that its parameters and topics have; the only one has none.

    Attributes
    ----------
        answering: what answers, from configuring to cleaning up.
        topics, links: what it reads and publishes, and what the middleware tells of that.
        history: samples answered since it last forgot everything.
        together, partners: what solves it together with others, and who they are.
        listeners: by input, the connectors and their inputs that get the same messages.
    """

    def __init__(
        self,
        node: LifecycleNode,
        name: str,
        scene: Callable[[], Scene],
        recorder: Recorder,
        lock: Any,
        on_loop: bool,
    ) -> None:
        """``scene`` gives the one in force; ``lock`` is held by all that changes what answers.

        ``on_loop``: a :class:`~cylconn_ros.ros.executor.executor.Loop` takes the inputs, not the executor.
        """
        self.name = name
        self._node, self._scene, self._recorder, self._lock = node, scene, recorder, lock
        self.links = Links()
        self.topics = Topics(node, name, self.links, on_loop)
        self._on_loop = on_loop
        self._straight: Straight | None = None  # while inputs are open, where it can be had
        self.together: Together | None = None
        self.partners: list[Served] = []  # as the members of ``together`` are
        self.listeners: dict[str, list[tuple[Served, str]]] = {}
        self.answering: Answering | None = None
        self._prepared: Answering | None = None
        self._answered_at = 0.0  # s, steady clock
        self._waiting, self._silence = Waiting(), Silence()
        self._drawing = scene().markers  # fixed when the node starts
        self.history = 0
        own_name = node.get_fully_qualified_name().strip("/")
        self._monitor = Monitor(f"{own_name}/{name}" if name else own_name)

    # --- samples ---------------------------------------------------------------------------------

    def open_inputs(self) -> Inputs:
        """Subscribe; what a loop is to serve."""
        answering = self.answering
        assert answering is not None
        entries = self.topics.open_inputs(answering, self._receiver)
        if not self._goes_straight(answering):
            return Inputs(entries)
        often = [name for name in answering.inputs if not is_seldom(name)]
        inputs = [
            fused.Input(entry.subscription, STREAM_OF[name], entry.receive, Gaps(entry.lost))
            for name, entry in zip(
                often, [entry for entry in entries if not entry.seldom], strict=True
            )
        ]
        self._straight = Straight(
            inputs, self.topics.publishers, answering.parts, self._went_straight
        )
        return Inputs(entries, self._take_straight)

    def _goes_straight(self, answering: Answering) -> bool:
        """Whether nothing stands between a sample and the compiled call that answers it."""
        alone = self.together is None and not self.listeners and not self.topics.foreign
        compiled = answering.connector.method != "minimal" and not fused.missing()
        return self._on_loop and alone and compiled

    def _take_straight(self, caught: Callable[[Exception], object]) -> int | None:
        assert self._straight is not None
        writer = self._recorder.writer
        if writer is not self._straight.writer:
            self._straight.record(writer, [] if writer is None else self._channels(writer))
        return self._straight.take(caught)

    def _channels(self, writer: RunWriter) -> list[int]:
        """Where the messages of the straight way are recorded: inputs, then answers."""
        assert self.answering is not None
        inputs = [name for name in self.answering.inputs if not is_seldom(name)]
        names = [*inputs, *(name for name, _ in OUTPUTS)]
        return [writer.channels[self.topics.resolved(name)] for name in names]

    def _went_straight(self, samples: int) -> None:
        """Take note of samples that were answered and published."""
        assert self.answering is not None
        assert self._straight is not None
        stamp, before, begun, unsent = self._straight.told[fused.STAMP : fused.UNSENT + 1]
        self.answering.went_on(stamp, before if begun else None, samples)
        if unsent:
            self._straight.told[fused.UNSENT] = 0
            self.topics.failed(unsent)
        self._published(stamp, samples)

    def _receiver(self, name: str, topic: str) -> Receive:
        """What takes the messages of input ``name``, received on ``topic``."""
        recorder = self._recorder
        takers = [(self, name), *self.listeners.get(name, ())]

        def receive(data: bytes) -> bool:
            """Answer, publish, record; whether a sample was complete."""
            recording = recorder.running
            came = now() if recording else 0
            answered: list[tuple[Served, Answer]] = []
            for connector, its in takers:
                connector.take(its, data, answered)
            if recording:
                recorder.write(topic, data, came)
                for connector, answer in answered:
                    connector.record(answer)
            return bool(answered)

        return receive

    def take(self, name: str, data: bytes, answered: list[tuple[Served, Answer]]) -> None:
        """Take a message of an input; publish what it completes, and add it to ``answered``."""
        answering = self.answering
        assert answering is not None
        answer = answering.inputs[name].receive(data)
        if answer is None:
            return
        self._publish(answer)
        answered.append((self, answer))
        if self.together is not None:
            for k, other in self.together.taken().items():
                self.partners[k]._publish(other)
                answered.append((self.partners[k], other))

    def _publish(self, answer: Answer) -> None:
        self.topics.publish(answer)
        self._published(answer.stamp, 1)

    def _published(self, stamp: int, samples: int) -> None:
        self._answered_at = time.monotonic()
        self.history += samples
        if self._drawing and self.answering is not None:
            self.topics.draw(stamp, self.answering)

    def record(self, answer: Answer) -> None:
        """Record an answer, after the message that completed its sample."""
        went = now()
        for topic, data in self.topics.outgoing(answer):
            self._recorder.write(topic, data, went)

    def _wanted(self, name: str) -> bool:
        """Whether an output is to be made: somebody listens, or it is recorded."""
        return self._recorder.running or self.topics.wanted(name)

    def look(self, now: float) -> float:
        """Watch the timeout at ``now``; when to look again (s, steady clock)."""
        answering, silence = self.answering, self._silence
        if answering is None or now < silence.due:
            return silence.due
        with self._lock:
            answering.settle()
            scene, answered = self._scene(), self._answered_at if self.history else None
        logger = self._node.get_logger()
        reason = self._waiting.look(answering.matcher, scene, now)
        if reason:
            logger.warning(said(self.name, reason))
        news = silence.look(now, answered, scene.timeout)
        self.links.silent = silence.silent
        if news is News.BACK:
            logger.info(said(self.name, "samples are back"))
        elif news is News.STOPPED:
            self.links.timeouts += 1
            text = f"no complete sample for {scene.timeout:g} s: zero wrench until the next"
            logger.warning(said(self.name, text))
            self.send_zero()
        return silence.due

    def send_zero(self) -> None:
        """Publish zero wrenches, where a sample was ever answered."""
        with self._lock:
            answer = None if self.answering is None else self.answering.zero()
            if answer is not None:
                self.topics.publish(answer)
                self.record(answer)

    def report(self, recorder: Recorder | None) -> list[Part]:
        """What diagnostics say of it, and of the recording where they are to."""
        with self._lock:  # what happens meanwhile belongs into the next report
            health = None if self.answering is None else self.answering.health.taken()
        return self._monitor.report(self.answering, recorder, self.links, health)

    # --- lifecycle and parameters ----------------------------------------------------------------

    def configure(self) -> str:
        """Make the connector and its publishers; its model in words."""
        self.answering = Answering(self._scene())
        self.answering.wanted = self._wanted
        self.topics.open_outputs(self._scene())
        if self._goes_straight(self.answering):
            fused.prepare(self.answering.parts)
        return self.answering.connector.model

    def activate(self) -> None:
        """Begin a new history."""
        assert self.answering is not None
        self.answering.release()  # a command that came before deactivation may be out of date
        self.forget()

    def deactivate(self) -> None:
        """Unsubscribe, and send a last zero wrench."""
        self.topics.close_inputs()
        if self._straight is not None:
            self._straight.close()
            self._straight = None
        self.send_zero()

    def clean(self) -> None:
        """Release connector and publishers."""
        self.topics.close_outputs()
        self.answering = None

    def wait_until_taken(self, timeout: Duration) -> None:
        """Wait until subscribers have acknowledged the wrenches, at most ``timeout``."""
        self.topics.wait_until_taken(timeout)

    def forget(self) -> None:
        """Forget the reference configuration and all history."""
        assert self.answering is not None
        self.answering.reset()
        if self.together is not None:
            self.together.forget()
        self.history = 0
        self._silence.forget()
        self.links.silent = False

    def prepare(self, scene: Scene) -> None:
        """Make the connector of a changed scene; raises SceneError where it cannot be served."""
        if self.answering is not None:
            self._prepared = Answering(scene)
            self._prepared.keep_imposed(self.answering)

    def apply(self) -> None:
        """Put in force what was prepared."""
        prepared, previous, self._prepared = self._prepared, self.answering, None
        if prepared is None or previous is None:
            return
        with self._lock:
            prepared.take_over(previous)
            self.answering = prepared
            self._silence.due = 0.0
            if self._straight is not None:
                self._straight.use(prepared.parts)
            if not prepared.continues:
                self.forget()
        logger = self._node.get_logger()
        if prepared.connector.model != previous.connector.model:
            logger.info(said(self.name, prepared.connector.model))
        if not prepared.continues:
            logger.info(said(self.name, "the next sample is the reference configuration"))
