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

from cylconn_ros.cli import bench_files, scenes
from cylconn_ros.cli.benchmarks import BENCHMARKS, Benchmark
from cylconn_ros.errors import CommandError
from cylconn_ros.scene.scene import Scene, load

if TYPE_CHECKING:  # importing a benchmark imports the compiler, which --help does not need
    from cylconn_ros.bench.common.results import Findings, Report
    from cylconn_ros.bench.common.settings import Settings

ALL = "all"
"""Name of the run of all benchmarks (``bench_all``)."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command, and list the benchmarks in its description."""
    parser.description = f"{parser.description or ''}\n\nBenchmarks:\n{_listed()}"
    parser.add_argument(
        "what", choices=[*BENCHMARKS, ALL], metavar="BENCHMARK", help="name from the list, or all"
    )
    parser.add_argument("--quick", action="store_true", help="short form with rough numbers")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="keep the results (new .json file); of all: the folder of the run (bench/run-SOURCES)",
    )
    parser.add_argument(
        "--document",
        type=Path,
        metavar="FILE",
        help="put the results into this Markdown page; of all: the folder docs",
    )
    parser.add_argument(
        "--pictures", type=Path, metavar="DIR", help="draw the results (precision and stability)"
    )
    parser.add_argument(
        "--from", dest="kept", type=Path, metavar="FILE",
        help="measure nothing: print, document and draw the results in FILE (all: in a folder)",
    )  # fmt: skip
    parser.add_argument(
        "--samples",
        type=int,
        metavar="N",
        help="samples of soak (2000000; --quick: 20000) or draws of identification (200)",
    )
    parser.add_argument(
        "--anew", action="store_true", help="of all: measure again what is already measured"
    )
    parser.add_argument("--strict", action="store_true", help="fail if a target is missed")


def _listed() -> str:
    """Names and docstrings of the benchmarks, as lines for a terminal of 80 columns."""
    lines = []
    for name, benchmark in BENCHMARKS.items():
        text = " ".join(inspect.cleandoc(benchmark.__doc__ or "").split())
        lines += textwrap.wrap(f"  {name:<15}{text}", 79, subsequent_indent=" " * 17)
    text = (
        "All of them, one after the other, planned for 40 minutes on two idle cores; the long ones "
    )
    text += (
        "(faults, free_running, soak, identification) in a short form. Continues a run that was "
    )
    text += "interrupted."
    lines += textwrap.wrap(f"  {ALL:<15}{text}", 79, subsequent_indent=" " * 17)
    return "\n".join(lines)


def run(options: argparse.Namespace) -> int:
    """Measure or read results, print them and keep them as asked; 1 if one is missing."""
    if options.what == ALL:
        from cylconn_ros.cli import bench_all

        return bench_all.run(options)
    from cylconn_ros.bench.common import report as reports

    bench = BENCHMARKS[options.what]()
    if options.pictures is not None and bench.draw is None:
        raise CommandError("--pictures: only precision and stability have pictures")
    if options.output is not None:
        bench_files.check_new(options.output)
    if options.kept is not None:
        report = bench_files.read_results(options.kept, f"cylconn bench {options.what}")
        command = report.command
    else:
        command = _command(options)
    if options.document is not None:
        bench_files.check_page(options.document, command)
    if options.kept is None:
        report = _measured(bench, options, command)
    text = reports.text(report, bench.body)
    encoding = sys.stdout.encoding or "ascii"
    print(text.encode(encoding, "replace").decode(encoding))
    _keep(bench, options, text, report)
    for one in report.failed:
        print(f"could not be measured: {one.subject}: {one.reason}", file=sys.stderr)
    if options.output is None and options.kept is None:
        print("next: keep the results with -o FILE.json", file=sys.stderr)
    elif options.output is not None:
        print(f"next: cylconn bench {options.what} --from {options.output}", file=sys.stderr)
    return int(bool(report.failed) or (options.strict and bool(report.missed)))


def _command(options: argparse.Namespace) -> str:
    """The command as results and pages state it: its name and what determines the extent."""
    words = ["cylconn bench", options.what]
    words += ["--quick"] if options.quick else []
    words += [f"--samples {options.samples}"] if options.samples else []
    return " ".join(words)


def _measured(bench: Benchmark, options: argparse.Namespace, command: str) -> Report:
    """Measure all parts; sources that change during the measurement count as a failure."""
    from cylconn_ros.bench.common import sources
    from cylconn_ros.bench.common.results import NotMeasured, Report
    from cylconn_ros.bench.common.settings import Settings

    settings = (Settings.short if options.quick else Settings)(_bundled)
    settings = dataclasses.replace(settings, samples=options.samples)
    before, report = sources.measured(), Report(command, settings.described())
    for name, part in bench.parts:
        print(f"measuring: {name}", file=sys.stderr, flush=True)
        report.findings.add(attempt(name, part, settings))
    if sources.measured() != before:
        reason = "the sources changed during the measurement: results are inconsistent"
        report.findings.not_measured.append(NotMeasured("all", "all", "failed", reason))
    return report


def _keep(bench: Benchmark, options: argparse.Namespace, text: str, report: Report) -> None:
    """Write results, page and pictures, as requested."""
    if options.output is not None:
        bench_files.write_results(options.output, report)
        print(f"kept        {options.output}")
    if options.document is not None:
        bench_files.write_page(options.document, report.command, text)
        print(f"document    {options.document}")
    if options.pictures is not None:
        files = bench_files.draw(bench, options.pictures, report)
        print("pictures    " + ", ".join(map(str, files)))


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
