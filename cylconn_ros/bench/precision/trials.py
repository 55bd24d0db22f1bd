"""Work and precision: what a whole motion costs and how far off it is, set-up by set-up."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cylconn_ros.bench.common.results import Findings, Measurement, Setting
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Array, Contestant, Spread, take_turns, timed

ERROR, COST = "error", "CPU time per simulated second"
Errors = dict[str, tuple[float, str]]
"""Size of each quantity's error, with its unit; NaN where there is none to be had."""


@dataclass(frozen=True)
class Trial:
    """One set-up of a contestant: ``solve`` the problem; ``errors`` of the last solution."""

    contestant: str
    settings: dict[str, Setting]
    solve: Callable[[], object]
    errors: Callable[[], Errors]

    @property
    def name(self) -> str:
        """Contestant and settings, unique in a problem."""
        return f"{self.contestant} {self.settings}"

    def timed(self) -> Contestant:
        """The trial as something to be timed."""

        def repeat(n: int) -> None:
            for _ in range(n):
                self.solve()

        return Contestant(self.name, timed(repeat))


def errors(trials: Sequence[Trial]) -> dict[str, Errors]:
    """The errors of every trial, by its name."""
    found = {}
    for trial in trials:
        trial.solve()
        found[trial.name] = trial.errors()
    return found


def times(trials: Sequence[Trial], settings: Settings) -> dict[str, Array]:
    """(rounds,) CPU seconds of every trial, in turns."""
    return take_turns([trial.timed() for trial in trials], settings.rounds, settings.block)


def measured(
    problem: str,
    trials: Sequence[Trial],
    sizes: dict[str, Errors],
    seconds: dict[str, Array],
    duration: float,
) -> Findings:
    """Errors and costs of all trials as measurements; ``duration`` simulated seconds each."""
    found = Findings()
    for trial in trials:
        for quantity, (error, unit) in sizes[trial.name].items():
            found.measurements.append(
                Measurement(
                    problem, trial.contestant, quantity, error, unit, settings=trial.settings
                )
            )
        found.measurements.append(
            Measurement.of(
                problem, trial.contestant, COST, Spread.of(seconds[trial.name]), "ms",
                scale=1e3 / duration, settings=trial.settings,
            )
        )  # fmt: skip
    return found


def worst_at_equal_time(
    ours: Sequence[tuple[float, float]], theirs: Sequence[tuple[float, float]]
) -> float:
    """Largest ratio of our error to theirs at the same cost; NaN where costs do not overlap.

    Points are (cost, error); between theirs, the logarithms are interpolated.
    """
    if not ours or len(theirs) < 2:
        return math.nan
    cost, error = np.log(np.array(sorted(theirs))).T
    worst = math.nan
    for c, e in ours:
        if cost[0] <= math.log(c) <= cost[-1]:
            there = math.exp(float(np.interp(math.log(c), cost, error)))
            worst = max(e / there, worst) if not math.isnan(worst) else e / there
    return worst
