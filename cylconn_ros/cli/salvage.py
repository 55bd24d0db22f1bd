"""Give back what is left of a run that was never closed, or whose file is damaged.

RUN is a recorded directory or an .mcap file; it is only read. What can be read of it becomes a new
run, RUN_salvaged unless -o names another: a valid one, with an index and metadata.yaml.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from cylconn_ros.recording.salvage import salvage


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("recording", metavar="RUN", type=Path, help="recorded directory or file")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="NAME", help="the new run (default RUN_salvaged)"
    )


def run(options: argparse.Namespace) -> int:
    """Salvage, and say what was saved and what was wrong."""
    saved = salvage(options.recording, options.output)
    print(f"{options.recording}: {saved.damage}")
    print(f"saved {saved.messages} messages over {saved.seconds:.3f} s in {saved.directory}")
    print(f"next: cylconn info {saved.directory}")
    return 0
