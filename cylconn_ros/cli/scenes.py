"""Scene files by path or by name of a bundled scene, with the overrides of the command line."""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cylconn_ros.errors import CommandError, SceneError
from cylconn_ros.scene.parameter_file import parse
from cylconn_ros.scene.resources import shipped_scenes
from cylconn_ros.scene.scene import Scene, load

bundled = shipped_scenes


def find(name: str) -> Path:
    """The file of a scene, by path or name; raises CommandError with the names of all scenes."""
    path = Path(name)
    if path.is_file():
        return path
    scenes = bundled()
    if name in scenes:
        return scenes[name]
    known = ", ".join(scenes) or "none"
    raise CommandError(f"{name} is neither a file nor a bundled scene ({known})")


def add_overrides(parser: argparse.ArgumentParser) -> None:
    """Declare --duration or --steps, and --period."""
    length = parser.add_mutually_exclusive_group()
    length.add_argument(
        "--duration", type=_positive, metavar="S", help="simulated time, s (default: of the scene)"
    )
    length.add_argument("--steps", type=_count, metavar="N", help="number of periods, instead")
    parser.add_argument(
        "--period", type=_positive, metavar="H", help="sample period, s (default: of the scene)"
    )


def add_set(parser: argparse.ArgumentParser) -> None:
    """Declare --set."""
    parser.add_argument(
        "--set", metavar="NAME=VALUE", action="append", default=[],
        help="one parameter, e.g. friction.coefficient=0.3; can be repeated",
    )  # fmt: skip


def changed_parameters(texts: Sequence[str]) -> dict[str, Any]:
    """Parameters by dotted name, from the values of --set; raises CommandError."""
    found: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise CommandError(f"--set {text}: must be NAME=VALUE")
        try:
            found[name.strip()] = parse(value)
        except SceneError as error:
            raise CommandError(f"--set {text}: {error}") from None
    return found


def load_with_overrides(path: Path, options: argparse.Namespace) -> Scene:
    """Load a scene with the length and period of the command line.

    Raises SceneError for an unusable scene, CommandError if duration or period are missing.
    """
    return overridden(path, load(path), options)


def all_overridden(
    path: Path, scenes: Mapping[str, Scene], options: argparse.Namespace
) -> dict[str, Scene]:
    """Scenes of the connectors of ``path`` with the changes of the command line, as above.

    ``--set left.friction.radius=0.01`` is for the connector ``left``, without a name for all.
    """
    given = changed_parameters(getattr(options, "set", ()))
    found = {}
    for name, scene in scenes.items():
        changes = {}
        for key, value in given.items():
            first, _, rest = key.partition(".")
            if not name or first not in scenes:
                changes[key] = value
            elif first == name:
                changes[rest] = value
        found[name] = overridden(path, scene, options, changes)
    return found


def overridden(
    path: Path, scene: Scene, options: argparse.Namespace, changes: Mapping[str, Any] | None = None
) -> Scene:
    """A scene of ``path`` with the changes of the command line, as above.

    ``changes``: parameters in place of those of --set.
    """
    if changes is None:
        changes = changed_parameters(getattr(options, "set", ()))
    if changes:
        try:
            scene = scene.replace(changes)
        except SceneError as error:
            raise CommandError(f"--set: {error}") from None
    if options.period is not None:
        scene = dataclasses.replace(scene, period=options.period)
    if scene.period <= 0.0:
        raise CommandError(f"{path} has no period: give --period H")
    duration = options.duration if options.steps is None else options.steps * scene.period
    if duration is not None:
        plant = dataclasses.replace(scene.plant, duration=duration)
        scene = dataclasses.replace(scene, plant=plant)
    if not math.isfinite(scene.plant.duration):
        raise CommandError(f"{path} has no plant.duration: give --duration S")
    return scene


def steps(scene: Scene) -> int:
    """Number of whole periods in the scene's duration, at least one."""
    return max(1, round(scene.plant.duration / scene.period))


def _count(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be at least 1")
    return value


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: must be a positive number of seconds")
    return value
