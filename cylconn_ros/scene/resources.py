"""Package resources: the bundled example scenes, and the share directories of ROS packages."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import cylconn_ros
from cylconn_ros.errors import SceneError


def share_directories() -> list[Path]:
    """``share`` directories of every prefix that may hold ROS packages, nearest first, each once.

    Sourced workspaces set AMENT_PREFIX_PATH. ROS installed from wheels does not, so the prefixes of
    the interpreter and of its site-packages are searched as well.
    """
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    prefixes.append(Path(sys.prefix))
    for entry in map(Path, sys.path):
        if entry.name in ("site-packages", "dist-packages") and len(entry.parents) > 2:
            prefixes.append(entry.parents[2])
    return [share for share in dict.fromkeys(p / "share" for p in prefixes) if share.is_dir()]


def shipped_scenes() -> dict[str, Path]:
    """Files of the bundled scenes by name: of the checkout, else of the installation.

    Example::

        print(*cr.shipped_scenes())
    """
    return _shipped("config", (".yaml",))


def shipped_models() -> dict[str, Path]:
    """Files of the bundled MJCF and URDF models by name: as those of the scenes."""
    return _shipped("models", (".xml", ".urdf"))


def _shipped(folder: str, endings: tuple[str, ...]) -> dict[str, Path]:
    checkout = Path(cylconn_ros.__file__).resolve().parents[1]
    places = [checkout / folder] if (checkout / "package.xml").is_file() else []
    places += [share / "cylconn_ros" / folder for share in share_directories()]
    for place in places:
        found = {p.stem: p for p in sorted(place.glob("*")) if p.suffix in endings}
        if found:
            return found
    return {}


def shipped(name: str) -> Path:
    """The file of a bundled scene.

    Raises SceneError that lists the bundled scenes.

    Example::

        scene = cr.load(cr.shipped("demo"))
    """
    scenes = shipped_scenes()
    if name not in scenes:
        raise SceneError(f"{name}: no bundled scene; there are {', '.join(scenes) or 'none'}")
    return scenes[name]
