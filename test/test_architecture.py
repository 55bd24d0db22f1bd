"""The layers of the package: imports go down only, without cycles, and stay light."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest
from paths import ROOT, SOURCE

import cylconn_ros

# Packages from the ground up. A module may import from its own package and from lower layers.
LAYERS = (
    ("errors", "core"),
    ("methods",),
    ("scene",),
    ("connector", "process", "importing"),
    ("mechanism",),
    ("simulation", "messages", "recording"),
    ("mujoco",),
    ("reference", "identification", "laws", "report", "replay", "ros"),
    ("study",),
    ("bench",),
    ("cli",),
)
LAYER = {package: n for n, packages in enumerate(LAYERS) for package in packages}
# Where rclpy and message packages may be imported.
ROS_PACKAGES = ("ros", "bench/nodes", "bench/faults")
ROS = {
    "ament_index_python",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "lifecycle_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "rclpy",
    "rosgraph_msgs",
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
# The files of core/ that know the compiler and its cache.
COMPILER = [SOURCE / "core" / f"{name}.py" for name in ("jit", "device_compiler", "kernel_cache")]
COMPILER_MAY = {
    "contextlib", "contextvars", "hashlib", "inspect", "llvmlite", "logging", "numba", "os",
    "pathlib", "pickle", "re", "tempfile",
}  # fmt: skip

MODULES = sorted(SOURCE.rglob("*.py"))


def module_name(path: Path) -> str:
    """Dotted name of a module below the package; empty for the package's own __init__."""
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


NAMES = {module_name(path) for path in MODULES}


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
            # `from package import module` names the module only in its list of names.
            names |= {f"{whole}.{alias.name}" for alias in node.names}
    return names


def violations(module: str, names: set[str]) -> list[str]:
    """Imports of `names` that the module with this dotted name may not have."""
    package = module.partition(".")[0]
    ros = any(f"{module}.".startswith(f"{part.replace('/', '.')}.") for part in ROS_PACKAGES)
    wrong = []
    for name in sorted(names):
        first, *rest = name.split(".")
        if first == "cylconn_ros":
            other = rest[0] if rest else ""
            if other == "msg":
                wrong += [] if ros else [name]
            elif other in LAYER and other != package and LAYER[other] >= LAYER[package]:
                wrong.append(name)
        elif (first in ROS and not ros) or (package == "core" and first not in CORE_MAY):
            wrong.append(name)
    return wrong


def cycles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules that import each other, each sorted (Tarjan's components)."""
    number: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found = []

    def visit(node: str) -> None:
        number[node] = low[node] = len(number)
        stack.append(node)
        for other in graph.get(node, ()):
            if other not in number:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], number[other])
        if low[node] == number[node]:
            group = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(group) > 1:
                found.append(sorted(group))

    for node in graph:
        if node not in number:
            visit(node)
    return found


def modules_in(names: set[str]) -> set[str]:
    """The package's own modules among imported names, `module.attribute` as `module`."""
    found = set()
    for name in names:
        if not name.startswith("cylconn_ros."):
            continue  # the library mujoco is not the package cylconn_ros.mujoco
        inner = name.removeprefix("cylconn_ros.")
        if inner in NAMES:
            found.add(inner)
        elif inner.rpartition(".")[0] in NAMES - {""}:
            found.add(inner.rpartition(".")[0])
    return found


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_imports_go_down(path: Path) -> None:
    module = module_name(path)
    if not module:
        return  # the package's own __init__ is the public face of all layers
    assert module.partition(".")[0] in LAYER, f"{module}: give its package a layer in this file"
    allowed = COMPILER_MAY if path in COMPILER else set()
    names = {name for name in imports(path) if name.split(".")[0] not in allowed}
    assert violations(module, names) == []


def test_no_module_imports_itself_by_way_of_others() -> None:
    graph = {module_name(path): modules_in(imports(path)) for path in MODULES if module_name(path)}
    assert cycles(graph) == []


def test_a_cycle_is_seen() -> None:
    assert cycles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}) == [["b", "c"]]


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("core.friction", "cylconn_ros.scene.scene"),  # up
        ("report.page", "cylconn_ros.replay.replay"),  # sideways
        ("connector.connector", "rclpy.node"),  # ROS outside the packages that may
        ("bench.step_cost.kernel", "rclpy.node"),
        ("cli.main", "cylconn_ros.msg.ConnectorState"),  # messages outside the packages that may
        ("core.friction", "time"),  # a clock in the core
        ("core.friction", "pathlib.Path"),  # files in the core
        ("core.friction", "numba.njit"),  # the compiler elsewhere than in its one file
    ],
)
def test_a_wrong_import_is_seen(module: str, name: str) -> None:
    assert violations(module, {name}) == [name]


# Folders with more modules side by side than a reader takes in at once, and why they are not cut.
MANY_FILES = 14
WIDE = {
    "connector": "one part of what serves samples a file",
    "core": "one concept of the mechanics a file",
    "laws": "one law, or one ingredient of the independent check, a file",
    "methods": "one method, or one part of a step that methods share, a file",
    "cli": "one command a file",
    "scene": "one group or aspect of the parameters a file",
}


def test_no_folder_is_wider_than_a_reader_takes_in() -> None:
    wide = {}
    for folder in {path.parent for path in MODULES}:
        files = [path for path in folder.glob("*.py") if path.name != "__init__.py"]
        if len(files) > MANY_FILES:
            wide[folder.relative_to(SOURCE).as_posix()] = len(files)
    assert {name: n for name, n in wide.items() if name not in WIDE} == {}


def test_tests_mirror_the_packages() -> None:
    folders = {path.parent.relative_to(ROOT / "test") for path in ROOT.glob("test/**/test_*.py")}
    assert [str(folder) for folder in sorted(folders) if not (SOURCE / folder).is_dir()] == []


def test_relative_imports_are_resolved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], "SOURCE", tmp_path)
    module = tmp_path / "core" / "a.py"
    module.parent.mkdir()
    module.write_text("from ..scene import scene\nfrom . import vectors\nimport numpy as np\n")
    expected = {"cylconn_ros.scene.scene", "cylconn_ros.core.vectors", "numpy"}
    assert imports(module) == expected


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("cylconn_ros", {"rclpy", "numba", "numpy", "matplotlib", "scipy", "yaml", "mcap"}),
        ("cylconn_ros.core", {"rclpy", "matplotlib", "scipy", "yaml", "mcap"}),
        ("cylconn_ros.scene.scene", {"rclpy", "numba", "matplotlib", "scipy", "mcap"}),
        ("cylconn_ros.recording.run", {"rclpy", "numba", "matplotlib", "scipy"}),
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


def test_tests_run_in_any_directory() -> None:
    """Paths to files of the repository begin with ROOT, or are found as package data."""
    folders = "bags|config|cylconn_ros|dashboards|docs|launch|models|msg|scripts|test"
    relative = re.compile(rf"(Path|open|load)\(\"({folders})/")
    assert [
        str(path) for path in ROOT.glob("test/**/*.py") if relative.search(path.read_text())
    ] == []
