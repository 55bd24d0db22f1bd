"""Write an HTML page of a recorded run: plots over time, friction disc, 3-D view, summary.

RUN is a recorded directory (with metadata.yaml) or an .mcap file. The page is one file that works
offline in any browser of 2023 or later. For a run of more than 40 000 samples it shows the smallest
and largest value of short intervals, and a note on the page says so; with --from and --to it shows
every sample of a part. The exit code is 1 if the recording is incomplete or has undecodable states.

For example: cylconn report RUN -o page.html

Next: open the page in a browser.
"""

from __future__ import annotations

import argparse
import datetime
import math
from pathlib import Path

from cylconn_ros.cli.checks import add_connector, add_recording
from cylconn_ros.connector.summary import FIELDS, Reduction, RunSummary
from cylconn_ros.errors import CommandError
from cylconn_ros.recording.run import Run, read_run
from cylconn_ros.report import gather, page, payload
from cylconn_ros.report.page import Fact

_CLOCK_NS = 10**17  # larger stamps are dates (from 1973 on), smaller ones simulated time
_MOST_OFFSET = 0.01  # m, if the run has no friction radius
_MOST_MISALIGNMENT = 0.1  # rad


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_recording(parser, "recording", "RUN")
    add_connector(parser)
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="page to write (default RUN.html)"
    )
    parser.add_argument("--title", help="heading of the page (default: the name of the run)")
    parser.add_argument(
        "--from", dest="start", type=float, default=-math.inf, metavar="S", help="first sample, s"
    )
    parser.add_argument(
        "--to", dest="end", type=float, default=math.inf, metavar="S", help="last sample, s"
    )


def run(options: argparse.Namespace) -> int:
    """Write the page; 1 if the recording is incomplete or has undecodable states."""
    recorded = _read(options.recording, options.connector)
    name = options.recording[0].resolve().with_suffix("").name
    output = options.output or Path(f"{name}.html")
    if output.suffix not in (".html", ".htm"):
        raise CommandError(f"{output}: the page must end in .html")
    found = gather.gather(recorded, options.start, options.end)
    results = _summary(found)
    head, numbers = payload.build_payload(found)
    text = page.render(
        title=options.title or " ".join(filter(None, (name, options.connector))),
        facts=facts(results, recorded),
        notes=found.notes,
        sources=sources(recorded, found, options.connector),
        parameters=recorded.metadata.get("parameters", ""),
        head=head,
        numbers=numbers,
    )
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise CommandError(f"{output}: {error.strerror or error}") from None
    shown = "every sample" if head["whole"] else f"buckets of up to {head['bucket']} samples"
    print(f"report      {output}  ({len(text) / 1e6:.1f} MB; {results.samples} samples: {shown})")
    for note in found.notes:
        print(f"note        {note}")
    print(f"next: open {output} in a browser")
    return 0 if recorded.incomplete is None and not found.undecodable else 1


def _summary(found: gather.RunData) -> RunSummary:
    """Summary of the states, which are read once more."""
    reduction, at = Reduction(), 0
    for states in found.read_states(FIELDS):
        count = len(states("regime"))
        reduction.add(found.time[at : at + count], states.fields)
        at += count
    return reduction.result()


def _read(paths: list[Path], connector: str) -> Run:
    """Read a run; raises CommandError for a recording without states of a connector."""
    recorded = read_run(paths, connector)
    named = " ".join(map(str, paths)) + ("" if recorded.parameters else " --params SCENE.yaml")
    advice = f"cylconn replay {named} -o RUN computes them from recorded inputs"
    if "cylconn_ros/msg/ConnectorState" not in recorded.types.values():
        raise CommandError(f"{recorded.path}: contains no states of a connector; {advice}")
    return recorded


def facts(found: RunSummary, recorded: Run) -> list[Fact]:
    """The summary of a run, as lines of the page."""
    shares = [f"{share:.1%} {name}" for name, share in found.regimes.items()]
    shares.sort(key=lambda text: -float(text.split("%")[0]))
    rest = found.stop_time
    radius = recorded.parameters.get("friction.radius", 0.0)
    # Beyond these the sleeve is no longer on the shaft; not finite is beyond them, too.
    most_offset = radius if isinstance(radius, float) and radius > 0.0 else _MOST_OFFSET
    apart = not found.worst_offset <= most_offset
    askew = not found.worst_misalignment <= _MOST_MISALIGNMENT
    listed = [
        Fact("samples", f"{found.samples:,}".replace(",", " "), f"over {found.duration:.6g} s"),
        Fact("regime", shares[0], ", ".join(shares[1:])),
        Fact("slide at the end", f"{found.distance:.6g} m"),
        Fact("spin at the end", f"{found.turns:.6g} turns"),
        Fact("at rest from", "not at the end" if math.isnan(rest) else f"{rest:.6g} s"),
        Fact("worst offset", f"{found.worst_offset * 1e3:.3g} mm", bad=apart),
        Fact("worst misalignment", f"{found.worst_misalignment * 1e3:.3g} mrad", bad=askew),
        Fact(
            "worst residual",
            f"{found.worst_residual:.2g}",
            "of the equations",
            bad=not math.isfinite(found.worst_residual),
        ),
    ]
    if found.problem:
        listed.insert(0, Fact("run", "not usable", found.problem, bad=True))
    if found.flags:
        flags = ", ".join(f"{name} {count}" for name, count in found.flags.items())
        listed.append(Fact("flags", flags, "samples"))
    if found.refused:
        listed.append(Fact("refused", str(found.refused), "samples with a zero wrench", bad=True))
    if recorded.incomplete is not None:
        listed.append(Fact("recording", "incomplete", recorded.incomplete, bad=True))
    return listed


def sources(recorded: Run, found: gather.RunData, connector: str = "") -> list[tuple[str, str]]:
    """Origin of a run: recording, version, method, parameters, messages."""
    methods = ", ".join(found.methods)
    listed = [
        ("recording", recorded.path.name),
        *([("connector", connector)] if connector else []),
        ("recorded by", f"cylconn_ros {recorded.version or '(version not recorded)'}"),
        ("method", methods),
        ("model", recorded.metadata.get("model", "not recorded")),
    ]
    listed += _parameters(recorded)
    if found.start_ns > _CLOCK_NS:
        when = datetime.datetime.fromtimestamp(found.start_ns / 1e9, datetime.timezone.utc)
        listed.append(("first sample", f"{when:%Y-%m-%d %H:%M:%S} UTC"))
    counts = ", ".join(f"{topic} {count}" for topic, count in sorted(recorded.counts.items()))
    listed.append(("messages", counts))
    if "salvaged" in recorded.metadata:
        listed.append(("recovered", recorded.metadata["salvaged"]))
    return listed


def _parameters(recorded: Run) -> list[tuple[str, str]]:
    """The parameters of the run that a reader looks for first."""
    named = recorded.parameters
    directions = ["friction.coefficient_forward", "friction.coefficient_backward"]
    directions = [n for n in directions if _is_set(named.get(n))]
    # neither direction has the common coefficient if both have their own
    common = [] if len(directions) == 2 else ["friction.coefficient"]
    names = ["period", *common, *directions, "friction.radius", "friction.overlap"]
    names += [
        "friction.preload",
        *(["friction.offset_force"] if named.get("friction.offset_force") else []),
    ]
    return [(name, str(named[name])) for name in names if named.get(name) is not None]


def _is_set(value: object) -> bool:
    """Whether a parameter that may be .nan, or missing in an older recording, has a value."""
    return isinstance(value, int | float) and not math.isnan(value)
