"""Run plant and connector as two ROS 2 processes, and check the recorded run.

A sleeve slides and spins down an inclined, loaded shaft until friction stops it. Both processes run
in lock step in a ROS domain of their own. The checks read the recording and compare it with an
independent solution. The exit code is 0 only if every check holds.

For example: cylconn demo --duration 2

Next: cylconn info RUN shows the run, cylconn report RUN makes a page of it.
"""

from __future__ import annotations

import argparse
import dataclasses
import datetime
import importlib.util
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cylconn_ros.cli import checks, demo_checks, scenes
from cylconn_ros.cli.compile import compile_with_progress
from cylconn_ros.cli.progress import Progress
from cylconn_ros.errors import CommandError, ProcessError
from cylconn_ros.process.child import Child, executable, private_environment
from cylconn_ros.recording.run import read_run
from cylconn_ros.scene import parameter_file

_SCENE = "demo"
_START_TIMEOUT = 240.0  # s until the first progress, or since a sign that a node still compiles
_PROGRESS_TIMEOUT = 60.0  # s without progress after that
_NEEDED = ("matplotlib", "scipy")


class DemoFailedError(ProcessError):
    """The run did not reach its end; the message gives the reason and the processes' output."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    scenes.add_overrides(parser)
    parser.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        help="new directory for recording and picture (default runs/demo_<time>)",
    )


def run(options: argparse.Namespace) -> int:
    """Run the demo; 0 if all checks hold, 1 otherwise."""
    missing = [name for name in _NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise CommandError(f"needs {' and '.join(missing)}: pip install '.[demo]'")
    path = scenes.find(_SCENE)
    output = _new_directory(options.output)
    scene = scenes.load_with_overrides(path, options)
    scene = dataclasses.replace(
        scene,
        record=dataclasses.replace(scene.record, enabled=True, directory=str(output)),
        plant=dataclasses.replace(scene.plant, lock_step=True, progress=True),
    )
    used = output / "scene.yaml"
    used.write_text(parameter_file.dump(scene), encoding="utf-8")
    if importlib.util.find_spec("numba") is None:
        print("numba is not installed: the physics runs uncompiled, which is slower")
    else:
        compile_with_progress({_SCENE: scene})
    restore = _interrupt_on_signals()
    try:
        closing_lines = run_processes(used, scenes.steps(scene))
    except DemoFailedError as failure:
        print(f"✗ {failure}")
        return 1
    finally:
        restore()
    recording = _recording(output)
    run_ = read_run(recording)
    print("computing the reference solution …", file=sys.stderr, flush=True)
    reference = demo_checks.reference(scene)
    picture = demo_checks.draw(run_, scene, reference, output / "demo.png")
    print()
    passed = checks.show(demo_checks.check_run(run_, scene, reference))
    for line in closing_lines:
        print(f"  {line}")
    print(f"\nrecorded run  {recording}\npicture       {picture}")
    print(f"next: cylconn info {recording}\n      cylconn report {recording}")
    return 0 if passed else 1


def run_processes(scene: Path, steps: int) -> list[str]:
    """Run connector and plant with a scene file until the plant ends.

    Returns the plant's closing lines. Raises DemoFailedError if a process ends early or makes no
    progress. Both processes have ended when this function returns or raises.
    """
    environment = private_environment()
    with Progress("demo") as bar:
        monitor = _PlantMonitor(bar, steps)
        arguments = ["--ros-args", "--params-file", str(scene)]
        connector_command = [str(executable("connector")), *arguments]
        plant_command = [str(executable("plant")), *arguments]
        bar.note("starting")
        with (
            Child(
                "connector", connector_command, environment, monitor.watch_connector
            ) as connector,
            Child("plant", plant_command, environment, monitor) as plant,
        ):
            _watch(connector, plant, monitor)
            code = plant.finish()
            if code != 0:
                _fail(f"plant ended with exit code {code}", plant, connector)
            code = connector.finish()
            if code != 0:
                _fail(f"connector ended with exit code {code}", connector)
            return list(plant.lines)[-1:]


class _PlantMonitor:
    """Consumes the plant's progress lines, shows them and extends the deadline."""

    def __init__(self, bar: Progress, steps: int) -> None:
        self._bar = bar
        self.deadline = time.monotonic() + _START_TIMEOUT
        self._steps = steps

    def watch_connector(self, line: str) -> bool:
        """Extend the deadline while the connector compiles; False: the line is kept."""
        if "compiling" in line:  # the cache could not be written
            self.deadline = time.monotonic() + _START_TIMEOUT
            self._bar.note("the connector compiles the physics")
        return False

    def __call__(self, line: str) -> bool:
        """Return whether the line is a progress line, ``progress DONE TOTAL``."""
        words = line.split()
        if len(words) != 3 or words[0] != "progress" or not (words[1] + words[2]).isdigit():
            return False
        self.deadline = time.monotonic() + _PROGRESS_TIMEOUT
        self._bar(int(words[1]), int(words[2]) or self._steps)
        return True


def _watch(connector: Child, plant: Child, monitor: _PlantMonitor) -> None:
    """Wait for the end of the plant; raises DemoFailedError."""
    while plant.exit_code is None:
        if connector.exit_code is not None:
            _fail(f"connector ended early with exit code {connector.exit_code}", connector, plant)
        if time.monotonic() > monitor.deadline:
            _fail("no progress within the time limit", plant, connector)
        time.sleep(0.02)


def _fail(reason: str, *children: Child) -> None:
    raise DemoFailedError("\n".join([reason, *(child.last_words() for child in children)]))


def _new_directory(wanted: Path | None) -> Path:
    """Create the output directory; raises CommandError if it exists."""
    stamp = datetime.datetime.now(datetime.timezone.utc).strftime("%Y%m%dT%H%M%S.%fZ")
    directory = wanted or Path("runs") / f"demo_{stamp}"
    try:
        directory.mkdir(parents=True)
    except FileExistsError:
        raise CommandError(f"{directory} exists; a run is never overwritten") from None
    except OSError as error:
        raise CommandError(f"{directory}: {error.strerror or error}") from None
    return directory.resolve()


def _recording(output: Path) -> Path:
    found = [path.parent for path in output.glob("*/metadata.yaml")]
    if len(found) != 1:
        raise CommandError(f"{output}: expected one recorded run, found {len(found)}")
    return found[0]


def _interrupt_on_signals() -> Callable[[], Any]:
    """Turn SIGTERM and SIGHUP into KeyboardInterrupt, so that the processes are ended.

    Returns a function that restores the previous handlers.
    """

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    old = {number: signal.signal(number, interrupt) for number in (signal.SIGTERM, signal.SIGHUP)}
    return lambda: [signal.signal(number, handler) for number, handler in old.items()]
