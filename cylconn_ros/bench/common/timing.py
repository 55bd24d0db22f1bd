"""The timing harness: measure solvers or processes in turns, so that all see the same conditions.

A machine's speed drifts. Interleaved turns spread that drift evenly over the compared solvers. A
turn repeats the timed function until it is long enough for the clock. The clock counts the CPU time
of this process: other processes cost it cache and frequency, but no time slice. Ratios are formed
within a round, before the median.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Key = TypeVar("Key")
Result = TypeVar("Result")
Block = Callable[[int], float]
"""Runs n repetitions and returns their CPU time, s."""


@dataclass(frozen=True)
class Spread:
    """Median, quartiles and number of some values."""

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
    """A block from a function that runs n repetitions; garbage collection is off while it runs."""

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


def run_interleaved(
    turns: Mapping[Key, Callable[[], Result]], rounds: int
) -> dict[Key, list[Result]]:
    """Results of ``rounds`` calls of each function, in order, by key.

    Each round calls every function once. The first one of a round moves on from round to round, so
    that no function always follows the same one.
    """
    keys = list(turns)
    shift = max(len(keys) // rounds, 1) if rounds else 0
    found: dict[Key, list[Result]] = {key: [] for key in keys}
    for k in range(rounds):
        for j in range(len(keys)):
            key = keys[(j + k * shift) % len(keys)]
            found[key].append(turns[key]())
    return found


def time_interleaved(blocks: Mapping[str, Block], rounds: int, seconds: float) -> dict[str, Array]:
    """(rounds,) CPU time (s) of one repetition of each block, by name.

    Each block has one turn of about ``seconds`` per round, after a warm-up.
    """
    turns = {
        name: partial(_turn, block, _repetitions(block, seconds)) for name, block in blocks.items()
    }
    return {name: np.array(values) for name, values in run_interleaved(turns, rounds).items()}


def ratio(numerator: Array, denominator: Array) -> Spread:
    """Spread of the ratio of two timings, formed within each round."""
    return Spread.of(numerator / denominator)


def _turn(block: Block, n: int) -> float:
    return block(n) / n


def _repetitions(block: Block, seconds: float) -> int:
    """Repetitions that fill a turn; warms up."""
    n = 1
    block(n)
    while True:
        spent = block(n)
        if spent >= 0.5 * seconds or n >= 1 << 24:
            return max(1, round(n * min(seconds / max(spent, 1e-9), 2.0)))
        n *= 2
