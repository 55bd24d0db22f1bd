"""Recover the intact messages of a damaged run, or of a run that was never closed.

RUN is a recorded directory or file; it is opened read-only. The recovered messages become
a new, valid run with an index and metadata.yaml: RUN_salvaged, unless -o gives another name.

For example: cylconn salvage runs/connector_1

Next: cylconn info RUN_salvaged shows the recovered run.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from cylconn_ros.recording.salvage import salvage


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("recording", metavar="RUN", type=Path, help="recorded directory or file")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="NAME", help="new run (default RUN_salvaged)"
    )


def run(options: argparse.Namespace) -> int:
    """Recover a run, and print the damage and the number of recovered messages."""
    saved = salvage(options.recording, options.output)
    print(f"{options.recording}: {saved.damage}")
    print(f"recovered {saved.messages} messages over {saved.seconds:.3f} s in {saved.directory}")
    for topic, reason in saved.left_out.items():
        print(f"left out  {topic}: {reason}")
    print(f"next: cylconn info {saved.directory}")
    return 0
