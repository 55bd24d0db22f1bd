"""What a timing depends on: processor, system, versions and a digest of the sources."""

from __future__ import annotations

import hashlib
import os
import platform
from importlib import metadata
from pathlib import Path

import cylconn_ros

DISTRIBUTIONS = (
    "numpy", "numba", "llvmlite", "scipy", "mujoco", "drake", "exudyn", "pin", "pybullet",
)  # fmt: skip
MEASURED_PACKAGES = (
    "core", "methods", "scene", "connector", "simulation", "messages", "recording", "replay", "ros",
)  # fmt: skip
"""Packages whose code runs while a benchmark measures."""


def describe() -> dict[str, str]:
    """Name and value of everything that a timing depends on, in printing order."""
    found = {
        "processor": f"{_processor()}, {os.cpu_count()} cores",
        "system": f"{platform.system()} {platform.release()}, {platform.machine()}",
        "load": " ".join(f"{x:.2f}" for x in os.getloadavg()),
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "cylconn_ros": f"{cylconn_ros.__version__}, sources {sources()}",
    }
    for name in DISTRIBUTIONS:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def sources() -> str:
    """Digest (12 hexadecimal digits) of the measured sources; the version does not identify them.

    It covers every Python file of MEASURED_PACKAGES, subpackages included.
    """
    root = Path(cylconn_ros.__file__).parent
    digest = hashlib.sha256()
    for package in MEASURED_PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown processor"
