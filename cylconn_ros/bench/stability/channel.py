"""Faulty channel between a plant and a solver: arrays, stamps and random faults, no middleware.

The plant sends (stamp, sample). The channel determines which samples arrive, in which order, and
how late a wrench acts. Faults of the plant itself (restart, teleport) are here too, so that one
module holds everything that is not mechanics.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from cylconn_ros.bench.common.timing import Array
from cylconn_ros.core import layout

PAUSE = 50  # number of times that a paused simulator sends its sample
JUMP = 0.3  # s by which the clock goes back
TELEPORT = (0.1, 0.02, -0.01)  # m, of B
CORRUPT_INTERVAL = 25  # samples between two corrupt fields
BAD = {"NaN": math.nan, "infinity": math.inf}
QUATERNIONS = {"zero quaternion": 0.0, "denormal quaternion": 5e-324}
TWISTS = [*range(7, 13), *range(20, 26)]

Delivery = tuple[int, Array]
"""Stamp in ns and sample (NSAMPLE,)."""


@dataclass(frozen=True)
class Faults:
    """Faults between plant and connector.

    Attributes
    ----------
        late: samples by which a wrench acts after its own sample.
        jitter: greatest relative deviation of a period.
        drop, duplicate, reorder: shares of samples that are lost, arrive twice, or arrive after the
            next one.
        twist: relative error of the reported twist.
        pause, jump, restart, teleport: each once, at half of the duration.
        corrupt: NaN, infinity, "zero quaternion" or "denormal quaternion", in each field once.
        lag: of a free-running plant, samples; negative: in lock step. lag_kind: of
            :class:`cylconn_ros.bench.faults.free_running.Lag`.
        seed: of the random faults.
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
    lag: float = -1.0
    lag_kind: str = "constant"
    seed: int = 7

    @property
    def any(self) -> bool:
        """Whether there is a fault."""
        return replace(self, seed=NONE.seed) != NONE

    @property
    def free_running(self) -> bool:
        """Whether the plant does not wait."""
        return self.lag >= 0.0

    @property
    def is_random(self) -> bool:
        """Whether the run depends on the seed."""
        return max(self.jitter, self.drop, self.reorder) > 0.0

    @property
    def displaces_bodies(self) -> bool:
        """Whether the bodies' state is set at half of the duration."""
        return self.restart or self.teleport


class Channel:
    """A channel with faults; the same seed gives the same faults."""

    def __init__(self, faults: Faults, fields: list[int]) -> None:
        """``fields``: indices of the fields of a sample that are sent (those of moving bodies)."""
        self.faults = faults
        self._random = np.random.default_rng(faults.seed)
        self._delayed: list[Delivery] = []
        self._in_transit: deque[Array] = deque([np.zeros(12)] * faults.late)
        self._corrupt = _corrupt_fields(faults.corrupt, fields)

    def period_factor(self) -> float:
        """Factor of the next period."""
        return 1.0 + self.faults.jitter * float(self._random.uniform(-1.0, 1.0))

    def deliver(self, step: int, stamp: int, sample: Array) -> list[Delivery]:
        """Send the plant's sample number ``step``; return what arrives, in order."""
        f, sent = self.faults, sample.copy()
        sent[TWISTS] *= 1.0 + f.twist
        index, rest = divmod(step, CORRUPT_INTERVAL)
        if self._corrupt and rest == 0 and 0 < index <= len(self._corrupt):
            corrupt, value = self._corrupt[index - 1]
            sent[corrupt] = value
        u = self._random.uniform()
        delayed, self._delayed = self._delayed, []
        if u < f.drop:
            return delayed
        if u < f.reorder:
            self._delayed = [(stamp, sent)]
            return delayed
        copies = 2 if u < f.duplicate else 1
        return [(stamp, sent)] * copies + delayed

    def act(self, wrench: Array) -> Array:
        """(12,) wrenches that act on the bodies now, given the newest ones computed."""
        self._in_transit.append(wrench.copy())
        return self._in_transit.popleft()


def first_response(faults: Faults, samples: int) -> tuple[int, int]:
    """Periods until the first wrench acts, and the most for which one acts among the first.

    ``samples``: number of samples considered.
    """
    channel, none = Channel(faults, []), np.zeros(layout.NSAMPLE)
    arrivals, newest = [], -1
    for k in range(samples):
        delivered = channel.deliver(k, k, none)
        channel.period_factor()
        if delivered and delivered[0][0] > newest:
            newest = delivered[0][0]
            arrivals.append(k)
    return arrivals[0] + faults.late, int(np.diff(arrivals).max())


def _corrupt_fields(kind: str, fields: list[int]) -> list[tuple[list[int], float]]:
    """Indices of the fields that are corrupted together, and their value."""
    if kind in BAD:
        return [([field], BAD[kind]) for field in fields]
    if kind in QUATERNIONS:
        starts = [at for at in (layout.A_POSE + 3, layout.B_POSE + 3) if at in fields]
        return [([*range(at, at + 4)], QUATERNIONS[kind]) for at in starts]
    return []


def teleport(state: Array) -> Array:
    """(26,) the state with body B displaced."""
    moved = state.copy()
    moved[layout.B_POSE : layout.B_POSE + 3] += TELEPORT
    return moved


NONE = Faults()
