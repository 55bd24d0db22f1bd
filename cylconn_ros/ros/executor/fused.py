"""Fused path: rcl take, step and publish in one compiled call.

A call takes queued messages, computes each sample that they complete, publishes its outputs and
goes on while samples are complete. It returns at the first message that does not match its
template; the caller processes that message on the reference path and calls again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from cylconn_ros.connector import batch
from cylconn_ros.core import layout
from cylconn_ros.core.jit import COMPILED, call, device_function, inline_function, kernel
from cylconn_ros.messages import partial_sample, prefix_decoder
from cylconn_ros.messages.output_messages import PipelineParts
from cylconn_ros.messages.prefix_decoder import MAX_BYTES
from cylconn_ros.messages.statistics import count as count_sample
from cylconn_ros.messages.templates import BEGIN, COUNT, SIZE, write
from cylconn_ros.recording.mcap.chunk_buffer import ChunkBuffer
from cylconn_ros.recording.mcap.kernels import append
from cylconn_ros.ros.executor import rcl
from cylconn_ros.ros.executor.sequence_numbers import SequenceNumbers

if TYPE_CHECKING:
    from cylconn_ros.recording.writer import RunWriter

_REAL, _MONOTONIC = 0, 1  # CLOCK_REALTIME, CLOCK_MONOTONIC
_WRENCHES: Final = 2  # the first outputs, which are published even without subscribers

# Status block exchanged with _serve().
MISMATCH: Final = 0  # index of the input whose message does not match its template; -1: none
LAST: Final = 1  # index of the input with the last message of a sample's motion; -1: none
STAMP: Final = 2  # of the last sample, ns
PREVIOUS: Final = 3  # stamp of the sample before it, ns
HAS_PREVIOUS: Final = 4  # whether there was one
UNPUBLISHED: Final = 5  # messages that could not be published
NEXT: Final = 6  # place in the order of the input to begin with: the one after MISMATCH
MOST: Final = 7  # samples that one call may process
RECORDING: Final = 8  # whether messages are recorded
FIRST: Final = 9  # index of the input to take first, whose end ends a call; -1: none
NSTATUS: Final = 10
_ALL = 1 << 30
_NO_CHUNK = ChunkBuffer(0, np.zeros((2, 1), np.int64)).arrays
_MOST_RECORDED = 4  # samples per call while recording


@device_function
def _now(addresses: Any, clock: Any) -> float:
    """Seconds on the steady clock."""
    call(addresses[rcl.CLOCK], _MONOTONIC, addresses[rcl.NUMBERS], 0, 0)
    return clock[0] + 1e-9 * clock[1]


@device_function
def _time_of_day(addresses: Any, clock: Any) -> int:
    """Nanoseconds since the epoch."""
    call(addresses[rcl.CLOCK], _REAL, addresses[rcl.NUMBERS], 0, 0)
    return clock[0] * 1_000_000_000 + clock[1]


@device_function
def _is_wanted(k: int, addresses: Any, clock: Any, publishers: Any) -> bool:
    """Whether output ``k`` is published: a wrench always, the others if there are subscribers."""
    if k < _WRENCHES:
        return True
    clock[0] = 0
    call(addresses[rcl.SUBSCRIBERS], publishers[k], addresses[rcl.NUMBERS], 0, 0)
    return clock[0] != 0


@inline_function
def _accept(
    stream: int, begin: int, source: int, size: int,
    addresses: Any, memory_address: int, words: Any, columns: Any, prefixes: Any, partial: Any,
    load_state: Any,
) -> int:  # fmt: skip
    """Copy a message at address ``source`` to its row and match it with its template."""
    received = partial[partial_sample.RECEIVED] & partial_sample.quantities(stream, columns)
    if size > MAX_BYTES or received != 0:
        return partial_sample.MISMATCH
    call(addresses[rcl.COPY], memory_address + begin, source, size, 0)
    return partial_sample.accept(stream, begin, size, words, columns, prefixes, partial, load_state)


@inline_function
def _step(
    addresses: Any, clock: Any, partial: Any, columns: Any, numbers: Any, loads: Any,
    load_state: Any,
    sample: Any, handle: Any, par: Any, mem: Any, period: float, out: Any,
) -> float:  # fmt: skip
    """Write ``sample``, compute ``out`` and return the seconds since the last sample."""
    began = _now(addresses, clock)
    partial_sample.write_sample(numbers, columns, partial, loads, load_state, sample)
    stamp, last = partial[partial_sample.STAMP], partial[partial_sample.LAST]
    h = (stamp - last) * 1e-9 if partial[partial_sample.HAS_LAST] else 0.0
    batch.process(handle, par, mem, sample, h, period, out)
    out[layout.COMPUTING_TIME] = _now(addresses, clock) - began
    return h


@inline_function
def _publish(
    status: Any, recording: bool, first_channel: int, addresses: Any, clock: Any,
    offsets: Any, template_bytes: Any,
    publishers: Any, outbox: Any,
    records: Any, entries: Any, used: Any, counts: Any, channels: Any,
) -> None:  # fmt: skip
    """Publish the outputs of a sample and record them."""
    now = _time_of_day(addresses, clock) if recording else 0
    for k in range(COUNT):
        wanted = _is_wanted(k, addresses, clock, publishers)
        if wanted and call(addresses[rcl.PUBLISH], publishers[k], outbox[k], 0, 0) != 0:
            status[UNPUBLISHED] += 1
        if recording:
            begin, size = offsets[BEGIN + k], offsets[SIZE + k]
            data, to = template_bytes[begin : begin + size], channels[first_channel + k]
            append(records, entries, used, counts, to, now, now, data, size)


@kernel
def _serve(
    status: Any, addresses: Any, info: Any, clock: Any,
    subscriptions: Any, streams: Any, expected: Any, boxes: Any, inbox: Any,
    partial: Any, columns: Any, prefixes: Any, memory_address: int, memory: Any, words: Any,
    numbers: Any,
    loads: Any, load_state: Any, sample: Any,
    handle: Any, par: Any, mem: Any, period: float, out: Any, counters: Any,
    offsets: Any, template_numbers: Any, template_words: Any, template_bytes: Any,
    publishers: Any, outbox: Any,
    records: Any, entries: Any, used: Any, counts: Any, channels: Any,
) -> int:  # fmt: skip
    """Process queued messages; return the number of samples computed.

    Messages are taken from the inputs in turn. The call ends if the input FIRST has no more and a
    sample was computed, or if no input has any.

    Args:
        status: (NSTATUS,). addresses, info, clock: of ``rcl.CallTable``, the last its ``numbers``.
        subscriptions: (n,) addresses. streams: (n,) of each. expected: (n,) sequence numbers of
            the next messages. boxes, inbox: memory and addresses of ``rcl.ReceiveBuffers`` for n.
        partial, columns, prefixes, memory, words, numbers: of a ``PrefixDecoder`` and its table;
            memory_address: the address of ``memory``. loads, load_state, sample: of its matcher.
        handle, par, mem, period: of a ``Connector``. out, counters: of a ``MessagePipeline``.
        offsets, template_numbers, template_words, template_bytes: of ``MessageTemplates``.
        publishers, outbox: (COUNT,) addresses.
        records, entries, used, counts: of a chunk buffer. channels: (n + COUNT,) of the inputs and
            of the outputs.
    """
    processed, count, recording = 0, len(subscriptions), status[RECORDING] != 0
    status[MISMATCH] = status[LAST] = -1
    while processed < status[MOST]:
        first, messages = status[NEXT], 0
        status[NEXT] = 0
        for i in range(first, count):
            j = (max(status[FIRST], 0) + i) % count
            taking = addresses[rcl.TAKE]
            if call(taking, subscriptions[j], inbox[j], addresses[rcl.INFO], 0) != 0:
                if processed > 0 and i == 0 and status[FIRST] >= 0:
                    return processed  # the first input has no more messages
                continue
            messages += 1
            stream = streams[j]
            size = boxes[rcl.MESSAGE * j + rcl.LENGTH]
            begin = prefix_decoder.row_begin(stream)
            taken = partial_sample.MISMATCH
            if info[rcl.SEQUENCE] == expected[j]:
                taken = _accept(
                    stream, begin, boxes[rcl.MESSAGE * j + rcl.BYTES], size,
                    addresses, memory_address, words, columns, prefixes, partial, load_state,
                )  # fmt: skip
            if taken == partial_sample.MISMATCH:
                status[MISMATCH], status[NEXT] = j, i + 1
                return processed
            expected[j] += 1
            if recording:
                now = _time_of_day(addresses, clock)
                data = memory[begin : begin + size]
                append(records, entries, used, counts, channels[j], now, now, data, size)
            if partial[partial_sample.RECEIVED] == partial[partial_sample.NEEDED]:
                status[LAST] = j
            if taken != partial_sample.COMPLETE:
                continue
            h = _step(
                addresses, clock, partial, columns, numbers, loads, load_state, sample,
                handle, par, mem, period, out,
            )  # fmt: skip
            stamp = partial[partial_sample.STAMP]
            write(stamp, out, offsets, template_numbers, template_words, template_bytes)
            _publish(
                status, recording, count, addresses, clock, offsets, template_bytes, publishers,
                outbox, records, entries, used, counts, channels,
            )  # fmt: skip
            count_sample(counters, sample, out, h, period)
            status[HAS_PREVIOUS] = partial[partial_sample.HAS_LAST]
            status[PREVIOUS], status[STAMP] = partial[partial_sample.LAST], stamp
            partial[partial_sample.HAS_LAST], partial[partial_sample.LAST] = 1, stamp
            processed += 1
        if first == 0 and messages == 0:
            return processed
    return processed


def missing() -> str:
    """Return the missing prerequisite, or '' if the fused path is supported."""
    return rcl.missing() if COMPILED else "numba"


KERNELS: Final = (_serve,)
"""The kernels of the fused path."""


def prepare(parts: PipelineParts) -> None:
    """Load or compile the kernels now, not while a sample waits."""
    FusedPath([], [], parts, lambda _: None).take(None, lambda _: None)


class Input(NamedTuple):
    """A subscription of rclpy, its stream, and the handler of messages on the reference path."""

    subscription: Any
    stream: int
    receive: Callable[[bytes], bool]
    sequence: SequenceNumbers


class FusedPath:
    """Process the poses, twists or odometry of one connector in compiled code.

    Attributes
    ----------
        status: (NSTATUS,) int64, the status block of the last call.
        writer: the recording's writer, or None.
    """

    def __init__(
        self,
        inputs: Sequence[Input],
        publishers: Sequence[Any],
        parts: PipelineParts,
        on_samples: Callable[[int], object],
    ) -> None:
        """``publishers``: handles of rclpy, in the order of the outputs.

        ``on_samples`` is called with the number of samples computed; :attr:`status` has the stamps.
        """
        self._on_samples = on_samples
        self._inputs = list(inputs)
        self._calls = rcl.CallTable()
        self._received = rcl.ReceiveBuffers(len(inputs))
        status = np.zeros(NSTATUS, np.int64)
        self._status, self.status = status, status.data  # Python reads the memoryview faster
        self._expected, self._subscriptions, self._streams = (
            np.array(found, np.int64)
            for found in (
                [one.sequence.expected for one in inputs],
                [one.subscription.handle.pointer for one in inputs],
                [one.stream for one in inputs],
            )
        )
        self._publishers = np.array([publisher.pointer for publisher in publishers], np.int64)
        self._messages = _MOST_RECORDED * (len(inputs) + COUNT)
        self.record(None)
        self.use(parts)

    def use(self, parts: PipelineParts) -> None:
        """Work on these arrays from now on."""
        decoder, templates = parts.decoder, parts.templates
        self._decoder, self._parts = decoder, parts
        self._sent = rcl.SendBuffers(templates.addresses, templates.sizes.tolist())
        self._largest = max(MAX_BYTES, *templates.sizes.tolist())
        matcher, calls, received = decoder.matcher, self._calls, self._received
        self._arguments = (
            self._status, calls.addresses, calls.info, calls.numbers,
            self._subscriptions, self._streams, self._expected, received.memory, received.addresses,
            decoder.partial, decoder.table.columns, decoder.table.words,
            decoder.memory.ctypes.data, decoder.memory, decoder.words, decoder.numbers,
            matcher.loads.numbers, matcher.loads.state, matcher.sample,
            *parts.connector, parts.out, parts.counters,
            templates.offsets, templates.numbers, templates.words, templates.memory,
            self._publishers, self._sent.addresses,
        )  # fmt: skip

    def take(
        self, first: int | None, on_error: Callable[[Exception], object], one: bool = False
    ) -> tuple[bool, int | None]:
        """Process queued messages until no input has any; with ``one``, until a sample is complete.

        With ``first``, an input, it may end if that one has none and a sample was complete. Returns
        whether a sample was complete, and the index of the input with the last message of a
        sample's motion. ``on_error`` gets exceptions raised by the handlers of the reference path.
        """
        most = self.status[MOST]
        self.status[MOST] = 1 if one else most
        try:
            return self._take(first, on_error, one)
        finally:
            self.status[MOST] = most

    def _take(
        self, first: int | None, on_error: Callable[[Exception], object], one: bool
    ) -> tuple[bool, int | None]:
        complete, last, status = False, None, self.status
        status[FIRST] = -1 if first is None else first
        while True:
            self._decoder.follow()
            processed = self._serve()
            if status[LAST] >= 0:
                last = status[LAST]
            if processed:
                complete = True
                self._decoder.count_unknown_frames()
                self._on_samples(processed)
            k = status[MISMATCH]
            if k < 0:
                if one or processed < status[MOST]:
                    return complete, last
                continue
            last = k
            try:
                complete |= self._receive_mismatch(k)
            except Exception as error:
                on_error(error)
            if one and complete:
                return complete, last

    def record(self, writer: RunWriter | None, channels: Sequence[int] = ()) -> None:
        """Record with ``writer`` from now on, or stop recording (None).

        ``channels``: channel numbers in the file, of the inputs and of the outputs.
        """
        self.writer = writer
        recording = writer is not None
        self.status[RECORDING] = recording
        self.status[MOST] = _MOST_RECORDED if recording else _ALL
        self._channels = np.array(channels, np.int64)

    def _serve(self) -> int:
        writer = self.writer
        if writer is None:
            return _serve(*self._arguments, *_NO_CHUNK, self._channels)
        with writer.lock:
            chunk = writer.reserve(self._messages, self._messages * self._largest)
            return _serve(*self._arguments, *chunk.arrays, self._channels)

    def _receive_mismatch(self, k: int) -> bool:
        """Process the first message that does not match its template on the reference path.

        Returns True if it completed a sample.
        """
        one, number = self._inputs[k], int(self._calls.info[rcl.SEQUENCE])
        one.sequence.expected = int(self._expected[k])
        one.sequence.check(number if number >= 0 else None)  # -1: the middleware has no numbers
        self._expected[k] = one.sequence.expected
        return one.receive(self._received.message(k))

    def close(self) -> None:
        """Free the receive buffers; the object must not be used afterwards."""
        self._received.close()
