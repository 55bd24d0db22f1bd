"""Run an MJCF or URDF model with a connector in place of, or beside, one of its joints.

Starts the model (mujoco_plant) and the connector as two ROS 2 processes in lock step, records the
run and shows the motion while it lasts. The topics are in your ROS domain, so that RViz, Foxglove
or PlotJuggler show them, too; --view opens MuJoCo's window. Without --scene the scene is imported
from the model as `cylconn import` does it. With a duration the run ends by itself, else at Ctrl-C
or when the window is closed.

For example: cylconn mujoco drawer_arm --joint drawer --coefficient 0.3 --radius 0.01 --overlap 0.1

Next: cylconn report RUN makes a page of the run, cylconn info RUN shows it in the terminal.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from pathlib import Path
from typing import Any

from cylconn_ros.cli import import_, scenes
from cylconn_ros.cli.compile import compile_with_progress
from cylconn_ros.cli.node_pair import (
    PairFailedError,
    interrupt_on_signals,
    new_directory,
    recording_in,
    run_pair,
)
from cylconn_ros.core import jit
from cylconn_ros.errors import CommandError
from cylconn_ros.importing import from_mujoco
from cylconn_ros.importing.model_file import find_model
from cylconn_ros.process.child import executable
from cylconn_ros.scene import parameter_file
from cylconn_ros.scene.resources import shipped_models
from cylconn_ros.scene.scene import Scene, load


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        "model",
        metavar="MODEL",
        help=".xml or .urdf, or a bundled model: " + ", ".join(shipped_models()),
    )
    parser.add_argument(
        "--joint", action="append", required=True, metavar="NAME",
        help="joint of the model; twice for a slide and a hinge on one axis",
    )  # fmt: skip
    parser.add_argument("--scene", metavar="FILE", help="parameter file (default: imported)")
    import_.add_friction(parser)
    scenes.add_set(parser)
    parser.add_argument(
        "--constraint", choices=("connector", "simulator"),
        help="connector: the joint is removed from a copy of the model; simulator: it stays, and "
        "only friction, stops, springs and drives are sent (default: of the scene; of an imported "
        "one simulator if body A is part of a mechanism)",
    )  # fmt: skip
    scenes.add_overrides(parser)
    parser.add_argument(
        "--motion", type=Path, metavar="CSV",
        help="commands of actuators over time (default: CSV file beside a bundled model)",
    )  # fmt: skip
    parser.add_argument(
        "--real-time-factor", type=float, metavar="X",
        help="run freely at X times the speed of the wall clock instead of in lock step",
    )  # fmt: skip
    parser.add_argument(
        "--view",
        action="store_true",
        help="open MuJoCo's window; lock step is then no faster than the wall clock",
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR",
        help="new directory for scene and recording (default runs/mujoco_TIME)",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Run model and connector; 0 if both reach the end, 1 otherwise."""
    path = find_model(options.model)
    motion = _motion(path, options)
    scene = _scene(path, options)
    output = new_directory(options.output, "mujoco")
    changes: dict[str, Any] = {
        "record.enabled": True, "record.directory": str(output), "plant.progress": True
    }  # fmt: skip
    if options.real_time_factor is None:
        changes |= {"plant.lock_step": True, "latency": 0.0}
    scene = scene.replace(changes)
    used = output / "scene.yaml"
    used.write_text(parameter_file.dump(scene), encoding="utf-8")
    if jit.COMPILED:
        compile_with_progress({"scene": scene})
    parameters = ["--ros-args", "--params-file", str(used)]
    model = [str(executable("mujoco_plant")), str(path)]
    for name in options.joint:
        model += ["--joint", name]
    model += [] if motion is None else ["--motion", str(motion)]
    model += ["--view"] if options.view else []
    if options.real_time_factor is not None:
        model += ["--real-time-factor", str(options.real_time_factor)]
    elif options.view:
        model += ["--pace", "1"]
    steps = scenes.steps(scene) if math.isfinite(scene.plant.duration) else None
    if steps is None:
        print("no duration is given: Ctrl-C ends the run", file=sys.stderr)
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    connector = [str(executable("connector")), *parameters]
    restore = interrupt_on_signals()
    try:
        last = run_pair(
            "mujoco", connector, [*model, *parameters], environment, steps,
            lambda values: _described(scene, values),
        )  # fmt: skip
    except PairFailedError as failure:
        print(f"✗ {failure}")
        return 1
    finally:
        restore()
    for line in last:
        print(line)
    recording = recording_in(output)
    print(f"recorded run  {recording}\nscene         {used}")
    print(f"next: cylconn info {recording}\n      cylconn report {recording}")
    return 0


def _motion(path: Path, options: argparse.Namespace) -> Path | None:
    """The file of the motion: the given one, else that of a bundled model."""
    beside = path.with_suffix(".csv")
    is_bundled = path in shipped_models().values() and beside.is_file()
    given: Path | None = options.motion
    return given or (beside if is_bundled else None)


def _scene(path: Path, options: argparse.Namespace) -> Scene:
    """The scene of the file, or of the model, with the changes of the command line."""
    given = [name for name in import_.FRICTION if getattr(options, name) is not None]
    if options.scene is not None:
        if given:
            raise CommandError(f"--{given[0]}: is for an imported scene; with --scene use --set")
        file = scenes.find(options.scene)
        scene = load(file)
    else:
        file = path
        draft = from_mujoco.draft_of(path, options.joint)
        import_.put_friction(draft, options)
        import_.print_left_out(draft)
        imported = draft.scene()
        assert imported is not None  # a model has masses, else it was refused
        scene = imported
        if scene.body_a.kind == "driven" and options.constraint is None:
            print("body A is part of a mechanism: the model keeps its joint "
                  "(--constraint simulator)", file=sys.stderr)  # fmt: skip
            scene = scene.replace({"constraint": "simulator"})
    if options.constraint is not None:
        scene = scene.replace({"constraint": options.constraint})
    if not math.isfinite(scene.plant.duration) and options.duration is None and not options.steps:
        scene = scene.replace({"plant.duration": 1.0})  # overridden() wants one
        return scenes.overridden(file, scene, options).replace({"plant.duration": math.inf})
    return scenes.overridden(file, scene, options)


def _described(scene: Scene, values: dict[str, float]) -> str:
    """One line of the motion, without an axis that is held."""
    parts = [f"t {values['time']:.2f} s"]
    if math.isnan(scene.command.slide.position):
        parts.append(
            f"slide {values['length']:.4f} m {values['rate']:+.3f} m/s {values['force']:+.1f} N"
        )
    if math.isnan(scene.command.spin.position):
        parts.append(
            f"spin {values['angle']:+.3f} rad {values['spin']:+.2f} rad/s "
            f"{values['moment']:+.2f} N m"
        )
    return "  ".join(parts)
