"""``cylconn``: parser and dispatch of the commands, and their exit codes."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence

import cylconn_ros
from cylconn_ros.errors import CylconnError, RecordingError
from cylconn_ros.process.interrupt import INTERRUPTED, interruptible

COMMANDS = {
    "compile": "compile the physics into the cache: nodes and commands then start at once",
    "demo": "run plant and connector as two ROS 2 processes and check the recorded run",
    "simulate": "run a scene in this process, without ROS",
    "sweep": "run many variants of a scene, one row of results a run",
    "replay": "run a recording through the connector again, also with other parameters",
    "archive": "replay, identify or check many recordings, one row of results a recording",
    "info": "show the contents of a recorded run",
    "report": "write an HTML page of a recorded run: plots, friction disc, 3-D view, summary",
    "salvage": "recover the intact messages of a damaged run, or of one that was never closed",
    "import": "make a scene from an MJCF or URDF model or an Abaqus deck",
    "mujoco": "run an MJCF or URDF model and a connector as two ROS 2 processes, recorded",
    "identify": "estimate friction parameters from a recording of a joint",
    "laws": "check the laws of a connector step on random states, scenes or a recorded run",
    "bench": "measure speed and accuracy, also of peer solvers",
}
"""Commands and their summaries. A command is the module of the same name in this package, with
``add_arguments(parser)`` and ``run(options) -> exit code``. The module's docstring is its help
text. A last paragraph that starts with ``Next:`` follows the list of arguments."""

_MODULES = {"import": "import_"}  # a word of the language cannot name a module

USAGE_ERROR = 2


def parser() -> argparse.ArgumentParser:
    """Build the parser of all commands."""
    top = argparse.ArgumentParser(
        prog="cylconn",
        description="Cylindrical connector with friction between two rigid bodies.",
        epilog="Next: `cylconn COMMAND --help` explains a command; `cylconn simulate coast` runs a "
        "scene.",
    )
    top.add_argument("--version", action="version", version=cylconn_ros.__version__)
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, summary in COMMANDS.items():
        module = importlib.import_module(f"cylconn_ros.cli.{_MODULES.get(name, name)}")
        description, _, following = (module.__doc__ or "").partition("\n\nNext: ")
        command = commands.add_parser(
            name,
            help=summary,
            description=description,
            epilog=f"Next: {following}" if following else None,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(command)
        command.set_defaults(run=module.run)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code.

    0: success; 1: a check failed or something is missing; 2: the command cannot be carried out;
    130: interrupted.
    """
    options = parser().parse_args(arguments)
    try:
        with interruptible(f"cylconn {options.command}"):
            return int(options.run(options))
    except CylconnError as error:
        print(f"cylconn {options.command}: {_named(options, error)}", file=sys.stderr)
        return USAGE_ERROR
    except KeyboardInterrupt:
        print(f"\ncylconn {options.command}: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # `cylconn info RUN | head`
        sys.stderr.close()
        return 0


def _named(options: argparse.Namespace, error: CylconnError) -> str:
    """The text of an error, with the name of the recording if that is concerned."""
    text, given = str(error), getattr(options, "recording", getattr(options, "bag", None)) or []
    paths = [str(path) for path in (given if isinstance(given, list) else [given])]
    if not isinstance(error, RecordingError) or any(path in text for path in paths) or not paths:
        return text
    written = getattr(options, "output", None)
    return text if written is not None and str(written) in text else f"{' '.join(paths)}: {text}"


if __name__ == "__main__":
    sys.exit(main())
