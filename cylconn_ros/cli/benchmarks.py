"""What each ``cylconn bench`` measures, how it is shown, and what is drawn of it.

Each is made when it is asked for: to measure imports the compiler, SciPy and peers, which
``--help`` can do without.
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
class Bench:
    """One benchmark.

    Attributes
    ----------
        parts: what is said to be measured, and what measures it.
        body: what shows the measurements, where that is not a table a problem.
        draw: draws them into a folder and returns the files, where there are pictures; raises
            ImportError where what draws is not installed.
    """

    parts: Sequence[tuple[str, Callable[[Settings], Findings]]]
    body: Callable[[Findings], str] | None = None
    draw: Callable[[Path, Report], Sequence[Path]] | None = None


def _kernel() -> Bench:
    from cylconn_ros.bench.step_cost import kernel, startup, whole_motion

    return Bench(
        [
            ("a step of every method, and MuJoCo's", kernel.measure),
            ("start to first answer", startup.measure),
            ("minimal and SciPy on slide and spin", whole_motion.slide_and_spin),
            ("minimal and MuJoCo's RK4 on two free bodies", whole_motion.two_free_bodies),
        ]
    )


def _orders() -> Bench:
    from cylconn_ros.bench.common import report
    from cylconn_ros.bench.convergence import orders

    return Bench([("orders and costs of every method", orders.measure)], report.orders)


def _precision() -> Bench:
    from cylconn_ros.bench.precision import run, text

    return Bench([("everybody on every scene", run.measure)], text.body, _draw_precision)


def _draw_precision(folder: Path, report: Report) -> list[Path]:
    """The picture, twice, and the interactive page."""
    from cylconn_ros.bench.precision import page, picture

    pictures = [folder / f"precision.{end}" for end in ("png", "svg")]
    picture.draw(report.findings, pictures)
    interactive = folder / "precision.html"
    interactive.write_text(page.page(report), encoding="utf-8")
    return [*pictures, interactive]


def _model() -> Bench:
    from cylconn_ros.bench.step_cost import features

    return Bench([("the lean and the full model of every scene", features.measure)], features.text)


def _stability() -> Bench:
    from cylconn_ros.bench.stability import measure, picture
    from cylconn_ros.laws.runs_recorded_or_simulated import broken

    def measured(settings: Settings) -> Findings:
        """The map; the laws of every answer take most of the time and are left to the full form."""
        with Progress("stability") as bar:
            return measure.measure(settings, bar, None if settings.quick else broken)

    def draw(folder: Path, report: Report) -> list[Path]:
        """The heat map, twice."""
        pictures = [folder / f"stability.{end}" for end in ("png", "svg")]
        picture.save(report.findings, pictures)
        return pictures

    return Bench([("everybody under every condition", measured)], picture.body, draw)


def _node() -> Bench:
    from cylconn_ros.bench.nodes import measure

    def measured(settings: Settings) -> Findings:
        return measure.measure(settings, private_environment())

    return Bench([("nodes asked in turns", measured)])


def _connectors() -> Bench:
    from cylconn_ros.bench.nodes import connectors

    def measured(settings: Settings) -> Findings:
        return connectors.measure(settings, private_environment())

    return Bench([("1, 10 and 100 connectors", measured)])


def _replay() -> Bench:
    from cylconn_ros.bench.nodes import replay_cost

    return Bench([("recordings replayed", replay_cost.measure)])


def _faults() -> Bench:
    from cylconn_ros.bench.faults import show
    from cylconn_ros.cli import reliability

    return Bench([("faults of processes and messages", reliability.faults)], show.body)


def _soak() -> Bench:
    from cylconn_ros.cli import reliability

    return Bench([("a node that records", reliability.soak)])


BENCHES: dict[str, Callable[[], Bench]] = {
    "kernel": _kernel,
    "orders": _orders,
    "precision": _precision,
    "model": _model,
    "stability": _stability,
    "node": _node,
    "connectors": _connectors,
    "replay": _replay,
    "faults": _faults,
    "soak": _soak,
}
