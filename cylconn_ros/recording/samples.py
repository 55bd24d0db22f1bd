"""The samples in a recorded run: its inputs, put together by the node's own matching.

Messages go in as they were recorded, loads before poses before twists of the same moment.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from cylconn_ros.connector.synchronizer import Matched, SampleMatcher
from cylconn_ros.core import layout
from cylconn_ros.recording.run import Run, Table
from cylconn_ros.scene.scene import Scene

Array = NDArray[np.float64]

_BODIES = ("body_a", "body_b")


class Sampled(NamedTuple):
    """A complete sample of a run."""

    stamp: int  # ns
    h: float  # s since the sample before; 0 for the first of a history
    restarted: bool  # a new history begins
    sample: Array  # (NSAMPLE,)


def vectors(table: Table, names: tuple[str, ...], axes: str = "xyz") -> Array:
    """Stack the columns of vectors: (n, 3) for each of ``names``."""
    return np.column_stack([table[f"{name}.{axis}"] for name in names for axis in axes])


def _pose(table: Table, prefix: str) -> Array:
    position = vectors(table, (f"{prefix}position",))
    return np.hstack([position, vectors(table, (f"{prefix}orientation",), "xyzw")])


def matched(run: Run, scene: Scene, names: Mapping[str, str] | None = None) -> Iterator[Sampled]:
    """The samples of a run as the node's own matching makes them, in the order of the recording.

    ``names`` says where a run has another topic for one of ours: ``{"body_b/pose": "/arm/pose"}``.
    Raises RecordingError for a topic named that is not there, or one of inputs without columns.
    """
    matcher = SampleMatcher(scene)
    own = {ours: topic for ours, topic in run.names.items() if topic in run.types}
    takers: list[Callable[[int], Matched | None]] = []
    places: list[NDArray[np.int64]] = []  # log time, rank, stream and row of every message
    loads = 0
    for body, name in enumerate(_BODIES):
        for rank, kind in enumerate(("load", "pose", "twist", "odom")):
            ours = f"{name}/{kind}"
            topic = (names or {}).get(ours) or own.get(ours)
            if topic is None:
                topic = next((t for t in run.types if t.endswith(ours)), None)
            if topic is None:
                continue
            loads += kind == "load"  # also where none came: then there was none
            if topic in run.counts and not run.counts[topic]:
                continue
            table = run.table(topic)
            count, stream = len(table), len(takers)
            row = np.arange(count)
            places.append(
                np.stack([table.log_time, np.full(count, rank), np.full(count, stream), row])
            )
            takers.append(_taker(matcher, body, kind, table))
    if not loads:  # simulate knows its loads from the scene
        matcher.sample[layout.LOADS] = (*scene.plant.body_a.load, *scene.plant.body_b.load)
    together = np.concatenate(places or [np.zeros((4, 0), np.int64)], axis=1)
    # in the order of log times; at one time loads, poses, twists, each in its own order
    order = np.lexsort((together[3], together[1], together[0]))
    stream_of, row_of = together[2:, order]
    del together, places, order
    for stream, row in zip(stream_of, row_of, strict=True):
        found = takers[stream](row)
        if found is not None and not found.repeated:
            yield Sampled(found.stamp, found.h, found.restarted, matcher.sample.copy())


class Samples(Sequence[Sampled]):
    """Samples kept as columns: a third of what as many objects take.

    Attributes
    ----------
        stamps: (n,) ns. since: (n,) s since the sample before.
        restarted: (n,) a new history begins.
        numbers: (n, NSAMPLE).
    """

    def __init__(
        self, stamps: NDArray[np.int64], since: Array, restarted: NDArray[np.bool_], numbers: Array
    ) -> None:
        self.stamps, self.since, self.restarted, self.numbers = stamps, since, restarted, numbers

    @classmethod
    def of(cls, samples: Iterable[Sampled]) -> Samples:
        """Keep samples as they come."""
        if isinstance(samples, Samples):
            return samples
        parts: list[tuple[NDArray[Any], ...]] = []
        rest = iter(samples)
        while some := list(itertools.islice(rest, 4096)):
            stamps, since, restarted, numbers = zip(*some, strict=True)
            parts.append(
                (np.array(stamps, np.int64), np.array(since, np.float64),
                 np.array(restarted, np.bool_), np.array(numbers, np.float64))
            )  # fmt: skip
        if not parts:
            none = np.zeros(0, np.int64)
            return cls(none, none.astype(float), none.astype(bool), np.zeros((0, layout.NSAMPLE)))
        return cls(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def __len__(self) -> int:
        return len(self.stamps)

    @overload
    def __getitem__(self, k: int) -> Sampled: ...
    @overload
    def __getitem__(self, k: slice) -> Samples: ...
    def __getitem__(self, k: int | slice) -> Sampled | Samples:
        if isinstance(k, slice):
            return Samples(self.stamps[k], self.since[k], self.restarted[k], self.numbers[k])
        return Sampled(
            int(self.stamps[k]), float(self.since[k]), bool(self.restarted[k]), self.numbers[k]
        )

    def every_second(self) -> Samples:
        """The samples with every second left out."""
        since, restarted = self.since[::2].copy(), self.restarted[::2].copy()
        count = len(since) - 1
        since[1:] += self.since[1::2][:count]
        restarted[1:] |= self.restarted[1::2][:count]
        return Samples(self.stamps[::2], since, restarted, self.numbers[::2])


def _taker(
    matcher: SampleMatcher, body: int, kind: str, table: Table
) -> Callable[[int], Matched | None]:
    """What gives the matcher a message of one topic, by its row."""
    frames, stamps = table["header.frame_id"], table.stamp
    if kind == "odom":
        poses = _pose(table, "pose.pose.")
        twists = vectors(table, ("twist.twist.linear", "twist.twist.angular"))
        children = table["child_frame_id"]
        return lambda k: matcher.odometry(
            body,
            int(stamps[k]),
            (str(frames[k]), str(children[k])),
            poses[k].tolist(),
            twists[k].tolist(),
        )
    if kind == "load":
        wrenches = vectors(table, ("wrench.force", "wrench.torque"))
        return lambda k: matcher.load(body, str(frames[k]), wrenches[k].tolist())
    rows = (
        _pose(table, "pose.")
        if kind == "pose"
        else vectors(table, ("twist.linear", "twist.angular"))
    )
    take = matcher.pose if kind == "pose" else matcher.twist
    return lambda k: take(body, int(stamps[k]), str(frames[k]), rows[k].tolist())
