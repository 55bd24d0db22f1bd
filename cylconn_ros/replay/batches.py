"""Stretches of a recording answered in one call: as the node would, but sooner."""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.frames import into_world_all
from cylconn_ros.connector.synchronizer import PLACES
from cylconn_ros.core import layout
from cylconn_ros.messages import prefix_decoder, statistics
from cylconn_ros.messages.pipeline import Answering
from cylconn_ros.messages.prefix import MOST_WORDS, STREAM_OF, STREAMS, Forms
from cylconn_ros.recording.chunk_buffer import Messages
from cylconn_ros.recording.message_block import Block

MOST = 2048  # samples of a stretch: what they and their answers take stays in the cache
_SHORT = 8  # samples below which a stretch was not worth its call
_PATIENCE = 1 << 14  # messages that go the ordinary way, at most, before another try

_LOADS = tuple(slice(at, at + 6) for at in (layout.A_LOAD, layout.B_LOAD))


class Stretch:
    """Samples answered together; to be looked at before the next is made.

    Attributes
    ----------
        topics, block: where its messages stand; they are those from ``begin`` to ``end``.
        closing: (n,) the message with which each sample was complete.
        stamps: (n,) of the samples, ns. outs: (n, NOUT) the answers.
    """

    def __init__(
        self,
        topics: Mapping[int, str],
        block: Block,
        place: tuple[int, int],
        found: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]],
        answering: Answering,
    ) -> None:
        self.topics, self.block = topics, block
        self.begin, self.end = place
        self.closing, self.stamps, self.outs = found
        self._answering = answering

    def __len__(self) -> int:
        return len(self.stamps)

    def recorded(self, topic: str) -> tuple[int, NDArray[np.int64]]:
        """Size and numbers of the messages of a topic among them; -1: they differ in size."""
        numbers = [channel for channel, name in self.topics.items() if name == topic]
        part = slice(self.begin, self.end)
        which = self.begin + np.flatnonzero(np.isin(self.block.channel[part], numbers))
        sizes = self.block.size[which]
        alike = not len(sizes) or bool((sizes == sizes[0]).all())
        return int(sizes[0]) if alike and len(sizes) else -1 if len(sizes) else 0, which

    def rows(self, name: str) -> NDArray[np.uint8]:
        """(n, bytes) the messages of an output, by its relative name."""
        return self._answering.rows(name, self.stamps, self.outs)

    def to_record(
        self, channels: Mapping[str, int], inputs: Collection[str], outputs: Mapping[str, str]
    ) -> Messages:
        """Its messages of ``inputs`` and the answers, in the order of a recording.

        ``channels``: the numbers of topics there; ``outputs``: topics by relative name.
        """
        block, (begin, end) = self.block, (self.begin, self.end)
        numbers = np.zeros(1 + int(block.channel[begin:end].max()), np.int64)
        for number in range(len(numbers)):
            topic = self.topics[number]
            numbers[number] = channels[topic] if topic in inputs else 0
        of_all = numbers[block.channel[begin:end]]
        which = np.flatnonzero(of_all)
        start, size = block.start[begin:end][which], block.size[begin:end][which]
        first, last = int(start[0]), int(start[-1] + size[-1])
        data = [np.frombuffer(block.raw, np.uint8)[first:last]]
        channel, starts, sizes = [of_all[which]], [start - first], [size]
        places = [which * (1 + len(outputs))]  # in the order of all; answers follow what closed
        at = last - first
        for k, (name, topic) in enumerate(outputs.items(), 1):
            rows = self.rows(name)
            data.append(rows.ravel())
            channel.append(np.full(len(rows), channels[topic]))
            starts.append(at + rows.shape[1] * np.arange(len(rows)))
            sizes.append(np.full(len(rows), rows.shape[1]))
            places.append((self.closing - begin) * (1 + len(outputs)) + k)
            at += rows.size
        place = np.concatenate(places)
        order = np.argsort(place)
        log_time = block.log_time[begin:end].astype(np.int64)[place[order] // (1 + len(outputs))]
        return Messages(
            np.concatenate(data),
            np.concatenate(channel)[order],
            log_time,
            log_time,
            np.concatenate(starts)[order],
            np.concatenate(sizes)[order],
        )


class Stretches:
    """Take stretches out of a recording for a connector that also answers single messages."""

    def __init__(self, answering: Answering, names: Mapping[str, str]) -> None:
        """``names``: the inputs by recorded topic."""
        self._answering = answering
        self._names = names
        self._forms = Forms(answering.scene)
        self._needed = sum(1 << stream for stream in answering.matcher.needed)
        self._seen: dict[int, bytes] = {}  # the last message of a stream on the ordinary way
        self._formed: dict[int, bytes] = {}  # and that which its form is of
        self._foreign = [0] * STREAMS
        self._turned = [False] * STREAMS
        self._numbers = np.full((STREAMS, 4), -1, np.int64)
        self._words = np.zeros((STREAMS, MOST_WORDS), np.uint64)
        self._topics: Mapping[int, str] = {}
        self._streams = np.zeros(0, np.int64)
        self._held = np.zeros(STREAMS, np.int64)
        self._samples = np.zeros((MOST, layout.NSAMPLE))
        self._outs = np.zeros((MOST, layout.NOUT))
        self._since = np.zeros(MOST)
        self._stamps, self._closing = np.zeros((2, MOST), np.int64)
        self._wait, self._patience = 0, 1

    def may_begin(self, topic: str, data: bytes) -> bool:
        """Whether a stretch may begin behind a message of an input that went the ordinary way."""
        stream = STREAM_OF.get(self._names[topic])
        if stream is not None:
            self._seen[stream] = data
        self._wait -= 1
        return self._wait <= 0 and self._answering.between_samples

    def next(self, topics: Mapping[int, str], block: Block, begin: int) -> Stretch | None:
        """Answer samples from message ``begin`` of a block on; None where that is not possible."""
        if self._wait > 0 or not prefix_decoder.POSSIBLE or not self._answering.between_samples:
            return None
        if not self._know_forms():
            return None
        began = time.perf_counter()
        self._look_up(topics, block)
        matcher = self._answering.matcher
        assert matcher.last_stamp is not None  # or it would not be between samples
        base = matcher.sample.copy()
        for at, load in zip(_LOADS, matcher.loads, strict=True):
            if load is not None:
                base[at] = load[0]
        n, end = prefix_decoder.take(
            block.unaligned("<u8"), block.unaligned("<f8"), block.channel, block.start, block.size,
            begin, len(block), self._streams, self._numbers, self._words, self._needed,
            base, matcher.last_stamp, self._held, self._samples, self._stamps,
            self._since, self._closing,
        )  # fmt: skip
        self._patience = min(2 * self._patience, _PATIENCE) if n < _SHORT else 1
        self._wait = self._patience if n < _SHORT else 0
        if not n:
            return None
        found = self._closing[:n], self._stamps[:n], self._outs[:n]
        self._answer(n, began)
        return Stretch(topics, block, (begin, end), found, self._answering)

    def _answer(self, n: int, began: float) -> None:
        """Answer n samples and keep what the node keeps of each."""
        answering, outs, stamps = self._answering, self._outs[:n], self._stamps
        matcher, since = answering.matcher, self._since[:n]
        before = int(stamps[n - 2]) if n > 1 else matcher.last_stamp
        matcher.counts.foreign_frames += n * sum(self._foreign)
        answering.connector.run_each(self._into_world(n), since, outs)
        outs[:, layout.COMPUTING_TIME] = (time.perf_counter() - began) / n
        matcher.sample[:], answering.out[:] = self._samples[n - 1], outs[n - 1]
        answering.went_on(int(stamps[n - 1]), before, n)
        statistics.note_all(answering.health.numbers, outs, since, answering.scene.period)

    def _into_world(self, n: int) -> NDArray[np.float64]:
        """(n, NSAMPLE) the samples, what is in body axes turned into the world's."""
        samples = self._samples[:n]
        for body, load in enumerate(self._answering.matcher.loads):
            poses = samples[:, PLACES[2 * body]]
            into = [PLACES[2 * body + 1]] * (self._turned[2 * body + 1] or self._turned[4 + body])
            if load is not None and not load[1]:
                into.append(_LOADS[body])
            for at in into:
                samples[:, at] = into_world_all(poses, samples[:, at])
        return samples

    def _know_forms(self) -> bool:
        """Keep the forms of what came last; whether there is one for each stream needed."""
        for stream, data in self._seen.items():
            if self._formed.get(stream) is data:
                continue
            self._formed[stream] = data
            form = self._forms.of(stream, data)
            self._numbers[stream] = -1
            if form is not None:
                self._numbers[stream], self._words[stream] = form.numbers, form.words
            self._foreign[stream] = form.foreign if form is not None else 0
            self._turned[stream] = form is not None and form.turned
        odometry = self._answering.scene.input == "odometry"
        streams = (
            [4 + b for b in (0, 1) if self._needed >> 2 * b & 1]
            if odometry
            else [s for s in range(4) if self._needed >> s & 1]
        )
        return all(self._numbers[stream, 0] >= 0 for stream in streams)

    def _look_up(self, topics: Mapping[int, str], block: Block) -> None:
        """Which channel brings which stream."""
        most = int(block.channel.max()) + 1
        if topics is self._topics and most <= len(self._streams):
            return
        self._topics = topics
        self._streams = np.full(most, prefix_decoder.NOT_READ, np.int64)
        for channel in range(most):
            name = self._names.get(topics[channel])
            if name is not None:
                self._streams[channel] = STREAM_OF.get(name, prefix_decoder.OTHER)
