"""Find scene files: by path, or by the name of a scene that comes with the package."""

from __future__ import annotations

import argparse
import dataclasses
import math
from pathlib import Path

from cylconn_ros.errors import CommandError
from cylconn_ros.scene.resources import shipped_scenes
from cylconn_ros.scene.scene import Scene, load

bundled = shipped_scenes


def find(name: str) -> Path:
    """Return the file of a scene; raises CommandError naming the scenes there are."""
    path = Path(name)
    if path.is_file():
        return path
    scenes = bundled()
    if name in scenes:
        return scenes[name]
    known = ", ".join(scenes) or "none"
    raise CommandError(f"{name} is neither a file nor a scene that comes along ({known})")


def add_overrides(parser: argparse.ArgumentParser) -> None:
    """Add --duration and --period."""
    parser.add_argument(
        "--duration", type=_positive, metavar="S", help="simulated seconds (the scene's otherwise)"
    )
    parser.add_argument(
        "--period", type=_positive, metavar="H", help="sample period in seconds (the scene's)"
    )


def load_with_overrides(path: Path, options: argparse.Namespace) -> Scene:
    """Load a scene with the duration and period given on the command line.

    Raises SceneError for an unusable scene, CommandError where duration or period stay open.
    """
    scene = load(path)
    if options.duration is not None:
        plant = dataclasses.replace(scene.plant, duration=options.duration)
        scene = dataclasses.replace(scene, plant=plant)
    if options.period is not None:
        scene = dataclasses.replace(scene, period=options.period)
    if not math.isfinite(scene.plant.duration):
        raise CommandError(f"{path} has no plant.duration: say how long with --duration")
    if scene.period <= 0.0:
        raise CommandError(f"{path} has no period of its own: give one with --period")
    return scene


def steps(scene: Scene) -> int:
    """Whole periods in the scene's duration, at least one."""
    return max(1, round(scene.plant.duration / scene.period))


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: must be a positive number of seconds")
    return value
