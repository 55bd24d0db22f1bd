"""Show what is in a recorded run: topics and counts, method, regimes, worst violation, end.

RUN is a recorded directory (with metadata.yaml) or an .mcap file.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from cylconn_ros.cli.results import Results, reduce_states
from cylconn_ros.recording.errors import RecordingError
from cylconn_ros.recording.reader import Run, read_run


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("recording", metavar="RUN", type=Path, help="recorded directory or file")


def run(options: argparse.Namespace) -> int:
    """Print the screen; 1 if the recording is not whole or a topic holds undecodable messages."""
    recorded = read_run(options.recording)
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
    try:
        state = recorded.state
    except RecordingError as error:
        return [f"no states to judge: {error}"]
    if not len(state):
        return ["no state was recorded"]
    methods = ", ".join(dict.fromkeys(state["method"]))
    model = recorded.metadata.get("model", "not recorded")
    found = reduce_states(state.time, state.columns)
    return [f"method      {methods}", f"model       {model}", *describe(found)]


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
