"""Measure speed and accuracy, of our methods and of what people would use instead.

  kernel   what an answer costs: compiled, called from Python, without the compiler, beside
           MuJoCo's step; start-up; minimal beside SciPy and MuJoCo's RK4
  orders   orders of convergence and costs of every method on a set of scenes
  precision  error against CPU time on twelve scenes: every method, and MuJoCo, Drake, PyBullet,
           Pinocchio, Exudyn and SciPy in several set-ups each; peers come with
           pip install '.[peers]'
  model    cost and error of the whole model against the lean one that a scene needs, and
           what each feature costs
  stability  the map of hard conditions: who survives how much of each, of our methods, of
           MuJoCo and of what people write by hand
  node     delay and CPU time of a sample as a node, recording on and off, beside a usual rclpy
           node and the least a node can do
  replay  reading a recording and evaluating its samples, by the input message
  connectors  what a sample costs with 1, 10 and 100 connectors in one process, and what holds
  faults   processes killed and paused, floods, garbage, late and lost messages, every ending: real
           nodes, and every scene of the library with and without latency
  soak     millions of samples in lock step with a node that records them: memory, losses, and the
           laws of the recording; an hour or less

Contestants take turns; medians and quartiles of CPU time. Peers come with
pip install '.[bench]'; an absent one is said to be absent. Exit code 1 where something
could not be measured, and with --strict where a target was missed.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from cylconn_ros.cli import scenes
from cylconn_ros.cli.benchmarks import BENCHES, Bench
from cylconn_ros.errors import CommandError
from cylconn_ros.scene.scene import Scene, load

if TYPE_CHECKING:  # measuring imports the compiler, which --help can do without
    from cylconn_ros.bench.common.results import Findings, Report
    from cylconn_ros.bench.common.settings import Settings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("what", choices=BENCHES, help="what to measure")
    parser.add_argument("--quick", action="store_true", help="the short form; rough numbers")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="keep the results (new .json file)"
    )
    parser.add_argument(
        "--document", type=Path, metavar="FILE", help="put the results into this Markdown page"
    )
    parser.add_argument(
        "--pictures", type=Path, metavar="DIR",
        help="draw the results there: precision.png, .svg and .html, or stability.png and .svg",
    )  # fmt: skip
    parser.add_argument(
        "--from", dest="kept", type=Path, metavar="FILE",
        help="measure nothing: print, document and draw results that -o has kept",
    )  # fmt: skip
    parser.add_argument(
        "--samples", type=int, metavar="N", help="soak: how many (2000000; --quick: 20000)"
    )
    parser.add_argument("--strict", action="store_true", help="fail where a target is missed")


def run(options: argparse.Namespace) -> int:
    """Measure, print and keep."""
    from cylconn_ros.bench.common import report as reports

    command = f"cylconn bench {options.what}"
    bench = BENCHES[options.what]()
    _check_files(bench, options, command)
    if options.kept is not None:
        report = _read(options.kept, command)
    else:
        report = _measured(bench, options, command)
    text = reports.text(report, bench.body)
    encoding = sys.stdout.encoding or "ascii"
    print(text.encode(encoding, "replace").decode(encoding))
    _keep(bench, options, command, text, report)
    for gap in report.failed:
        print(f"could not be measured: {gap.contestant}: {gap.reason}", file=sys.stderr)
    return int(bool(report.failed) or (options.strict and bool(report.missed)))


def _measured(bench: Bench, options: argparse.Namespace, command: str) -> Report:
    """All parts, and whether the sources stayed as they were."""
    from cylconn_ros.bench.common import machine
    from cylconn_ros.bench.common.results import Gap, Report
    from cylconn_ros.bench.common.settings import Settings

    settings = (Settings.short if options.quick else Settings)(_bundled)
    settings = dataclasses.replace(settings, samples=options.samples)
    report = Report(command + (" --quick" if options.quick else ""), settings.described())
    for name, part in bench.parts:
        print(f"measuring: {name}", file=sys.stderr, flush=True)
        report.findings.add(attempt(name, part, settings))
    if machine.describe()["cylconn_ros"] != report.machine["cylconn_ros"]:
        reason = "the sources changed meanwhile: the numbers belong together no more"
        report.findings.gaps.append(Gap("all", "all", "failed", reason))
    return report


def _read(file: Path, command: str) -> Report:
    """Results kept before, of the same command."""
    from cylconn_ros.bench.common import results_kept

    try:
        report = results_kept.read(file)
    except OSError as error:
        raise CommandError(f"{file}: {error.strerror or error}") from None
    except ValueError as error:
        raise CommandError(f"{file}: {error}") from None
    if not report.command.startswith(command):
        raise CommandError(f"{file}: holds results of {report.command}, not of {command}")
    return report


def _check_files(bench: Bench, options: argparse.Namespace, command: str) -> None:
    """Refuse before the work what would be refused after it."""
    from cylconn_ros.bench.common.report_document import replaced

    output: Path | None = options.output
    page: Path | None = options.document
    if options.pictures is not None and bench.draw is None:
        raise CommandError("--pictures: only precision and stability have pictures")
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


def _keep(
    bench: Bench, options: argparse.Namespace, command: str, text: str, report: Report
) -> None:
    from cylconn_ros.bench.common.report_document import replaced

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
        if options.pictures is not None and bench.draw is not None:
            options.pictures.mkdir(parents=True, exist_ok=True)
            files = bench.draw(options.pictures, report)
            print("drawn: " + ", ".join(map(str, files)))
    except OSError as error:
        raise CommandError(f"{error.filename}: {error.strerror or error}") from None
    except ImportError as error:
        raise CommandError(f"--pictures: {error}; pip install '.[demo]' brings it") from None


def attempt(name: str, part: Callable[[Settings], Findings], settings: Settings) -> Findings:
    """One part's findings; where it fails, that it did, so that the others are not lost."""
    from cylconn_ros.bench.common.results import Findings, Gap

    try:
        return part(settings)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        return Findings(gaps=[Gap(name, "all", "failed", reason)])


def _bundled(name: str) -> Scene:
    return load(scenes.find(name))
