"""The precision benchmark: all solvers on all cases, over a range of steps or tolerances.

Each family of solvers runs in its own subprocess. Every solver first runs once per step or
tolerance, from coarse to fine, until a run takes more than ``max_cost`` CPU seconds. Then all runs
that returned a solution are timed in turns. A run that crashes, exceeds its time limit, diverges or
ends in the wrong regime is kept as a failed point.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from cylconn_ros.bench.common.results import Findings, NotMeasured, merge_cases
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.peers.isolated import SolverProcess
from cylconn_ros.bench.peers.registry import SOLVERS
from cylconn_ros.bench.peers.solver import Solver, calibration_scene
from cylconn_ros.bench.precision import cases, pareto
from cylconn_ros.bench.precision.cases import Case
from cylconn_ros.bench.precision.trials import CaseSetup, Trial, time_trials
from cylconn_ros.scene import parameter_file
from cylconn_ros.scene.scene import Scene

STEPS = (2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5)
ONE_JOINT = "connectors that share a body: this configuration has one joint"
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)


@dataclass(frozen=True)
class Extent:
    """The range of a precision benchmark.

    Attributes
    ----------
        steps, tolerances: from coarse to fine. rounds: turns per trial; block: CPU seconds of a
        turn. max_cost: CPU seconds of a run, after which no finer one follows. patience: CPU
        seconds after which a run is ended (the first one compiles). names: of the cases; by default
        all.
    """

    steps: Sequence[float] = STEPS
    tolerances: Sequence[float] = TOLERANCES
    rounds: int = 3
    block: float = 0.01
    max_cost: float = 0.25
    patience: float = 120.0
    names: tuple[str, ...] = ()

    @classmethod
    def short(cls) -> Extent:
        """The form that tests run: two cases, a few points."""
        return cls((1e-2, 2e-3), (1e-4, 1e-8), 2, 0.001, 0.1, 120.0, ("coast", "near_jam"))


def measure(settings: Settings) -> Findings:
    """All cases with all solvers."""
    extent = Extent.short() if settings.quick else Extent()
    found = Findings()
    with ExitStack() as stack:
        families = dict.fromkeys(solver.family for solver in SOLVERS.values())
        processes = {name: stack.enter_context(SolverProcess(extent.patience)) for name in families}
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        for case in cases.chosen(extent.names):
            scene = cases.scene_of(settings.load, case)
            started = time.monotonic()
            found.add(run(case, scene, extent, processes, folder))
            print(f"  {case.name}: {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)
    found.targets += pareto.targets(found)
    found.not_measured = merge_cases(found.not_measured)
    return found


def run(
    case: Case, scene: Scene, extent: Extent, processes: Mapping[str, SolverProcess], folder: Path
) -> Findings:
    """All solvers on one case."""
    file = folder / f"{case.name}.yaml"
    file.write_text(parameter_file.dump(scene))
    calibration: cases.Reference = {}
    if scene.friction.on and case.calibrates:
        solution = case.reference(calibration_scene(scene), case.duration)
        calibration = {name: float(value) for name, value in solution.items()}
    reference = case.reference(scene, case.duration)
    setup = CaseSetup(case, scene, file, reference, calibration, processes)
    found = Findings()
    trials: list[Trial] = []
    for solver in SOLVERS.values():
        if case.group and not solver.groups:
            found.not_measured.append(
                NotMeasured(case.name, solver.name, "not applicable", ONE_JOINT)
            )
            continue
        for value in _coarse_to_fine(solver, case, extent):
            trial = Trial(setup, solver, value)
            missing = trial.run()
            if missing:
                found.not_measured.append(missing)
                break
            trials.append(trial)
            if not trial.first_cost <= extent.max_cost:
                break
    time_trials(trials, extent.rounds, extent.block)
    for trial in trials:
        found.measurements += trial.measurements()
    return found


def _coarse_to_fine(solver: Solver, case: Case, extent: Extent) -> Iterator[float]:
    """Tolerances, or the steps that divide the duration."""
    if solver.parameter == "tolerance":
        yield from extent.tolerances
        return
    for step in extent.steps:
        steps = case.duration / step
        if abs(steps - round(steps)) < 1e-6:
            yield step
