"""Exact-time synchronisation: poses, twists and loads of single messages to complete samples.

A sample is complete when the pose and the twist of every moving body carry the same stamp. Complete
samples have ascending stamps. Every message that does not become part of a sample is counted.

A stamp that goes back has one of two causes. A message overtaken on the transport is *late*: a
newer sample is complete already, and the message is not used. A simulation that starts again is a
*restart*: a new history begins. A complete sample older than the last one counts as a restart in
two cases: it is older by more than :data:`REORDERING` periods, farther than messages overtake each
other; or :data:`MIN_OLD_SAMPLES` complete old samples (also the same one repeatedly) arrive with no
newer sample between them.

A sample takes the loads for its stamp, and waits for one that is awaited
(connector/load_history.py), until :data:`MOST_WAITING` newer samples are complete or the caller
gives up.

The reference path for messages ends here; messages/prefix_decoder.py writes complete samples faster
and calls :meth:`SampleMatcher.accept`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cylconn_ros.connector.frames import IN_BODY, IN_WORLD, frame_name, into_world, write_load
from cylconn_ros.connector.load_history import NO, LoadHistory, is_settled, select_loads
from cylconn_ros.connector.synchronized_sample import Counts, SynchronizedSample, UnknownFrame
from cylconn_ros.core import layout
from cylconn_ros.scene.inputs import BODIES
from cylconn_ros.scene.scene import Scene

REORDERING = 10  # periods
MIN_OLD_SAMPLES = 3
MOST_WAITING = 2
"""Samples that wait for loads at the same time."""
_MAX_PENDING = 1024  # incomplete samples: more than a queue of 1000 messages can hold
_MAX_OLD = 8  # incomplete samples older than the last complete one

QUANTITIES = tuple(f"{body}/{quantity}" for body in BODIES for quantity in ("pose", "twist"))
"""The quantities of a sample; bit k of a set of quantities stands for QUANTITIES[k]."""
_POSE, _TWIST = 0, 1  # the quantity of a body is 2 body + one of these
_AT = (
    slice(layout.A_POSE, layout.A_POSE + 7),
    slice(layout.A_TWIST, layout.A_TWIST + 6),
    slice(layout.B_POSE, layout.B_POSE + 7),
    slice(layout.B_TWIST, layout.B_TWIST + 6),
)

Vector = Sequence[float]


class _Slot:
    """An incomplete sample."""

    __slots__ = ("newest", "pieces", "received", "stamp")

    def __init__(self, stamp: int) -> None:
        self.stamp = stamp
        self.newest = stamp  # of its messages
        self.received = 0  # bits of the quantities
        self.pieces: list[tuple[Vector, bool]] = [((), True)] * 4


class SampleMatcher:
    """Synchronise messages to samples; one per connector, bounded in memory.

    Each method that takes a message returns ``None``, or a :class:`SynchronizedSample` if the
    message completes one. With a stamp tolerance the sample has the newest stamp of its messages.

    Attributes
    ----------
    sample
        (NSAMPLE,) float64, the numbers of the last complete sample (core/layout.py); the pose of a
        fixed body is that of the scene.
    counts
        Counters of samples and of unused messages.
    received
        Number of messages received, by quantity.
    needed
        Bits of the quantities that a sample needs: those of the moving bodies.
    loads
        The loads in force and those that wait for their stamps.
    expects
        Function of a body and the stamp (ns) of the first sample of a history: NO, IF_REGULAR or
        ALWAYS, whether loads are awaited from that sample on (connector/load_history.py).
    unknown_frame
        The last frame_id that is no frame of the scene, or None.
    late_load
        (6,) the load received last, world axes, if the last sample was processed without it.
    """

    def __init__(self, scene: Scene) -> None:
        self.sample = np.zeros(layout.NSAMPLE)
        self.counts = Counts()
        self.received = dict.fromkeys(QUANTITIES, 0)
        self._tolerance = round(scene.stamp_tolerance * 1e9)
        self._period = round(scene.period * 1e9)
        self._world = frame_name(scene.world_frame)
        self._frames = tuple(frame_name(body.frame) for body in scene.bodies)
        self._world_by_default = scene.twist_axes == "world"
        self.needed = 0
        for index, body in enumerate(scene.bodies):
            if body.kind == "fixed":
                self.sample[_AT[2 * index + _POSE]] = body.pose
            else:
                self.needed |= 0b11 << 2 * index
        self._names = [name for bit, name in enumerate(QUANTITIES) if self.needed >> bit & 1]
        self.loads = LoadHistory(self._tolerance)
        self.expects: Callable[[int, int], int] = lambda *_: NO
        self.unknown_frame: UnknownFrame | None = None
        self.late_load: Vector | None = None
        self._pending: dict[int, _Slot] = {}
        self._ready = 0  # samples in ``_pending`` that lack nothing but a load
        self._old: dict[int, _Slot] = {}
        self.reset()

    def reset(self) -> None:
        """Forget stamps and incomplete samples; loads and counts stay."""
        self._drop_pending()
        self._restarting = False  # the next sample begins a new history because stamps went back
        self._last: int | None = None
        self._step = 0
        self._asked = False  # whether the loads of the first sample are awaited
        self._duplicates = 0  # bits of the quantities received once more for the last sample
        self._old_samples = 0  # complete old samples since the last newer one
        self._old.clear()
        self.loads.reset()

    def restore_from(self, other: SampleMatcher, history: bool) -> None:
        """Adopt another matcher's counts and loads; with ``history``, also its last stamp."""
        self.counts, self.received = other.counts, other.received
        self.unknown_frame = other.unknown_frame
        self.loads.restore_from(other.loads, history)
        self.expects = other.expects
        if history:
            self._last, self._step = other._last, other._step
            if (self.needed, self._tolerance) == (other.needed, other._tolerance):
                self._pending, self._ready = other._pending, other._ready
                self._asked, self._restarting = other._asked, other._restarting

    @property
    def last_stamp(self) -> int | None:
        """Stamp of the last complete sample in ns, or None."""
        return self._last

    @property
    def has_pending(self) -> bool:
        """Whether samples are incomplete, or may consist of messages with different stamps."""
        return bool(self._pending or self._tolerance)

    @property
    def is_partial(self) -> bool:
        """Whether messages of a sample that is not complete are received."""
        return bool(self._pending)

    @property
    def is_overtaken(self) -> bool:
        """Whether messages of a newer sample than :attr:`waiting` are received."""
        return any(slot.newest > (self.waiting or 0) for slot in self._pending.values())

    @property
    def waiting(self) -> int | None:
        """Stamp in ns of the oldest sample that lacks nothing but a load, or None."""
        return self._oldest.newest if self._ready else None

    @property
    def _oldest(self) -> _Slot:
        """The oldest sample that lacks nothing but a load; there must be one."""
        ready = (slot for slot in self._pending.values() if slot.received == self.needed)
        return min(ready, key=lambda slot: slot.newest)

    @property
    def missing(self) -> tuple[str, ...]:
        """Quantities that a sample needs and of which no message was received so far."""
        return tuple(name for name in self._names if not self.received[name])

    @property
    def stamp_offset(self) -> int | None:
        """Least difference in ns between the stamps of one incomplete sample; None if unknown."""
        stamps = [
            [slot.stamp for slot in self._pending.values() if slot.received >> bit & 1]
            for bit in range(len(QUANTITIES))
            if self.needed >> bit & 1
        ]
        if not stamps or not all(stamps):
            return None
        first, *others = stamps
        return min(max(min(abs(s - t) for t in other) for other in others) for s in first)

    def accept(self, stamp: int) -> SynchronizedSample:
        """Count a complete sample whose numbers the caller writes to :attr:`sample`, world axes.

        ``stamp`` must be newer than the last, and no sample incomplete (:attr:`has_pending`).
        """
        for name in self._names:
            self.received[name] += 1
        return self._begin(stamp, self._last)

    def advance(self, stamp: int, before: int | None, samples: int) -> None:
        """Count ``samples`` complete samples, as that many calls of :meth:`accept` do.

        ``stamp`` and ``before``: of the last of them, and of the one before it, if any.
        """
        for name in self._names:
            self.received[name] += samples
        self._begin(stamp, before)
        self.counts.samples += samples - 1

    def pose(self, body: int, stamp: int, frame: str, pose: Vector) -> SynchronizedSample | None:
        """Process the pose (7: position, quaternion xyzw) of body A (0) or B (1) in the world."""
        if frame_name(frame) not in ("", self._world):
            self._count_unknown_frame(body, "pose", frame, "world")
        return self._add(2 * body + _POSE, stamp, pose, True)

    def twist(self, body: int, stamp: int, frame: str, twist: Vector) -> SynchronizedSample | None:
        """Process the twist (6: velocity of the frame's origin, angular velocity) of a body.

        ``frame`` states its axes: the world frame's name or the body frame's. With any other name
        the axes are those of the parameter ``twist_axes``.
        """
        return self._add(2 * body + _TWIST, stamp, twist, self._in_world(body, "twist", frame))

    def motion(
        self, body: int, stamp: int, frames: tuple[str, str | None], pose: Vector, twist: Vector
    ) -> SynchronizedSample | None:
        """Process a message of any input type; a quantity that it does not carry is empty.

        ``frames``: of its header, and its child frame or None. With a child frame the twist is in
        body axes, unless the child frame is the world frame.
        """
        frame, child = frames
        first = self.pose(body, stamp, frame, pose) if len(pose) else None
        if not len(twist):
            return first
        if child is None:
            return self.twist(body, stamp, frame, twist) or first
        child_name = frame_name(child)
        if child_name not in (self._world, self._frames[body], ""):
            self._count_unknown_frame(body, "twist", child, "body")
        second = self._add(2 * body + _TWIST, stamp, twist, child_name == self._world)
        return second or first

    def load(self, body: int, stamp: int, frame: str, load: Vector) -> SynchronizedSample | None:
        """Process an external load on a body (6: force, torque about the frame's origin).

        It acts from the sample with its stamp on until the next load; with stamp 0 from the next
        sample on. ``frame`` states its axes, as for :meth:`twist`.
        """
        world = self._in_world(body, "load", frame)
        axes = IN_WORLD if world else IN_BODY
        late = self.loads.receive(body, stamp, axes, load, self._last, self.counts)
        if late and not world:
            load = into_world(self.sample[_AT[2 * body + _POSE]].tolist(), load)
        self.late_load = load if late else None
        return self.next()

    def next(self) -> SynchronizedSample | None:
        """Complete the oldest sample that waits for no load; None if there is none."""
        if not self._ready:
            return None
        slot = self._oldest
        if self._last is None and not self._asked:
            self._asked = True
            for body in (0, 1):
                if self.needed >> 2 * body & 1:
                    self.loads.await_loads(body, self.expects(body, slot.newest))
        if self._ready <= MOST_WAITING and not is_settled(slot.newest, self.loads.state):
            return None
        return self._complete(slot, self._last)

    def _in_world(self, body: int, quantity: str, frame: str) -> bool:
        name = frame_name(frame)
        if name == self._world:
            return True
        if name == self._frames[body]:
            return False
        if name:
            axes = "world" if self._world_by_default else "body"
            self._count_unknown_frame(body, quantity, frame, axes)
        return self._world_by_default

    def _count_unknown_frame(self, body: int, quantity: str, frame: str, axes: str) -> None:
        self.counts.unknown_frames += 1
        self.unknown_frame = UnknownFrame(body, quantity, frame, axes)

    def _add(
        self, quantity: int, stamp: int, values: Vector, in_world: bool
    ) -> SynchronizedSample | None:
        self.received[QUANTITIES[quantity]] += 1
        bit = 1 << quantity
        if not self.needed & bit:
            return None
        last = self._last
        if last is not None and stamp <= last + self._tolerance:
            if stamp >= last - self._tolerance:
                return self._add_duplicate(bit)
            self.counts.late += 1
            slot = self._slot(self._old, stamp)
        else:
            slot = self._slot(self._pending, stamp)
        if slot.received & bit:
            # An old message is already counted as late.
            self.counts.duplicate_messages += slot.stamp in self._pending
            return None
        slot.received |= bit
        slot.newest = max(slot.newest, stamp)
        slot.pieces[quantity] = (values, in_world)
        if slot.received != self.needed:
            return None
        if last is not None and slot.newest < last:
            return self._complete_old(slot, last)
        self._ready += 1
        return self.next()

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
            removed = slots.pop(min(slots))
            if slots is self._pending:
                self.counts.incomplete += 1
                self._ready -= removed.received == self.needed
        slot = slots[stamp] = _Slot(stamp)
        return slot

    def _add_duplicate(self, bit: int) -> SynchronizedSample | None:
        """Count a message with the last sample's stamp; the last of them repeats the sample."""
        self.counts.duplicate_messages += 1
        self._duplicates |= bit
        if self._duplicates != self.needed:
            return None
        self._duplicates = 0
        self.counts.duplicate_samples += 1
        assert self._last is not None
        return SynchronizedSample(self._last, 0.0, repeated=True, restarted=False)

    def _complete_old(self, slot: _Slot, last: int) -> SynchronizedSample | None:
        """Decide whether a complete sample older than the last is late or a restart."""
        del self._old[slot.stamp]
        self._old_samples += 1
        reach = REORDERING * (self._period or self._step)
        if last - slot.newest <= reach and self._old_samples < MIN_OLD_SAMPLES:
            return None
        self.counts.restarts += 1
        self.counts.late -= self.needed.bit_count()
        self._drop_pending()
        self.counts.unused_loads -= self.loads.restart(last)
        self._restarting, self._asked, self._last = True, False, None
        self._pending[slot.stamp] = slot
        self._ready = 1
        return self.next()

    def _drop_pending(self) -> None:
        self.counts.incomplete += len(self._pending)
        self._pending.clear()
        self._ready = 0

    def _complete(self, slot: _Slot, last: int | None) -> SynchronizedSample:
        stamp = slot.newest
        del self._pending[slot.stamp]
        self._ready -= 1
        overtaken = [older for older in self._pending if older < stamp]
        for older in overtaken:
            del self._pending[older]
        self.counts.incomplete += len(overtaken)
        self._write(slot)
        restarted, self._restarting = self._restarting, False
        return self._begin(stamp, last)._replace(restarted=restarted)

    def _begin(self, stamp: int, last: int | None) -> SynchronizedSample:
        if self._old:
            self._old.clear()
        self._duplicates = self._old_samples = 0
        self._step = 0 if last is None else stamp - last
        self._last = stamp
        self.counts.samples += 1
        return SynchronizedSample(stamp, self._step * 1e-9, False, False)

    def _write(self, slot: _Slot) -> None:
        """Write the numbers of a sample to :attr:`sample`, twists and loads in world axes."""
        for body in (0, 1):
            if self.needed >> 2 * body & 1:
                pose, _ = slot.pieces[2 * body + _POSE]
                twist, in_world = slot.pieces[2 * body + _TWIST]
                self.sample[_AT[2 * body + _POSE]] = pose
                self.sample[_AT[2 * body + _TWIST]] = twist if in_world else into_world(pose, twist)
        # Python numbers are faster than elements of an array.
        numbers, state, sample = self.loads.numbers.data, self.loads.state.data, self.sample.data
        select_loads(slot.newest, numbers, state)
        for body in (0, 1):
            write_load(body, numbers, state, sample)
