"""``cylconn``: the commands, what they have in common and how they fail."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence

import cylconn_ros
from cylconn_ros.errors import CommandError, RecordingError, SceneError
from cylconn_ros.process.interrupt import INTERRUPTED, interruptible

COMMANDS = {
    "demo": "run plant and connector as two processes and judge the recorded run",
    "simulate": "run a scene in this process, without ROS",
    "replay": "run a recording through the connector again, or with other parameters",
    "info": "show what is in a recorded run",
    "report": "make one page of a recorded run: plots, friction disc, 3-D view, summary",
    "salvage": "give back what is left of a run that was never closed",
    "identify": "estimate friction from a recording of a joint",
    "laws": "check the laws of the step from outside, on random states or a recorded run",
    "bench": "measure speed and accuracy, beside others'",
}
"""Name of each command, which is also its module, and what it does."""

USAGE_ERROR = 2


def parser() -> argparse.ArgumentParser:
    """Build the parser of all commands."""
    top = argparse.ArgumentParser(
        prog="cylconn",
        description="Cylindrical connector between two rigid bodies: run it, look at runs.",
        epilog="cylconn COMMAND --help says how to use a command.",
    )
    top.add_argument("--version", action="version", version=cylconn_ros.__version__)
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, summary in COMMANDS.items():
        module = importlib.import_module(f"cylconn_ros.cli.{name}")
        command = commands.add_parser(
            name,
            help=summary,
            description=module.__doc__,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(command)
        command.set_defaults(run=module.run)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code: 0 well, 1 something is off, 2 wrongly used.

    130 where it was interrupted.
    """
    options = parser().parse_args(arguments)
    try:
        with interruptible(f"cylconn {options.command}"):
            return int(options.run(options))
    except (CommandError, RecordingError, SceneError) as error:
        print(f"cylconn {options.command}: {error}", file=sys.stderr)
        return USAGE_ERROR
    except KeyboardInterrupt:
        print(f"\ncylconn {options.command}: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # `cylconn info RUN | head`
        sys.stderr.close()
        return 0


if __name__ == "__main__":
    sys.exit(main())
