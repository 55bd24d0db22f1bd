"""Trials: one solver with one step or tolerance on one case; their errors and CPU times."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cylconn_ros.bench.common.results import Errors, Measurement, NotMeasured, Setting
from cylconn_ros.bench.common.timing import Spread, run_interleaved
from cylconn_ros.bench.peers.isolated import SolverProcess
from cylconn_ros.bench.peers.solver import Solver
from cylconn_ros.bench.precision import cases
from cylconn_ros.bench.precision.cases import ERROR, Case
from cylconn_ros.scene.scene import Scene

COST = "CPU time per simulated second"
MAX_REPEAT = 100_000


@dataclass(frozen=True)
class CaseSetup:
    """What all trials of one case share.

    ``file``: the scene as a parameter file. ``reference``: at the end of the case;
    ``calibration``: at the end of the calibration scene. ``processes`` by solver family.
    """

    case: Case
    scene: Scene
    file: Path
    reference: cases.Reference
    calibration: cases.Reference
    processes: Mapping[str, SolverProcess]


@dataclass
class Trial:
    """One solver with one value of its step (s) or tolerance.

    Attributes
    ----------
        sizes: errors of the end state. failed: why the solution is not usable, or empty.
        first_cost: CPU time of the second run, s. seconds: CPU times of its turns, s.
    """

    setup: CaseSetup
    solver: Solver
    value: float
    sizes: Errors = field(default_factory=dict)
    failed: str = ""
    first_cost: float = math.nan
    seconds: list[float] = field(default_factory=list)

    def run(self) -> NotMeasured | None:
        """Run twice: once for the end state, once for a first cost.

        Returns the reason if the solver is not installed or not applicable.
        """
        response = self._request(repeat=0)
        status, setup = response.get("status", ""), self.setup
        if status in ("not installed", "not applicable"):
            return NotMeasured(setup.case.name, self.solver.name, status, response["reason"])
        if status:
            self.failed = response["reason"]
            return None
        state = np.array([math.nan if x is None else x for x in response["state"]])
        self.sizes = cases.errors(setup.case, setup.scene, setup.reference, state)
        self.failed = cases.failure(setup.case, setup.scene, self.sizes, state)
        self.first_cost = self._request(repeat=1).get("cpu", math.nan)
        return None

    def turn(self, block: float) -> float:
        """CPU time (s) of one run, from repetitions that take about ``block`` s; NaN if failed."""
        repeat = max(1, min(round(block / max(self.first_cost, 1e-7)), MAX_REPEAT))
        return float(self._request(repeat=repeat).get("cpu", math.nan))

    def _request(self, repeat: int) -> dict[str, Any]:
        setup = self.setup
        return setup.processes[self.solver.family].request(
            solver=self.solver.name, case=setup.case.name, scene=str(setup.file),
            duration=setup.case.duration, calibration=setup.calibration, value=self.value,
            repeat=repeat,
        )  # fmt: skip

    def measurements(self) -> list[Measurement]:
        """Errors and cost; if there is no error, NaN and the reason."""
        sizes = self.sizes or {ERROR: (math.nan, "m")}
        case, name = self.setup.case, self.solver.name
        settings: dict[str, Setting] = {self.solver.parameter: self.value}
        found = [
            Measurement(case.name, name, quantity, size, unit, settings=settings, note=self.failed)
            for quantity, (size, unit) in sizes.items()
        ]
        spread = Spread.of(self.seconds or [self.first_cost])
        found.append(
            Measurement.of(
                case.name, name, COST, spread, "ms", scale=1e3 / case.duration, settings=settings,
                note=self.failed,
            )
        )  # fmt: skip
        return found


def time_trials(trials: Sequence[Trial], rounds: int, block: float) -> None:
    """Time all trials that have run, in turns of about ``block`` CPU seconds."""
    turns = {
        k: partial(trial.turn, block)
        for k, trial in enumerate(trials)
        if math.isfinite(trial.first_cost)
    }
    for k, seconds in run_interleaved(turns, rounds).items():
        trials[k].seconds = [s for s in seconds if math.isfinite(s)]
