"""Layouts of Foxglove, PlotJuggler and RViz: what they show exists in published messages."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml
from paths import ROOT
from scenes import bundled

from cylconn_ros.process.child import private_environment
from cylconn_ros.recording.message_definitions import interface
from cylconn_ros.recording.schema import parse
from cylconn_ros.ros.connector.topics import OUTPUTS
from cylconn_ros.scene.inputs import POSE

FOXGLOVE = ROOT / "dashboards" / "foxglove.json"
PLOTJUGGLER = ROOT / "dashboards" / "plotjuggler.xml"

# Topics of the node without namespace and remapping.
TOPICS = {
    **{"/" + name.replace("~", "connector"): kind for name, kind in OUTPUTS},
    "/body_a/pose": POSE,
    "/body_b/pose": POSE,
    "/connector/markers": "visualization_msgs/msg/MarkerArray",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}


def check(topic: str, steps: list[str]) -> None:
    """Follow a path of steps ``field`` or ``field[2]`` to a number or a string."""
    assert topic in TOPICS, f"no topic {topic}"
    kind = TOPICS[topic]
    schema = parse(kind, interface(kind).definition)
    at = kind.replace("/msg/", "/")
    for step in steps:
        match = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", step)
        assert match, f"{topic}: cannot read {step}"
        members = {member.name: member for member in schema.get(at, ())}
        assert match[1] in members, f"{topic}: {at} has no field {match[1]}"
        member = members[match[1]]
        assert member.is_array == (match[2] is not None), f"{topic}: {step}: one of several?"
        if match[2] is not None and member.count is not None:
            assert int(match[2]) < member.count, f"{topic}: {step}: it has {member.count}"
        at = member.type
    assert at not in schema or not steps, f"{topic}: {steps[-1]} is a message, not a value"


def foxglove_paths(config: Any) -> Iterator[str]:
    for key, value in config.items():
        if key == "paths":
            yield from (path["value"] for path in value)
        elif key == "xAxisPath":
            yield value["value"]
        elif key in ("topicToRender", "topicPath"):
            yield value
        elif key == "topics":
            yield from value


def panels_of(layout: Any) -> Iterator[str]:
    if isinstance(layout, str):
        yield layout
    else:
        assert layout["direction"] in ("row", "column")
        assert 0 < layout["splitPercentage"] < 100
        yield from panels_of(layout["first"])
        yield from panels_of(layout["second"])


def test_foxglove_paths_exist() -> None:
    layout = json.loads(FOXGLOVE.read_text())
    paths = [path for config in layout["configById"].values() for path in foxglove_paths(config)]
    assert len(paths) > 40
    for path in paths:
        topic, *steps = path.split(".")
        check(topic, steps)


def test_foxglove_and_lichtblick_read_the_titles() -> None:
    panels = json.loads(FOXGLOVE.read_text())["configById"]
    for name, panel in panels.items():
        if name.startswith(("Plot!", "StateTransitions!", "3D!")):
            assert panel["foxglovePanelTitle"] == panel["lichtblickPanelTitle"] != "", name
            assert "title" not in panel, name  # read by neither


def test_foxglove_places_every_panel_once() -> None:
    layout = json.loads(FOXGLOVE.read_text())
    placed = list(panels_of(layout["layout"]))
    for config in layout["configById"].values():
        for tab in config.get("tabs", []):
            placed += panels_of(tab["layout"])
    assert sorted(placed) == sorted(layout["configById"])
    assert {"configById", "globalVariables", "userNodes", "playbackConfig"} <= set(layout)


def plotjuggler_curves(root: ElementTree.Element) -> tuple[list[str], set[str]]:
    """Return the series that come from messages, and the names of the computed ones."""
    computed = {snippet.attrib["name"] for snippet in root.iter("snippet")}
    series = []
    for curve in root.iter("curve"):
        xy = [curve.attrib[axis] for axis in ("curve_x", "curve_y") if axis in curve.attrib]
        series += xy or [curve.attrib["name"]]
    for snippet in root.iter("snippet"):
        series += [source.text or "" for source in snippet.iter() if source.tag in SOURCES]
    return [name for name in series if name not in computed], computed


SOURCES = ("linked_source", "v1", "v2")


def test_plotjuggler_paths_exist() -> None:
    root = ElementTree.parse(PLOTJUGGLER).getroot()
    series, computed = plotjuggler_curves(root)
    assert len(series) > 35
    for name in series:
        topic = next((t for t in TOPICS if name.startswith(t + "/")), name)
        check(topic, name[len(topic) + 1 :].split("/"))
    drawn = {curve.attrib["name"] for curve in root.iter("curve")}
    assert computed <= drawn


def test_plotjuggler_splits_add_up() -> None:
    for splitter in ElementTree.parse(PLOTJUGGLER).getroot().iter("DockSplitter"):
        sizes = [float(size) for size in splitter.attrib["sizes"].split(";")]
        assert len(sizes) == len(splitter) == int(splitter.attrib["count"])
        assert sum(sizes) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(
    ("topic", "steps", "why"),
    [
        ("/connector/stat", ["force"], "no topic"),
        ("/connector/state", ["normal"], "no field normal"),
        ("/connector/state", ["force"], "one of several"),
        ("/connector/state", ["force[3]"], "it has 3"),
        ("/connector/state", ["traction[0]"], "one of several"),
        ("/body_b/pose", ["pose", "position"], "is a message"),
    ],
)
def test_a_wrong_path_is_found(topic: str, steps: list[str], why: str) -> None:
    with pytest.raises(AssertionError, match=re.escape(why)):
        check(topic, steps)


def test_rviz_shows_topics_of_the_node() -> None:
    config = yaml.safe_load((ROOT / "dashboards" / "connector.rviz").read_text())
    displays = config["Visualization Manager"]["Displays"]
    topics = {display["Topic"]["Value"] for display in displays if "Topic" in display}
    assert topics == {"/connector/markers"}
    assert config["Visualization Manager"]["Global Options"]["Fixed Frame"] == "world"


def test_the_robot_model_can_be_the_value_of_a_parameter() -> None:
    """As in `-p robot_description:="$(cat FILE)"`, which ROS reads as YAML."""
    text = (ROOT / "dashboards" / "shaft_and_sleeve.urdf").read_text()
    assert isinstance(yaml.safe_load(text), str)


def test_the_robot_model_has_the_joints_of_the_connector() -> None:
    """A prismatic and a turning joint about the slot, from the frame of body A to that of B."""
    scene = bundled("slide_and_spin")
    model = ElementTree.parse(ROOT / "dashboards" / "shaft_and_sleeve.urdf").getroot()
    links = {link.attrib["name"] for link in model.iter("link")}
    joints = {joint.attrib["name"]: joint for joint in model.iter("joint")}

    def ends(name: str) -> tuple[str, str]:
        found = [joints[name].find(end) for end in ("parent", "child")]
        first, second = (end.attrib["link"] for end in found if end is not None)
        assert {first, second} <= links
        return first, second

    slide, spin = scene.joint_names.slide, scene.joint_names.spin
    assert ends("shaft_in_world") == (scene.world_frame, scene.body_a.frame)
    assert (ends(slide)[0], ends(spin)[1]) == (scene.body_a.frame, scene.body_b.frame)
    assert ends(slide)[1] == ends(spin)[0]
    for name, kind in ((slide, "prismatic"), (spin, "continuous")):
        axis = joints[name].find("axis")
        assert joints[name].attrib["type"] == kind
        assert axis is not None
        assert axis.attrib["xyz"] == "1 0 0"


# The guide

GUIDE = (ROOT / "docs" / "how_to" / "dashboards.md").read_text()


def test_every_command_of_the_guide_works(tmp_path: Path) -> None:
    blocks = re.findall(r"^```sh\n(.*?)^```", GUIDE, re.DOTALL | re.MULTILINE)
    assert len(blocks) == 3
    # If a command fails, the ones in the background end too: they hold the pipe of the output.
    end = "trap 'kill $(jobs -p) 2>/dev/null || :' EXIT"
    environment = {
        **private_environment(),
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
    }
    done = subprocess.run(
        ["bash", "-euc", "\n".join([end, *blocks])],
        cwd=tmp_path,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=500,
    )
    assert done.returncode == 0, done.stdout
    for name in ("drawer", "connector", "again"):
        assert "every sample" in done.stdout
        assert (tmp_path / f"{name}.html").stat().st_size > 50_000, done.stdout
    assert "friction.coefficient: 0.15" in (tmp_path / "again.html").read_text()


def test_files_that_the_guide_names_exist() -> None:
    for target in re.findall(r"\]\(([^)#]+)", GUIDE):
        assert "://" in target or (ROOT / "docs" / "how_to" / target).exists(), target
    for name in re.findall(r"dashboards/(\w+\.\w+)", GUIDE):
        assert (ROOT / "dashboards" / name).is_file(), name
    assert (ROOT / "docs" / "pictures" / "report.png").stat().st_size < 200_000
