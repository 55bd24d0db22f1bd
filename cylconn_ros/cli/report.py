"""Make one page of a recorded run: plots over time, friction disc, 3-D view, summary.

RUN is a recorded directory (with metadata.yaml) or an .mcap file. The page is one file, needs no
network and opens in any browser of 2023 or later. Of runs beyond 40 000 samples it shows the
smallest and the largest value of short stretches, and says so; --from and --to take every sample of
a part.
"""

from __future__ import annotations

import argparse
import datetime
import math
from pathlib import Path

from cylconn_ros.cli.checks import add_connector
from cylconn_ros.cli.summary import FIELDS, Reduction, Results
from cylconn_ros.errors import CommandError
from cylconn_ros.recording.run import Run, read_run
from cylconn_ros.report import gather, page, payload
from cylconn_ros.report.page import Fact

_CLOCK_NS = 10**17  # later stamps are a date (1973), earlier ones a simulation's time


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("recording", metavar="RUN", type=Path, help="recorded directory or file")
    add_connector(parser)
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="page to write (default RUN.html)"
    )
    parser.add_argument("--title", help="heading of the page (default: the name of the run)")
    parser.add_argument(
        "--from", dest="start", type=float, default=-math.inf, metavar="S", help="s, first sample"
    )
    parser.add_argument(
        "--to", dest="end", type=float, default=math.inf, metavar="S", help="s, last sample"
    )


def run(options: argparse.Namespace) -> int:
    """Write the page; 1 if the recording is not whole or holds states that cannot be decoded."""
    recorded = _read(options.recording, options.connector)
    name = options.recording.resolve().with_suffix("").name
    output = options.output or Path(f"{name}.html")
    if output.suffix not in (".html", ".htm"):
        raise CommandError(f"{output}: a page ends in .html")
    found = gather.gather(recorded, options.start, options.end)
    results = _reduced(found)
    head, numbers = payload.build(found)
    text = page.render(
        title=options.title or name,
        facts=facts(results, recorded),
        notes=found.notes,
        sources=sources(recorded, found),
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
    return 0 if recorded.incomplete is None and not found.undecodable else 1


def _reduced(found: gather.Gathered) -> Results:
    """The results, in one more reading."""
    reduction, at = Reduction(), 0
    for states in found.pieces(FIELDS):
        count = len(states("regime"))
        reduction.add(found.time[at : at + count], states.fields)
        at += count
    return reduction.result()


def _read(path: Path, connector: str) -> Run:
    """Read a run; of a recording without a connector's states, say what makes one of it."""
    elsewhere = f"cylconn replay {path} -o RUN makes a run of a recording of inputs"
    recorded = read_run(path, connector)
    if "cylconn_ros/msg/ConnectorState" not in recorded.types.values():
        raise CommandError(f"{path}: holds no states of a connector; {elsewhere}")
    return recorded


def facts(found: Results, recorded: Run) -> list[Fact]:
    """Return the summary of a run."""
    shares = [f"{share:.1%} {name}" for name, share in found.regimes.items()]
    shares.sort(key=lambda text: -float(text.split("%")[0]))
    rest = found.stop_time
    listed = [
        Fact("samples", f"{found.samples:,}".replace(",", " "), f"over {found.duration:.6g} s"),
        Fact("regime", shares[0], ", ".join(shares[1:])),
        Fact("slide at the end", f"{found.distance:.6g} m"),
        Fact("spin at the end", f"{found.turns:.6g} turns"),
        Fact("at rest from", "not at the end" if math.isnan(rest) else f"{rest:.6g} s"),
        Fact("worst offset", f"{found.worst_offset * 1e3:.3g} mm"),
        Fact("worst misalignment", f"{found.worst_misalignment * 1e3:.3g} mrad"),
        Fact("worst residual", f"{found.worst_residual:.2g}", "of the equations"),
    ]
    if found.flags:
        flags = ", ".join(f"{name} {count}" for name, count in found.flags.items())
        listed.append(Fact("flags", flags, "samples"))
    if found.refused:
        listed.append(Fact("refused", str(found.refused), "samples with a zero wrench", bad=True))
    if recorded.incomplete is not None:
        listed.append(Fact("recording", "not whole", recorded.incomplete, bad=True))
    return listed


def sources(recorded: Run, found: gather.Gathered) -> list[tuple[str, str]]:
    """Return what a run was made with."""
    methods = ", ".join(found.methods)
    listed = [
        ("recording", recorded.path.name),
        ("recorded by", f"cylconn_ros {recorded.version or '(version not recorded)'}"),
        ("method", methods),
        ("model", recorded.metadata.get("model", "not recorded")),
    ]
    names = ("period", "friction.coefficient", "friction.radius", "friction.overlap")
    values = [(name, recorded.parameters.get(name)) for name in (*names, "friction.preload")]
    listed += [(name, str(value)) for name, value in values if value is not None]
    if found.start_ns > _CLOCK_NS:
        when = datetime.datetime.fromtimestamp(found.start_ns / 1e9, datetime.timezone.utc)
        listed.append(("first sample", f"{when:%Y-%m-%d %H:%M:%S} UTC"))
    counts = ", ".join(f"{topic} {count}" for topic, count in sorted(recorded.counts.items()))
    listed.append(("messages", counts))
    if "salvaged" in recorded.metadata:
        listed.append(("salvaged", recorded.metadata["salvaged"]))
    return listed
