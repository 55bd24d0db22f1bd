"""Show what is in a recorded run: topics and counts, method, how it went, worst violation, end.

One line a quantity draws its course from the smallest to the largest value; violations by powers of
ten. RUN is a recorded directory (with metadata.yaml) or an .mcap file.
"""

from __future__ import annotations

import argparse
import math
import shutil
import sys
from pathlib import Path

import numpy as np

from cylconn_ros.cli.checks import add_connector
from cylconn_ros.cli.results import REGIMES, Results, reduce_states
from cylconn_ros.recording.errors import RecordingError
from cylconn_ros.recording.reader import Run, Table, read_run
from cylconn_ros.report.sparkline import BLOCKS, PLAIN, sparkline, strip


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
    counts = {}
    for topic in recorded.types:
        try:
            counts[topic] = recorded.table(topic).undecodable
        except RecordingError:  # a type without columns
            continue
    return {topic: count for topic, count in counts.items() if count}


def _states(recorded: Run) -> list[str]:
    if recorded.connectors:
        return _several(recorded)
    try:
        state = recorded.state
    except RecordingError as error:
        return [f"no states to judge: {error}"]
    if not len(state):
        return ["no state was recorded"]
    methods = ", ".join(dict.fromkeys(state["method"]))
    model = recorded.metadata.get("model", "not recorded")
    found = reduce_states(state.time, state.columns)
    lines = [f"method      {methods}", f"model       {model}", *describe(found)]
    return lines + courses(state, width=shutil.get_terminal_size((100, 24)).columns)


def _several(recorded: Run) -> list[str]:
    """A line a connector."""
    names = recorded.connectors
    width = max(map(len, names))
    lines = [f"{len(names)} connectors; more of one with --connector NAME"]
    for name in names:
        state = recorded.only(name).state
        if len(state):
            found = reduce_states(state.time, state.columns)
            end = f"slide {found.distance:.6g} m, spin {found.turns:.6g} turns at the end"
            worst = f"{found.worst_offset * 1e3:.1e} mm, {found.worst_misalignment * 1e3:.1e} mrad"
            text = f"{found.samples} samples over {found.duration:.6g} s; {end}; at most {worst}"
        else:
            text = "no state was recorded"
        lines.append(f"  {name:<{width}}  {text}")
    return lines


_COURSES = (
    ("slide", "displacement", None, 1.0, "m", False),
    ("spin", "rotation", None, 0.5 / math.pi, "turns", False),
    ("slip rate", "slip_rate", None, 1.0, "m/s", False),
    ("normal", "normal_force", None, 1.0, "N", False),
    ("limit", "friction_limit", None, 1.0, "N", False),
    ("traction", "traction", None, 1.0, "N", False),
    ("force f1", "force", 0, 1.0, "N", False),
    ("moment m1", "moment", 0, 1.0, "N m", False),
    ("offset", "offset_violation", None, 1e3, "mm", True),
    ("misaligned", "angular_violation", None, 1e3, "mrad", True),
    ("energy", "energy_exchanged", None, 1.0, "J", False),
)
"""Name, field and component of ConnectorState, factor, unit, whether by powers of ten."""

_RANGE_WIDTH = 36  # of the smallest and largest value and the unit, behind a line


def courses(state: Table, width: int) -> list[str]:
    """Draw how the run went, a line a quantity that was not zero throughout."""
    blocks = _can_print(BLOCKS)
    width = min(max(width - 12 - _RANGE_WIDTH, 10), 60)
    marks = ".█░" if blocks else ".#~"
    named = [f"{marks[k]} {REGIMES[k]}" for k in range(3) if np.any(state["regime"] == k)]
    lines = [f"regime      {strip(state['regime'], marks, width)}  {', '.join(named)}"]
    for name, field, component, factor, unit, log in _COURSES:
        values = np.asarray(state[field], dtype=np.float64) * factor
        values = np.abs(values) if log else values
        values = values if component is None else values[:, component]
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
