"""Show what is in a recorded run: topics and counts, method, how it went, worst violation, end.

One line a quantity draws its course from the smallest to the largest value; violations by powers of
ten. RUN is a recorded directory (with metadata.yaml) or an .mcap file.
"""

from __future__ import annotations

import argparse
import math
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cylconn_ros.cli.checks import add_connector
from cylconn_ros.cli.summary import FIELDS, Reduction, Results
from cylconn_ros.connector.enums import REGIMES
from cylconn_ros.errors import RecordingError
from cylconn_ros.recording.run import STAMP, Run, read_run
from cylconn_ros.report.sparkline import BLOCKS, PLAIN, sparkline, strip

Array = npt.NDArray[Any]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("recording", metavar="RUN", type=Path, help="recorded directory or file")
    add_connector(parser)


def run(options: argparse.Namespace) -> int:
    """Print the screen; 1 if the recording is not whole or a topic holds undecodable messages."""
    recorded = read_run(options.recording, options.connector)
    lines = [f"{recorded.path}"]
    if recorded.version:
        lines.append(f"recorded by cylconn_ros {recorded.version}")
    if "salvaged" in recorded.metadata:
        lines.append(f"salvaged {recorded.metadata['salvaged']}")
    lines += _topics(recorded)
    whole = recorded.incomplete is None
    if not whole:
        lines.append(f"NOT WHOLE: {recorded.incomplete}")
    undecodable = _undecodable(recorded)
    lines += [f"UNDECODABLE: {count} messages of {topic}" for topic, count in undecodable.items()]
    lines += _states(recorded)
    print("\n".join(lines))
    return 0 if whole and not undecodable else 1


def _topics(recorded: Run) -> list[str]:
    width = max((len(topic) for topic in recorded.types), default=0)
    lines = [f"{sum(recorded.counts.values())} messages over {recorded.duration:.1f} s"]
    for topic, kind in sorted(recorded.types.items()):
        lines.append(f"  {topic:<{width}}  {recorded.counts[topic]:>8}  {kind}")
    return lines


def _undecodable(recorded: Run) -> dict[str, int]:
    """Messages that are not what their type says, by topic; types without columns are left out."""
    counts: dict[str, int] = {}
    topics = [topic for topic in recorded.types if recorded.has_columns(topic)]
    for piece in recorded.pieces(*topics, only=()):
        counts[piece.topic] = counts.get(piece.topic, 0) + piece.undecodable
    return {topic: count for topic, count in counts.items() if count}


def _states(recorded: Run) -> list[str]:
    if recorded.connectors:
        return _several(recorded)
    try:
        found, methods, drawn = _read(recorded)
    except RecordingError as error:
        return [f"no states to judge: {error}"]
    if found is None:
        return ["no state was recorded"]
    model = recorded.metadata.get("model", "not recorded")
    lines = [f"method      {', '.join(methods)}", f"model       {model}", *describe(found)]
    return lines + courses(drawn, width=shutil.get_terminal_size((100, 24)).columns)


def _read(recorded: Run) -> tuple[Results | None, list[str], dict[str, Array]]:
    """The results of a run, its methods, and what is drawn of it: in single precision."""
    topic = recorded.state_topic
    reduction, methods = Reduction(), dict[str, None]()
    fields = {field for _, field, *_ in _COURSES} | {"regime"}
    drawn: dict[str, list[Array]] = {field: [np.zeros(0, np.float32)] for field in fields}
    begin = None
    for piece in recorded.pieces(topic, only={*FIELDS, *fields, *STAMP, "method"}):
        if not len(piece):
            continue
        stamp = piece.stamp
        begin = int(stamp[0]) if begin is None else begin
        reduction.add(np.asarray((stamp - begin) * 1e-9, np.float64), piece.columns)
        methods |= dict.fromkeys(piece["method"])
        for field, parts in drawn.items():
            values = piece[field]
            parts.append((values if values.ndim == 1 else values[:, 0]).astype(np.float32))
    found = None if begin is None else reduction.result()
    return found, list(methods), {name: np.concatenate(parts) for name, parts in drawn.items()}


def _several(recorded: Run) -> list[str]:
    """A line a connector."""
    names = recorded.connectors
    width = max(map(len, names))
    lines = [f"{len(names)} connectors; more of one with --connector NAME"]
    for name in names:
        found, _, _ = _read(recorded.only(name))
        if found is not None:
            end = f"slide {found.distance:.6g} m, spin {found.turns:.6g} turns at the end"
            worst = f"{found.worst_offset * 1e3:.1e} mm, {found.worst_misalignment * 1e3:.1e} mrad"
            text = f"{found.samples} samples over {found.duration:.6g} s; {end}; at most {worst}"
        else:
            text = "no state was recorded"
        lines.append(f"  {name:<{width}}  {text}")
    return lines


_COURSES = (
    ("slide", "displacement", 1.0, "m", False),
    ("spin", "rotation", 0.5 / math.pi, "turns", False),
    ("slip rate", "slip_rate", 1.0, "m/s", False),
    ("normal", "normal_force", 1.0, "N", False),
    ("limit", "friction_limit", 1.0, "N", False),
    ("traction", "traction", 1.0, "N", False),
    ("force f1", "force", 1.0, "N", False),
    ("moment m1", "moment", 1.0, "N m", False),
    ("offset", "offset_violation", 1e3, "mm", True),
    ("misaligned", "angular_violation", 1e3, "mrad", True),
    ("energy", "energy_exchanged", 1.0, "J", False),
)
"""Name, field of ConnectorState (its first component), factor, unit, whether by powers of ten."""

_RANGE_WIDTH = 36  # of the smallest and largest value and the unit, behind a line


def courses(state: Mapping[str, Array], width: int) -> list[str]:
    """Draw how the run went, a line a quantity that was not zero throughout."""
    blocks = _can_print(BLOCKS)
    width = min(max(width - 12 - _RANGE_WIDTH, 10), 60)
    marks = ".█░" if blocks else ".#~"
    named = [f"{marks[k]} {REGIMES[k]}" for k in range(3) if np.any(state["regime"] == k)]
    lines = [f"regime      {strip(state['regime'], marks, width)}  {', '.join(named)}"]
    for name, field, factor, unit, log in _COURSES:
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


def describe(found: Results) -> list[str]:
    """Return the reduced results of a run as lines of text."""
    shares = ", ".join(f"{name} {share:.1%}" for name, share in found.regimes.items())
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
    if found.flags:
        flags = ", ".join(f"{name} {count}" for name, count in found.flags.items())
        lines.append(f"flags       {flags} (samples)")
    return lines
