"""Programs of this package run as processes of their own: started, watched, ended."""

from __future__ import annotations

import os
import random
import signal
import socket
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType

import cylconn_ros
from cylconn_ros.errors import CommandError

_TAIL_LINES = 15
_PATIENCE = 10.0  # s for a process to end by itself after a signal


def executable(name: str) -> Path:
    """Find an installed program of this package: beside the running one, else in this prefix."""
    prefix = Path(sys.prefix)
    places = [
        Path(sys.argv[0]).absolute().parent,
        prefix / "lib" / "cylconn_ros",
        prefix / "bin",
        Path(sys.executable).parent,
    ]
    for place in places:
        if os.access(place / name, os.X_OK) and (place / name).is_file():
            return place / name
    searched = ", ".join(dict.fromkeys(map(str, places)))
    raise CommandError(f"the program {name} is not installed (looked in {searched})")


def private_environment() -> dict[str, str]:
    """Environment for processes that shall hear only each other: own domain, loopback, at once."""
    profile = Path(cylconn_ros.__file__).with_name("ros") / "loopback.xml"
    if not profile.is_file():  # without it they would talk to the network
        raise CommandError(f"{profile} is missing: install cylconn_ros again")
    return {
        **os.environ,
        "ROS_DOMAIN_ID": str(_free_domain()),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",  # as the profile says
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(profile),
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "PYTHONUNBUFFERED": "1",
    }


def _free_domain() -> int:
    """Pick a ROS domain nobody on this machine uses: its first participants' ports are free."""
    for domain in random.sample(range(1, 100), 50):
        first = 7400 + 250 * domain + 10  # the port formula of the DDS wire protocol
        try:
            for port in range(first, first + 8):
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                    probe.bind(("", port))
        except OSError:
            continue
        return domain
    raise CommandError("no free ROS domain found on this machine")


class Child:
    """A process whose output is read line by line; a context manager that never leaves it behind.

    It is out of the terminal's reach: Ctrl-C comes to us only, and we end it in order.
    """

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        environment: Mapping[str, str],
        on_line: Callable[[str], bool] | None = None,
    ) -> None:
        """Start ``command``; ``on_line`` is told each line and returns whether it was for it."""
        self.name = name
        self.lines: deque[str] = deque(maxlen=_TAIL_LINES)  # the last ones nobody else took
        self._on_line = on_line
        try:
            self._process = subprocess.Popen(
                list(command),
                env=dict(environment),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                start_new_session=True,
            )
        except OSError as error:
            raise CommandError(f"{name} cannot be started: {error}") from error
        self._reader = threading.Thread(target=self._read, name=f"{name} output", daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            line = line.rstrip()
            if line and not (self._on_line is not None and self._on_line(line)):
                self.lines.append(line)

    @property
    def exit_code(self) -> int | None:
        """Exit code, or None while it runs."""
        return self._process.poll()

    def finish(self, patience: float = _PATIENCE) -> int:
        """Ask it to end (interrupt, terminate, kill; ``patience`` seconds each) and wait."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            if self._process.poll() is None:
                self._process.send_signal(number)
            try:
                self._process.wait(patience)
                break
            except subprocess.TimeoutExpired:
                continue
        self._reader.join(patience)
        return self._process.wait()

    def last_words(self) -> str:
        """Return its last lines of output, indented, for an error message."""
        self._reader.join(1.0 if self.exit_code is not None else 0.0)
        text = "\n".join(f"    {line}" for line in self.lines) or "    (no output)"
        return f"{self.name} said last:\n{text}"

    def __enter__(self) -> Child:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.finish()
