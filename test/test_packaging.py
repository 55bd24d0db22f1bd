"""pip and colcon install the same things, and what they install runs.

Every way of installing is done once, on a copy of the sources and without the network.
"""

import ast
import re
import runpy
import sys
import xml.etree.ElementTree as ElementTree
import zipfile
from email import message_from_bytes
from pathlib import Path
from unittest import mock

import pytest
from installing import (
    ROOT,
    colcon_build,
    copy_sources,
    installed_environment,
    pip_install,
    run,
    succeed,
)

PYTHON = "python{}.{}".format(*sys.version_info)
PACKAGE = f"lib/{PYTHON}/site-packages/cylconn_ros"
EXECUTABLES = ("connector", "plant", "mujoco_plant", "cylconn")
TYPE_SUPPORT = ("c", "fastrtps_c", "introspection_c")

# What `ros2 run`, rclpy, rosbag2, C++ peers and the ament tools look for. See also test_same_files.
INSTALLED = [
    *(f"lib/cylconn_ros/{name}" for name in EXECUTABLES),
    *(f"lib/libcylconn_ros__rosidl_generator_{kind}.so" for kind in ("c", "py")),
    *(f"lib/libcylconn_ros__rosidl_typesupport_{kind}.so" for kind in TYPE_SUPPORT),
    *(
        f"lib/libcylconn_ros__rosidl_typesupport_{kind}.so"
        for kind in ("cpp", "fastrtps_cpp", "introspection_cpp")
    ),
    *(f"{PACKAGE}/cylconn_ros_s__rosidl_typesupport_{kind}.so" for kind in TYPE_SUPPORT),
    f"{PACKAGE}/msg/__init__.py",
    f"{PACKAGE}/msg/_connector_state.py",
    *(
        f"share/ament_index/resource_index/{index}/cylconn_ros"
        for index in ("packages", "package_run_dependencies", "rosidl_interfaces")
    ),
    "share/cylconn_ros/package.xml",
    *(f"share/cylconn_ros/msg/ConnectorState.{kind}" for kind in ("msg", "idl", "json")),
    "share/cylconn_ros/cmake/cylconn_rosConfig.cmake",
    "share/cylconn_ros/environment/ament_prefix_path.sh",
    "include/cylconn_ros/cylconn_ros/msg/connector_state.hpp",
    *(f"share/cylconn_ros/{path.relative_to(ROOT)}" for path in ROOT.glob("launch/*.py")),
    *(f"share/cylconn_ros/{path.relative_to(ROOT)}" for path in ROOT.glob("config/*")),
    *(f"share/cylconn_ros/{path.relative_to(ROOT)}" for path in ROOT.glob("models/*")),
    *(f"share/cylconn_ros/{path.relative_to(ROOT)}" for path in ROOT.glob("dashboards/*")),
]
SOURCES = [
    f"lib/{PYTHON}/site-packages/{path.relative_to(ROOT)}"
    for path in ROOT.glob("cylconn_ros/**/*")
    if path.is_file() and "__pycache__" not in path.parts
]
# What each way of installing adds for its own bookkeeping.
PIP_ONLY = re.compile(r"bin/|pyvenv|lib64|include/python|.*\.dist-info/|.*\.pth$")
COLCON_ONLY = re.compile(
    r"share/colcon-core/|share/cylconn_ros/(hook/|package\.(bash|sh|ps1|zsh)$)"
    r"|.*\.egg-info/|share/ament_index/resource_index/parent_prefix_path/"
)

WAYS = ("pip", "pip_editable", "colcon", "colcon_symlink")


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    sources = copy_sources(folder / "a clean copy")  # with spaces, as users' folders have
    offline = ("--no-index", "--no-deps", "--no-build-isolation")
    succeed(sys.executable, "-m", "pip", "wheel", *offline, "-w", folder, sources)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="session")
def prefixes(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One prefix for each of WAYS."""
    folder = tmp_path_factory.mktemp("installed")
    sources = copy_sources(folder / "sources")
    return {
        "pip": pip_install(folder / "pip", wheel),
        "pip_editable": pip_install(folder / "pip_editable", "-e", sources),
        "colcon": colcon_build(folder / "colcon"),
        "colcon_symlink": colcon_build(folder / "colcon_symlink", "--symlink-install"),
    }


def files(prefix: Path) -> set[str]:
    """Files in a prefix, relative to it, without compiled Python."""
    found = (path for path in prefix.rglob("*") if path.is_file())
    return {str(path.relative_to(prefix)) for path in found if "__pycache__" not in path.parts}


@pytest.mark.parametrize("way", WAYS)
def test_everything_is_installed(way: str, prefixes: dict[str, Path]) -> None:
    expected = {*INSTALLED, *(() if way == "pip_editable" else SOURCES)}
    assert expected - files(prefixes[way]) == set()


@pytest.mark.parametrize("way", ["colcon", "colcon_symlink"])
def test_same_files(way: str, prefixes: dict[str, Path]) -> None:
    with_pip = {name for name in files(prefixes["pip"]) if not PIP_ONLY.match(name)}
    with_colcon = {name for name in files(prefixes[way]) if not COLCON_ONLY.match(name)}
    if way == "colcon_symlink":  # rosidl then leaves out the C sources among its headers
        with_pip = {name for name in with_pip if not re.match(r"include/.*\.c(pp)?$", name)}
    # The exported CMake targets carry the name of the build type.
    with_colcon = {name.replace("-noconfig.cmake", "-release.cmake") for name in with_colcon}
    assert with_pip ^ with_colcon == set()


@pytest.mark.parametrize("way", WAYS)
def test_installed_messages_travel(way: str, prefixes: dict[str, Path]) -> None:
    code = """
        from cylconn_ros.msg import ConnectorState
        from rclpy.serialization import deserialize_message, serialize_message
        sent = ConnectorState(length=0.5, force=[1.0, 2.0, 3.0], method="impulse")
        assert deserialize_message(serialize_message(sent), ConnectorState) == sent
        import cylconn_ros
        print(cylconn_ros.__file__)
    """
    prefix = prefixes[way]
    python = prefix / "bin" / "python" if way.startswith("pip") else sys.executable
    environment = installed_environment(prefix)
    if way == "pip_editable":
        del environment["PYTHONPATH"]
    done = run(python, "-c", "if True:" + code, env=environment, cwd=prefix)
    assert done.returncode == 0, done.stdout
    expected = prefixes["pip"].with_name("sources") if way == "pip_editable" else prefix
    assert done.stdout.startswith(str(expected))


@pytest.mark.parametrize("way", WAYS)
def test_installed_executables_run(way: str, prefixes: dict[str, Path]) -> None:
    folder = prefixes[way] / "lib" / "cylconn_ros"
    environment = installed_environment(prefixes[way])
    if way == "pip_editable":
        del environment["PYTHONPATH"]
    done = run(folder / "cylconn", "--help", env=environment, cwd=prefixes[way])
    assert done.returncode == 0, done.stdout
    assert "usage: cylconn" in done.stdout
    for name in ("connector", "plant"):
        wrong = ("--ros-args", "-p", "period:=-1.0")
        done = run(folder / name, *wrong, env=environment, cwd=prefixes[way])
        assert done.returncode == 2, done.stdout
        assert "period" in done.stdout
        assert "Traceback" not in done.stdout


def test_wheel_says_what_it_is(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("METADATA"))
        metadata = message_from_bytes(archive.read(name))
        (name,) = (name for name in archive.namelist() if name.endswith("entry_points.txt"))
        entry_points = archive.read(name).decode()
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    assert metadata["Name"].replace("-", "_") == package.findtext("name")
    assert metadata["Version"] == package.findtext("version")
    assert re.findall(r"^(\w+) =", entry_points, re.MULTILINE) == sorted(EXECUTABLES)
    # Built for this Python, not for any.
    assert f"cp{sys.version_info.major}{sys.version_info.minor}" in wheel.name


def test_every_ros_package_imported_is_declared(wheel: Path) -> None:
    imported = set()
    for path in ROOT.glob("cylconn_ros/**/*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
                imported.add(node.module.split(".")[0])
    ros = {name for name in imported if re.search(r"_(msgs|srvs|interfaces|index_python)$", name)}
    ros |= imported & {"rclpy"}
    assert "rclpy" in ros
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    declared = {element.text for element in package if element.tag.endswith("depend")}
    assert ros - declared == set()
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("METADATA"))
        required = message_from_bytes(archive.read(name)).get_all("Requires-Dist", [])
    wheels = {re.match(r"[\w-]+", line)[0] for line in required}  # type: ignore[index]
    assert {f"ros-jazzy-{name.replace('_', '-')}" for name in ros} - wheels == set()


def test_colcon_test(prefixes: dict[str, Path]) -> None:
    """Colcon test runs the suite against what is installed; one file of it shows that."""
    workspace = prefixes["colcon"].parent.parent
    show = ("--return-code-on-test-failure", "--event-handlers", "console_direct+")
    only = ("--ctest-args", "-R", "^test_architecture$")
    succeed("colcon", "test", *show, *only, cwd=workspace)
    listed = succeed("ctest", "-N", cwd=workspace / "build" / "cylconn_ros")
    tests = {path.stem for path in ROOT.glob("test/**/test_*.py")} - {"test_packaging"}
    assert set(re.findall(r"Test +#\d+: (\w+)", listed)) == tests


def test_building_without_a_compiler_is_said_plainly(tmp_path: Path) -> None:
    sources = copy_sources(tmp_path / "sources")
    command = (sys.executable, "-m", "pip", "wheel", "--no-build-isolation", "--no-deps", sources)
    done = run("env", "CXX=no-such-compiler", *command, cwd=tmp_path)
    assert done.returncode != 0
    assert "CXX names no-such-compiler, which does not exist" in done.stdout
    assert "Traceback" not in done.stdout


def test_building_without_ros_is_said_plainly(tmp_path: Path) -> None:
    sources = copy_sources(tmp_path / "sources")
    tools = tmp_path / "tools"  # setuptools alone
    tools.mkdir()
    import setuptools

    available = Path(setuptools.__file__).parent.parent
    for name in ("setuptools", "_distutils_hack", "pkg_resources", "wheel", "packaging"):
        if (available / name).exists():
            (tools / name).symlink_to(available / name)
    bare = (
        f"import sys; sys.path[:] = [p for p in sys.path if 'site-packages' not in p] + ['{tools}']"
    )
    bare += f"; sys.prefix = '{tmp_path}'; sys.argv[0] = 'setup.py'"
    bare += "; import runpy; runpy.run_path('setup.py', run_name='__main__')"
    done = run("env", "-u", "AMENT_PREFIX_PATH", sys.executable, "-c", bare, "build", cwd=sources)
    assert done.returncode != 0
    assert "the ROS 2 package ament_cmake is not in this environment" in done.stdout
    assert "Traceback" not in done.stdout


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ("PYTHON=no-such-python", "cylconn_ros needs Python 3.10"),
        ("CXX=no-such-compiler", "CXX names no-such-compiler"),
    ],
)
def test_make_says_what_is_missing(setting: str, sentence: str, tmp_path: Path) -> None:
    sources = copy_sources(tmp_path / "sources")
    done = run("make", "demo", setting, cwd=sources)
    assert done.returncode != 0
    assert sentence in done.stdout
    assert "sudo apt install" in done.stdout
    assert "Traceback" not in done.stdout


def test_preparing_again_only_for_what_an_install_copies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sources = copy_sources(tmp_path / "sources")
    monkeypatch.syspath_prepend(ROOT / "scripts")
    import prepare

    monkeypatch.setattr(prepare, "ROOT", sources)
    before = prepare.fingerprint()
    with (sources / "cylconn_ros" / "__init__.py").open("a") as module:
        module.write("# used in place\n")
    assert prepare.fingerprint() == before
    with (sources / "msg" / "ConnectorState.msg").open("a") as message:
        message.write("# built\n")
    assert prepare.fingerprint() != before
    assert "ros-jazzy-std-msgs" in prepare.build_requirements()


@pytest.mark.parametrize("path", sorted(ROOT.glob("launch/*.py")), ids=lambda path: path.name)
def test_launch_files_start_what_is_installed(path: Path) -> None:
    """With stand-ins for launch, which has no wheels: packages, executables and files exist."""
    names = ("launch", "launch.actions", "launch.substitutions", "launch_ros", "launch_ros.actions")
    stand_ins = {name: mock.MagicMock() for name in (*names, "launch_ros.substitutions")}
    with mock.patch.dict(sys.modules, stand_ins):
        runpy.run_path(str(path))["generate_launch_description"]()
    nodes = stand_ins["launch_ros.actions"].Node.call_args_list
    assert nodes
    for node in nodes:
        assert node.kwargs["package"] == "cylconn_ros"
        assert node.kwargs["executable"] in EXECUTABLES
    for call in stand_ins["launch.substitutions"].PathJoinSubstitution.call_args_list:
        _, *inside = call.args[0]
        assert ROOT.joinpath(*inside).is_file(), inside
