"""Work and precision: everybody on every scene, over a range of steps or tolerances.

Each family of contestants runs in a process of its own. Every set-up runs once for its answer, from
coarse to fine, until a run costs more than ``longest`` CPU seconds; then all that gave an answer
take their turns at the clock, round after round. What crashes, hangs, blows up or ends in the wrong
regime is kept as a point that failed.
"""

from __future__ import annotations

import dataclasses
import math
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cylconn_ros.bench.common.results import Findings, Gap, Measurement, Setting
from cylconn_ros.bench.common.settings import Settings
from cylconn_ros.bench.common.timing import Spread
from cylconn_ros.bench.peers.isolated import Process
from cylconn_ros.bench.peers.registry import CONTESTANTS
from cylconn_ros.bench.peers.solver import Contestant, milder
from cylconn_ros.bench.precision import cases, pareto
from cylconn_ros.bench.precision.cases import PLACE, Case
from cylconn_ros.bench.precision.trials import COST, Errors
from cylconn_ros.scene import parameter_file
from cylconn_ros.scene.scene import Scene

STEPS = (2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5)
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)


@dataclass(frozen=True)
class Extent:
    """How far a precision benchmark goes.

    Attributes
    ----------
        steps, tolerances: from coarse to fine. rounds: turns at the clock; block: CPU seconds of a
        turn. longest: CPU seconds of a run, beyond which no finer one is tried. patience: CPU
        seconds after which a run is ended (the first compiles). names: of scenes; all by default.
    """

    steps: Sequence[float] = STEPS
    tolerances: Sequence[float] = TOLERANCES
    rounds: int = 5
    block: float = 0.01
    longest: float = 0.4
    patience: float = 120.0
    names: tuple[str, ...] = ()

    @classmethod
    def short(cls) -> Extent:
        """The form that tests run: two scenes, a few points."""
        return cls((1e-2, 2e-3), (1e-4, 1e-8), 2, 0.001, 0.1, 120.0, ("coast", "near_jam"))


@dataclass
class Point:
    """A contestant with one value of its knob on one scene."""

    contestant: Contestant
    value: float
    sizes: Errors = field(default_factory=dict)
    failed: str = ""
    first: float = math.nan
    seconds: list[float] = field(default_factory=list)

    def settings(self) -> dict[str, Setting]:
        """What was set."""
        return {self.contestant.knob: self.value}


def measure(settings: Settings) -> Findings:
    """Everything."""
    extent = Extent.short() if settings.quick else Extent()
    found = Findings()
    with ExitStack() as stack:
        families = dict.fromkeys(c.family for c in CONTESTANTS.values())
        processes = {name: stack.enter_context(Process(extent.patience)) for name in families}
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        for case in cases.chosen(extent.names):
            scene = cases.scene_of(settings.load, case)
            started = time.monotonic()
            found.add(run(case, scene, extent, processes, folder))
            print(f"  {case.name}: {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)
    found.targets += pareto.targets(found)
    found.gaps = merged(found.gaps)
    return found


def run(
    case: Case, scene: Scene, extent: Extent, processes: Mapping[str, Process], folder: Path
) -> Findings:
    """Everybody on one scene."""
    file = folder / f"{case.name}.yaml"
    file.write_text(parameter_file.dump(scene))
    truth = case.answer(scene, case.duration)
    mild = {}
    if scene.friction.on:
        mild = {k: float(v) for k, v in case.answer(milder(scene), case.duration).items()}
    found, points = Findings(), []
    for contestant in CONTESTANTS.values():
        request = {
            "contestant": contestant.name, "name": case.name, "scene": str(file),
            "duration": case.duration, "truth": mild,
        }  # fmt: skip
        process = processes[contestant.family]
        for point in _coarse_to_fine(contestant, case, extent):
            gap = _answer(point, process, request, case, scene, truth)
            if gap:
                found.gaps.append(gap)
                break
            points.append(point)
            if not point.first <= extent.longest:
                break
    _take_turns(points, extent, processes, str(file), case, mild)
    for point in points:
        found.measurements += _measurements(case, point)
    return found


def _coarse_to_fine(contestant: Contestant, case: Case, extent: Extent) -> Iterator[Point]:
    values = extent.tolerances if contestant.knob == "tolerance" else extent.steps
    for value in values:
        steps = case.duration / value
        if contestant.knob == "tolerance" or abs(steps - round(steps)) < 1e-6:
            yield Point(contestant, value)


def _answer(
    point: Point, process: Process, request: Mapping[str, object], case: Case, scene: Scene,
    truth: cases.Truth,
) -> Gap | None:  # fmt: skip
    """Run once for the answer, once for a first time; a gap where the contestant cannot."""
    answer = process.ask(**request, value=point.value, repeat=0)
    status = answer.get("status", "")
    if status in ("absent", "left out"):
        return Gap(case.name, point.contestant.name, status, answer["reason"])
    if status:
        point.failed = f"{status}: {answer['reason']}" if status == "failed" else answer["reason"]
        return None
    state = np.array([math.nan if x is None else x for x in answer["state"]])
    point.sizes = cases.errors(case, scene, truth, state)
    point.failed = cases.failure(case, scene, point.sizes, state)
    point.first = process.ask(**request, value=point.value, repeat=1).get("cpu", math.nan)
    return None


def _take_turns(
    points: Sequence[Point], extent: Extent, processes: Mapping[str, Process], file: str,
    case: Case, mild: cases.Truth,
) -> None:  # fmt: skip
    """Rounds at the clock; who begins moves on each round."""
    running = [point for point in points if math.isfinite(point.first)]
    for k in range(extent.rounds):
        for j in range(len(running)):
            point = running[(j + k * max(len(running) // extent.rounds, 1)) % len(running)]
            answer = processes[point.contestant.family].ask(
                contestant=point.contestant.name, name=case.name, scene=file,
                duration=case.duration, truth=mild, value=point.value,
                repeat=max(1, min(round(extent.block / max(point.first, 1e-7)), 100_000)),
            )  # fmt: skip
            if "cpu" in answer:
                point.seconds.append(answer["cpu"])


def _measurements(case: Case, point: Point) -> list[Measurement]:
    """Errors and cost; where there is no error, that it failed."""
    sizes = point.sizes or {PLACE: (math.nan, "m")}
    name, settings = point.contestant.name, point.settings()
    found = [
        Measurement(case.name, name, quantity, size, unit, settings=settings, note=point.failed)
        for quantity, (size, unit) in sizes.items()
    ]
    spread = Spread.of(point.seconds or [point.first])
    found.append(
        Measurement.of(
            case.name, name, COST, spread, "ms", scale=1e3 / case.duration, settings=settings,
            note=point.failed,
        )
    )  # fmt: skip
    return found


def merged(gaps: Sequence[Gap]) -> list[Gap]:
    """One line for what is so everywhere."""
    alike: dict[tuple[str, str, str], list[Gap]] = {}
    for gap in gaps:
        alike.setdefault((gap.contestant, gap.status, gap.reason), []).append(gap)
    return [
        dataclasses.replace(group[0], problem=", ".join(gap.problem for gap in group))
        for group in alike.values()
    ]
