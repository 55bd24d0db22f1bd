"""Measure speed and accuracy, of our methods and of what people would use instead.

  kernel   what an answer costs: compiled, called from Python, without the compiler, beside
           MuJoCo's step; start-up; minimal beside SciPy and MuJoCo's RK4
  orders   orders of convergence and costs of every method on a set of scenes
  precision  error against CPU time on twelve scenes: every method, and MuJoCo, Drake, PyBullet,
           Pinocchio, Exudyn and SciPy in several set-ups each

Contestants take turns; medians and quartiles of CPU time. Peers come with
pip install '.[bench]'; an absent one is said to be absent. Exit code 1 where something
could not be measured, and with --strict where a target was missed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cylconn_ros.cli import scenes
from cylconn_ros.cli.errors import CommandError
from cylconn_ros.connector.scene import Scene, load

if TYPE_CHECKING:  # measuring imports the compiler, which --help can do without
    from cylconn_ros.bench.results import Findings, Report
    from cylconn_ros.bench.settings import Settings

    Part = Callable[[Settings], Findings]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("what", choices=("kernel", "orders", "precision"), help="what to measure")
    parser.add_argument("--quick", action="store_true", help="the short form; rough numbers")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="keep the results (new .json file)"
    )
    parser.add_argument(
        "--document", type=Path, metavar="FILE", help="put the results into this Markdown page"
    )
    parser.add_argument("--strict", action="store_true", help="fail where a target is missed")


def run(options: argparse.Namespace) -> int:
    """Measure, print and keep."""
    from cylconn_ros.bench import machine
    from cylconn_ros.bench import report as reports
    from cylconn_ros.bench.results import Gap, Report
    from cylconn_ros.bench.settings import Settings

    command = f"cylconn bench {options.what}"
    _check_files(options, command)
    settings = (Settings.short if options.quick else Settings)(_bundled)
    report = Report(command + (" --quick" if options.quick else ""), settings.described())
    for name, part in parts(options.what):
        print(f"measuring: {name}", file=sys.stderr, flush=True)
        report.findings.add(attempt(name, part, settings))
    if machine.describe()["cylconn_ros"] != report.machine["cylconn_ros"]:
        reason = "the sources changed meanwhile: the numbers belong together no more"
        report.findings.gaps.append(Gap("all", "all", "failed", reason))
    text = reports.text(report, reports.orders if options.what == "orders" else None)
    encoding = sys.stdout.encoding or "ascii"
    print(text.encode(encoding, "replace").decode(encoding))
    _keep(options, command, text, report)
    for gap in report.failed:
        print(f"could not be measured: {gap.contestant}: {gap.reason}", file=sys.stderr)
    return int(bool(report.failed) or (options.strict and bool(report.missed)))


def _check_files(options: argparse.Namespace, command: str) -> None:
    """Refuse before the work what would be refused after it."""
    from cylconn_ros.bench.document import replaced

    output: Path | None = options.output
    page: Path | None = options.document
    if output is not None:
        if output.suffix != ".json":
            raise CommandError(f"{output}: results end in .json")
        if output.exists():
            raise CommandError(f"{output} exists; results are never overwritten")
    if page is not None:
        try:
            replaced(page.read_text(encoding="utf-8"), command, "")
        except OSError as error:
            raise CommandError(f"{page}: {error.strerror or error}") from None
        except ValueError as error:
            raise CommandError(f"{page}: {error}") from None


def _keep(options: argparse.Namespace, command: str, text: str, report: Report) -> None:
    from cylconn_ros.bench.document import replaced

    output: Path | None = options.output
    page: Path | None = options.document
    try:
        if output is not None:
            output.parent.mkdir(parents=True, exist_ok=True)
            with output.open("x", encoding="utf-8") as file:
                file.write(report.json())
            print(f"kept in {output}")
        if page is not None:
            old = page.read_text(encoding="utf-8")
            page.write_text(replaced(old, command, text), encoding="utf-8")
            print(f"written into {page}")
    except OSError as error:
        raise CommandError(f"{error.filename}: {error.strerror or error}") from None


def parts(what: str) -> Sequence[tuple[str, Part]]:
    """The parts of a benchmark with what they measure; imported when they are asked for."""
    if what == "kernel":
        from cylconn_ros.bench import accuracy, kernel, startup

        return (
            ("a step of every method, and MuJoCo's", kernel.measure),
            ("start to first answer", startup.measure),
            ("minimal and SciPy on slide and spin", accuracy.slide_and_spin),
            ("minimal and MuJoCo's RK4 on two free bodies", accuracy.two_free_bodies),
        )
    if what == "precision":
        from cylconn_ros.bench import precision

        return (("everybody on every scene", precision.measure),)
    from cylconn_ros.bench import orders

    return (("orders and costs of every method", orders.measure),)


def attempt(name: str, part: Part, settings: Settings) -> Findings:
    """One part's findings; where it fails, that it did, so that the others are not lost."""
    from cylconn_ros.bench.results import Findings, Gap

    try:
        return part(settings)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        return Findings(gaps=[Gap(name, "all", "failed", reason)])


def _bundled(name: str) -> Scene:
    return load(scenes.find(name))
