"""The recipes for containers and conda name what package.xml and setup.py require."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import yaml
from paths import ROOT

PACKAGE = ElementTree.parse(ROOT / "package.xml").getroot()
ROS = {
    element.text or ""
    for tag in ("depend", "exec_depend")
    for element in PACKAGE.findall(tag)
    if element.text and not element.text.startswith("python3-")
}
# In ros-base, on which the image is built, and in the metapackage of RoboStack.
BASE = {
    "ament_index_python", "builtin_interfaces", "geometry_msgs", "launch", "lifecycle_msgs",
    "nav_msgs", "rcl_interfaces", "rclpy", "rosgraph_msgs", "rosidl_default_runtime",
    "sensor_msgs", "std_msgs", "std_srvs",
}  # fmt: skip
PYTHON = {"bokeh", "numba", "numpy", "pyyaml", "scipy", "zstandard"}


def text(name: str) -> str:
    return Path(ROOT / name).read_text()


def missing(names: set[str], found: str) -> list[str]:
    return sorted(name for name in names if not re.search(rf"(?<![\w-]){name}(?![\w])", found))


def test_the_image_holds_what_the_package_needs() -> None:
    recipe = text("packaging/Dockerfile")
    final = recipe.split("\nFROM ")[-1]
    ros = {f"-{name.replace('_', '-')}" for name in ROS - BASE}
    assert [name for name in ros if name not in final] == []
    assert missing(PYTHON | {"mcap", "matplotlib", "mujoco"}, recipe) == []
    for copied in re.findall(r"^COPY (?!--from)(\S+)", recipe, re.MULTILINE):
        assert (ROOT / copied).exists(), copied


def test_the_environment_of_pixi_holds_what_the_package_needs() -> None:
    found = text("pixi.toml")
    ros = {f"ros-jazzy-{name.replace('_', '-')}" for name in ROS - BASE}
    assert missing(ros | PYTHON | {"mcap", "matplotlib-base"}, found) == []


def test_the_recipe_of_conda_holds_what_the_package_needs() -> None:
    recipe = yaml.safe_load(text("packaging/recipe.yaml"))
    run = "\n".join(recipe["requirements"]["run"])
    ros = {f"ros-jazzy-{name.replace('_', '-')}" for name in ROS}
    of_others = {"ros-jazzy-builtin-interfaces", "ros-jazzy-rcl-interfaces", "ros-jazzy-launch"}
    assert missing((ros - of_others) | PYTHON, run) == []
    assert recipe["context"]["version"] == PACKAGE.findtext("version")
