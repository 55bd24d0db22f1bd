"""``cylconn bench all``: every benchmark, one after the other, into one folder of results.

Each part is a process of its own, so that a crash of a solver loses no other part. A part whose
results are in the folder, complete and of the same sources and processor, is kept: an interrupted
run continues. The manifest of the folder states date, machine, versions, digests and the duration
of each part. At the end pages and pictures are written from the results.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cylconn_ros.cli import bench_files
from cylconn_ros.cli.bench_parts import PARTS, Part
from cylconn_ros.cli.benchmarks import BENCHMARKS
from cylconn_ros.cli.progress import duration
from cylconn_ros.errors import CommandError
from cylconn_ros.process.child import Child, module_command
from cylconn_ros.process.interrupt import interruptible

if TYPE_CHECKING:
    from cylconn_ros.bench.common.results import Report

MANIFEST = "manifest.json"
IDLE = 0.5  # load average up to which a machine counts as idle
MEASURED, KEPT, INCOMPLETE, FAILED = "measured", "kept", "incomplete", "failed"


@dataclass
class Outcome:
    """What became of a part.

    Attributes
    ----------
        part: its name. command: what made it. state: measured, kept (from before), incomplete (some
        results failed) or failed (no results). seconds: its duration. reason: of a failure.
    """

    part: str
    command: str
    state: str
    seconds: float
    reason: str = ""

    @property
    def good(self) -> bool:
        """Whether all results are there."""
        return self.state in (MEASURED, KEPT)


def run(options: argparse.Namespace) -> int:
    """Measure what is missing, then write pages and pictures; 1 if a result is missing."""
    _check(options)
    if options.kept is not None:
        folder, outcomes = options.kept, [_found(options.kept, part) for part in PARTS]
    else:
        folder = _folder(options)
        folder.mkdir(parents=True, exist_ok=True)
        with interruptible("cylconn bench all", (signal.SIGTERM,)):
            outcomes = _measure(folder, options.quick)
    missed = list(_written(folder, options))
    for outcome in outcomes:
        line = f"{outcome.part:<15}{outcome.state:<12}{duration(outcome.seconds):>12}"
        print(f"{line}  {outcome.reason}".rstrip())
    print(f"results     {folder}")
    for text in missed:
        print(f"target missed: {text}")
    good = all(outcome.good for outcome in outcomes)
    print(f"next: {_next(good, folder, options)}", file=sys.stderr)
    return int(not good or (options.strict and bool(missed)))


def _check(options: argparse.Namespace) -> None:
    """Raise CommandError before anything is measured if a page or folder cannot be used."""
    if options.kept is not None and not options.kept.is_dir():
        raise CommandError(f"{options.kept}: is not the folder of a run of all benchmarks")
    if options.document is not None:
        if options.quick:
            raise CommandError("--document: the pages hold full measurements, not those of --quick")
        for part in PARTS:
            bench_files.check_page(options.document / part.page, part.command)


def _folder(options: argparse.Namespace) -> Path:
    """Folder of the run: named by its sources; the newest of these, or a new one with --anew."""
    from cylconn_ros.bench.common import sources

    if options.output is not None:
        if options.anew and options.output.exists():
            raise CommandError(f"{options.output} exists; --anew needs a new folder")
        return Path(options.output)
    name = f"bench/run-{sources.measured()}" + ("-quick" if options.quick else "")
    numbered = [Path(name), *(Path(f"{name}.{k}") for k in range(2, 1000))]
    new = next(k for k, folder in enumerate(numbered) if not folder.exists())
    return numbered[new if options.anew else max(new - 1, 0)]


def _measure(folder: Path, quick: bool) -> list[Outcome]:
    """Measure every part that is not kept."""
    load = os.getloadavg()[0]
    if load > IDLE:
        print(f"the machine is not idle (load {load:.2g}): times will be rough", file=sys.stderr)
    outcomes: list[Outcome] = []
    started, expected, spent = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()), 0.0, 0.0
    kept = {part.name: _kept(folder, part, quick) for part in PARTS}
    for k, part in enumerate(PARTS):
        if kept[part.name]:
            outcome = _found(folder, part)
        else:
            left = sum(60.0 * one.minutes for one in PARTS[k:] if not kept[one.name])
            pace = "" if quick else f", {duration(left * _pace(expected, spent))} left"
            print(f"part {k + 1} of {len(PARTS)}: {part.name}{pace}", file=sys.stderr, flush=True)
            outcome = _part(folder, part, quick)
            expected, spent = expected + 60.0 * part.minutes, spent + outcome.seconds
        outcomes.append(outcome)
        _write_manifest(folder, started, outcomes)
    return outcomes


def _pace(expected: float, spent: float) -> float:
    """Duration of the parts so far over the expected one, which counts as five more minutes."""
    return (spent + 300.0) / (expected + 300.0)


def _part(folder: Path, part: Part, quick: bool) -> Outcome:
    """Measure one part in a process of its own; its tables go to a text file."""
    file = folder / f"{part.name}.json"
    if file.exists():  # incomplete, or of other sources
        file.rename(folder / f"{part.name}.{round(file.stat().st_mtime)}.json")
    options = part.quick if quick else part.options
    arguments = ["bench", part.name, *options, "-o", str(file.absolute())]
    begin = time.monotonic()
    with (folder / f"{part.name}.txt").open("w", encoding="utf-8") as log:
        echo = [True]

        def on_line(line: str) -> bool:
            log.write(line + "\n")
            echo[0] = echo[0] and not line.startswith(("Kernel ", "|"))
            if echo[0]:
                print(f"  {line}", file=sys.stderr, flush=True)
            return False

        command = module_command("cylconn_ros.cli.main", *arguments)
        with Child(part.name, command, os.environ, on_line, folder=folder) as child:
            while (code := child.wait(1.0)) is None:
                pass
    seconds = time.monotonic() - begin
    if not file.exists():
        last = child.lines[-1] if child.lines else "no output"
        return Outcome(part.name, part.command, FAILED, seconds, f"exit code {code}: {last}")
    outcome = _found(folder, part)
    outcome.state = MEASURED if outcome.state == KEPT else outcome.state
    outcome.seconds = seconds
    return outcome


def _found(folder: Path, part: Part) -> Outcome:
    """The outcome of a part from the results in the folder."""
    report, seconds = _report(folder, part), _seconds(folder, part)
    if report is None:
        return Outcome(part.name, part.command, FAILED, seconds, "no results")
    if report.failed:
        reason = "; ".join(f"{one.subject}: {one.reason}" for one in report.failed)
        return Outcome(part.name, report.command, INCOMPLETE, seconds, reason)
    return Outcome(part.name, report.command, KEPT, seconds)


def _report(folder: Path, part: Part) -> Report | None:
    """Results of a part in the folder; None if there are none."""
    try:
        return bench_files.read_results(folder / f"{part.name}.json", f"cylconn bench {part.name}")
    except CommandError:
        return None


def _kept(folder: Path, part: Part, quick: bool) -> bool:
    """Whether the folder has complete results of the part, of these sources and this processor."""
    from cylconn_ros.bench.common import machine

    report, here = _report(folder, part), machine.describe()
    if report is None or report.failed:
        return False
    same = all(report.machine.get(name) == here[name] for name in ("cylconn_ros", "processor"))
    return same and (quick or report.command == part.command)


def _written(folder: Path, options: argparse.Namespace) -> Iterator[str]:
    """Write pages and pictures from all results; return the missed targets."""
    from cylconn_ros.bench.common import report as reports

    for part in PARTS:
        report = _report(folder, part)
        if report is None or not report.findings.measurements:
            continue
        bench = BENCHMARKS[part.name]()
        yield from (f"{part.name}: {target.name}" for target in report.missed)
        if options.document is not None:
            page = options.document / part.page
            bench_files.write_page(page, part.command, reports.text(report, bench.body))
            print(f"document    {page}: {part.name}")
        if options.pictures is not None:
            files = bench_files.draw(bench, options.pictures, report)
            if files:
                print("pictures    " + ", ".join(map(str, files)))


def _seconds(folder: Path, part: Part) -> float:
    """Duration of a part by the manifest; 0 if it is not known."""
    found = [one["seconds"] for one in _manifest(folder).get("parts", ())
             if one["part"] == part.name]  # fmt: skip
    return float(found[0]) if found else 0.0


def _manifest(folder: Path) -> dict[str, Any]:
    try:
        data: dict[str, Any] = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return data


def _write_manifest(folder: Path, started: str, outcomes: Sequence[Outcome]) -> None:
    """Write date, machine, versions, digests and what became of each part; whole at any time."""
    from cylconn_ros.bench.common import machine, sources

    data = {
        "started": started,
        "kernel": sources.kernel(),
        "sources": sources.measured(),
        "machine": machine.describe(),
        "seconds": sum(outcome.seconds for outcome in outcomes),
        "parts": [asdict(outcome) for outcome in outcomes],
    }
    new = folder / f"{MANIFEST}.new"
    new.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    new.replace(folder / MANIFEST)


def _next(good: bool, folder: Path, options: argparse.Namespace) -> str:
    if not good:
        return f"the same command measures again what failed (texts: {folder}/*.txt)"
    if options.document is None:
        return f"cylconn bench all --from {folder} --document docs --pictures docs/pictures"
    return f"look at the pages and pictures, commit {options.document}"
