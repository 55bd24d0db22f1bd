"""Front end for pip: run the same CMake as colcon into a staging prefix and pack the result.

CMakeLists.txt defines the installed files, package.xml the name, version and licence. This file
turns the staged prefix into a wheel: the Python package with the generated messages becomes the
wheel's package, all other files become data files.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import cast

from setuptools import Command, Distribution, find_packages, setup
from setuptools.command.build import build
from setuptools.command.build_py import build_py

# isort: split
from distutils.command.install_data import install_data  # setuptools' own copy of distutils

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "scripts"))

import toolchain  # noqa: E402  (scripts/ is not on the path of a build backend)

PACKAGE = ElementTree.parse(HERE / "package.xml").getroot()
NAME = PACKAGE.findtext("name", "").strip()
PARENT_PREFIXES = ("share", "ament_index", "resource_index", "parent_prefix_path")

ROS = [
    "ros-jazzy-rclpy[fastrtps]",
    "ros-jazzy-rmw-fastrtps-cpp",
    "ros-jazzy-ament-index-python",
    "ros-jazzy-builtin-interfaces",
    "ros-jazzy-diagnostic-msgs",
    "ros-jazzy-geometry-msgs",
    "ros-jazzy-lifecycle-msgs",
    "ros-jazzy-nav-msgs",
    "ros-jazzy-rcl-interfaces",
    "ros-jazzy-rosgraph-msgs",
    "ros-jazzy-sensor-msgs",
    "ros-jazzy-std-msgs",
    "ros-jazzy-std-srvs",
    "ros-jazzy-visualization-msgs",
]
FAST = ["numba>=0.59"]
DEMO = [*FAST, "matplotlib>=3.8", "scipy>=1.11"]
MUJOCO = [*FAST, "mujoco>=3.3"]
BENCH = [*DEMO, *MUJOCO]
PEERS = [*BENCH, "drake>=1.30", "exudyn>=1.8", "pin>=3", "pybullet>=3.2.5; python_version < '3.12'"]
DOCS = ["furo>=2024.8", "myst-parser>=4", "sphinx>=8.1"]
BAGS = ["lz4>=4.3", "rosbags>=0.10"]
TABLES = ["pandas>=2.2", "pyarrow>=16"]
# SciPy draws samples, fsspec opens object stores, Dask distributes over machines.
SCALE = [*FAST, "dask[distributed]>=2024.8", "fsspec>=2024.6", "pyarrow>=16", "scipy>=1.11"]
TEST = [
    *BAGS,
    *BENCH,
    *DOCS,
    *SCALE,
    "colcon-common-extensions",
    "drake>=1.30",  # with pin: the worked examples of docs/how_to/mechanism.md
    "duckdb>=1",
    "hypothesis>=6.100",
    "mcap-ros2-support>=0.5",
    # Pinned, because findings depend on the version of the tool and of NumPy's types.
    "mypy==2.4.*",
    "numpy==2.2.*",
    "pin>=3",
    *TABLES,
    "pytest>=8",
    "ruff==0.17.*",
    "types-PyYAML",
]


class CannotBuild(SystemExit):
    """Ends the build with one sentence; pip shows other exceptions as a stack trace."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"{NAME} cannot be built: {reason}")


def find_ros() -> list[Path]:
    """Prefixes to build against: pip's build environment, this environment, sourced ones.

    Raises CannotBuild with the name of a missing package.
    """
    prefixes = [
        Path(entry).parents[2]
        for entry in sys.path
        if Path(entry).name in ("site-packages", "dist-packages")
    ]
    prefixes.append(Path(sys.prefix))
    sourced = os.environ.get("AMENT_PREFIX_PATH", "")
    prefixes += [Path(entry) for entry in sourced.split(os.pathsep) if entry]
    for package in ("ament_cmake", "rosidl_default_generators", "std_msgs"):
        if not any((prefix / "share" / package / "cmake").is_dir() for prefix in prefixes):
            raise CannotBuild(
                f"the ROS 2 package {package} is not in this environment. Let pip make its own "
                "(leave out --no-build-isolation), install the requirements listed in "
                "pyproject.toml's [build-system] first, or source a ROS 2 Jazzy installation."
            )
    return list(dict.fromkeys(prefixes))


class StageWithCMake(Command):
    """Configure, build and install with CMake; `prefix` is then the installed tree."""

    description = "build messages and install everything into a staging tree, with CMake"
    user_options: list[tuple] = []

    def initialize_options(self) -> None:
        self.work = self.prefix = Path()
        self.done = False

    def finalize_options(self) -> None:
        self.work = Path(self.get_finalized_command("build").build_temp).resolve()
        self.prefix = self.work / "stage" / Path(sys.prefix).relative_to("/")

    def run(self) -> None:
        if self.done:
            return
        missing = toolchain.missing_for_building()
        if missing:
            raise CannotBuild(toolchain.explain(missing).replace("\n", " "))
        prefixes = find_ros()
        tree, stage = self.work / "cmake", self.work / "stage"
        for stale in (tree, stage):  # they contain paths of an earlier build environment
            shutil.rmtree(stale, ignore_errors=True)
        configure = [
            f"-DCMAKE_INSTALL_PREFIX={sys.prefix}",
            f"-DCMAKE_PREFIX_PATH={';'.join(map(str, prefixes))}",
            f"-DPython3_EXECUTABLE={sys.executable}",
            "-DPython3_FIND_VIRTUALENV=ONLY",
            "-DCMAKE_BUILD_TYPE=Release",
            "-DBUILD_TESTING=OFF",
            "-DCYLCONN_RELOCATABLE=ON",
        ]
        # cmake and ninja of the environment first, even if it is not activated.
        path = os.pathsep.join([sysconfig.get_path("scripts"), os.environ.get("PATH", os.defpath)])
        if shutil.which("ninja", path=path):
            configure += ["-G", "Ninja"]
        cmake = shutil.which("cmake", path=path)
        if cmake is None:
            raise CannotBuild("cmake is not on PATH. Install it with: python -m pip install cmake")
        for step in (
            ["-S", HERE, "-B", tree, *configure],
            ["--build", tree, "--parallel", os.cpu_count() or 1],
            ["--install", tree],
        ):
            command = [cmake, *map(str, step)]
            environment = {**os.environ, "PATH": path, "DESTDIR": str(stage)}
            if subprocess.run(command, env=environment).returncode:
                raise CannotBuild("the CMake build failed; its output is above")
        for cache in list(self.prefix.rglob("__pycache__")):  # pip compiles at its own time
            shutil.rmtree(cache)
        self.done = True

    def package(self) -> Path:
        """The staged Python package, generated messages included."""
        return next(self.prefix.glob(f"**/{NAME}/msg/__init__.py")).parents[1]

    def data(self) -> list[Path]:
        """Staged files outside the package, without those that describe the building machine."""
        left_out = {self.package().parent, self.prefix.joinpath(*PARENT_PREFIXES)}
        files = (path for path in sorted(self.prefix.rglob("*")) if not path.is_dir())
        return [path for path in files if left_out.isdisjoint(path.parents)]


def staged(command: Command) -> StageWithCMake:
    """Return the finished staging command whose result `command` packs."""
    return cast("StageWithCMake", command.get_finalized_command("stage_with_cmake"))


class Build(build):
    """Stage before anything is packed."""

    sub_commands = [("stage_with_cmake", None), *build.sub_commands]


class BuildPackage(build_py):
    """The wheel's package is the staged one; an editable install keeps using the source tree."""

    def run(self) -> None:
        if self.editable_mode:
            super().run()
            return
        shutil.rmtree(self.build_lib, ignore_errors=True)  # contains modules deleted since
        shutil.copytree(staged(self).package(), Path(self.build_lib, NAME))


class InstallData(install_data):
    """Data files of the prefix; for an editable install the generated part of the package as well.

    That part has no __init__.py, so Python finds the source tree's package first, and its __path__
    (see cylconn_ros/__init__.py) then reaches the installed messages.
    """

    def run(self) -> None:
        stage = staged(self)
        for path in stage.data():
            self.put(path, Path(self.install_dir, path.relative_to(stage.prefix)))
        if cast("BuildPackage", self.get_finalized_command("build_py")).editable_mode:
            packages = Path(self.install_dir).with_name(
                "platlib"
            )  # beside `data` in a wheel's .data
            for path in stage.package().rglob("*"):
                inside = Path(NAME, path.relative_to(stage.package()))
                if path.is_file() and not (HERE / inside).exists():
                    self.put(path, packages / inside)

    def put(self, source: Path, target: Path) -> None:
        self.mkpath(str(target.parent))
        self.copy_file(str(source), str(target))
        self.outfiles.append(str(target))


class RosDistribution(Distribution):
    """A distribution with compiled messages and data files, which setuptools does not know."""

    def has_ext_modules(self) -> bool:
        return True

    def has_data_files(self) -> bool:
        return True

    has_data = has_data_files  # read by editable installs


setup(
    name=NAME,
    version=PACKAGE.findtext("version", "").strip(),
    description=" ".join(PACKAGE.findtext("description", "").split()),
    long_description=(HERE / "README.md").read_text() if (HERE / "README.md").exists() else "",
    long_description_content_type="text/markdown",
    maintainer=PACKAGE.findtext("maintainer"),
    license=PACKAGE.findtext("license"),
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_dir={"": "."},
    package_data={NAME: ["py.typed"]},
    install_requires=[
        *ROS,
        "bokeh>=3.4",
        "mcap>=1.1",
        "numpy>=1.26",
        "pyyaml>=6",
        "zstandard>=0.22",
    ],
    extras_require={
        "fast": FAST,
        "mujoco": MUJOCO,
        "demo": DEMO,
        "bench": BENCH,
        "peers": PEERS,
        "bags": BAGS,
        "docs": DOCS,
        "tables": TABLES,
        "scale": SCALE,
        "test": TEST,
    },
    entry_points={
        "console_scripts": [
            f"connector = {NAME}.ros.connector.node:main",
            f"plant = {NAME}.ros.plant.node:main",
            f"mujoco_plant = {NAME}.ros.plant.mujoco_node:main",
            f"cylconn = {NAME}.cli.main:main",
        ]
    },
    distclass=RosDistribution,
    cmdclass={
        "build": Build,
        "build_py": BuildPackage,
        "install_data": InstallData,
        "stage_with_cmake": StageWithCMake,
    },
)
