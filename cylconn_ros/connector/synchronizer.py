"""Samples from messages: poses, twists and loads that arrive one by one, matched by stamp.

A sample is complete when the pose and the twist of every moving body carry the same stamp. Complete
samples come out in ascending order of stamps; what cannot be used is counted, never just dropped.

Stamps that go back are of two kinds. A message overtaken on its way is *late*, and too late: time
has moved on. A simulation started anew is a *restart*, and a new history begins. A complete sample
older than the last is taken for a restart when it is older by more than :data:`REORDERING` periods,
farther than messages overtake each other, or when the source insists: :data:`INSISTENCE` complete
old samples (or the same one again and again) with none newer in between.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cylconn_ros.connector.frames import IN_BODY, IN_WORLD, NO_LOAD, into_world
from cylconn_ros.core import layout
from cylconn_ros.scene.scene import Scene

REORDERING = 10
INSISTENCE = 3
_MAX_PENDING = 64  # samples under construction: more than a queue of 50 messages can hold
_MAX_OLD = 8

STREAMS = ("body_a/pose", "body_a/twist", "body_b/pose", "body_b/twist")
PLACES = (
    slice(layout.A_POSE, layout.A_POSE + 7),
    slice(layout.A_TWIST, layout.A_TWIST + 6),
    slice(layout.B_POSE, layout.B_POSE + 7),
    slice(layout.B_TWIST, layout.B_TWIST + 6),
)
_LOADS = (slice(layout.A_LOAD, layout.A_LOAD + 6), slice(layout.B_LOAD, layout.B_LOAD + 6))
_POSE, _TWIST = 0, 1  # streams of a body: 2 body + one of these

Vector = Sequence[float]


class Matched(NamedTuple):
    """A complete sample; its numbers are in :attr:`SampleMatcher.sample`."""

    stamp: int  # ns
    h: float  # s since the sample before; 0 for the first of a history
    repeated: bool  # the last sample came again: nothing is to be computed
    restarted: bool  # stamps went back: a new history begins


@dataclasses.dataclass
class Counts:
    """What became of the messages."""

    samples: int = 0  # complete samples, each stamp once
    answered_again: int = 0  # complete samples that repeat the last stamp
    repeated: int = 0  # messages already received for the last sample or one under construction
    late: int = 0  # messages older than the last complete sample
    incomplete: int = 0  # samples given up: a newer one was complete, or too many waited
    restarts: int = 0  # times the stamps went back to a new history
    foreign_frames: int = 0  # messages whose frame_id names no frame of the scene


class _Slot:
    """A sample under construction."""

    __slots__ = ("newest", "pieces", "seen", "stamp")

    def __init__(self, stamp: int) -> None:
        self.stamp = stamp
        self.newest = stamp  # of its pieces
        self.seen = 0  # one bit a stream
        self.pieces: list[tuple[Vector, bool]] = [((), True)] * 4


class SampleMatcher:
    """Match messages into samples; one per connector, bounded in memory.

    Each message gives ``None``, or a :class:`Matched` when it completes a sample. With a stamp
    tolerance the sample's stamp is the newest of its messages'.

    Attributes
    ----------
    sample
        (38,) float64, the numbers of the last complete sample (core/layout.py), a fixed body's from
        the scene.
    counts
        What became of the messages.
    received
        Messages received, by stream.
    load_numbers, load_axes
        (12,), (2,) the loads in force of A and B, and NO_LOAD, IN_WORLD or IN_BODY for each.
    """

    def __init__(self, scene: Scene) -> None:
        self.sample = np.zeros(layout.NSAMPLE)
        self.counts = Counts()
        self.received = dict.fromkeys(STREAMS, 0)
        self._tolerance = round(scene.stamp_tolerance * 1e9)
        self._period = round(scene.period * 1e9)
        self._world = scene.world_frame
        self._frames = tuple(body.frame for body in scene.bodies)
        self._world_by_default = scene.twist_axes == "world"
        self._needed = 0
        for index, body in enumerate(scene.bodies):
            if body.kind == "fixed":
                self.sample[PLACES[2 * index + _POSE]] = body.pose
            else:
                self._needed |= 0b11 << 2 * index
        self._names = [STREAMS[stream] for stream in self.needed]
        self.load_numbers = np.zeros(2 * 6)
        self.load_axes = np.full(2, NO_LOAD)
        self._pending: dict[int, _Slot] = {}
        self._old: dict[int, _Slot] = {}
        self.forget()

    def forget(self) -> None:
        """Forget stamps and samples under construction; loads and counts stay."""
        self._give_up_pending()
        self._last: int | None = None
        self._step = 0
        self._again = 0  # bits of the last sample's streams that came again
        self._insisted = 0
        self._old.clear()

    def take_over(self, other: SampleMatcher, history: bool) -> None:
        """Go on with another matcher's counts and loads; with ``history``, also after its stamp."""
        self.counts, self.received = other.counts, other.received
        self.load_numbers[:], self.load_axes[:] = other.load_numbers, other.load_axes
        if history:
            self._last, self._step = other._last, other._step

    @property
    def last_stamp(self) -> int | None:
        """Stamp of the last complete sample in ns, or None."""
        return self._last

    @property
    def needed(self) -> tuple[int, ...]:
        """Numbers of the streams that a sample needs, in :data:`STREAMS`."""
        return tuple(k for k in range(len(STREAMS)) if self._needed >> k & 1)

    @property
    def waiting(self) -> bool:
        """Whether samples are under construction, or may be made of several stamps."""
        return bool(self._pending or self._tolerance)

    @property
    def missing(self) -> tuple[str, ...]:
        """Streams that a sample needs and that have brought nothing so far."""
        needed = (name for bit, name in enumerate(STREAMS) if self._needed >> bit & 1)
        return tuple(name for name in needed if not self.received[name])

    @property
    def apart(self) -> int | None:
        """Ns by which the stamps of one sample differ at least, as far as the waiting ones say.

        None where a stream has brought nothing that waits.
        """
        stamps = [
            [slot.stamp for slot in self._pending.values() if slot.seen >> bit & 1]
            for bit in range(len(STREAMS))
            if self._needed >> bit & 1
        ]
        if not stamps or not all(stamps):
            return None
        first, *others = stamps
        return min(max(min(abs(s - t) for t in other) for other in others) for s in first)

    def is_new(self, stamp: int) -> bool:
        """Whether a stamp is newer than the last complete sample's."""
        return self._last is None or stamp > self._last

    def straight(self, stamp: int) -> Matched:
        """Take a sample all of whose messages came together, at a stamp that :meth:`is_new`.

        The caller writes its numbers, world axes, to :attr:`sample` at :data:`PLACES` and then
        calls :meth:`fill_loads`. Not to be used while others are :attr:`waiting`.
        """
        for name in self._names:
            self.received[name] += 1
        return self._begin(stamp, self._last)

    @property
    def loads(self) -> tuple[tuple[Vector, bool] | None, ...]:
        """For each body the load in force and whether it is in world axes, or None."""
        return tuple(
            None if axes == NO_LOAD else (numbers, axes == IN_WORLD)
            for numbers, axes in zip(
                self.load_numbers.reshape(2, 6).tolist(), self.load_axes.tolist(), strict=True
            )
        )

    def went_on(self, stamp: int, before: int | None, samples: int) -> None:
        """Count ``samples`` that were matched elsewhere, as :meth:`straight` would have.

        ``stamp`` and ``before``: of the last of them, and of the one before it, if any.
        """
        for name in self._names:
            self.received[name] += samples
        self._begin(stamp, before)
        self.counts.samples += samples - 1

    def pose(self, body: int, stamp: int, frame: str, pose: Vector) -> Matched | None:
        """Take the pose (7: position, quaternion) of body A (0) or B (1) in the world."""
        if frame and frame != self._world:
            self.counts.foreign_frames += 1
        return self._add(2 * body + _POSE, stamp, pose, True)

    def twist(self, body: int, stamp: int, frame: str, twist: Vector) -> Matched | None:
        """Take the twist (6: velocity of the frame's origin, angular velocity) of a body.

        ``frame`` says in which axes it is: the world frame's name, the body frame's, or neither.
        """
        return self._add(2 * body + _TWIST, stamp, twist, self._in_world(body, frame))

    def odometry(
        self, body: int, stamp: int, frames: tuple[str, str], pose: Vector, twist: Vector
    ) -> Matched | None:
        """Take pose and twist in one; ``frames`` are its header's and its child frame.

        The twist is in the child frame: the body's axes, unless it names the world frame.
        """
        frame, child = frames
        first = self.pose(body, stamp, frame, pose)
        if child not in (self._world, self._frames[body], ""):
            self.counts.foreign_frames += 1
        second = self._add(2 * body + _TWIST, stamp, twist, child == self._world)
        return second or first

    def load(self, body: int, frame: str, load: Vector) -> None:
        """Take a body's external load (6: force, torque about the frame's origin).

        It is held until the next, in the axes ``frame`` names (rule as for a twist).
        """
        self.load_numbers[6 * body : 6 * body + 6] = load
        self.load_axes[body] = IN_WORLD if self._in_world(body, frame) else IN_BODY

    def _in_world(self, body: int, frame: str) -> bool:
        if frame == self._world:
            return True
        if frame == self._frames[body]:
            return False
        if frame:
            self.counts.foreign_frames += 1
        return self._world_by_default

    def _add(self, stream: int, stamp: int, values: Vector, in_world: bool) -> Matched | None:
        self.received[STREAMS[stream]] += 1
        bit = 1 << stream
        if not self._needed & bit:
            return None
        last = self._last
        if last is not None and stamp <= last + self._tolerance:
            if stamp >= last - self._tolerance:
                return self._repeat(bit)
            self.counts.late += 1
            slot = self._slot(self._old, stamp)
        else:
            slot = self._slot(self._pending, stamp)
        if slot.seen & bit:
            self.counts.repeated += slot.stamp in self._pending  # old ones count as late already
            return None
        slot.seen |= bit
        slot.newest = max(slot.newest, stamp)
        slot.pieces[stream] = (values, in_world)
        if slot.seen != self._needed:
            return None
        if last is not None and slot.newest < last:
            return self._older(slot, last)
        return self._emit(slot, last)

    def _slot(self, slots: dict[int, _Slot], stamp: int) -> _Slot:
        slot = slots.get(stamp)
        if slot is not None:
            return slot
        if self._tolerance:
            near = [s for s in slots.values() if abs(s.stamp - stamp) <= self._tolerance]
            if near:
                return min(near, key=lambda s: abs(s.stamp - stamp))
        limit = _MAX_OLD if slots is self._old else _MAX_PENDING
        if len(slots) >= limit:
            del slots[min(slots)]
            if slots is self._pending:
                self.counts.incomplete += 1
        slot = slots[stamp] = _Slot(stamp)
        return slot

    def _repeat(self, bit: int) -> Matched | None:
        """Count a message of the last sample; answer once all of them have come again."""
        self.counts.repeated += 1
        self._again |= bit
        if self._again != self._needed:
            return None
        self._again = 0
        self.counts.answered_again += 1
        assert self._last is not None
        return Matched(self._last, 0.0, repeated=True, restarted=False)

    def _older(self, slot: _Slot, last: int) -> Matched | None:
        """Decide whether a complete sample older than the last is late or a restart."""
        del self._old[slot.stamp]
        self._insisted += 1
        reach = REORDERING * (self._period or self._step)
        if last - slot.newest <= reach and self._insisted < INSISTENCE:
            return None
        self.counts.restarts += 1
        self.counts.late -= self._needed.bit_count()
        self._give_up_pending()
        return self._emit(slot, None)._replace(restarted=True)

    def _give_up_pending(self) -> None:
        self.counts.incomplete += len(self._pending)
        self._pending.clear()

    def _emit(self, slot: _Slot, last: int | None) -> Matched:
        stamp = slot.newest
        self._pending.pop(slot.stamp, None)
        overtaken = [older for older in self._pending if older < stamp]
        for older in overtaken:
            del self._pending[older]
        self.counts.incomplete += len(overtaken)
        self._fill(slot)
        return self._begin(stamp, last)

    def _begin(self, stamp: int, last: int | None) -> Matched:
        if self._old:
            self._old.clear()
        self._again = self._insisted = 0
        self._step = 0 if last is None else stamp - last
        self._last = stamp
        self.counts.samples += 1
        return Matched(stamp, self._step * 1e-9, False, False)

    def _fill(self, slot: _Slot) -> None:
        """Write the sample's numbers; what is in body axes is turned into the world's."""
        for body in (0, 1):
            if self._needed >> 2 * body & 1:
                pose, _ = slot.pieces[2 * body + _POSE]
                twist, in_world = slot.pieces[2 * body + _TWIST]
                self.sample[PLACES[2 * body + _POSE]] = pose
                self.sample[PLACES[2 * body + _TWIST]] = (
                    twist if in_world else into_world(pose, twist)
                )
        self.fill_loads()

    def fill_loads(self) -> None:
        """Write the loads in force to the sample; those in body axes turn with its poses."""
        if not self.load_axes.any():
            return
        for body, load in enumerate(self.loads):
            if load is not None:
                pose = self.sample[PLACES[2 * body + _POSE]].tolist()
                self.sample[_LOADS[body]] = load[0] if load[1] else into_world(pose, load[0])
