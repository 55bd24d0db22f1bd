"""What a timing depends on: processor, system, versions and digests of the sources."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from pathlib import Path

import cylconn_ros
from cylconn_ros.bench.common import sources

DISTRIBUTIONS = (
    "numpy", "numba", "llvmlite", "scipy", "mujoco", "drake", "exudyn", "pin", "pybullet",
)  # fmt: skip


def describe() -> dict[str, str]:
    """Name and value of everything that a timing depends on, in printing order."""
    digests = f"kernel {sources.kernel()}, sources {sources.measured()}"
    found = {
        "processor": f"{_processor()}, {os.cpu_count()} cores",
        "system": f"{platform.system()} {platform.release()}, {platform.machine()}",
        "load": " ".join(f"{x:.2f}" for x in os.getloadavg()),
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "cylconn_ros": f"{cylconn_ros.__version__}, {digests}",
    }
    for name in DISTRIBUTIONS:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or "unknown processor"
