"""Child processes: the one supervisor of programs that commands and benchmarks start.

:class:`Child` starts a program, reads its output line by line, exchanges JSON lines with it,
signals it and ends it. The functions beside it build commands and an isolated environment.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Literal

import cylconn_ros
from cylconn_ros.errors import CommandError, ProcessError
from cylconn_ros.process.interrupt import interruptible_children

PATIENCE = 10.0
"""Default time in seconds that a child gets to end after each signal."""

_KEPT_LINES = 10_000
_QUOTED_LINES = 15
_ROS_LIBRARIES_PREPARED = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"
"""Set by the ROS wheels in a process whose library path they have prepared."""


# --- commands and environments --------------------------------------------------------------------


def executable(name: str) -> Path:
    """Find an installed program of this package: beside the running one, else in this prefix.

    Raises CommandError if it is not installed; the message lists the directories searched.
    """
    prefix = Path(sys.prefix)
    directories = [
        Path(sys.argv[0]).absolute().parent,
        prefix / "lib" / "cylconn_ros",
        prefix / "bin",
        Path(sys.executable).parent,
    ]
    for directory in directories:
        if os.access(directory / name, os.X_OK) and (directory / name).is_file():
            return directory / name
    searched = ", ".join(dict.fromkeys(map(str, directories)))
    raise CommandError(f"the program {name} is not installed (looked in {searched})")


def module_command(module: str, *arguments: str) -> list[str]:
    """Command that runs a Python module with this interpreter."""
    return [sys.executable, "-m", module, *arguments]


def node_command(
    node: Literal["connector", "plant"], parameter_file: Path, *arguments: str
) -> list[str]:
    """Command that runs a node of this package with a ROS 2 parameter file.

    Parameters
    ----------
        arguments: further ROS arguments, such as ``-p name:=value``.
    """
    ros_arguments = ("--ros-args", "--params-file", str(parameter_file), *arguments)
    return module_command(f"cylconn_ros.ros.{node}.node", *ros_arguments)


def private_environment() -> dict[str, str]:
    """Environment for processes isolated from other ROS programs: free domain, loopback only.

    Raises CommandError if the Fast DDS profile is missing or no ROS domain is free.
    """
    profile = Path(cylconn_ros.__file__).with_name("ros") / "loopback.xml"
    if not profile.is_file():  # without it the processes would use all network interfaces
        raise CommandError(f"{profile} is missing: install cylconn_ros again")
    return {
        **os.environ,
        "ROS_DOMAIN_ID": str(_free_domain()),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",  # the profile sets the range
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(profile),
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "PYTHONUNBUFFERED": "1",
    }


def _free_domain() -> int:
    """A ROS domain without participants on this machine: the ports of its first eight are free."""
    for domain in random.sample(range(1, 100), 50):
        first = 7400 + 250 * domain + 10  # port formula of the DDS-RTPS wire protocol
        try:
            for port in range(first, first + 8):
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                    probe.bind(("", port))
        except OSError:
            continue
        return domain
    raise CommandError("no free ROS domain found on this machine")


def cpu_time(pid: int) -> float:
    """CPU time that all threads of a process have used, s. Raises OSError if it does not exist."""
    return time.clock_gettime((~pid << 3) | 2)  # CPUCLOCK_SCHED of another process (Linux)


# --- the supervisor -------------------------------------------------------------------------------


class Child:
    """A child process in a session of its own; a context manager that ends it.

    Ctrl-C in the terminal does not reach the child: this process receives it and ends the child.
    The child prepares the ROS libraries for itself, as a program started from a shell does. SIGINT,
    which ends it, has its default action in the child, even if this process ignores it (nohup, or
    the background of a shell).

    There are two forms of output:

    - Text: standard output and standard error are one stream of lines.
    - JSON (``json_lines=True``): standard output has one JSON value a line (:meth:`read`,
      :meth:`messages`), standard input takes one a line (:meth:`request`); standard error has text.

    Attributes
    ----------
        name: used in error messages.
        lines: the latest lines of text that ``on_line`` did not consume.
    """

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        environment: Mapping[str, str],
        on_line: Callable[[str], bool] | None = None,
        *,
        folder: Path | None = None,
        json_lines: bool = False,
    ) -> None:
        """Start ``command``.

        Parameters
        ----------
            on_line: called with each line of text, on a thread; returns True if it consumed it.
            folder: working directory; by default that of this process.

        Raises ProcessError if the command cannot be started.
        """
        self.name = name
        self.lines: deque[str] = deque(maxlen=_KEPT_LINES)
        self._on_line = on_line
        self._values: queue.Queue[str | None] = queue.Queue()  # None: end of the output
        try:
            with interruptible_children():
                self._process = subprocess.Popen(
                    list(command),
                    cwd=folder,
                    env={k: v for k, v in environment.items() if k != _ROS_LIBRARIES_PREPARED},
                    stdin=subprocess.PIPE if json_lines else subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE if json_lines else subprocess.STDOUT,
                    text=True,
                    errors="replace",
                    start_new_session=True,
                )
        except OSError as error:
            raise ProcessError(f"{name} cannot be started: {error}") from error
        self._readers = [self._reader(self._process.stdout, self._keep_value)] if json_lines else []
        text = self._process.stderr if json_lines else self._process.stdout
        self._readers.append(self._reader(text, self._keep_text))

    def _reader(
        self, stream: IO[str] | None, keep: Callable[[str | None], None]
    ) -> threading.Thread:
        """Start a thread that passes each line of a stream to ``keep``, and None at its end."""
        assert stream is not None

        def read() -> None:
            with stream:
                for line in stream:
                    keep(line.rstrip())
            keep(None)

        thread = threading.Thread(target=read, name=f"{self.name} output", daemon=True)
        thread.start()
        return thread

    def _keep_text(self, line: str | None) -> None:
        if line and not (self._on_line is not None and self._on_line(line)):
            self.lines.append(line)

    def _keep_value(self, line: str | None) -> None:
        self._values.put(line)

    # --- output ---

    @property
    def output(self) -> str:
        """The kept lines of text, joined."""
        return "\n".join(self.lines)

    def wait_for(self, text: str, timeout: float) -> str:
        """Wait for a line that contains ``text`` and return it.

        Raises TimeoutError after ``timeout`` seconds, ProcessError if the child ends before.
        """
        end = time.monotonic() + timeout
        while True:
            ended = not any(reader.is_alive() for reader in self._readers)
            for line in list(self.lines):
                if text in line:
                    return line
            if ended:
                raise self._ended()
            if time.monotonic() > end:
                raise TimeoutError(f"{self.name}: no line with {text!r} within {timeout:g} s")
            time.sleep(0.01)

    def read(self, timeout: float | None = None) -> Any:
        """Return the next JSON value of the child's output.

        Raises TimeoutError after ``timeout`` seconds, ProcessError if the output has ended or is
        not JSON.
        """
        try:
            line = self._values.get(timeout=timeout)
        except queue.Empty:
            raise TimeoutError(f"{self.name}: no output within {timeout:g} s") from None
        if line is None:
            self._values.put(None)
            raise self._ended()
        return self._value(line)

    def write(self, value: object) -> None:
        """Send a JSON value as a line. Raises ProcessError if the child no longer reads."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(value) + "\n")
            self._process.stdin.flush()
        except (BrokenPipeError, ValueError):  # ValueError: the stream is closed
            raise self._ended() from None

    def request(self, value: object, timeout: float | None = None) -> Any:
        """Send a JSON value and return the next one that the child writes; errors as above."""
        self.write(value)
        return self.read(timeout)

    def messages(self) -> Iterator[Any]:
        """Yield the JSON values of the output until it ends.

        Raises ProcessError if the child then ends with another exit code than 0.
        """
        while (line := self._values.get()) is not None:
            yield self._value(line)
        self._values.put(None)
        if self._process.wait():
            raise self._ended()

    def _value(self, line: str) -> Any:
        try:
            return json.loads(line)
        except ValueError:
            raise ProcessError(f"{self.name} wrote a line that is not JSON: {line}") from None

    def last_words(self) -> str:
        """The last lines of text, indented, for an error message."""
        self._join(1.0 if self.exit_code is not None else 0.0)
        last = list(self.lines)[-_QUOTED_LINES:]
        text = "\n".join(f"    {line}" for line in last) or "    (no output)"
        return f"last output of {self.name}:\n{text}"

    def _ended(self) -> ProcessError:
        """The error of a child that ended early, with its exit code and its last line."""
        code = self.wait(1.0)
        last = self.lines[-1] if self.lines else "(no output)"
        state = "closed its output" if code is None else f"ended with exit code {code}"
        return ProcessError(f"{self.name} {state}: {last}")

    # --- the process ---

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Exit code (minus the signal's number if a signal ended it); None while it runs."""
        return self._process.poll()

    @property
    def running(self) -> bool:
        """Whether the process has not ended."""
        return self.exit_code is None

    @property
    def cpu_time(self) -> float:
        """CPU time used so far, s; 0 if the process has ended."""
        with contextlib.suppress(OSError):
            return cpu_time(self.pid)
        return 0.0

    @property
    def resident_memory(self) -> float:
        """Resident memory, MB; NaN if the process has ended."""
        with contextlib.suppress(OSError):
            for line in Path(f"/proc/{self.pid}/status").read_text().splitlines():
                if line.startswith("VmRSS"):
                    return int(line.split()[1]) / 1024.0
        return float("nan")

    def signal(self, number: int) -> None:
        """Send a signal; without effect if the process has ended."""
        self._process.send_signal(number)

    def kill(self) -> None:
        """End the process with SIGKILL and wait for its end."""
        self._process.kill()
        self._process.wait()
        self._close()

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """Stop the process (SIGSTOP) for the duration of a ``with`` block."""
        self.signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self.signal(signal.SIGCONT)

    def wait(self, timeout: float) -> int | None:
        """Wait for the end and return the exit code; None if it does not end in time.

        After the end the output is complete.
        """
        try:
            code = self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            return None
        self._join(1.0)
        return code

    def finish(self, patience: float = PATIENCE) -> int:
        """End the process in order and return its exit code.

        In turn, until the process ends, with ``patience`` seconds each: end of its input (JSON form
        only), SIGINT, SIGTERM, SIGKILL.
        """
        self.signal(signal.SIGCONT)
        if self._process.stdin is not None:
            self._close_input()
            self.wait(patience)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            if not self.running:
                break
            self.signal(number)
            self.wait(patience)
        code = self._process.wait()
        self._close(patience)
        return code

    def _close(self, patience: float = PATIENCE) -> None:
        """Read the rest of the output; its readers close the streams."""
        self._close_input()
        self._join(patience)

    def _close_input(self) -> None:
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.close()

    def _join(self, timeout: float) -> None:
        for reader in self._readers:
            reader.join(timeout)

    def __enter__(self) -> Child:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.finish()
