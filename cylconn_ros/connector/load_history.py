"""External loads by stamp: the load that acts on a sample, and the samples that wait for a load.

The load with the greatest stamp up to the sample's acts on a sample; of two loads with one stamp,
the later one. Loads with later stamps wait for their sample. A load without stamp (zero) acts from
the next sample on.

A simulator that sends a load with each sample may send it after pose and twist. A sample therefore
waits for the load with its stamp if such loads are awaited:

- from the begin of a history, if the load's topic has a publisher,
- after :data:`REGULAR_FROM` consecutive samples whose loads had their stamps.

Samples wait no longer after :data:`MOST_MISSED` consecutive samples without their load, and are
tried again after :data:`PAUSE` consecutive loads with the stamp of their sample. The caller bounds
the time of a wait (:meth:`LoadHistory.give_up`). A load with a newer stamp ends it, too, because
the messages of a topic keep their order.

The state is in two arrays, on which compiled code and Python work with the same functions.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from cylconn_ros.connector.frames import NO_LOAD
from cylconn_ros.connector.synchronized_sample import Counts
from cylconn_ros.core.jit import device_function

REGULAR_FROM: Final = 2
MOST_MISSED: Final = 3
PAUSE: Final = 32
CAPACITY: Final = 1024
"""Loads of a body that can wait: more than a queue of 1000 messages holds."""
EARLY: Final = 1_000_000_000
"""Lead of a load's stamp over the last sample's that calls for a warning, ns."""
NEVER: Final = -(1 << 62)
"""Stamp older than all, ns."""

# Meanings of AWAITED.
NO: Final = 0
IF_REGULAR: Final = 1  # until MOST_MISSED samples had none
ALWAYS: Final = 2  # the caller decides when a wait ends (replay)

# Indices of the int64 array; two numbers each, for A and B.
AXES: Final = 0  # of the load in force: NO_LOAD, IN_WORLD or IN_BODY (connector/frames.py)
AWAITED: Final = 2
NEWEST: Final = 4  # newest stamp received, ns
IN_FORCE: Final = 6  # stamp of the load in force, ns
COUNT: Final = 8  # loads that wait
REGULAR: Final = 10  # consecutive samples with a load of their own stamp
MISSED: Final = 12  # consecutive samples that waited in vain
OWN: Final = 14  # 1: a load with the last sample's stamp has arrived
GIVEN_UP: Final = 16  # stamp up to which samples do not wait, ns (one number)
TOLERANCE: Final = 17  # ns (one number)
_STAMPS: Final = 18  # (2 CAPACITY,) of the loads that wait, in the order of arrival
_AXES: Final = _STAMPS + 2 * CAPACITY  # (2 CAPACITY,)
NSTATE: Final = _AXES + 2 * CAPACITY
_NUMBERS: Final = 12  # the loads in force come first, then (2 CAPACITY, 6) those that wait


@device_function
def is_settled(stamp: int, state: Any) -> bool:
    """Whether the sample at ``stamp`` (ns) needs to wait for no load."""
    if (state[AWAITED] == NO and state[AWAITED + 1] == NO) or stamp <= state[GIVEN_UP]:
        return True
    for body in range(2):
        if state[AWAITED + body] != NO and state[NEWEST + body] < stamp - state[TOLERANCE]:
            return False
    return True


@device_function
def select_loads(stamp: int, numbers: Any, state: Any) -> None:
    """Put the loads for the sample at ``stamp`` (ns) in force; note whether they have its stamp."""
    for body in range(2):
        if state[COUNT + body] != 0:
            _select(body, stamp + state[TOLERANCE], numbers, state)
        own = state[IN_FORCE + body] >= stamp - state[TOLERANCE]
        if state[OWN + body] == 0 and state[REGULAR + body] > 0:
            state[REGULAR + body] = 0
        state[OWN + body] = 0
        if own:
            note_own_load(body, state)
            state[MISSED + body] = 0
        elif state[AWAITED + body] == IF_REGULAR:
            state[MISSED + body] += 1
            if state[MISSED + body] == MOST_MISSED:
                state[AWAITED + body] = NO
                state[MISSED + body] = 0
                state[REGULAR + body] = REGULAR_FROM - PAUSE


@device_function
def note_own_load(body: int, state: Any) -> None:
    """Note that a load with the stamp of its sample has arrived, in time or late."""
    state[OWN + body] = 1
    state[REGULAR + body] += 1
    if state[REGULAR + body] >= REGULAR_FROM and state[AWAITED + body] == NO:
        state[AWAITED + body] = IF_REGULAR


@device_function
def _select(body: int, latest: int, numbers: Any, state: Any) -> None:
    """Put the newest load with a stamp up to ``latest`` in force, and remove those up to it."""
    first, kept = body * CAPACITY, 0
    for k in range(first, first + state[COUNT + body]):
        stamp = state[_STAMPS + k]
        if stamp > latest:
            to = first + kept
            kept += 1
            if to != k:
                state[_STAMPS + to] = stamp
                state[_AXES + to] = state[_AXES + k]
                for j in range(6):
                    numbers[_NUMBERS + 6 * to + j] = numbers[_NUMBERS + 6 * k + j]
        elif stamp >= state[IN_FORCE + body]:
            state[IN_FORCE + body] = stamp
            state[AXES + body] = state[_AXES + k]
            for j in range(6):
                numbers[6 * body + j] = numbers[_NUMBERS + 6 * k + j]
    state[COUNT + body] = kept


class LoadHistory:
    """The loads of a connector's bodies: in force, and waiting for their stamps.

    Attributes
    ----------
        numbers: (12 + 12 CAPACITY,) float64; the first 12 are the loads in force on A and B.
        state: (NSTATE,) int64; the first 2 are the axes of the loads in force.
    """

    def __init__(self, tolerance: int = 0) -> None:
        """``tolerance``: ns by which the stamps of one sample may differ."""
        self.numbers = np.zeros(_NUMBERS + 2 * CAPACITY * 6)
        self.state = np.zeros(NSTATE, np.int64)
        self.state[AXES : AXES + 2] = NO_LOAD
        self.state[TOLERANCE] = tolerance
        self.state[IN_FORCE : IN_FORCE + 2] = NEVER
        self.reset()

    @property
    def silent(self) -> bool:
        """Whether no load has arrived on either body in this history."""
        return bool((self.state[NEWEST : NEWEST + 2] == NEVER).all())

    def reset(self) -> None:
        """Begin a new history: stamps may have any value; the loads stay."""
        state = self.state
        for body in range(2):
            state[NEWEST + body] = max(self._waiting(body), default=NEVER)
            state[IN_FORCE + body] = NEVER
            for at in (AWAITED, REGULAR, MISSED, OWN):
                state[at + body] = 0
        state[GIVEN_UP] = NEVER

    def restart(self, last: int) -> int:
        """Begin a new history, whose stamps are older than ``last`` (ns).

        Loads that wait for a stamp after ``last`` belong to the history before. Returns the number
        of loads of the new history: they were superseded when they arrived.
        """
        awaited = self.state[AWAITED : AWAITED + 2].copy()
        recovered = 0
        for body in range(2):
            in_force = self.state[IN_FORCE + body]
            self._keep(body, [k for k, at in enumerate(self._waiting(body)) if at <= last])
            recovered += sum(bool(at < in_force) for at in self._waiting(body))
        self.reset()
        self.state[AWAITED : AWAITED + 2] = awaited
        return recovered

    def await_loads(self, body: int, awaited: int) -> None:
        """Let samples wait for the loads of a body: IF_REGULAR or ALWAYS; NO changes nothing."""
        if awaited != NO:
            self.state[AWAITED + body] = awaited

    def receive(
        self,
        body: int,
        stamp: int,
        axes: int,
        load: Sequence[float],
        last: int | None,
        counts: Counts,
    ) -> bool:
        """Take a load (6: force, torque) on a body, and count it if it is not in time.

        ``stamp``: ns, 0 for a load that acts from the next sample on. ``axes``: IN_WORLD or
        IN_BODY. ``last``: stamp of the last sample in ns, or None. Returns whether the load
        acts on the last sample, which has been processed without it.
        """
        late = False
        state = self.state
        in_force, tolerance = int(state[IN_FORCE + body]), int(state[TOLERANCE])
        if stamp == 0 and last is None:
            stamp = max([0, *self._waiting(body)])
        elif stamp == 0 and last != 0:
            stamp = last or 0
        elif last is not None:
            late = stamp - last <= tolerance < stamp - in_force
            if late:
                counts.late_loads, counts.load_body = counts.late_loads + 1, body
                if last - stamp <= tolerance:
                    note_own_load(body, state)
            elif stamp < in_force:
                counts.unused_loads, counts.load_body = counts.unused_loads + 1, body
            elif stamp - last > EARLY:
                counts.early_loads, counts.load_body = counts.early_loads + 1, body
                counts.load_lead = stamp - last
        counts.unused_loads += self._add(body, stamp, axes, load)
        return late

    def _add(self, body: int, stamp: int, axes: int, load: Sequence[float]) -> int:
        """Add a load; returns the number of loads dropped for lack of room."""
        waiting, dropped = self._waiting(body), 0
        if len(waiting) == CAPACITY:
            oldest = min(range(CAPACITY), key=lambda k: waiting[k])
            self._keep(body, [k for k in range(CAPACITY) if k != oldest])
            dropped = 1
        state = self.state
        at = body * CAPACITY + int(state[COUNT + body])
        state[_STAMPS + at], state[_AXES + at] = stamp, axes
        self.numbers[_NUMBERS + 6 * at : _NUMBERS + 6 * at + 6] = load
        state[COUNT + body] += 1
        state[NEWEST + body] = max(int(state[NEWEST + body]), stamp)
        return dropped

    def give_up(self, stamp: int) -> None:
        """Let samples up to ``stamp`` (ns) wait no longer."""
        self.state[GIVEN_UP] = max(int(self.state[GIVEN_UP]), stamp)

    def restore_from(self, other: LoadHistory, history: bool) -> None:
        """Adopt the loads of another connector; without ``history``, as after :meth:`reset`."""
        tolerance = self.state[TOLERANCE]
        self.numbers[:], self.state[:] = other.numbers, other.state
        self.state[TOLERANCE] = tolerance
        if not history:
            self.reset()

    def _waiting(self, body: int) -> list[int]:
        """Stamps of the loads that wait, in the order of their arrival."""
        at = _STAMPS + body * CAPACITY
        stamps: list[int] = self.state[at : at + self.state[COUNT + body]].tolist()
        return stamps

    def _keep(self, body: int, which: list[int]) -> None:
        """Keep only some of the loads that wait, by their numbers."""
        at = [body * CAPACITY + k for k in which]
        to = slice(body * CAPACITY, body * CAPACITY + len(at))
        rows = self.numbers[_NUMBERS:].reshape(2 * CAPACITY, 6)
        rows[to] = rows[at]
        for block in (_STAMPS, _AXES):
            own = self.state[block : block + 2 * CAPACITY]
            own[to] = own[at]
        self.state[COUNT + body] = len(which)
