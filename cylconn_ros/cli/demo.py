"""Run the main job and judge it: plant and connector, two processes talking ROS 2.

A sleeve slides and spins down an inclined, loaded shaft until friction stops it. The run is
recorded; the summary is made from the recording and compared with an independent solution. The
exit code is 0 only if every line of the summary is well.
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
from cylconn_ros.cli.progress import Progress
from cylconn_ros.errors import CommandError
from cylconn_ros.process.child import Child, executable, private_environment
from cylconn_ros.recording.run import read_run
from cylconn_ros.scene import parameter_file

_SCENE = "demo"
_START_PATIENCE = 240.0  # s until the first progress: the first run ever compiles the physics
_STALL_PATIENCE = 60.0  # s without progress after that
_NEEDED = ("matplotlib", "scipy")


class DemoFailedError(Exception):
    """The run did not come to its end; the message says why, with the processes' last words."""


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
    """Run the demo; 0 if all is well, 1 if anything is off."""
    missing = [name for name in _NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise CommandError(
            f"needs {' and '.join(missing)}: pip install '.[demo]' brings what is missing"
        )
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
        print("numba is not installed: the same physics runs uncompiled, slower")
    restore = _end_on_terminate()
    try:
        said = run_processes(used, scenes.steps(scene))
    except DemoFailedError as failure:
        print(f"✗ {failure}")
        return 1
    finally:
        restore()
    recording = _recording(output)
    run_ = read_run(recording)
    print("solving the scene independently, to compare …", file=sys.stderr, flush=True)
    reference = demo_checks.reference(scene)
    picture = demo_checks.draw(run_, scene, reference, output / "demo.png")
    print()
    well = checks.show(demo_checks.judge(run_, scene, reference))
    for line in said:
        print(f"  {line}")
    print(f"\nrecorded run  {recording}\npicture       {picture}")
    print(f"next: cylconn info {recording}")
    return 0 if well else 1


def run_processes(scene: Path, steps: int) -> list[str]:
    """Run connector and plant on a scene file until the plant is done.

    Returns the plant's closing lines. Raises DemoFailedError when a process dies or hangs; both
    processes have ended when this returns or raises.
    """
    environment = private_environment()
    with Progress("demo") as bar:
        follower = _Follower(bar, steps)
        arguments = ["--ros-args", "--params-file", str(scene)]
        connector_command = [str(executable("connector")), *arguments]
        plant_command = [str(executable("plant")), *arguments]
        bar.note("starting (the first run compiles the physics)")
        with (
            Child("connector", connector_command, environment) as connector,
            Child("plant", plant_command, environment, follower) as plant,
        ):
            _watch(connector, plant, follower)
            code = plant.finish()
            if code != 0:
                _fail(f"plant ended with exit code {code}", plant, connector)
            code = connector.finish()
            if code != 0:
                _fail(f"connector ended with exit code {code}", connector)
            return list(plant.lines)[-1:]


class _Follower:
    """Takes the plant's progress lines out of its output and shows them."""

    def __init__(self, bar: Progress, steps: int) -> None:
        self._bar = bar
        self.deadline = time.monotonic() + _START_PATIENCE
        self._steps = steps

    def __call__(self, line: str) -> bool:
        words = line.split()
        if len(words) != 3 or words[0] != "progress" or not (words[1] + words[2]).isdigit():
            return False
        self.deadline = time.monotonic() + _STALL_PATIENCE
        self._bar(int(words[1]), int(words[2]) or self._steps)
        return True


def _watch(connector: Child, plant: Child, follower: _Follower) -> None:
    while plant.exit_code is None:
        if connector.exit_code is not None:
            _fail(f"connector ended too early, exit code {connector.exit_code}", connector, plant)
        if time.monotonic() > follower.deadline:
            _fail("no progress any more", plant, connector)
        time.sleep(0.02)


def _fail(reason: str, *children: Child) -> None:
    raise DemoFailedError("\n".join([reason, *(child.last_words() for child in children)]))


def _new_directory(wanted: Path | None) -> Path:
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


def _end_on_terminate() -> Callable[[], Any]:
    """Make SIGTERM and SIGHUP unwind like Ctrl-C, so that no process is left behind."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    old = {number: signal.signal(number, interrupt) for number in (signal.SIGTERM, signal.SIGHUP)}
    return lambda: [signal.signal(number, handler) for number, handler in old.items()]
