"""A faulty way between a plant and whoever answers it: arrays, stamps and chance, no middleware.

What is published leaves the plant as (stamp, sample); the channel says what arrives, in which
order, and how long an answer takes to act. What befalls the plant itself (a restart, a teleport)
is here too: one place for everything that is not mechanics.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from cylconn_ros.bench.common.timing import Array
from cylconn_ros.core import layout

PAUSE = 50  # samples a paused simulator repeats
JUMP = 0.3  # s by which the clock goes back
TELEPORT = (0.1, 0.02, -0.01)  # m, of B
CORRUPT_EVERY = 25  # samples between two bad fields
BAD = {"NaN": math.nan, "infinity": math.inf}
QUATERNIONS = {"zero quaternion": 0.0, "denormal quaternion": 5e-324}
TWISTS = [*range(7, 13), *range(20, 26)]

Delivery = tuple[int, Array]


@dataclass(frozen=True)
class Faults:
    """What goes wrong between plant and connector.

    Attributes
    ----------
        late: samples between a sample and the action of its wrench.
        jitter: by which share of itself a period is longer or shorter, at most.
        drop, duplicate, reorder: shares of samples that are lost, come twice, or arrive after the
            next one.
        twist: by which share of itself the twist is reported too large.
        pause, jump, restart, teleport: each once, at half time.
        corrupt: NaN, infinity, "zero quaternion" or "denormal quaternion": each field once.
        seed: of what comes by chance.
    """

    late: int = 0
    jitter: float = 0.0
    drop: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    twist: float = 0.0
    pause: bool = False
    jump: bool = False
    restart: bool = False
    teleport: bool = False
    corrupt: str = ""
    seed: int = 7

    @property
    def any(self) -> bool:
        """Whether there is one."""
        return replace(self, seed=NONE.seed) != NONE

    @property
    def by_chance(self) -> bool:
        """Whether another seed would be another run."""
        return max(self.jitter, self.drop, self.reorder) > 0.0

    @property
    def begins_anew(self) -> bool:
        """Whether the bodies are somewhere else at half time than they were going."""
        return self.restart or self.teleport


class Channel:
    """One way with its faults; the same seed does the same again.

    Args:
        fields: which fields of a sample are sent (those of moving bodies).
    """

    def __init__(self, faults: Faults, fields: list[int]) -> None:
        self.faults = faults
        self._chance = np.random.default_rng(faults.seed)
        self._waiting: list[Delivery] = []
        self._acting: deque[Array] = deque([np.zeros(12)] * faults.late)
        self._bad = _bad_fields(faults.corrupt, fields)

    def stretch(self) -> float:
        """What the coming period is multiplied by."""
        return 1.0 + self.faults.jitter * float(self._chance.uniform(-1.0, 1.0))

    def deliver(self, step: int, stamp: int, sample: Array) -> list[Delivery]:
        """What arrives when ``sample`` is sent as the plant's ``step``-th."""
        f, sent = self.faults, sample.copy()
        sent[TWISTS] *= 1.0 + f.twist
        index, rest = divmod(step, CORRUPT_EVERY)
        if self._bad and rest == 0 and 0 < index <= len(self._bad):
            where, value = self._bad[index - 1]
            sent[where] = value
        chance = self._chance.uniform()
        late, self._waiting = self._waiting, []
        if chance < f.drop:
            return late
        if chance < f.reorder:
            self._waiting = [(stamp, sent)]
            return late
        copies = 2 if chance < f.duplicate else 1
        return [(stamp, sent)] * copies + late

    def act(self, wrench: Array) -> Array:
        """(12,) what acts on the bodies now that ``wrench`` is the newest answer."""
        self._acting.append(wrench.copy())
        return self._acting.popleft()


def opening(faults: Faults, samples: int) -> tuple[int, int]:
    """After how many periods the first answer acts, and how many one acts among the first."""
    way, none = Channel(faults, []), np.zeros(layout.NSAMPLE)
    came, newest = [], -1
    for k in range(samples):
        delivered = way.deliver(k, k, none)
        way.stretch()
        if delivered and delivered[0][0] > newest:
            newest = delivered[0][0]
            came.append(k)
    return came[0] + faults.late, int(np.diff(came).max())


def _bad_fields(kind: str, fields: list[int]) -> list[tuple[list[int], float]]:
    """Places and values, one at a time."""
    if kind in BAD:
        return [([field], BAD[kind]) for field in fields]
    if kind in QUATERNIONS:
        starts = [at for at in (layout.A_POSE + 3, layout.B_POSE + 3) if at in fields]
        return [([*range(at, at + 4)], QUATERNIONS[kind]) for at in starts]
    return []


def teleported(state: Array) -> Array:
    """(26,) the same motion, B somewhere else."""
    moved = state.copy()
    moved[layout.B_POSE : layout.B_POSE + 3] += TELEPORT
    return moved


NONE = Faults()
