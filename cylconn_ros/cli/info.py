"""Show the contents of a recorded run: topics, counts, method, results and time curves.

RUN is a recorded directory (with metadata.yaml) or an .mcap file. One line per quantity draws its
curve from the smallest to the largest value; violations have a logarithmic scale. --csv and
--parquet also write a topic as a table, by default the states; its columns have the names of the
message's fields; --acceleration adds the accelerations of slide and spin, the mean over the period
that begins with each state. The exit code is 1 if the recording is incomplete or a topic has
undecodable messages.

For example: cylconn info runs/demo_20250101T120000Z/connector --csv states.csv

Next: make a page of the run with cylconn report RUN, or check it with cylconn laws --run RUN.
"""

from __future__ import annotations

import argparse
import math
import shutil
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.cli.checks import add_connector, add_recording
from cylconn_ros.connector.enums import REGIMES
from cylconn_ros.connector.summary import FIELDS, GREATEST, Reduction, RunSummary
from cylconn_ros.errors import CommandError, RecordingError
from cylconn_ros.recording import export
from cylconn_ros.recording.run import Run, read_run
from cylconn_ros.recording.table import STAMP, Table
from cylconn_ros.report.sparkline import BLOCKS, PLAIN, regime_strip, sparkline

Array = npt.NDArray[Any]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_recording(parser, "recording", "RUN")
    add_connector(parser)
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write a topic as CSV")
    parser.add_argument(
        "--parquet", type=Path, metavar="FILE", help="write a topic as Parquet (needs pyarrow)"
    )
    parser.add_argument(
        "--topic", default="", metavar="NAME", help="topic to write (default: the states)"
    )
    parser.add_argument(
        "--acceleration", action="store_true",
        help="write acceleration and angular_acceleration of slide and spin with the states",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Print the contents; 1 if the recording is incomplete or has undecodable messages."""
    recorded = read_run(options.recording, options.connector)
    lines = [f"{recorded.path}"]
    if recorded.version:
        lines.append(f"recorded by cylconn_ros {recorded.version}")
    if "salvaged" in recorded.metadata:
        lines.append(f"recovered {recorded.metadata['salvaged']}")
    lines += _topics(recorded)
    lines += [f"left out    {topic}: {reason}" for topic, reason in recorded.left_out.items()]
    lines += [f"not decoded {topic}: {reason}" for topic, reason in recorded.undefined.items()]
    lines += [f"note        {text}" for text in recorded.source.notes]
    complete = recorded.incomplete is None
    if not complete:
        lines.append(f"INCOMPLETE: {recorded.incomplete}")
    undecodable = _undecodable(recorded)
    lines += [f"UNDECODABLE: {count} messages of {topic}" for topic, count in undecodable.items()]
    empty = not any(recorded.counts.values())
    if empty:
        lines.append("NO MESSAGE  nothing of the recording can be read")
    states, problem = _states(recorded)
    print("\n".join(lines + states))
    for line in _export(recorded, options):
        print(line)
    if not empty:
        print(_next(recorded, complete))
    return 0 if complete and not undecodable and not empty and not problem else 1


def _export(recorded: Run, options: argparse.Namespace) -> Iterator[str]:
    """Write the tables asked for; one line for each."""
    if not (options.csv or options.parquet):
        if options.topic:
            raise CommandError("--topic names the topic to write: it needs --csv or --parquet")
        if options.acceleration:
            raise CommandError("--acceleration adds columns to a table: needs --csv or --parquet")
        return
    topic = recorded.topic(options.topic) if options.topic else recorded.state_topic
    for path, write in ((options.csv, export.write_csv), (options.parquet, export.write_parquet)):
        if path is None:
            continue
        layout = write(lambda: _blocks(recorded, topic, options.acceleration), path)
        columns = len(layout.kinds())
        yield f"written     {path}  ({layout.rows} rows, {columns} columns of {topic})"
        for name in layout.left_out:
            yield f"left out    {name}: more than {export.LONGEST} values per message"


def _blocks(recorded: Run, topic: str, acceleration: bool) -> Iterator[Table]:
    blocks = recorded.read_blocks(topic)
    return export.with_acceleration(blocks) if acceleration else blocks


def _next(recorded: Run, complete: bool) -> str:
    """The command to run next."""
    if not complete:
        return f"next: cylconn salvage {recorded.path}"
    if recorded.connectors:
        return f"next: cylconn info {recorded.path} --connector {recorded.connectors[0]}"
    states = [t for t, kind in recorded.types.items() if kind == "cylconn_ros/msg/ConnectorState"]
    if any(recorded.counts.get(topic, 0) for topic in states):
        return f"next: cylconn report {recorded.path}"
    scene = "" if recorded.parameters else " --params SCENE.yaml"
    return f"next: cylconn replay {recorded.path}{scene} -o RUN"


def _topics(recorded: Run) -> list[str]:
    """One line per topic: name, number of messages, type."""
    width = max((len(topic) for topic in recorded.types), default=0)
    lines = [f"{sum(recorded.counts.values())} messages over {recorded.duration:.1f} s"]
    for topic, kind in sorted(recorded.types.items()):
        lines.append(f"  {topic:<{width}}  {recorded.counts[topic]:>8}  {kind}")
    return lines


def _undecodable(recorded: Run) -> dict[str, int]:
    """Number of undecodable messages by topic, for the types that can be decoded."""
    counts: dict[str, int] = {}
    topics = [topic for topic in recorded.types if recorded.has_columns(topic)]
    for block in recorded.read_blocks(*topics, fields=()):
        counts[block.topic] = counts.get(block.topic, 0) + block.undecodable
    return {topic: count for topic, count in counts.items() if count}


def _states(recorded: Run) -> tuple[list[str], bool]:
    """Summary and curves of the states, or of each connector; whether they show a problem."""
    if recorded.connectors:
        return _connectors(recorded)
    if _STATE not in recorded.types.values():
        return ["no state was recorded"], False
    try:
        found, methods, drawn = _read(recorded)
    except RecordingError as error:
        return [f"states cannot be read: {error}"], True
    if found is None:
        return ["no state was recorded"], False
    model = recorded.metadata.get("model", "not recorded")
    lines = [f"method      {', '.join(methods)}", f"model       {model}", *describe(found)]
    lines += ["", "State timeline"]
    lines += timeline(drawn, width=shutil.get_terminal_size((100, 24)).columns)
    return lines, bool(found.problem)


def _read(recorded: Run) -> tuple[RunSummary | None, list[str], dict[str, Array]]:
    """Summary of a run, its methods, and the columns to draw, in single precision."""
    topic = recorded.state_topic
    reduction, methods = Reduction(), dict[str, None]()
    fields = {field for _, field, *_ in _CURVES} | {"regime", "status"}
    drawn: dict[str, list[Array]] = {field: [np.zeros(0, np.float32)] for field in fields}
    begin = None
    for block in recorded.read_blocks(topic, fields={*FIELDS, *fields, *STAMP, "method"}):
        if not len(block):
            continue
        stamp = block.stamp
        begin = int(stamp[0]) if begin is None else begin
        reduction.add(np.asarray((stamp - begin) * 1e-9, np.float64), block.columns)
        methods |= dict.fromkeys(block["method"])
        for field, parts in drawn.items():
            values = block[field]
            parts.append((values if values.ndim == 1 else values[:, 0]).astype(np.float32))
    found = None if begin is None else reduction.result()
    return found, list(methods), {name: np.concatenate(parts) for name, parts in drawn.items()}


def _connectors(recorded: Run) -> tuple[list[str], bool]:
    """One line per connector; whether one shows a problem."""
    names = recorded.connectors
    width = max(map(len, names))
    lines = [f"{len(names)} connectors; details of one with --connector NAME"]
    problems = False
    for name in names:
        found, _, _ = _read(recorded.select(name))
        if found is not None:
            end = f"slide {found.distance:.6g} m, spin {found.turns:.6g} turns at the end"
            worst = f"{found.worst_offset * 1e3:.1e} mm, {found.worst_misalignment * 1e3:.1e} mrad"
            text = f"{found.samples} samples over {found.duration:.6g} s; {end}; "
            text += f"violation at most {worst}"
            if found.problem:
                text, problems = f"{text}; NOT USABLE: {found.problem}", True
        else:
            text = "no state was recorded"
        lines.append(f"  {name:<{width}}  {text}")
    return lines, problems


_STATE = "cylconn_ros/msg/ConnectorState"
_CURVES = (
    ("slide", "displacement", 1.0, "m", False),
    ("spin", "rotation", 0.5 / math.pi, "turns", False),
    ("slip rate", "slip_rate", 1.0, "m/s", False),
    ("FN", "normal_force", 1.0, "N", False),
    ("limit", "friction_limit", 1.0, "N", False),
    ("traction", "traction", 1.0, "N", False),
    ("force f1", "force", 1.0, "N", False),
    ("moment m1", "moment", 1.0, "N m", False),
    ("offset", "offset_violation", 1e3, "mm", True),
    ("misaligned", "angular_violation", 1e3, "mrad", True),
    ("energy", "energy_exchanged", 1.0, "J", False),
)
"""Name, field of ConnectorState (its first component), factor, unit, whether logarithmic."""

_RANGE_WIDTH = 36  # columns for the smallest and largest value and the unit


def timeline(state: Mapping[str, Array], width: int) -> list[str]:
    """Draw the curves over time, one line per quantity that is not zero throughout."""
    blocks = _can_print(BLOCKS)
    width = min(max(width - 12 - _RANGE_WIDTH, 10), 60)
    marks = ".█░!" if blocks else ".#~!"
    names = (*REGIMES, "refused")
    shown = np.where(np.asarray(state.get("status", 0)) == 0, state["regime"], len(REGIMES))
    named = [f"{marks[k]} {names[k]}" for k in range(len(names)) if np.any(shown == k)]
    lines = [f"regime      {regime_strip(shown, marks, width)}  {', '.join(named)}"]
    for name, field, factor, unit, log in _CURVES:
        values = np.asarray(state[field], dtype=np.float64) * factor
        values = np.abs(values) if log else values
        finite = values[np.isfinite(values)]
        if not np.any(finite):
            continue
        drawn = sparkline(values, width, log, BLOCKS if blocks else PLAIN)
        span = f"{finite.min():.4g} to {finite.max():.4g} {unit}"
        lines.append(f"{name:<11} {drawn}  {span}")
    return lines


def _can_print(text: str) -> bool:
    try:
        text.encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        return False
    return True


def describe(found: RunSummary) -> list[str]:
    """The summary of a run as lines of text."""
    shares = ", ".join(f"{name} {share:.1%}" for name, share in found.regimes.items())
    shares = shares or "none: all samples were refused"
    lines = [
        f"samples     {found.samples} over {found.duration:.6g} s"
        + (f", {found.refused} refused" if found.refused else ""),
        f"regime      {shares}",
        f"end         slide {found.distance:.6f} m, spin {found.turns:.6f} turns",
    ]
    if found.stop_time == found.stop_time:
        lines.append(f"at rest     from {found.stop_time:.6f} s on")
    lines.append(
        f"violation   at most {found.worst_offset * 1e3:.2e} mm, "
        f"{found.worst_misalignment * 1e3:.2e} mrad; residual at most {found.worst_residual:.1e}"
    )
    if found.greatest:
        texts = (f"{name} {value:.6g} {GREATEST[name]}" for name, value in found.greatest.items())
        lines.append(f"greatest    {', '.join(texts)}".replace("_", " "))
    if found.flags:
        flags = ", ".join(f"{name} {count}" for name, count in found.flags.items())
        lines.append(f"flags       {flags} (samples)")
    if found.problem:
        lines.append(f"NOT USABLE  {found.problem}")
    return lines
