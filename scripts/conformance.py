"""Read the conformance files of the MCAP format and compare what is read with what they hold.

python scripts/conformance.py FOLDER

FOLDER holds pairs NAME.mcap and NAME.json (sub-folders are searched), as the folder
tests/conformance/data of the repository github.com/foxglove/mcap. Its .mcap files are in Git LFS;
the generator beside them writes the same bytes: npx tsx scripts/generate-inputs.ts --data-dir data.
Compared are the topics of the channels, and times and content of every message. No file may be
called damaged or unfinished, and the reason why a topic cannot be decoded has to be given.

The exit code is 0 if all files pass.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from cylconn_ros.cli.main import main as cylconn
from cylconn_ros.recording.mcap.reader import McapFile

Rows = list[tuple[int, int, int, bytes]]  # channel, log time, publish time, content


def expected(path: Path) -> tuple[dict[int, tuple[str, str]], Rows]:
    """Topic and message encoding by channel, and the messages by log time, of a .json file."""
    records = [(r["type"], dict(r["fields"])) for r in json.loads(path.read_text())["records"]]
    channels = {
        int(r["id"]): (r["topic"], r["message_encoding"])
        for kind, r in records
        if kind == "Channel"
    }
    rows = [
        (int(r["channel_id"]), int(r["log_time"]), int(r["publish_time"]), content(r["data"]))
        for kind, r in records
        if kind == "Message"
    ]
    return channels, sorted(rows, key=lambda row: row[1])


def content(numbers: Sequence[str]) -> bytes:
    """Content of a message, written as a list of decimal numbers."""
    return bytes(int(number) for number in numbers)


def faults(path: Path) -> Iterator[str]:
    """What differs between a file as it is read and its description."""
    channels, rows = expected(path.with_suffix(".json"))
    with contextlib.closing(McapFile(path)) as file:
        found = file.contents()
        yield from (f"called damaged: {text}" for text in found.damage)
        if not found.finished:
            yield "called unfinished"
        if {number: c.topic for number, c in found.channels.items()} != {
            number: topic for number, (topic, _) in channels.items()
        }:
            yield f"channels {found.channels}, expected {channels}"
        for number, (topic, encoding) in channels.items():
            reason = found.channels[number].reason
            if encoding != "cdr" and reason != f"its messages are {encoding}, not cdr":
                yield f"{topic} cannot be decoded, but the reason given is {reason!r}"
        read: Rows = [
            (int(channel), int(log_time), int(publish_time), bytes(data))
            for unit in found.units
            for block in file.load(unit, unit.first, unit.last + 1)
            for channel, log_time, publish_time, data in block.messages()
        ]
        if sorted(read, key=lambda row: row[1]) != rows:
            yield f"{len(read)} messages that differ from the {len(rows)} expected"


def answers(path: Path) -> Iterator[str]:
    """Exceptions that leave a command."""
    with tempfile.TemporaryDirectory() as folder:
        target = ["-o", str(Path(folder) / "out")]
        for command in (
            ["info"],
            ["replay"],
            ["identify"],
            ["report", *target],
            ["salvage", *target],
        ):
            silent = io.StringIO()
            try:
                with contextlib.redirect_stdout(silent), contextlib.redirect_stderr(silent):
                    code: Any = cylconn([command[0], str(path), *command[1:]])
            except Exception as error:
                yield f"cylconn {command[0]}: {type(error).__name__}: {error}"
            else:
                if code not in (0, 1, 2):
                    yield f"cylconn {command[0]}: exit code {code}"


def main() -> int:
    """Check every file; print those that fail, and their number."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", metavar="FOLDER", type=Path)
    parser.add_argument("--commands", action="store_true", help="also run the commands on each")
    options = parser.parse_args()
    files = sorted(options.folder.rglob("*.mcap"))
    files = [path for path in files if path.with_suffix(".json").is_file()]
    if not files:
        print(f"{options.folder}: contains no pair NAME.mcap and NAME.json", file=sys.stderr)
        return 2
    passed = 0
    for path in files:
        found = [*faults(path), *(answers(path) if options.commands else ())]
        passed += not found
        for text in found:
            print(f"{path}: {text}")
    print(f"{passed} of {len(files)} files pass")
    return int(passed < len(files))


if __name__ == "__main__":
    sys.exit(main())
