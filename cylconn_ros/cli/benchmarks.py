"""Table of the benchmarks: what each ``cylconn bench NAME`` measures, prints and draws.

Each entry imports its measurements when it is called, so that ``--help`` needs neither the compiler
nor SciPy nor the peer solvers. The docstring of an entry is its text in ``cylconn bench --help``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cylconn_ros.cli.progress import Progress
from cylconn_ros.process.child import private_environment

if TYPE_CHECKING:
    from cylconn_ros.bench.common.results import Findings, Report
    from cylconn_ros.bench.common.settings import Settings


@dataclass(frozen=True)
class Benchmark:
    """One benchmark.

    Attributes
    ----------
        parts: title and function of each measurement.
        body: formats the measurements; by default one table per case.
        draw: draws the report into a folder and returns the files; None if there are no pictures.
            Raises ImportError if a plotting package is missing.
    """

    parts: Sequence[tuple[str, Callable[[Settings], Findings]]]
    body: Callable[[Findings], str] | None = None
    draw: Callable[[Path, Report], Sequence[Path]] | None = None


def _kernel() -> Benchmark:
    """Cost of one step of every method, compiled, called from Python and without the compiler.

    Also MuJoCo's step and the start-up time.
    """
    from cylconn_ros.bench.step_cost import kernel, startup

    return Benchmark(
        [
            ("one step of every method, and of MuJoCo", kernel.measure),
            ("from process start to the first output", startup.measure),
        ]
    )


def _orders() -> Benchmark:
    """Orders of convergence and costs of every method on a set of scenes."""
    from cylconn_ros.bench.convergence import orders

    return Benchmark([("orders and costs of every method", orders.measure)], orders.text)


def _precision() -> Benchmark:
    """Error against CPU time on 21 scenes, for all methods and peer solvers.

    Peers are MuJoCo, Drake, PyBullet, Pinocchio, Exudyn and SciPy in several configurations each
    (pip install '.[peers]').
    """
    from cylconn_ros.bench.precision import run, text

    return Benchmark([("all solvers on all scenes", run.measure)], text.body, _draw_precision)


def _draw_precision(folder: Path, report: Report) -> list[Path]:
    """Draw the picture (PNG and SVG) and the interactive page."""
    from cylconn_ros.bench.precision import page, picture

    pictures = [folder / f"precision.{end}" for end in ("png", "svg")]
    picture.draw(report.findings, pictures)
    interactive = folder / "precision.html"
    interactive.write_text(page.page(report), encoding="utf-8")
    return [*pictures, interactive]


def _model() -> Benchmark:
    """Cost and error of the full model against the reduced model that a scene needs.

    Also the cost of each model feature.
    """
    from cylconn_ros.bench.step_cost import features

    measured = ("the reduced and the full model of every scene", features.measure)
    return Benchmark([measured], features.text)


def _stability() -> Benchmark:
    """Stability map: the range of each hard condition that a solver survives.

    Solvers are all methods, MuJoCo, and a spring-damper joint as users write it.
    """
    from cylconn_ros.bench.stability import measure, picture
    from cylconn_ros.laws.runs import first_violation

    def measured(settings: Settings) -> Findings:
        """Measure the map; the check of the laws takes most of the time, so --quick skips it."""
        with Progress("stability") as bar:
            return measure.measure(settings, bar, None if settings.quick else first_violation)

    def draw(folder: Path, report: Report) -> list[Path]:
        """Draw the heat map (PNG and SVG)."""
        pictures = [folder / f"stability.{end}" for end in ("png", "svg")]
        picture.save(report.findings, pictures)
        return pictures

    return Benchmark([("all solvers under all conditions", measured)], picture.body, draw)


def _node() -> Benchmark:
    """Latency and CPU time per sample of the node, with and without recording.

    Compared with a plain rclpy node and a node that only forwards bytes.
    """
    from cylconn_ros.bench.nodes import measure

    def measured(settings: Settings) -> Findings:
        return measure.measure(settings, private_environment())

    return Benchmark([("nodes in turns", measured)])


def _connectors() -> Benchmark:
    """Cost per sample with 1, 10 and 100 connectors in one process, and the sustainable rate."""
    from cylconn_ros.bench.nodes import connectors

    def measured(settings: Settings) -> Findings:
        return connectors.measure(settings, private_environment())

    return Benchmark([("1, 10 and 100 connectors", measured)])


def _replay() -> Benchmark:
    """Cost of replay per input message: reading a recording and processing its samples."""
    from cylconn_ros.bench.nodes import replay_cost

    return Benchmark([("replay of recordings", replay_cost.measure)])


def _faults() -> Benchmark:
    """Fault injection into real nodes: processes, messages, stamps and shutdown.

    Also every bundled scene with and without latency.
    """
    from cylconn_ros.bench.faults import measure, tables

    def measured(settings: Settings) -> Findings:
        with Progress("scenes") as bar:
            return measure.measure(settings, private_environment(), bar)

    return Benchmark([("faults of processes and messages", measured)], tables.body)


def _free_running() -> Benchmark:
    """Every bundled scene with a plant that does not wait, at 100 to 1000 Hz, nothing declared.

    The part of faults that runs in process; five minutes.
    """
    from cylconn_ros.bench.faults import measure, tables

    def measured(settings: Settings) -> Findings:
        with Progress("scenes") as bar:
            return measure.free_running_matrix(settings, bar)

    return Benchmark([("a plant that does not wait", measured)], tables.all_free_running)


def _soak() -> Benchmark:
    """Soak test: millions of samples in lock step with a recording node; up to an hour.

    It reports memory, lost samples and the laws of the recording.
    """
    from cylconn_ros.bench.faults import soak_report

    def measured(settings: Settings) -> Findings:
        samples = settings.samples or (soak_report.QUICK if settings.quick else soak_report.SAMPLES)
        with Progress("soak") as exchange, Progress("laws") as check:
            return soak_report.measure(samples, private_environment(), exchange, check)

    return Benchmark([("a recording node", measured)])


def _identification() -> Benchmark:
    """Coverage of the intervals of identify on simulated joints, beside ordinary least squares.

    Also mujoco.sysid (pip install 'mujoco[sysid]') on guides, and an axis of known parameters.

    200 draws of each friction and noise, which takes about an hour; finished draws are kept in
    identification.jsonl of the working directory, from which the next run resumes.
    """
    from cylconn_ros.bench.identification import coverage, text

    def measured(settings: Settings) -> Findings:
        with Progress("coverage") as bar:
            return coverage.measure(settings, bar)

    return Benchmark([("coverage of intervals", measured)], text.text)


BENCHMARKS: dict[str, Callable[[], Benchmark]] = {
    "kernel": _kernel,
    "orders": _orders,
    "precision": _precision,
    "model": _model,
    "stability": _stability,
    "node": _node,
    "connectors": _connectors,
    "replay": _replay,
    "faults": _faults,
    "free_running": _free_running,
    "soak": _soak,
    "identification": _identification,
}
"""Entries by name, in the order of the help text."""
