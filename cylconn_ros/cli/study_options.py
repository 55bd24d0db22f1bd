"""What the commands of many runs or recordings share: where tasks run, and what is printed."""

from __future__ import annotations

import argparse

from cylconn_ros.cli.progress import duration
from cylconn_ros.study.run import Outcome


def add_engine(parser: argparse.ArgumentParser) -> None:
    """Declare --scheduler, --workers and --chunk."""
    parser.add_argument(
        "--scheduler", default="", metavar="ADDRESS",
        help="Dask scheduler, tcp://HOST:PORT, or 'local' to start one here with its workers; "
        "default: processes of this machine",
    )  # fmt: skip
    parser.add_argument(
        "--workers", type=positive, metavar="N", help="processes that are started (one a core)"
    )
    parser.add_argument(
        "--chunk",
        type=positive,
        default=0,
        metavar="N",
        help="rows a task",
    )


def positive(text: str) -> int:
    """Parse a whole number > 0."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be at least 1")
    return value


def describe(found: Outcome, unit: str) -> list[str]:
    """What was done, as lines: rows, cost, and memory of the workers."""
    resumed = f", {found.present} were there before" if found.present else ""
    lines = [f"{unit + 's':<12}{found.rows} in {duration(found.seconds)}{resumed}"]
    if found.rows:
        each = 1e3 * found.cpu / found.rows
        lines.append(f"cost        {each:.3g} ms of CPU time a {unit}")
    if found.memory:
        first, last = (max(pair[k] for pair in found.memory.values()) * 1e-6 for k in (0, 1))
        lines.append(
            f"memory      {first:.0f} MB a process after its first task, {last:.0f} MB at the end"
        )
    if found.repeated:
        lines.append(f"repeated    {found.repeated} tasks whose worker died")
    if found.failed:
        lines.append(f"FAILED      {found.failed} rows; their column 'error' says why")
    return lines
