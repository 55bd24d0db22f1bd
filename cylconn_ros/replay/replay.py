"""Replay: process a recording's inputs with the node's message pipeline, without ROS.

The messages pass through a :class:`~cylconn_ros.messages.pipeline.MessagePipeline` in the order in
which they were recorded. The outputs are those that the live node published, byte for byte except
the computing time.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Generator, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from cylconn_ros.connector.description import unknown_frame_text
from cylconn_ros.connector.load_history import ALWAYS, IF_REGULAR, NO
from cylconn_ros.connector.usable import MotionCheck
from cylconn_ros.errors import RecordingError, SceneError
from cylconn_ros.messages import cdr_decoder
from cylconn_ros.messages.commands.commands import COMMAND, PRELOAD
from cylconn_ros.messages.pipeline import OUTPUTS, STATE_TOPIC, MessagePipeline, Response
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.files.storage import Topics
from cylconn_ros.recording.mcap.message_block import MessageBlock
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.replay.batches import Batch, Batches
from cylconn_ros.scene import parameter_file
from cylconn_ros.scene.inputs import BODIES, INPUTS, LOAD, WRENCH
from cylconn_ros.scene.packing import latency_is_measurable
from cylconn_ros.scene.scene import Scene

NODE = "/connector"
_FEW = 64  # messages processed one by one before the next attempt at a batch

_OPTIONAL = tuple(f"/{kind.topic}" for kind in INPUTS if not kind.carries_motion)


class Item(NamedTuple):
    """A recorded message, or a replayed output with the log time of the message that caused it."""

    topic: str
    log_time: int
    data: bytes
    replayed: bool


@dataclasses.dataclass
class Counts:
    """Numbers of messages of a recording, by their use."""

    read: int = 0
    used: int = 0  # inputs
    responses: int = 0  # samples processed
    outputs: int = 0  # recorded outputs of the connector
    other: int = 0  # of topics that are neither input nor output
    by_topic: dict[str, int] = dataclasses.field(default_factory=dict)


UNRELATED = "motion"
"""Key in the metadata of a replay whose recorded motion does not follow from its wrenches."""


def follows(metadata: Mapping[str, str], scene: Scene) -> bool:
    """Whether the motion of a recording followed from wrenches of the parameters of ``scene``.

    If not, it tells nothing about the time at which they act. ``metadata``: of the recording.
    """
    if UNRELATED in metadata:
        return False
    try:
        stored = Scene.from_parameters(parameter_file.parameters_of(metadata["parameters"]))
    except (KeyError, SceneError):
        return False
    return parameter_file.dump(stored) == parameter_file.dump(scene)


def for_motion(scene: Scene, follows: bool) -> Scene:
    """The scene with which a recorded motion is evaluated: one that does not follow has no lag."""
    if follows or scene.latency >= 0 or not latency_is_measurable(scene):
        return scene
    return dataclasses.replace(scene, latency=0)


class Replay:
    """Process a recording's inputs with the pipeline of a connector.

    Attributes
    ----------
        pipeline: the message pipeline, with its counters.
        inputs: recorded topic of every input found, by its relative name.
        names, outputs: resolved topic and type of every output, by its relative name.
        input_topics: recorded topics that are inputs.
        timing: by topic, the bytes that differ in every run.
        follows: whether the recorded motion followed from wrenches of these parameters.
        beside: outputs, by log time, of connectors that are solved together with this one.
        counts: numbers of messages so far. motion: outputs of the samples so far.

    Raises RecordingError if the recording lacks an input that every sample needs, and SceneError if
    the connector cannot serve the scene.
    """

    def __init__(self, bag: Bag, scene: Scene, renamed: Mapping[str, str] | None = None) -> None:
        """``renamed``: the recorded topic of an input, e.g. ``{"body_b/odom": "/robot/odom"}``."""
        self.bag, self.scene = bag, scene
        self.follows = follows(bag.metadata, scene)
        used = for_motion(scene, self.follows)
        self.pipeline = MessagePipeline(used, check_latency=self.follows)
        self.node = bag.metadata.get("node", NODE)
        self.inputs = _inputs(bag, self.pipeline, self.node, dict(renamed or {}))
        self.names = {n: bag.names.get(n) or _resolved(n, self.node) for n, _ in OUTPUTS}
        self.outputs = dict(OUTPUTS)
        self.input_topics = frozenset(self.inputs.values())
        self.timing = {self.names[STATE_TOPIC]: self.pipeline.output.timing}
        self.counts, self.motion = Counts(), MotionCheck()
        self._output_topics = set(self.names.values())
        self._receive: dict[str, Callable[[bytes], Response | None]] = {}
        wrenches = {self.names[n] for n, kind in OUTPUTS if kind == WRENCH}
        # Of a recording by the node: they follow the message that completed their sample.
        self._wrenches = wrenches & set(bag.types) if "version" in bag.metadata else set()
        self.pipeline.matcher.expects = self._expects
        self.beside: Callable[[int], Iterator[Item]] = lambda _: iter(())

    def provenance(self) -> dict[str, str]:
        """Metadata for a recording of the replay: where it comes from."""
        found = {"replayed": f"from {self.bag.path.name}"}
        if not self.follows:
            found[UNRELATED] = "does not follow from the wrenches"
        return found

    def messages(self) -> Iterator[Item]:
        """Yield every recorded input and output message, and every replayed output."""
        self.begin()
        end = 0
        for topic, log_time, data in self.bag.messages():
            yield from self.process(topic, log_time, data)
            end = log_time
        yield from self.flush(end)

    def parts(self) -> Iterator[Item | Batch]:
        """As :meth:`messages`, batched: runs of messages with known prefixes come as one Batch.

        The arrays of a batch are valid until the next part is requested.
        """
        self.begin()
        by_topic = {topic: name for name, topic in self.inputs.items()}
        batches = Batches(self.pipeline, by_topic, self._wrenches)
        end = 0
        for topics, block in self.bag.blocks():
            at = 0
            while at < len(block):
                batch = batches.next(topics, block, at)
                if batch is None:
                    at = yield from self._one_by_one(topics, block, at, batches)
                else:
                    at = batch.end
                    self._count(batch)
                    yield batch
            end = int(block.log_time[-1]) if len(block) else end
        yield from self.flush(end)

    def begin(self) -> None:
        """Prepare for :meth:`process`."""
        inputs = self.pipeline.inputs
        self._receive = {topic: inputs[name].receive for name, topic in self.inputs.items()}

    def _one_by_one(
        self, topics: Topics, block: MessageBlock, begin: int, batches: Batches
    ) -> Generator[Item, None, int]:
        """Process messages until a batch may begin, _FEW at most; return the number of the next."""
        end = min(begin + _FEW, len(block))
        for k, (channel, log_time, _, data) in enumerate(block.messages(begin, end), begin + 1):
            topic = topics[channel]
            yield from self.process(topic, log_time, data)
            if topic in self.input_topics and batches.may_begin():
                return k
        return end

    def process(self, topic: str, log_time: int, data: bytes) -> Iterator[Item]:
        """Yield a recorded message, and the outputs of the sample that it completes."""
        counts = self.counts
        counts.read += 1
        receive = self._receive.get(topic)
        if receive is None:
            if topic in self._output_topics:
                counts.outputs += 1
                yield Item(topic, log_time, data, False)
                if topic in self._wrenches:
                    yield from self._answer(log_time, data)
            else:
                counts.other += 1
            return
        counts.by_topic[topic] = counts.by_topic.get(topic, 0) + 1
        counts.used += 1
        yield Item(topic, log_time, data, False)
        yield from self._outputs(receive(data), log_time)

    def _answer(self, log_time: int, wrench: bytes) -> Iterator[Item]:
        """Process a sample that waits for a load: the recorded node did, and sent ``wrench``."""
        stamp = self.pipeline.decoder.waiting
        if stamp is not None and stamp == _stamp_of(wrench):
            yield from self._outputs(self.pipeline.give_up(), log_time)

    def _outputs(self, response: Response | None, log_time: int) -> Iterator[Item]:
        """Yield the outputs of a sample, and of those that are complete after it."""
        while response is not None:
            yield from self.respond(response, log_time)
            yield from self.beside(log_time)
            response = self.pipeline.next()

    def respond(self, response: Response, log_time: int) -> Iterator[Item]:
        """Yield the outputs of one sample."""
        self.counts.responses += 1
        self.motion.add(self.pipeline.out[np.newaxis])
        for (name, _), message in zip(OUTPUTS, response[1:], strict=True):
            if message is not None:
                yield Item(self.names[name], log_time, message, True)

    def _expects(self, body: int, stamp: int) -> int:
        """Whether samples wait for the loads of a body (connector/load_history.py).

        The wrenches that a node recorded show when it waited no longer. Without them, samples wait
        from the first one on if a load with its stamp is found in the first block.
        """
        topic = self.inputs.get(f"{BODIES[body]}/{LOAD.topic}")
        if topic is None:
            return NO
        if self._wrenches:
            return ALWAYS
        for topics, block in self.bag.blocks():
            for channel, _, _, data in block.messages():
                if topics[channel] == topic and _stamp_of(data) == stamp:
                    return IF_REGULAR
            break
        return NO

    def _count(self, batch: Batch) -> None:
        """Count the messages of a batch."""
        counts, topics = self.counts, batch.topics
        channels = batch.block.channel[batch.begin : batch.end].astype(np.int64)
        for channel, number in enumerate(np.bincount(channels).tolist()):
            topic = topics[channel] if number else ""
            counts.read += number
            if topic in self.input_topics:
                counts.used += number
                counts.by_topic[topic] = counts.by_topic.get(topic, 0) + number
            elif topic in self._output_topics:
                counts.outputs += number
            else:
                counts.other += number
        counts.responses += len(batch)
        self.motion.add(batch.outs)

    def flush(self, log_time: int) -> Iterator[Item]:
        """Yield the outputs of samples that wait for loads, and count incomplete samples."""
        while self.pipeline.decoder.waiting is not None:
            yield from self._outputs(self.pipeline.give_up(), log_time)
        self.pipeline.flush()  # twice, without progress in between
        self.pipeline.flush()

    def topics(self) -> list[TopicInfo]:
        """The topics of a recording of the inputs and the replayed outputs."""
        kinds = {topic: self.pipeline.inputs[name].type for name, topic in self.inputs.items()}
        kinds |= {self.names[name]: kind for name, kind in OUTPUTS}
        return [TopicInfo(topic, kind) for topic, kind in kinds.items()]

    def problem(self) -> str:
        """Return why nothing of the recording is of use; '' if something is."""
        counts = self.pipeline.matcher.counts
        if not self.counts.used:
            return "no message of its inputs could be read"
        if not self.counts.responses:
            return "no sample was complete: pose and twist need the same stamp (stamp_tolerance)"
        if counts.duplicate_samples and self.counts.responses - counts.duplicate_samples <= 1:
            return (
                f"all stamps are equal: 1 sample was used, {counts.duplicate_samples} repeat its "
                "stamp"
            )
        return self.motion.problem()

    def irregularities(self) -> list[str]:
        """Texts about irregular messages and samples, e.g. ``duplicates: 3 samples, 6 messages``.

        Empty if every input message became part of a sample with a solution.
        """
        counts, health = self.pipeline.matcher.counts, self.pipeline.health
        kinds = {
            "undecodable": {"messages": health.undecodable},
            "not finite": {"samples": health.not_finite},
            "too large": {"samples": health.too_large},
            "overflow of the forces": {"samples": health.overflowed},
            "quaternion of length zero": {"samples": health.bad_quaternion},
            f"quaternion with a norm of {max(health.seen_norm):.4g}": {
                "samples": sum(health.off_norm),
            },
            "without a period": {"samples": health.no_period},
            "not one period apart": {"samples": health.off_period},
            "refused": {"commands": health.refused},
            "failed": {"samples": health.failed},
            "duplicates": {
                "samples": counts.duplicate_samples, "messages": counts.duplicate_messages,
            },
            "late": {"messages": counts.late, "loads": counts.late_loads},
            "not used": {"loads": counts.unused_loads},
            "far ahead of the samples": {"loads": counts.early_loads},
            "incomplete": {"samples": counts.incomplete},
            "stamps went back": {"restarts": counts.restarts},
        }  # fmt: skip
        seen = self.pipeline.matcher.unknown_frame
        if seen is not None:
            text = unknown_frame_text(self.scene, seen)
            kinds[text] = {"messages": counts.unknown_frames}
        return [
            f"{text}: " + ", ".join(f"{number} {of}" for of, number in found.items() if number)
            for text, found in kinds.items()
            if any(found.values())
        ]


def _stamp_of(data: bytes) -> int | None:
    """Stamp of a message in ns, or None if it cannot be decoded."""
    try:
        return cdr_decoder.read_stamp(data)
    except cdr_decoder.CdrError:
        return None


def _resolved(name: str, node: str) -> str:
    """A relative or private topic name, resolved for a node."""
    if name.startswith("~/"):
        return f"{node}/{name[2:]}"
    return f"{node.rpartition('/')[0]}/{name}"


def _inputs(
    bag: Bag, pipeline: MessagePipeline, node: str, renamed: dict[str, str]
) -> dict[str, str]:
    """The recorded topic of every input.

    It is the renamed one, or that of the recorded node, or the only topic with such an ending.
    """
    for name in renamed:
        if name not in pipeline.inputs:
            known = ", ".join(pipeline.inputs)
            raise RecordingError(f"{name}: is no input of this scene; its inputs are {known}")
    found: dict[str, str] = {}
    missing = []
    for name, wanted in pipeline.inputs.items():
        topic = renamed.get(name) or bag.names.get(name) or _resolved(name, node)
        if name not in renamed and topic not in bag.types:
            similar = [t for t in bag.types if t.endswith("/" + name.removeprefix("~/"))]
            topic = similar[0] if len(similar) == 1 else topic
        if topic in bag.types:
            if bag.types[topic] != wanted.type:
                raise RecordingError(
                    f"{bag.path}: {topic} has type {bag.types[topic]}, {name} must be {wanted.type}"
                )
            found[name] = topic
        elif name in renamed or not (name in (COMMAND, PRELOAD) or name.endswith(_OPTIONAL)):
            missing.append(f"{name} ({wanted.type}; searched for {topic})")
    if missing:
        has = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(bag.types.items()))
        raise RecordingError(
            f"{bag.path}: lacks {'; '.join(missing)}. It has {has or 'no topics'}. "
            "Name one with --remap INPUT:=TOPIC, or choose input: odometry with --set"
        )
    return found
