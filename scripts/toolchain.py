"""System requirements of the build of the messages. Standard library only: setup.py uses it too."""

import os
import shutil
import sys
import sysconfig
from importlib.util import find_spec
from pathlib import Path

SUPPORTED = ((3, 10), (3, 13))


def missing_for_building() -> dict[str, str]:
    """Return the missing requirements: one sentence each, and the Debian package to install."""
    missing = {}
    named = os.environ.get("CXX", "").split()[:1]
    if not any(map(shutil.which, named or ("c++", "g++", "clang++"))):
        reason = (
            f"CXX names {named[0]}, which does not exist" if named else "there is no C++ compiler"
        )
        missing[reason] = "g++"
    version = "{}.{}".format(*sys.version_info)
    header = Path(sysconfig.get_path("include"), "Python.h")
    if not header.is_file():
        missing[f"Python {version} has no headers ({header})"] = f"python{version}-dev"
    return missing


def missing_for_environment() -> dict[str, str]:
    """Return the missing requirements of a virtual environment for the build, as above."""
    missing = {}
    version = "{}.{}".format(*sys.version_info)
    low, high = SUPPORTED
    if not low <= sys.version_info[:2] <= high:
        span = "{}.{} to {}.{}".format(*low, *high)
        missing[f"this is Python {version}, and ROS 2 Jazzy's wheels are for {span}"] = "python3"
    if not (find_spec("venv") and find_spec("ensurepip")):
        missing[f"Python {version} cannot create virtual environments"] = f"python{version}-venv"
    return {**missing, **missing_for_building()}


def explain(missing: dict[str, str]) -> str:
    """Say what is missing and how to get it, in plain sentences."""
    packages = " ".join(missing.values())
    return f"{'; '.join(missing)}.\nOn Debian or Ubuntu: sudo apt install {packages}"
