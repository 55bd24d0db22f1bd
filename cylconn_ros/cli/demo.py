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
import importlib.util
import sys
from pathlib import Path

from cylconn_ros.cli import checks, demo_checks, scenes
from cylconn_ros.cli.compile import compile_with_progress
from cylconn_ros.cli.node_pair import (
    PairFailedError,
    interrupt_on_signals,
    new_directory,
    recording_in,
    run_pair,
)
from cylconn_ros.errors import CommandError
from cylconn_ros.process.child import executable, private_environment
from cylconn_ros.recording.run import read_run
from cylconn_ros.scene import parameter_file

_SCENE = "demo"
_NEEDED = ("matplotlib", "scipy")


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
    output = new_directory(options.output, "demo")
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
    restore = interrupt_on_signals()
    try:
        connector, plant = (
            [str(executable(name)), "--ros-args", "--params-file", str(used)]
            for name in ("connector", "plant")
        )
        steps = scenes.steps(scene)
        closing_lines = run_pair("demo", connector, plant, private_environment(), steps)
    except PairFailedError as failure:
        print(f"✗ {failure}")
        return 1
    finally:
        restore()
    recording = recording_in(output)
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
