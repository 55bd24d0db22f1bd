"""The floors of the house: imports go down, never sideways between rooms, and stay light."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import cylconn_ros

SOURCE = Path(__file__).resolve().parent.parent / "cylconn_ros"

# Rooms and their floors. A module may import its own room and rooms on lower floors.
FLOORS = {
    "core": 0,
    "methods": 1,
    "connector": 2,
    "recording": 3,
    "reference": 3,
    "bench": 4,
    "identify": 4,
    "plots": 4,
    "report": 4,
    "laws": 4,
    "ros": 4,
    "cli": 5,
}
ROS = {
    "ament_index_python",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "lifecycle_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "rclpy",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "visualization_msgs",
}
# Physics computes: beyond arrays it needs nothing, no files and no clock.
CORE_MAY = {
    "__future__",
    "collections",
    "dataclasses",
    "enum",
    "functools",
    "math",
    "numpy",
    "types",
    "typing",
}
# The one file that knows the compiler and where its cache lies.
COMPILER = SOURCE / "core" / "compiled.py"
COMPILER_MAY = {"hashlib", "llvmlite", "numba", "os", "pathlib", "tempfile"}

MODULES = sorted(SOURCE.rglob("*.py"))


def room_of(path: Path) -> str:
    """Name of the room a module is in; empty for the package itself."""
    parts = path.relative_to(SOURCE).parts
    return parts[0] if len(parts) > 1 else ""


def imports(path: Path) -> set[str]:
    """Absolute dotted names of all modules a file imports, at its top or within a function."""
    package = ["cylconn_ros", *path.relative_to(SOURCE).parent.parts]
    names = set()
    for node in ast.walk(ast.parse(path.read_text(), str(path))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            whole = ".".join([*base, *(node.module or "").split(".")]).strip(".")
            # `from package import room` names the room only in its list of names.
            names |= {f"{whole}.{alias.name}" for alias in node.names}
    return names


def violations(room: str, names: set[str]) -> list[str]:
    """Imports of `names` that a module in `room` may not have."""
    wrong = []
    for name in sorted(names):
        first, *rest = name.split(".")
        if first == "cylconn_ros":
            other = rest[0] if rest else ""
            if other == "msg":
                wrong += [name] if room != "ros" else []
            elif other in FLOORS and other != room and FLOORS[other] >= FLOORS.get(room, -1):
                wrong.append(name)
        elif (room != "ros" and first in ROS) or (room == "core" and first not in CORE_MAY):
            wrong.append(name)
    return wrong


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_imports_go_down(path: Path) -> None:
    room = room_of(path)
    assert room in FLOORS or not room, f"{room}/ is not a room: give it a floor in this file"
    allowed = COMPILER_MAY if path == COMPILER else set()
    names = {name for name in imports(path) if name.split(".")[0] not in allowed}
    assert violations(room, names) == []


@pytest.mark.parametrize(
    ("room", "name"),
    [
        ("core", "cylconn_ros.connector.scene"),  # up
        ("plots", "cylconn_ros.ros.cdr"),  # sideways
        ("connector", "rclpy.node"),  # ROS outside the ROS room
        ("cli", "cylconn_ros.msg.ConnectorState"),  # messages outside the ROS room
        ("core", "time"),  # a clock in the core
        ("core", "pathlib.Path"),  # files in the core
        ("core", "numba.njit"),  # the compiler elsewhere than in its one file
    ],
)
def test_a_wrong_import_is_seen(room: str, name: str) -> None:
    assert violations(room, {name}) == [name]


def test_relative_imports_are_resolved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], "SOURCE", tmp_path)
    module = tmp_path / "core" / "a.py"
    module.parent.mkdir()
    module.write_text("from ..connector import scene\nfrom . import vectors\nimport numpy as np\n")
    expected = {"cylconn_ros.connector.scene", "cylconn_ros.core.vectors", "numpy"}
    assert imports(module) == expected


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("cylconn_ros", {"rclpy", "numba", "numpy", "matplotlib", "scipy", "yaml", "mcap"}),
        ("cylconn_ros.core", {"rclpy", "matplotlib", "scipy", "yaml", "mcap"}),
        ("cylconn_ros.connector.scene", {"rclpy", "numba", "matplotlib", "scipy", "mcap"}),
        ("cylconn_ros.recording.reader", {"rclpy", "numba", "matplotlib", "scipy"}),
        ("cylconn_ros.cli.main", {"rclpy", "numba", "matplotlib", "scipy"}),
    ],
)
def test_imports_stay_light(module: str, heavy: set[str]) -> None:
    code = f"import sys, {module}; print(*sorted({heavy} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == []


def test_modules_say_what_they_are() -> None:
    missing = [str(path) for path in MODULES if not ast.get_docstring(ast.parse(path.read_text()))]
    assert missing == []


def test_files_and_functions_stay_short() -> None:
    long = []
    for path in MODULES:
        text = path.read_text()
        lines = text.count("\n")
        long += [f"{path}: {lines} lines"] if lines > 400 else []
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                size = (node.end_lineno or 0) - node.lineno + 1
                long += [f"{path}:{node.name}: {size} lines"] if size > 80 else []
    assert long == []


def test_version_is_the_packages() -> None:
    root = SOURCE.parent
    assert f"<version>{cylconn_ros.__version__}</version>" in (root / "package.xml").read_text()
