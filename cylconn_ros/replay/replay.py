"""A recording through the connector again, as fast as the machine allows.

The messages go through the node's own :class:`~cylconn_ros.messages.pipeline.Answering` in the order in
which they were recorded, so that what comes out is what the live node published: the same bytes,
but for the time that an answer took.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Generator, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from cylconn_ros.errors import RecordingError
from cylconn_ros.messages.pipeline import COMMAND, OUTPUTS, STATE_TOPIC, Answer, Answering
from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.message_block import Block
from cylconn_ros.recording.metadata import TopicInfo
from cylconn_ros.recording.sqlite import Topics
from cylconn_ros.replay.batches import Stretch, Stretches
from cylconn_ros.scene.scene import Scene

NODE = "/connector"
_FEW = 64  # messages between two looks whether a stretch may begin


class Item(NamedTuple):
    """A message: as it was recorded, or ``replayed``, with the log time of what it answers."""

    topic: str
    log_time: int
    data: bytes
    replayed: bool


@dataclasses.dataclass
class Counts:
    """What became of the messages of a recording."""

    read: int = 0
    used: int = 0
    answers: int = 0
    outputs: int = 0  # what the recorded connector itself had published
    foreign: int = 0  # of topics that are no input
    by_topic: dict[str, int] = dataclasses.field(default_factory=dict)


class Replay:
    """A recording's inputs, answered by a connector.

    Attributes
    ----------
        answering: the connector and its health.
        inputs: recorded topic of every input found, by the input's relative name.
        names, outputs: resolved topic and type of every output, by its relative name.
        taken: recorded topics that are inputs.
        timing: the bytes that no two runs have in common, by topic.
        counts: what became of the messages so far.

    Raises RecordingError where the recording lacks an input that every sample needs, and SceneError
    where the connector cannot serve the scene.
    """

    def __init__(self, bag: Bag, scene: Scene, renamed: Mapping[str, str] | None = None) -> None:
        """Prepare; ``renamed``: the recorded topic of an input, ``body_b/odom: /robot/odom``."""
        self.bag, self.scene = bag, scene
        self.answering = Answering(scene)
        self.node = bag.texts.get("node", NODE)
        self.inputs = _inputs(bag, self.answering, self.node, dict(renamed or {}))
        self.names = {n: bag.names.get(n) or _resolved(n, self.node) for n, _ in OUTPUTS}
        self.outputs = dict(OUTPUTS)
        self.taken = frozenset(self.inputs.values())
        self.timing = {self.names[STATE_TOPIC]: self.answering.timing}
        self.counts = Counts()
        self._published = set(self.names.values())
        self._receive: dict[str, Callable[[bytes], Answer | None]] = {}

    def messages(self) -> Iterator[Item]:
        """Every message of an input or output, as recorded, and every answer's where it is due."""
        self._listen()
        for topic, log_time, data in self.bag.messages():
            yield from self._one(topic, log_time, data)
        self._settle()

    def parts(self) -> Iterator[Item | Stretch]:
        """The same, sooner: where messages are alike, many samples are one part.

        A stretch is to be looked at before the next part is asked for.
        """
        self._listen()
        by_topic = {topic: name for name, topic in self.inputs.items()}
        stretches = Stretches(self.answering, by_topic)
        for topics, block in self.bag.blocks():
            at = 0
            while at < len(block):
                stretch = stretches.next(topics, block, at)
                if stretch is None:
                    at = yield from self._ordinarily(topics, block, at, stretches)
                else:
                    at = stretch.end
                    self._count(stretch)
                    yield stretch
        self._settle()

    def _listen(self) -> None:
        inputs = self.answering.inputs
        self._receive = {topic: inputs[name].receive for name, topic in self.inputs.items()}

    def _ordinarily(
        self, topics: Topics, block: Block, begin: int, stretches: Stretches
    ) -> Generator[Item, None, int]:
        """Messages up to where a stretch may begin, or a few; gives the number of the next."""
        end = min(begin + _FEW, len(block))
        for k, (channel, log_time, _, data) in enumerate(block.messages(begin, end), begin + 1):
            topic = topics[channel]
            yield from self._one(topic, log_time, data)
            if topic in self.taken and stretches.may_begin(topic, data):
                return k
        return end

    def _one(self, topic: str, log_time: int, data: bytes) -> Iterator[Item]:
        """A message as recorded, and what answers it."""
        counts = self.counts
        counts.read += 1
        take = self._receive.get(topic)
        if take is None:
            if topic in self._published:
                counts.outputs += 1
                yield Item(topic, log_time, data, False)
            else:
                counts.foreign += 1
            return
        counts.by_topic[topic] = counts.by_topic.get(topic, 0) + 1
        counts.used += 1
        yield Item(topic, log_time, data, False)
        answer = take(data)
        if answer is not None:
            counts.answers += 1
            for (name, _), answered in zip(OUTPUTS, answer[1:], strict=True):
                if answered is not None:
                    yield Item(self.names[name], log_time, answered, True)

    def _count(self, stretch: Stretch) -> None:
        """Count the messages of a stretch."""
        counts, topics = self.counts, stretch.topics
        channels = stretch.block.channel[stretch.begin : stretch.end].astype(np.int64)
        for channel, number in enumerate(np.bincount(channels).tolist()):
            topic = topics[channel] if number else ""
            counts.read += number
            if topic in self.taken:
                counts.used += number
                counts.by_topic[topic] = counts.by_topic.get(topic, 0) + number
            elif topic in self._published:
                counts.outputs += number
            else:
                counts.foreign += number
        counts.answers += len(stretch)

    def _settle(self) -> None:
        """Count what is held for samples that are not complete."""
        self.answering.settle()
        self.answering.settle()

    def topics(self) -> list[TopicInfo]:
        """Every topic of a run that is made of inputs and answers."""
        kinds = {topic: self.answering.inputs[name].type for name, topic in self.inputs.items()}
        kinds |= {self.names[name]: kind for name, kind in OUTPUTS}
        return [TopicInfo(topic, kind) for topic, kind in kinds.items()]

    def unmatched(self) -> dict[str, int]:
        """Messages of inputs that did not become part of a sample, by reason."""
        counts = vars(self.answering.matcher.counts)
        return {name.replace("_", " "): n for name, n in counts.items() if n and name != "samples"}


def _resolved(name: str, node: str) -> str:
    """A relative or private name as the node of that name would have it."""
    if name.startswith("~/"):
        return f"{node}/{name[2:]}"
    return f"{node.rpartition('/')[0]}/{name}"


def _inputs(bag: Bag, answering: Answering, node: str, renamed: dict[str, str]) -> dict[str, str]:
    """The recorded topic of every input: as renamed, as the node had it, the only one like it."""
    for name in renamed:
        if name not in answering.inputs:
            known = ", ".join(answering.inputs)
            raise RecordingError(f"{name}: is no input of this scene; its inputs are {known}")
    found: dict[str, str] = {}
    missing = []
    for name, wanted in answering.inputs.items():
        topic = renamed.get(name) or bag.names.get(name) or _resolved(name, node)
        if name not in renamed and topic not in bag.types:
            alike = [t for t in bag.types if t.endswith("/" + name.removeprefix("~/"))]
            topic = alike[0] if len(alike) == 1 else topic
        if topic in bag.types:
            if bag.types[topic] != wanted.type:
                raise RecordingError(
                    f"{bag.path}: {topic} holds {bag.types[topic]}, {name} must be {wanted.type}"
                )
            found[name] = topic
        elif name in renamed or not (name == COMMAND or name.endswith("/load")):
            missing.append(f"{name} ({wanted.type}; looked for {topic})")
    if missing:
        has = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(bag.types.items()))
        raise RecordingError(
            f"{bag.path}: lacks {'; '.join(missing)}. It has {has or 'no topics'}. "
            "Name one with --remap INPUT:=TOPIC, or choose input: odometry with --set"
        )
    return found
