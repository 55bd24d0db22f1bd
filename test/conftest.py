"""What tests share: an isolated ROS graph, and where the package is installed."""

import os
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

# Tests that start processes must not meet other ROS programs, nor leave shared memory behind.
os.environ.setdefault("ROS_DOMAIN_ID", str(100 + os.getpid() % 100))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")


def find_installed_prefix() -> Path | None:
    """Prefix that the ament index says holds cylconn_ros: a sourced one, or the environment."""
    sourced = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    for prefix in (*filter(None, sourced), sys.prefix):
        if Path(prefix, "share/ament_index/resource_index/packages/cylconn_ros").is_file():
            return Path(prefix)
    return None


@pytest.fixture(scope="session")
def installed_prefix() -> Path:
    """Prefix in which cylconn_ros is installed: its lib/cylconn_ros/ holds the executables."""
    prefix = find_installed_prefix()
    assert prefix, "cylconn_ros is not installed: use `make test`, or pip install -e . first"
    return prefix
