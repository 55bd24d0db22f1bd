"""Ways to install the package, for the packaging tests: each gives a prefix to look into."""

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Mapping
from pathlib import Path

from paths import ROOT

LEFT_BEHIND = (".*", "build", "install", "log", "dist", "runs", "*.egg-info", "__pycache__")


def copy_sources(target: Path) -> Path:
    """Copy the checkout without what building and running left in it."""
    return Path(shutil.copytree(ROOT, target, ignore=shutil.ignore_patterns(*LEFT_BEHIND)))


def tool_environment() -> dict[str, str]:
    """Give the variables of this process, with the tools of its Python environment on PATH."""
    path = os.pathsep.join([sysconfig.get_path("scripts"), os.environ["PATH"]])
    return {**os.environ, "PATH": path}


def run(
    *command: object, cwd: Path | None = None, env: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, keeping standard output and error in one text."""
    return subprocess.run(
        list(map(str, command)),
        cwd=cwd,
        env=env if env is not None else tool_environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
    )


def succeed(*command: object, cwd: Path | None = None) -> str:
    """Run a command that must succeed; give its output."""
    done = run(*command, cwd=cwd)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout[-4000:]}"
    return done.stdout


def make_environment(prefix: Path) -> Path:
    """Make an environment that sees the dependencies but no cylconn_ros; give its Python.

    A path in a .pth file is added without the .pth files found there, so an editable install in
    this environment stays out of sight.
    """
    venv.create(prefix, with_pip=False, symlinks=True)
    site = Path(sysconfig.get_path("purelib", vars={"base": str(prefix)}))
    site.joinpath("dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return prefix / "bin" / "python"


def pip_install(prefix: Path, *what: object) -> Path:
    """Install with pip into a new environment at `prefix`, offline."""
    python = make_environment(prefix)
    offline = ("--no-index", "--no-deps", "--no-build-isolation", "--disable-pip-version-check")
    succeed(sys.executable, "-m", "pip", "--python", python, "install", *offline, *what)
    return prefix


def colcon_build(workspace: Path, *options: str) -> Path:
    """Build a copy of the sources in a new colcon workspace; give the package's prefix."""
    copy_sources(workspace / "src" / "cylconn_ros")
    succeed("colcon", "build", *options, cwd=workspace)
    return workspace / "install" / "cylconn_ros"


def installed_environment(prefix: Path) -> dict[str, str]:
    """Environment variables that a setup file would set for `prefix`; nothing of the checkout."""
    version = "python{}.{}".format(*sys.version_info)
    first: dict[str, list[object]] = {
        "AMENT_PREFIX_PATH": [prefix, sys.prefix],
        "LD_LIBRARY_PATH": [prefix / "lib", os.environ.get("LD_LIBRARY_PATH", "")],
        "PYTHONPATH": [prefix / "lib" / version / "site-packages"],
    }
    joined = {name: os.pathsep.join(map(str, paths)) for name, paths in first.items()}
    return {**tool_environment(), **joined}
