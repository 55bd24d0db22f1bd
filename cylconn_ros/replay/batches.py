"""Batches: runs of recorded messages with known prefixes, processed in one compiled call."""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.core import layout
from cylconn_ros.messages import prefix_decoder, statistics
from cylconn_ros.messages.pipeline import OUTPUTS, MessagePipeline
from cylconn_ros.recording.mcap.chunk_buffer import MessageArrays
from cylconn_ros.recording.mcap.message_block import MessageBlock
from cylconn_ros.replay.compare import Comparison
from cylconn_ros.scene.inputs import STREAM_NUMBER, STREAMS

MAX_SAMPLES = 2048
"""Samples of a batch at most: they and their outputs stay in the processor's cache."""
_MIN_SAMPLES = 8  # a smaller batch costs more than its messages one by one
_MAX_PAUSE = 1 << 14  # messages processed one by one, at most, before the next attempt

Integers = NDArray[np.int64]


class Batch:
    """Samples processed together; its arrays are valid until the next batch is made.

    Attributes
    ----------
        topics, block: the messages; those of the batch are ``begin`` to ``end``.
        closing: (n,) number of the message that completed each sample.
        stamps: (n,) ns. outs: (n, NOUT) outputs.
    """

    def __init__(
        self,
        topics: Mapping[int, str],
        block: MessageBlock,
        messages: tuple[int, int],
        samples: tuple[Integers, Integers, NDArray[np.float64]],
        pipeline: MessagePipeline,
    ) -> None:
        """``messages``: begin and end; ``samples``: closing, stamps, outs."""
        self.topics, self.block = topics, block
        self.begin, self.end = messages
        self.closing, self.stamps, self.outs = samples
        self._pipeline = pipeline

    def __len__(self) -> int:
        return len(self.stamps)

    def recorded(self, topic: str) -> tuple[int, Integers]:
        """Size in bytes and numbers of the messages of a topic in the batch.

        The size is -1 if it is not the same for all, and 0 without messages.
        """
        channels = [channel for channel, name in self.topics.items() if name == topic]
        part = slice(self.begin, self.end)
        which = self.begin + np.flatnonzero(np.isin(self.block.channel[part], channels))
        if not len(which):
            return 0, which
        sizes = self.block.size[which]
        return int(sizes[0]) if (sizes == sizes[0]).all() else -1, which

    def rows(self, name: str) -> NDArray[np.uint8]:
        """(n, bytes) the messages of an output, by its relative name."""
        number = [output for output, _ in OUTPUTS].index(name)
        return self._pipeline.output.rows(number, self.stamps, self.outs)

    def compare(self, topic: str, outputs: NDArray[np.uint8], comparison: Comparison) -> None:
        """Compare the ``rows`` of an output with the messages recorded on its topic."""
        if topic not in comparison.topics:
            return
        size, which = self.recorded(topic)
        if size == outputs.shape[1]:
            comparison.both(topic, self.block.rows(which, size), outputs)
            return
        for k in which.tolist():
            (message,) = self.block.messages(k, k + 1)
            comparison.recorded(topic, message.data)
        for row in outputs:
            comparison.replayed(topic, row.tobytes())

    def to_record(
        self, channels: Mapping[str, int], inputs: Collection[str], outputs: Mapping[str, str]
    ) -> MessageArrays:
        """The messages of ``inputs`` and the outputs, in the order of a recording.

        ``channels``: numbers of the topics in that recording; ``outputs``: topics by relative name.
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
        # Order of all messages: the outputs of a sample follow the message that completed it.
        ranks = [which * (1 + len(outputs))]
        at = last - first
        for k, (name, topic) in enumerate(outputs.items(), 1):
            rows = self.rows(name)
            data.append(rows.ravel())
            channel.append(np.full(len(rows), channels[topic]))
            starts.append(at + rows.shape[1] * np.arange(len(rows)))
            sizes.append(np.full(len(rows), rows.shape[1]))
            ranks.append((self.closing - begin) * (1 + len(outputs)) + k)
            at += rows.size
        rank = np.concatenate(ranks)
        order = np.argsort(rank)
        log_time = block.log_time[begin:end].astype(np.int64)[rank[order] // (1 + len(outputs))]
        return MessageArrays(
            np.concatenate(data),
            np.concatenate(channel)[order],
            log_time,
            log_time,
            np.concatenate(starts)[order],
            np.concatenate(sizes)[order],
        )


class Batches:
    """Find and process the batches of a recording, between messages processed one by one."""

    def __init__(
        self, pipeline: MessagePipeline, names: Mapping[str, str], wrenches: Collection[str] = ()
    ) -> None:
        """``names``: relative names of the inputs by recorded topic.

        ``wrenches``: recorded topics of the wrenches.
        """
        self._pipeline = pipeline
        self._names, self._wrenches = names, wrenches
        moving = [body.kind != "fixed" for body in pipeline.scene.bodies]
        self._needed = [
            number
            for number, (body, kind) in enumerate(STREAMS)
            if moving[body] and kind.mode == pipeline.scene.input
        ]
        self._topics: Mapping[int, str] = {}
        self._streams = np.zeros(0, np.int64)
        self._results = prefix_decoder.DecodedBlock.empty(MAX_SAMPLES)
        self._outs = np.zeros((MAX_SAMPLES, layout.NOUT))
        self._wait, self._pause = 0, 1

    def may_begin(self) -> bool:
        """Whether a batch may begin after an input message processed alone; called for each."""
        self._wait -= 1
        return self._wait <= 0 and self._pipeline.between_samples

    def next(self, topics: Mapping[int, str], block: MessageBlock, begin: int) -> Batch | None:
        """Process samples from message ``begin`` of a block on; None if no batch begins there."""
        pipeline = self._pipeline
        if self._wait > 0 or not prefix_decoder.AVAILABLE or not pipeline.between_samples:
            return None
        decoder = pipeline.decoder
        if any(decoder.table.size(stream) < 0 for stream in self._needed):
            return None
        began = time.perf_counter()
        self._assign_streams(topics, block)
        n, end = decoder.process_block(block, begin, self._streams, self._results)
        self._pause = min(2 * self._pause, _MAX_PAUSE) if n < _MIN_SAMPLES else 1
        self._wait = self._pause if n < _MIN_SAMPLES else 0
        if not n:
            return None
        self._step(n, began)
        found = self._results.closing[:n], self._results.stamps[:n], self._outs[:n]
        return Batch(topics, block, (begin, end), found, pipeline)

    def _step(self, n: int, began: float) -> None:
        """Process n samples, and update the state of the pipeline as single messages do."""
        pipeline, outs, results = self._pipeline, self._outs[:n], self._results
        matcher, stamps, since = pipeline.matcher, results.stamps, results.since[:n]
        before = int(stamps[n - 2]) if n > 1 else matcher.last_stamp
        pipeline.connector.run(results.samples[:n], since, outs)
        outs[:, layout.COMPUTING_TIME] = (time.perf_counter() - began) / n
        matcher.sample[:], pipeline.out[:] = results.samples[n - 1], outs[n - 1]
        pipeline.advance(int(stamps[n - 1]), before, n)
        statistics.count_all(
            pipeline.health.numbers, results.samples[:n], outs, since, pipeline.scene.period
        )

    def _assign_streams(self, topics: Mapping[int, str], block: MessageBlock) -> None:
        """Assign each channel number of the block to a stream."""
        count = int(block.channel.max()) + 1
        if topics is self._topics and count <= len(self._streams):
            return
        self._topics = topics
        self._streams = np.full(count, prefix_decoder.NOT_READ, np.int64)
        for channel in range(count):
            name = self._names.get(topics[channel])
            if name is not None:
                self._streams[channel] = STREAM_NUMBER.get(name, prefix_decoder.OTHER_INPUT)
            elif topics[channel] in self._wrenches:
                self._streams[channel] = prefix_decoder.OUTPUT
