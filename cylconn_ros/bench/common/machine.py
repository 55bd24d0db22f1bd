"""What a number was measured on: processor, system, versions, and which sources."""

from __future__ import annotations

import hashlib
import os
import platform
from importlib import metadata
from pathlib import Path

import cylconn_ros

PACKAGES = ("numpy", "numba", "llvmlite", "scipy", "mujoco", "drake", "exudyn", "pin", "pybullet")
ROOMS = ("core", "methods", "connector")


def describe() -> dict[str, str]:
    """Name and value of everything that a timing depends on, in the order to print."""
    found = {
        "processor": f"{_processor()}, {os.cpu_count()} cores",
        "system": f"{platform.system()} {platform.release()}, {platform.machine()}",
        "load": " ".join(f"{x:.2f}" for x in os.getloadavg()),
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "cylconn_ros": f"{cylconn_ros.__version__}, sources {sources()}",
    }
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "absent"
    return found


def sources() -> str:
    """A digest of the sources that are measured: the version alone does not tell them apart."""
    package = Path(cylconn_ros.__file__).parent
    digest = hashlib.sha256()
    for room in ROOMS:
        for path in sorted((package / room).glob("*.py")):
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
