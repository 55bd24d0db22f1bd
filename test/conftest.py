"""What tests share: an isolated ROS graph, default signals, and where the package is installed."""

import importlib
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from cylconn_ros.process.child import private_environment

# Tests that start processes must not meet other ROS programs, nor leave shared memory behind.
os.environ.update(private_environment())


# How long an example takes depends on the machine and on what else runs on it.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

# Started with nohup or in the background of a shell, this process ignores these signals. Programs
# inherit that, but not a handler: they begin with the default action.
for ignored in (signal.SIGINT, signal.SIGHUP):
    if signal.getsignal(ignored) is signal.SIG_IGN:
        signal.signal(ignored, lambda *_: None)


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


@pytest.fixture(scope="session")
def demo_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo as a recorded run, long enough to come to rest."""
    from cylconn_ros.cli.main import main

    path = tmp_path_factory.mktemp("report") / "demo"
    assert main(["simulate", "demo", "--duration", "4", "-o", str(path)]) == 0
    return path


@pytest.fixture(scope="session")
def demo_report(demo_recording: Path) -> Path:
    """Its page."""
    from cylconn_ros.cli.main import main

    path = demo_recording.with_suffix(".html")
    assert main(["report", str(demo_recording), "-o", str(path)]) == 0
    return path


@pytest.fixture
def peer() -> Iterator[Any]:
    """A foreign node on the graph (ros_processes.Peer)."""
    from ros_processes import Peer

    node = Peer()
    yield node
    node.close()


@pytest.fixture
def connector(installed_prefix: Path, tmp_path: Path) -> Any:
    """Run the installed executable with parameters, for the length of a block."""
    from ros_processes import installed, parameters, program

    @contextmanager
    def run(*rules: str, extra: tuple[str, ...] = ()) -> Iterator[Any]:
        command = [*installed(installed_prefix, "connector"), *parameters(*rules), *extra]
        with program(command, tmp_path) as running:
            yield running

    return run
