"""Samples of a recorded run: its input messages, synchronized as by the node.

Messages are processed in the order of their log times; at equal times loads before poses before
twists. A load acts on the sample with its stamp, unless the connector's wrench was recorded before.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.load_history import ALWAYS, IF_REGULAR
from cylconn_ros.connector.synchronized_sample import SynchronizedSample
from cylconn_ros.connector.synchronizer import SampleMatcher
from cylconn_ros.core import layout
from cylconn_ros.recording.run import Run
from cylconn_ros.recording.table import Table
from cylconn_ros.scene.inputs import BODIES, INPUTS, InputType
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

# In the order of processing at equal log times: loads, then motion.
_KINDS = tuple(sorted(INPUTS, key=lambda kind: kind.carries_motion))
_WRENCHES = tuple(f"{body}/wrench" for body in BODIES)
_BATCH = 4096  # samples that are converted to arrays at once


class RecordedSample(NamedTuple):
    """A complete sample of a run."""

    stamp: int  # ns
    h: float  # s since the previous sample; 0 for the first of a history
    restarted: bool  # a new history begins
    sample: Array  # (NSAMPLE,)


def vectors(table: Table, names: tuple[str, ...], axes: str = "xyz") -> Array:
    """Stack the columns ``name.axis`` of vector fields: (n, len(names) * len(axes))."""
    return np.column_stack([table[f"{name}.{axis}"] for name in names for axis in axes])


def lacks_twists(run: Run, remap: Mapping[str, str] | None = None) -> bool:
    """Whether a body has recorded poses but no twists."""
    streams, _ = _input_streams(run, remap or {})
    recorded = [one for one in streams if one.kind is not None and run.counts.get(one.topic, 1)]
    posed = {one.body for one in recorded if one.kind and one.kind.pose_fields[0]}
    moving = {one.body for one in recorded if one.kind and _has_twist(one.kind)}
    return bool(posed - moving)


def _has_twist(kind: InputType) -> bool:
    return kind.carries_motion and bool(kind.pair_fields[0])


def synchronized_samples(
    run: Run, scene: Scene, remap: Mapping[str, str] | None = None, *, twists: bool = True
) -> Iterator[RecordedSample]:
    """Yield the complete samples of a run, in recording order.

    Args:
        run: the recording.
        scene: the parameters of the connector.
        remap: topics of the recording by input name, e.g. ``{"body_b/pose": "/arm/pose"}``.
        twists: False: a pose alone makes a sample, with a twist of zero.

    Raises RecordingError if a topic of ``remap`` is missing, or an input topic has no columns.
    """
    matcher = SampleMatcher(scene)
    streams, wrench = _input_streams(run, remap or {})
    if not twists:
        streams = [one for one in streams if one.kind is None or one.kind.topic != "twist"]
    used = [stream for stream in streams if run.counts.get(stream.topic, 1)]
    waits = any(one.kind is not None and not one.kind.carries_motion for one in used)
    loads = any(one.kind is not None and not one.kind.carries_motion for one in streams)
    if waits:
        matcher.expects = lambda *_: IF_REGULAR if wrench is None else ALWAYS
        if wrench is not None:  # recorded by the node: shows when a sample waited no longer
            used.append(_Stream(wrench, 0, None, len(_KINDS)))
    if not loads:  # a simulated run has no load topics: its loads are in the scene
        matcher.sample[layout.LOADS] = (*scene.plant.body_a.load, *scene.plant.body_b.load)
    for handler, row in _in_order(run, used, matcher, twists):
        found = handler(row)
        while found is not None:
            if not found.repeated:
                yield RecordedSample(found.stamp, found.h, found.restarted, matcher.sample.copy())
            found = matcher.next()
    while (waiting := matcher.waiting) is not None:
        matcher.loads.give_up(waiting)
        found = matcher.next()
        if found is not None:
            yield RecordedSample(found.stamp, found.h, found.restarted, matcher.sample.copy())


class _Stream(NamedTuple):
    """A recorded topic of an input, or of the connector's wrench (no kind)."""

    topic: str
    body: int
    kind: InputType | None
    rank: int  # in the order of processing at equal log times


Handler = Callable[[int], SynchronizedSample | None]


def _input_streams(run: Run, remap: Mapping[str, str]) -> tuple[list[_Stream], str | None]:
    """Return the recorded inputs, and the topic of the connector's wrench if it was recorded."""
    stored = {name: topic for name, topic in run.names.items() if topic in run.types}
    found = []
    for body, name in enumerate(BODIES):
        for rank, kind in enumerate(_KINDS):
            ours = f"{name}/{kind.topic}"
            topic = remap.get(ours) or stored.get(ours)
            if topic is None:
                topic = next((t for t in run.types if t.endswith(ours)), None)
            if topic is not None:
                found.append(_Stream(topic, body, kind, rank))
    return found, next((stored[n] for n in _WRENCHES if n in stored), None)


def _in_order(
    run: Run, streams: Sequence[_Stream], matcher: SampleMatcher, twists: bool
) -> Iterator[tuple[Handler, int]]:
    """Yield the handler and row of every message, by log time; at equal times by rank.

    One part of the recording after the other, so that long recordings take no more memory. Messages
    with the last log time of a part wait for the next one, which may hold others of that time.
    """
    handlers: list[Handler] = []
    places: list[NDArray[np.int64]] = []  # (5, n) of _split
    numbers = {topic: k for k, topic in enumerate(dict.fromkeys(s.topic for s in streams))}
    counts, last = [0] * len(streams), -1
    for table in run.read_blocks(*numbers):
        if numbers[table.topic] <= last:  # a new part begins
            done, places = _split(places)
            yield from ((handlers[h], row) for row, h in done)
            waiting = {int(h) for part in places for h in np.unique(part[4])}
            handlers = [h if k in waiting else _unused for k, h in enumerate(handlers)]
            handlers = handlers if waiting else []
        last = numbers[table.topic]
        for k, stream in enumerate(streams):
            if stream.topic != table.topic:
                continue
            part = np.empty((5, len(table)), np.int64)
            part[0], part[1], part[4] = table.log_time, stream.rank, len(handlers)
            part[3] = np.arange(len(table))
            part[2] = counts[k] + part[3]
            counts[k] += len(table)
            places.append(part)
            if stream.kind is None:
                handlers.append(functools.partial(_end_wait, matcher, table.stamp))
            else:
                handlers.append(_handler(matcher, stream.body, stream.kind, table, twists))
    done, _ = _split(places, everything=True)
    yield from ((handlers[h], row) for row, h in done)


def _split(
    places: list[NDArray[np.int64]], *, everything: bool = False
) -> tuple[list[list[int]], list[NDArray[np.int64]]]:
    """Return row and handler of the messages before the last log time, in order, and the others.

    ``places`` has log time, rank, number in the topic, row in its table and handler of messages.
    """
    if not places or (not everything and (places[0][0, :1] == places[-1][0, -1:]).all()):
        return [], places
    merged = np.concatenate(places, axis=1)
    # By log time; at equal times by rank, each topic in its own order.
    merged = merged[:, np.lexsort((merged[2], merged[1], merged[0]))]
    end = merged.shape[1]
    if not everything:
        end = int(np.searchsorted(merged[0], merged[0, -1]))
    return merged[3:, :end].T.tolist(), [merged[:, end:]]


def _unused(_: int) -> None:
    """Stand for the handler of a part whose messages are all processed."""


class SampleArrays(Sequence[RecordedSample]):
    """Samples as arrays, which take a third of the memory of objects.

    Attributes
    ----------
        stamps: (n,) ns.
        h: (n,) s since the previous sample.
        restarted: (n,) bool, a new history begins.
        samples: (n, NSAMPLE).
        averaged: bool, the loads are means over the interval that begins with the sample.
    """

    def __init__(
        self,
        stamps: NDArray[np.int64],
        h: Array,
        restarted: NDArray[np.bool_],
        samples: Array,
        *,
        averaged: bool = False,
    ) -> None:
        self.stamps, self.h, self.restarted, self.samples = stamps, h, restarted, samples
        self.averaged = averaged

    @classmethod
    def collect(cls, samples: Iterable[RecordedSample]) -> SampleArrays:
        """Convert an iterable of samples."""
        if isinstance(samples, SampleArrays):
            return samples
        parts: list[tuple[NDArray[Any], ...]] = []
        rest = iter(samples)
        while batch := list(itertools.islice(rest, _BATCH)):
            stamps, h, restarted, rows = zip(*batch, strict=True)
            parts.append(
                (np.array(stamps, np.int64), np.array(h, np.float64),
                 np.array(restarted, np.bool_), np.array(rows, np.float64))
            )  # fmt: skip
        if not parts:
            none = np.zeros(0, np.int64)
            return cls(none, none.astype(float), none.astype(bool), np.zeros((0, layout.NSAMPLE)))
        return cls(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def __len__(self) -> int:
        return len(self.stamps)

    @overload
    def __getitem__(self, k: int) -> RecordedSample: ...
    @overload
    def __getitem__(self, k: slice) -> SampleArrays: ...
    def __getitem__(self, k: int | slice) -> RecordedSample | SampleArrays:
        if isinstance(k, slice):
            rows = (self.stamps[k], self.h[k], self.restarted[k], self.samples[k])
            return SampleArrays(*rows, averaged=self.averaged)
        return RecordedSample(
            int(self.stamps[k]), float(self.h[k]), bool(self.restarted[k]), self.samples[k]
        )

    def every_second(self) -> SampleArrays:
        """Return every second sample, from the first on, with ``h`` adapted."""
        h, restarted = self.h[::2].copy(), self.restarted[::2].copy()
        count = len(h) - 1
        h[1:] += self.h[1::2][:count]
        restarted[1:] |= self.restarted[1::2][:count]
        samples = self.samples[::2]
        if self.averaged:  # over both intervals
            samples = samples.copy()
            both = self.h[1::2][:count, None], self.h[2::2][:, None]
            loads = [self.samples[k::2][:count, layout.LOADS] for k in (0, 1)]
            mean = (both[0] * loads[0] + both[1] * loads[1]) / np.maximum(both[0] + both[1], 1e-12)
            samples[:count, layout.LOADS] = mean
        return SampleArrays(self.stamps[::2], h, restarted, samples, averaged=self.averaged)


def _end_wait(
    matcher: SampleMatcher, stamps: NDArray[np.int64], k: int
) -> SynchronizedSample | None:
    """Wait for no load any longer if sample ``stamps[k]`` waits."""
    if matcher.waiting != stamps[k]:
        return None
    matcher.loads.give_up(int(stamps[k]))
    return matcher.next()


def _handler(
    matcher: SampleMatcher, body: int, kind: InputType, table: Table, twists: bool
) -> Callable[[int], SynchronizedSample | None]:
    """Return the function that passes row k of a topic's table to the synchronizer."""
    frames, stamps = table["header.frame_id"], table.stamp
    pairs: Array = (
        vectors(table, kind.pair_fields) if kind.pair_fields[0] else np.empty((len(table), 0))
    )
    if not kind.carries_motion:
        return lambda k: matcher.load(body, int(stamps[k]), str(frames[k]), pairs[k].tolist())
    poses: Array = np.empty((len(table), 0))
    if kind.pose_fields[0]:
        position, orientation = kind.pose_fields
        poses = np.hstack([vectors(table, (position,)), vectors(table, (orientation,), "xyzw")])
    if kind.carries_motion and not (twists or kind.pair_fields[0]):
        pairs = np.zeros((len(table), 6))
    children = table["child_frame_id"] if kind.has_child_frame else None
    return lambda k: matcher.motion(
        body,
        int(stamps[k]),
        (str(frames[k]), None if children is None else str(children[k])),
        poses[k].tolist(),
        pairs[k].tolist(),
    )
