"""Measure speed and accuracy of the methods, of the node and of peer solvers.

All solvers of a benchmark take turns. Results are medians and quartiles of CPU time. Peer solvers
come with pip install '.[bench]'; a missing one is listed as not measured. The exit code is 1 if a
measurement fails or, with --strict, if a target is missed.

For example: cylconn bench kernel --quick

Next: keep results with -o FILE.json; print or draw kept results with --from FILE.json.
"""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from cylconn_ros.cli import scenes
from cylconn_ros.cli.benchmarks import BENCHMARKS, Benchmark
from cylconn_ros.errors import CommandError
from cylconn_ros.scene.scene import Scene, load

if TYPE_CHECKING:  # importing a benchmark imports the compiler, which --help does not need
    from cylconn_ros.bench.common.results import Findings, Report
    from cylconn_ros.bench.common.settings import Settings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command, and list the benchmarks in its description."""
    parser.description = f"{parser.description or ''}\n\nBenchmarks:\n{_listed()}"
    parser.add_argument("what", choices=BENCHMARKS, metavar="BENCHMARK", help="name from the list")
    parser.add_argument("--quick", action="store_true", help="short form with rough numbers")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="keep the results (new .json file)"
    )
    parser.add_argument(
        "--document", type=Path, metavar="FILE", help="put the results into this Markdown page"
    )
    parser.add_argument(
        "--pictures", type=Path, metavar="DIR", help="draw the results (precision and stability)"
    )
    parser.add_argument(
        "--from", dest="kept", type=Path, metavar="FILE",
        help="measure nothing: print, document and draw the results in FILE",
    )  # fmt: skip
    parser.add_argument(
        "--samples", type=int, metavar="N", help="samples of soak (2000000; --quick: 20000)"
    )
    parser.add_argument("--strict", action="store_true", help="fail if a target is missed")


def _listed() -> str:
    """Names and docstrings of the benchmarks, as lines for a terminal of 80 columns."""
    lines = []
    for name, benchmark in BENCHMARKS.items():
        text = " ".join(inspect.cleandoc(benchmark.__doc__ or "").split())
        lines += textwrap.wrap(f"  {name:<15}{text}", 79, subsequent_indent=" " * 17)
    return "\n".join(lines)


def run(options: argparse.Namespace) -> int:
    """Measure or read results, print them and keep them as asked; 1 if one is missing."""
    from cylconn_ros.bench.common import report as reports

    command = f"cylconn bench {options.what}"
    bench = BENCHMARKS[options.what]()
    _check_files(bench, options, command)
    if options.kept is not None:
        report = _read(options.kept, command)
    else:
        report = _measured(bench, options, command)
    text = reports.text(report, bench.body)
    encoding = sys.stdout.encoding or "ascii"
    print(text.encode(encoding, "replace").decode(encoding))
    _keep(bench, options, command, text, report)
    for one in report.failed:
        print(f"could not be measured: {one.subject}: {one.reason}", file=sys.stderr)
    if options.output is None and options.kept is None:
        print("next: keep the results with -o FILE.json", file=sys.stderr)
    elif options.output is not None:
        print(f"next: {command} --from {options.output}", file=sys.stderr)
    return int(bool(report.failed) or (options.strict and bool(report.missed)))


def _measured(bench: Benchmark, options: argparse.Namespace, command: str) -> Report:
    """Measure all parts; sources that change during the measurement count as a failure."""
    from cylconn_ros.bench.common import machine
    from cylconn_ros.bench.common.results import NotMeasured, Report
    from cylconn_ros.bench.common.settings import Settings

    settings = (Settings.short if options.quick else Settings)(_bundled)
    settings = dataclasses.replace(settings, samples=options.samples)
    report = Report(command + (" --quick" if options.quick else ""), settings.described())
    for name, part in bench.parts:
        print(f"measuring: {name}", file=sys.stderr, flush=True)
        report.findings.add(attempt(name, part, settings))
    if machine.describe()["cylconn_ros"] != report.machine["cylconn_ros"]:
        reason = "the sources changed during the measurement: results are inconsistent"
        report.findings.not_measured.append(NotMeasured("all", "all", "failed", reason))
    return report


def _read(file: Path, command: str) -> Report:
    """Read kept results of the same command."""
    from cylconn_ros.bench.common import results

    try:
        report = results.read(file)
    except OSError as error:
        raise CommandError(f"{file}: {error.strerror or error}") from None
    except ValueError as error:
        raise CommandError(f"{file}: {error}") from None
    if not report.command.startswith(command):
        raise CommandError(f"{file}: holds results of {report.command}, not of {command}")
    return report


def _check_files(bench: Benchmark, options: argparse.Namespace, command: str) -> None:
    """Raise CommandError before the measurement if a file cannot be written afterwards."""
    from cylconn_ros.bench.common.report import replace_results

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
            replace_results(page.read_text(encoding="utf-8"), command, "")
        except OSError as error:
            raise CommandError(f"{page}: {error.strerror or error}") from None
        except ValueError as error:
            raise CommandError(f"{page}: {error}") from None


def _keep(
    bench: Benchmark, options: argparse.Namespace, command: str, text: str, report: Report
) -> None:
    """Write results, page and pictures, as requested."""
    from cylconn_ros.bench.common.report import replace_results

    output: Path | None = options.output
    page: Path | None = options.document
    try:
        if output is not None:
            output.parent.mkdir(parents=True, exist_ok=True)
            with output.open("x", encoding="utf-8") as file:
                file.write(report.json())
            print(f"kept        {output}")
        if page is not None:
            old = page.read_text(encoding="utf-8")
            page.write_text(replace_results(old, command, text), encoding="utf-8")
            print(f"document    {page}")
        if options.pictures is not None and bench.draw is not None:
            options.pictures.mkdir(parents=True, exist_ok=True)
            files = bench.draw(options.pictures, report)
            print("pictures    " + ", ".join(map(str, files)))
    except OSError as error:
        raise CommandError(f"{error.filename}: {error.strerror or error}") from None
    except ImportError as error:
        raise CommandError(f"--pictures: {error}; install it with pip install '.[demo]'") from None


def attempt(name: str, part: Callable[[Settings], Findings], settings: Settings) -> Findings:
    """Measure one part; an exception becomes a failed result, so that other parts are kept."""
    from cylconn_ros.bench.common.results import Findings, NotMeasured

    try:
        return part(settings)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        return Findings(not_measured=[NotMeasured(name, "all", "failed", reason)])


def _bundled(name: str) -> Scene:
    return load(scenes.find(name))
