"""Contestants timed in turns, so that a slow moment of the machine meets all of them.

A turn is a block of many repetitions, long enough for the clock. The clock counts this process'
CPU time: what else the machine does then costs cache and frequency, but not the whole time slice.
Ratios are formed within a round, before the median.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Block = Callable[[int], float]
"""Does n repetitions and gives the CPU seconds that they took."""


@dataclass(frozen=True)
class Contestant:
    """Something to be timed: ``block`` for many repetitions."""

    name: str
    block: Block


@dataclass(frozen=True)
class Spread:
    """Median, quartiles and number of the values it was made of."""

    median: float
    low: float
    high: float
    count: int

    @classmethod
    def of(cls, values: Array | Sequence[float]) -> Spread:
        """The spread of some values."""
        low, median, high = np.quantile(np.asarray(values, dtype=float), (0.25, 0.5, 0.75))
        return cls(float(median), float(low), float(high), len(values))


def timed(repeat: Callable[[int], object]) -> Block:
    """A block out of a function that does n repetitions; no garbage collection meanwhile."""

    def block(n: int) -> float:
        collecting = gc.isenabled()
        gc.disable()
        try:
            start = time.process_time()
            repeat(n)
            return time.process_time() - start
        finally:
            if collecting:
                gc.enable()

    return block


def take_turns(contestants: Sequence[Contestant], rounds: int, seconds: float) -> dict[str, Array]:
    """(rounds,) seconds of one repetition for every contestant, by name.

    Every contestant has one turn of about ``seconds`` a round; who begins moves on by one each
    round.
    """
    repetitions = [_enough(contestant.block, seconds) for contestant in contestants]
    found: dict[str, Array] = {contestant.name: np.empty(rounds) for contestant in contestants}
    for k in range(rounds):
        for j in range(len(contestants)):
            at = (j + k) % len(contestants)
            n = repetitions[at]
            found[contestants[at].name][k] = contestants[at].block(n) / n
    return found


def ratio(of: Array, to: Array) -> Spread:
    """How many times longer one took than the other, compared round by round."""
    return Spread.of(of / to)


def _enough(block: Block, seconds: float) -> int:
    """Repetitions that fill a turn, after warming up."""
    n = 1
    block(n)
    while True:
        spent = block(n)
        if spent >= 0.5 * seconds or n >= 1 << 24:
            return max(1, round(n * min(seconds / max(spent, 1e-9), 2.0)))
        n *= 2
