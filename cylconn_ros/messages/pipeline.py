"""Message pipeline: serialized input messages to serialized output messages, without ROS.

The connector node subscribes to :attr:`MessagePipeline.inputs` and publishes the responses. A
replay feeds the same class from a recording and gets the same bytes.
"""

from __future__ import annotations

import collections
import functools
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cylconn_ros.connector.connector import Connector
from cylconn_ros.connector.synchronized_sample import SynchronizedSample
from cylconn_ros.connector.synchronizer import SampleMatcher
from cylconn_ros.core import layout
from cylconn_ros.messages import cdr_decoder, output_messages, statistics
from cylconn_ros.messages.commands.commands import COMMAND, JOINT_STATE, PRELOAD, Commands
from cylconn_ros.messages.health import Health
from cylconn_ros.messages.load_messages import LoadMessages
from cylconn_ros.messages.output_messages import VALID_SAMPLE, OutputMessages, PipelineParts
from cylconn_ros.messages.prefix_decoder import PrefixDecoder
from cylconn_ros.scene.inputs import BODIES, STREAM_NUMBER, STREAMS, WRENCH, InputType, selected
from cylconn_ros.scene.scene import Scene

STATE = "cylconn_ros/msg/ConnectorState"

STATE_TOPIC, JOINTS_TOPIC = "~/state", "~/joint_state"

OUTPUTS = (
    ("body_a/wrench", WRENCH),
    ("body_b/wrench", WRENCH),
    (STATE_TOPIC, STATE),
    (JOINTS_TOPIC, JOINT_STATE),
)
"""Name and type of the outputs, in the order of the messages of a :class:`Response`."""


class Response(NamedTuple):
    """The output messages of a sample.

    State and joint state are None if they are not requested, or if the step failed.
    """

    stamp: int  # ns
    wrench_a: bytes
    wrench_b: bytes
    state: bytes | None
    joint_state: bytes | None


class Input(NamedTuple):
    """An input topic: its type, and the function that processes a message."""

    type: str
    receive: Callable[[bytes], Response | None]


def input_names(scene: Scene) -> list[str]:
    """Relative names of the input topics of a scene: motion and load of moving bodies, commands."""
    of_bodies = (f"{BODIES[body]}/{kind.topic}" for body, kind in _body_inputs(scene))
    return [*of_bodies, COMMAND, PRELOAD]


def _body_inputs(scene: Scene) -> list[tuple[int, InputType]]:
    moving = [index for index, body in enumerate(scene.bodies) if body.kind != "fixed"]
    return [(body, kind) for body in moving for kind in selected(scene.input)]


class MessagePipeline:
    """Process input messages into responses; no message makes it raise.

    Attributes
    ----------
    commands
        What topics command: motion or force of slide and spin, the preload.
    loads, output
        The messages of loads; the output messages.
    wanted
        Function of an output's name: whether ``~/state`` or ``~/joint_state`` is requested.
    solve_coupled
        Function that processes a complete sample of a connector that shares bodies with others
        (messages/coupled_pipeline.py); None for a connector that shares none.
    is_loaded
        Whether the kernels are loaded, which messages need.
    continues
        Whether the history of the previous pipeline continues (:meth:`restore_from`).

    Raises SceneError at construction if the connector cannot serve the scene.
    """

    def __init__(
        self, scene: Scene, previous: MessagePipeline | None = None, load: bool = True,
        check_latency: bool = True,
    ) -> None:  # fmt: skip
        """Make the pipeline of a scene; with ``previous``, see :meth:`restore_from`.

        ``load``: load the kernels now. ``check_latency``: see Connector.
        """
        self.scene = scene
        self.connector = Connector(scene, check_latency)
        self.loads = LoadMessages()
        self._responses: collections.deque[Response] = collections.deque()  # for :meth:`next`
        self.matcher = SampleMatcher(scene)
        self.wanted: Callable[[str], bool] = lambda _: True
        self.solve_coupled: Callable[[SynchronizedSample, float], Response | None] | None = None
        self.decoder = PrefixDecoder(scene, self.matcher)
        self._pending_before: tuple[tuple[int, bytes], ...] = ()  # at the last flush()
        self.health = Health()
        self.commands = Commands(scene, self.connector, self.health)
        self.inputs = self._make_inputs()
        self._out = np.zeros(layout.NOUT)
        self.output = OutputMessages(scene, self.connector.method)
        self.is_loaded = False
        if load:
            self.load_kernels()
        self._last_stamp: int | None = None  # of the sample whose outputs are in ``out``
        self.continues = False
        if previous is not None:
            self.restore_from(previous)

    def load_kernels(self) -> None:
        """Load or compile all kernels, so that no sample has to wait for it."""
        memory = self.connector.memory
        self.connector.step(VALID_SAMPLE, 1e-3)
        self.connector.memory = memory
        self.decoder.prepare()
        statistics.count_one(
            np.zeros(statistics.NCOUNTER), VALID_SAMPLE, np.zeros(layout.NOUT), 0.0, 0.0
        )
        self.output.templates.write(0, self._out)
        self.is_loaded = True

    def restore_from(self, previous: MessagePipeline) -> None:
        """Adopt counts, loads and commands of ``previous``, which must not be used afterwards.

        The history continues if the change of the scene allows it (:attr:`continues`). A command
        stays in force where the parameters that it replaces have not changed.
        """
        self.continues = self.scene.keeps_history(previous.scene)
        self.health = self.commands.health = previous.health
        self.wanted = previous.wanted
        self.loads.restore_from(previous.loads, self.inputs)
        self._responses = previous._responses
        previous._replay_pending()
        self.matcher.restore_from(previous.matcher, history=self.continues)
        if self.continues:
            self.connector.memory = previous.connector.memory
            self._out[:], self._last_stamp = previous._out, previous._last_stamp
        memory = self.connector.memory
        kept = self.commands.keep(previous.commands)
        self.connector.memory = memory  # imposed motion continues from its present position
        self.commands.impose_scene(kept)

    def reset(self) -> None:
        """Forget the reference configuration and the history; loads and commands stay."""
        self.connector.reset(keep_in_flight=True)
        self._replay_pending()
        self.matcher.reset()
        self._last_stamp = None

    def flush(self) -> None:
        """Count the messages of a partial sample that made no progress since the previous call.

        To be called periodically, and :meth:`next` afterwards.
        """
        pending = self.decoder.pending
        if pending and pending == self._pending_before:
            self._replay_pending()
        self._pending_before = pending

    def next(self) -> Response | None:
        """The response to one more sample that is complete, or None.

        To be called after each response: a message can complete several samples that waited.
        """
        if self._responses:
            return self._responses.popleft()
        while (sample := self.decoder.next()) is not None:
            response = self._respond(sample)
            if response is not None:  # else it waits for those of other connectors
                return response
        return None

    def give_up(self) -> Response | None:
        """Process the oldest sample that waits for a load without it; None if none waits."""
        stamp = self.decoder.waiting
        if stamp is not None:
            self.matcher.loads.give_up(stamp)
        return self.next()

    @property
    def parts(self) -> PipelineParts:
        """The arrays for compiled code; they stay the same ones."""
        connector = self.connector.kernel_arguments()
        return PipelineParts(
            self.decoder, connector, self._out, self.health.numbers, self.output.templates
        )

    @property
    def out(self) -> np.ndarray:
        """(NOUT,) the outputs of the last sample (core/layout.py)."""
        return self._out

    @property
    def between_samples(self) -> bool:
        """Whether a sample was processed and no message of the next was received."""
        matcher = self.matcher
        return not (self.decoder.pending or matcher.has_pending or matcher.last_stamp is None)

    def advance(self, stamp: int, before: int | None, samples: int) -> None:
        """Take note of ``samples`` that compiled code processed with the arrays of this pipeline.

        ``stamp`` and ``before``: of the last of them, and of the one before it, if any.
        """
        self.matcher.advance(stamp, before, samples)
        self._last_stamp = stamp

    def zero(self) -> Response | None:
        """Zero wrenches for a timeout of the input; None if no sample was processed before.

        Their stamp is one nanosecond after the last sample's: the newest for a simulator that
        applies the newest wrench, and never the stamp that a simulator in lock step waits for.
        """
        return None if self._last_stamp is None else self._zero_wrenches(self._last_stamp + 1)

    def _make_inputs(self) -> dict[str, Input]:
        inputs: dict[str, Input] = {}
        for body, kind in _body_inputs(self.scene):
            name = f"{BODIES[body]}/{kind.topic}"
            if kind.carries_motion:
                receive = functools.partial(self._process_motion, STREAM_NUMBER[name])
            else:
                receive = functools.partial(self._process_load, name, body, kind)
            inputs[name] = Input(kind.type, receive)
        for name, (type_name, handle) in self.commands.inputs.items():
            inputs[name] = Input(type_name, functools.partial(self._process, name, handle))
        return inputs

    def _process_motion(self, stream: int, data: bytes) -> Response | None:
        """Process a pose, twist or odometry message: fast path if it matches, else decode."""
        found = self.decoder.process(stream, data)
        if found is True:
            return None
        if found is False:
            self._replay_pending()
            return self._in_order(self._use_reference_path(stream, data))
        return self._respond(found)

    def _respond(self, sample: SynchronizedSample) -> Response | None:
        try:
            return self._step(sample, time.perf_counter())
        except Exception as error:
            return self._fail(error, sample)

    def _replay_pending(self) -> None:
        """Pass the partly received sample to the reference path."""

        def replay(stream: int, data: bytes) -> None:
            response = self._use_reference_path(stream, data)
            if response is not None:
                self._responses.append(response)

        self.decoder.replay_pending(replay)

    def _in_order(self, response: Response | None) -> Response | None:
        """The next response, if ``response`` is the newest."""
        if not self._responses:
            return response
        if response is not None:
            self._responses.append(response)
        return self._responses.popleft()

    def _use_reference_path(self, stream: int, data: bytes) -> Response | None:
        """Process a message of motion on the reference path."""
        return self._process(STREAMS[stream].name, functools.partial(self._decode, stream), data)

    def _decode(self, stream: int, data: bytes) -> SynchronizedSample | None:
        """Decode a message, and make its prefix the known one of the stream."""
        self.decoder.learn(stream, data)
        body, kind = STREAMS[stream]
        stamp, frame, child, pose, twist = cdr_decoder.read_input(kind, data)
        return self.matcher.motion(body, stamp, (frame, child), pose, twist)

    def _process_load(self, name: str, body: int, kind: InputType, data: bytes) -> Response | None:
        """Process a load, and the sample that waited for it."""
        return self._process(name, functools.partial(self._add_load, name, body, kind), data) or (
            self.next()
        )

    def _add_load(
        self, name: str, body: int, kind: InputType, data: bytes
    ) -> SynchronizedSample | None:
        message = cdr_decoder.read_input(kind, data)
        sample = self.matcher.load(body, message.stamp, message.frame, message.pair)
        self.loads.add(name, message.stamp, data, self.matcher.last_stamp)
        if self.matcher.late_load is not None:
            self.connector.correct_load(body, self.matcher.late_load)
        return sample

    def _process(
        self, name: str, handle: Callable[[bytes], SynchronizedSample | None], data: bytes
    ) -> Response | None:
        """Process a message of an input with its handler; the response if a sample is complete."""
        begin = time.perf_counter()
        sample = None
        try:
            sample = handle(data)
            return None if sample is None else self._step(sample, begin)
        except cdr_decoder.CdrError as error:
            self.health.undecodable += 1
            self.health.undecodable_text = f"{name}: {error}"
            return None
        except Exception as error:
            return self._fail(error, sample)

    def _fail(self, error: Exception, sample: SynchronizedSample | None) -> Response | None:
        """Count an unexpected exception; the response to a complete sample is zero wrenches."""
        self.health.failed += 1
        self.health.failure = f"{type(error).__name__}: {error}"
        if sample is None:
            return None
        self._out[:], self._last_stamp = 0.0, sample.stamp
        return self._zero_wrenches(sample.stamp)

    def _step(self, sample: SynchronizedSample, begin: float) -> Response | None:
        if sample.repeated and self._last_stamp is not None:
            return self._write(self._last_stamp)
        if self.solve_coupled is not None:
            return self.solve_coupled(sample, begin)
        if sample.restarted:
            self.connector.reset(keep_in_flight=True)
        self.connector.step(self.matcher.sample, sample.h, self._out)
        return self.finish(sample.stamp, sample.h, begin)

    def finish(self, stamp: int, h: float, begin: float) -> Response:
        """The response to the sample at ``stamp``, whose outputs are in :attr:`out`.

        ``h``: s since the sample before; ``begin``: begin of the computation (perf_counter, s).
        """
        out = self._out
        out[layout.COMPUTING_TIME] = time.perf_counter() - begin
        self._last_stamp = stamp
        statistics.count_one(self.health.numbers, self.matcher.sample, out, h, self.scene.period)
        return self._write(stamp)

    def _write(self, stamp: int) -> Response:
        message = self.output.templates.message
        self.output.templates.write(stamp, self._out)
        state = message(output_messages.STATE) if self.wanted(STATE_TOPIC) else None
        joints = message(output_messages.JOINTS) if self.wanted(JOINTS_TOPIC) else None
        return Response(stamp, message(0), message(1), state, joints)

    def _zero_wrenches(self, stamp: int) -> Response:
        return Response(stamp, *self.output.zero(stamp), None, None)
