"""What tests share: an isolated ROS graph, and where the package is installed."""

import importlib
import os
from pathlib import Path

import pytest

# Tests that start processes must not meet other ROS programs, nor leave shared memory behind.
os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")


@pytest.fixture(scope="session")
def installed_prefix() -> Path:
    """Prefix in which cylconn_ros is installed: its lib/cylconn_ros/ holds the executables.

    The generated messages are always there, in lib/pythonX.Y/site-packages/cylconn_ros/msg/, also
    where the rest of the package is used from the checkout.
    """
    try:
        messages = importlib.import_module("cylconn_ros.msg")
    except ImportError as error:
        raise AssertionError("not installed: use `make test`, or pip install -e . first") from error
    return Path(str(messages.__file__)).parents[5]
