"""Sweep: one simulation of a scene a row, in memory or into a dataset."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import cylconn_ros
from cylconn_ros.core.jit import CACHE_DIRECTORY
from cylconn_ros.errors import SceneError, StudyError
from cylconn_ros.scene.multiple import ONE
from cylconn_ros.scene.scene import Scene
from cylconn_ros.simulation.run import Run
from cylconn_ros.simulation.simulate import simulate
from cylconn_ros.study.dataset import Dataset
from cylconn_ros.study.executors import Engine, engine
from cylconn_ros.study.outputs import DEFAULT
from cylconn_ros.study.rows import Axis, Rows, axis_of, combine, wrong_value
from cylconn_ros.study.run import Outcome, chunk_size, run
from cylconn_ros.study.sampling import read_distribution, sample
from cylconn_ros.study.variants import (
    GroupRuns,
    Scenes,
    VariantOutputs,
    Variants,
    run_again,
)

if TYPE_CHECKING:
    import pandas

Progress = Callable[[int, int], None]

_CHECKED_HERE = 2000  # rows that are checked without an engine
_CHECK = 500  # rows of a check task


@dataclass(frozen=True)
class Simulation:
    """The task of a sweep: simulate a row's scene and reduce it to the outputs.

    Attributes
    ----------
        variants: the scenes that the rows change. duration: s, None: of the scene. names: of the
            outputs.
    """

    variants: Variants
    duration: float | None
    names: tuple[str, ...]

    @cached_property
    def _outputs(self) -> VariantOutputs:
        return self.variants.outputs(self.names)

    @property
    def outputs(self) -> Mapping[str, str]:
        """Type of each output column."""
        return self._outputs.types

    def __call__(self, row: Mapping[str, Any]) -> Mapping[str, Any]:
        """Simulate a row. Raises SceneError if its scene cannot be simulated."""
        return self._outputs.reduce(self.variants.of(row), self.duration)

    def __getstate__(self) -> dict[str, Any]:
        """Return what is sent to workers: the fields."""
        return {name: self.__dict__[name] for name in ("variants", "duration", "names")}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        self.__dict__.update(state)


def physics() -> str:
    """Digest of the sources of the physics, which a resumed study must share."""
    return Path(CACHE_DIRECTORY).name if CACHE_DIRECTORY else "not compiled"


def describe(task: Simulation, rows: Rows, chunk: int) -> dict[str, Any]:
    """Content of study.json: what the rows of a sweep follow from."""
    return {
        "kind": "sweep",
        "version": cylconn_ros.__version__,
        "physics": physics(),
        "rows": len(rows),
        "columns": list(rows.columns),
        "values": rows.digest(),
        "outputs": list(task.outputs),
        "duration": task.duration,
        "scene": task.variants.text(),
        "chunk": chunk,
    }


def check_rows(
    variants: Variants, rows: Rows, used: Engine, progress: Progress | None = None
) -> None:
    """Make the scenes of every row; raises StudyError with the first row that has none."""
    variants.check_names(rows.columns)
    _report(wrong_value(rows))
    if len(rows) <= _CHECKED_HERE:
        _report(wrong_row(variants, 0, rows))
        return
    pending: deque[tuple[int, Any]] = deque()
    firsts = iter(range(0, len(rows), _CHECK))
    try:
        while True:
            while len(pending) < 3 * used.workers and (first := next(firsts, None)) is not None:
                part = rows.part(first, first + _CHECK)
                pending.append((first, used.submit(wrong_row, variants, first, part)))
            if not pending:
                return
            first, future = pending.popleft()
            _report(future.result())
            if progress is not None:
                progress(min(first + _CHECK, len(rows)), len(rows))
    except BrokenExecutor:
        used.renew()
        _report(wrong_row(variants, 0, rows))


def wrong_row(variants: Variants, first: int, rows: Rows) -> str:
    """Name the first row, counted from ``first``, that makes no scene, and why; '' if all do."""
    for k in range(len(rows)):
        try:
            variants.of(rows.row(k))
        except SceneError as error:
            return f"row {first + k}: {error}"
    return ""


def _report(wrong: str) -> None:
    if wrong:
        raise StudyError(f"{wrong}; nothing was run")


def cost(task: Simulation, rows: Rows) -> float:
    """Time of one row, s; compiles what the rows need, so that workers find it compiled."""
    seconds = 0.0
    for _ in range(2):
        begin = time.perf_counter()
        try:
            task(rows.row(0))
        except Exception:  # it will be that row's failure
            return 1e-3
        seconds = time.perf_counter() - begin
    return seconds


def sweep_rows(
    vary: Sequence[Axis],
    distributions: Mapping[str, str] | None = None,
    count: int = 0,
    *,
    correlations: Sequence[tuple[str, str, float]] = (),
    design: str = "latin",
    seed: int = 1,
) -> Rows:
    """Rows of a sweep: all combinations of the axes, each with all points of the sample.

    ``distributions``: texts without the name, as ``normal:0.2:0.02``; arguments as in sampling.py.
    """
    axes = list(vary)
    if count or distributions:
        read = dict(read_distribution(f"{n}={text}") for n, text in (distributions or {}).items())
        axes.append(sample(read, count, correlations=correlations, design=design, seed=seed))
    if not axes:
        raise StudyError("nothing varies: give --vary, or --sample with --distribution")
    return combine(axes)


@dataclass(frozen=True)
class Sweep:
    """The result of a sweep into a dataset.

    Attributes
    ----------
        dataset: the folder. outcome: what was computed now, and what had been before.
    """

    dataset: Dataset
    outcome: Outcome = field(default_factory=Outcome)

    def to_dataframe(self, columns: Sequence[str] | None = None) -> pandas.DataFrame:
        """All rows, or some of their columns, as a pandas DataFrame."""
        return self.dataset.table(columns).to_pandas()

    def scenes(self, row: int) -> Scenes:
        """The scenes of a row by connector; the name is "" if there is one without a name.

        Raises StudyError if the row is not written.
        """
        description, values = self.dataset.description, self.dataset.row(row)
        varied = {name: values[name] for name in description["columns"]}
        return Variants.read(description["scene"]).of(varied)

    def run(self, row: int) -> Run | GroupRuns:
        """Simulate a row again: the whole run whose outputs the row holds.

        Of several connectors: a run of each group that shares bodies, by the connectors' names.
        """
        return run_again(self.scenes(row), self.dataset.description["duration"])


def into_dataset(
    task: Simulation,
    rows: Rows,
    output: str | Path,
    used: Engine,
    *,
    chunk: int = 0,
    progress: Progress | None = None,
    checking: Progress | None = None,
) -> Sweep:
    """Simulate the rows that the dataset ``output`` lacks.

    ``chunk``: rows of a task, 0: from the cost of a row. Raises StudyError before anything runs if
    a row makes no scene or the folder holds another study.
    """
    dataset = Dataset(output)
    if dataset.description:
        dataset.begin(describe(task, rows, 0))
    else:
        check_rows(task.variants, rows, used, checking)
        seconds = cost(task, rows)
        size = chunk or chunk_size(seconds, len(rows), used.workers)
        dataset.begin(describe(task, rows, size))
    return Sweep(dataset, run(task, rows, dataset, used, progress))


@overload
def sweep(
    scene: Scene,
    vary: Mapping[str, Sequence[Any]],
    duration: float | None = None,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
) -> list[Run]: ...


@overload
def sweep(
    scene: Scene | Scenes,
    vary: Mapping[str, Sequence[Any]] | None = None,
    duration: float | None = None,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
    output: str | Path,
    outputs: Sequence[str] = ...,
    distributions: Mapping[str, str] | None = ...,
    sample: int = ...,
    correlations: Sequence[tuple[str, str, float]] = ...,
    design: str = ...,
    seed: int = ...,
    scheduler: str = ...,
    chunk: int = ...,
) -> Sweep: ...


def sweep(
    scene: Scene | Scenes,
    vary: Mapping[str, Sequence[Any]] | None = None,
    duration: float | None = None,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
    output: str | Path | None = None,
    outputs: Sequence[str] = DEFAULT,
    distributions: Mapping[str, str] | None = None,
    sample: int = 0,
    correlations: Sequence[tuple[str, str, float]] = (),
    design: str = "latin",
    seed: int = 1,
    scheduler: str = "",
    chunk: int = 0,
) -> list[Run] | Sweep:
    """Simulate the scene for every combination of parameter values, on all cores.

    Without ``output`` the runs are returned, whole; with it, each run becomes a row of a dataset.

    Args:
        scene: or, with ``output``, those of several connectors by name.
        vary: dotted parameter names and the values of each; the last name varies fastest.
        duration: s, as for :func:`simulate`. workers: tasks at a time; by default one per core.
        progress: called with (done, total) runs.
        output: folder or fsspec address of the dataset; one that exists is resumed.
        outputs: names of the outputs (study/outputs.py): ``displacement.end``, ``stop_time``.
        distributions, sample: number of points, and distributions of further parameters:
            ``{"friction.coefficient": "normal:0.2:0.02"}``. correlations: (name, name, coefficient)
            of their scores. design: ``latin``, ``sobol`` or ``random``. seed: of the design.
        scheduler: address of a Dask scheduler, or ``local``. chunk: rows of a task.

    Returns the runs in order (``run.scene`` is the scene of each), or a Sweep with the dataset. All
    scenes are checked before the first run: raises :class:`~cylconn_ros.errors.SceneError` for an
    unusable value, and with ``output`` :class:`~cylconn_ros.errors.StudyError` that names the row.

    Example::

        scene = cr.load(cr.shipped("coast"))
        runs = cr.sweep(scene, {"friction.coefficient": [0.1, 0.2, 0.3]}, duration=1.0)
        print([run["displacement"][-1] for run in runs])
        found = cr.sweep(scene, {"friction.coefficient": [0.1, 0.2, 0.3]}, output="coast_study")
        print(found.to_dataframe(["friction.coefficient", "stop_time"]))
    """
    if output is None:
        if not isinstance(scene, Scene):
            raise StudyError("several connectors: give output, the folder of the dataset")
        return _in_memory(scene, vary or {}, duration, workers, progress)
    variants = Variants({ONE: scene} if isinstance(scene, Scene) else dict(scene))
    axes = [axis_of(name, values) for name, values in (vary or {}).items()]
    rows = sweep_rows(
        axes, distributions, sample, correlations=correlations, design=design, seed=seed
    )
    task = Simulation(variants, duration, tuple(outputs))
    with engine(scheduler, workers) as used:
        return into_dataset(task, rows, output, used, chunk=chunk, progress=progress)


def _in_memory(
    scene: Scene,
    vary: Mapping[str, Sequence[Any]],
    duration: float | None,
    workers: int | None,
    progress: Progress | None,
) -> list[Run]:
    """Whole runs of all combinations; threads, because compiled code runs beside Python."""
    scenes = [
        scene.replace(dict(zip(vary, values, strict=True))) for values in product(*vary.values())
    ]
    runs: list[Run] = []
    if not scenes:
        return runs

    def finished(run: Run) -> None:
        runs.append(run)
        if progress is not None:
            progress(len(runs), len(scenes))

    finished(simulate(scenes[0], duration))  # compiles, which threads would do at the same time
    with ThreadPoolExecutor(workers or os.cpu_count()) as pool:
        for run in pool.map(lambda one: simulate(one, duration), scenes[1:]):
            finished(run)
    return runs
