"""A connector node and a plant node as two processes that a command starts, watches and ends."""

from __future__ import annotations

import datetime
import json
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cylconn_ros.cli.progress import Progress
from cylconn_ros.errors import CommandError, ProcessError
from cylconn_ros.process.child import Child

_START_TIMEOUT = 240.0  # s until the first progress, or since a sign that a node still compiles
_PROGRESS_TIMEOUT = 60.0  # s without progress after that


class PairFailedError(ProcessError):
    """The run did not reach its end; the message gives the reason and the processes' output."""


def run_pair(
    label: str,
    connector_command: Sequence[str],
    plant_command: Sequence[str],
    environment: Mapping[str, str],
    steps: int | None,
    describe: Callable[[dict[str, float]], str] = lambda _: "",
) -> list[str]:
    """Run connector and plant until the plant ends.

    ``label``: of the progress bar. ``steps``: of the plant; None: it runs until it is interrupted,
    which is then no error, and has no bar. ``describe``: the text beside the bar for the motion
    that the plant reports.

    Returns the plant's last line. Raises PairFailedError if a process ends early or makes no
    progress. Both processes have ended when this function returns or raises.
    """
    with Progress(label) as bar:
        monitor = PlantMonitor(bar, steps, describe)
        bar.note("starting")
        with (
            Child(
                "connector", connector_command, environment, monitor.watch_connector
            ) as connector,
            Child("plant", plant_command, environment, monitor) as plant,
        ):
            try:
                _watch(connector, plant, monitor)
            except KeyboardInterrupt:
                if steps is not None:
                    raise
            code = plant.finish()
            if code != 0:
                _fail(f"plant ended with exit code {code}", plant, connector)
            code = connector.finish()
            if code != 0:
                _fail(f"connector ended with exit code {code}", connector)
            return list(plant.lines)[-1:]


class PlantMonitor:
    """Consumes the plant's progress lines, shows them and extends the deadline."""

    def __init__(
        self, bar: Progress, steps: int | None,
        describe: Callable[[dict[str, float]], str] = lambda _: "",
    ) -> None:  # fmt: skip
        self._bar = bar
        self.deadline = time.monotonic() + _START_TIMEOUT
        self._steps, self._describe = steps, describe

    def watch_connector(self, line: str) -> bool:
        """Extend the deadline while the connector compiles; False: the line is kept."""
        if "compiling" in line:  # the cache could not be written
            self.deadline = time.monotonic() + _START_TIMEOUT
            self._bar.note("the connector compiles the physics")
        return False

    def __call__(self, line: str) -> bool:
        """Return whether the line is of progress: ``progress DONE TOTAL`` or ``motion JSON``."""
        words = line.split(maxsplit=1)
        if words and words[0] == "motion":
            try:
                values = json.loads(words[1])
            except (IndexError, ValueError):
                return False
            self._bar.values = self._describe(values)
            if self._steps is None and values["time"] > 0.0:
                self.deadline = time.monotonic() + _PROGRESS_TIMEOUT
                self._bar.show_values()
            return True
        words = line.split()
        if len(words) != 3 or words[0] != "progress" or not (words[1] + words[2]).isdigit():
            return False
        self.deadline = time.monotonic() + _PROGRESS_TIMEOUT
        self._bar(int(words[1]), int(words[2]) or self._steps or 0)
        return True


def _watch(connector: Child, plant: Child, monitor: PlantMonitor) -> None:
    """Wait for the end of the plant; raises PairFailedError."""
    while plant.exit_code is None:
        if connector.exit_code is not None:
            _fail(f"connector ended early with exit code {connector.exit_code}", connector, plant)
        if time.monotonic() > monitor.deadline:
            _fail("no progress within the time limit", plant, connector)
        time.sleep(0.02)


def _fail(reason: str, *children: Child) -> None:
    raise PairFailedError("\n".join([reason, *(child.last_words() for child in children)]))


def new_directory(wanted: Path | None, name: str) -> Path:
    """Create a directory, by default runs/NAME_TIME; raises CommandError if it exists."""
    stamp = datetime.datetime.now(datetime.timezone.utc).strftime("%Y%m%dT%H%M%S.%fZ")
    directory = wanted or Path("runs") / f"{name}_{stamp}"
    try:
        directory.mkdir(parents=True)
    except FileExistsError:
        raise CommandError(f"{directory} exists; a run is never overwritten") from None
    except OSError as error:
        raise CommandError(f"{directory}: {error.strerror or error}") from None
    return directory.resolve()


def recording_in(output: Path) -> Path:
    """The one recording below a directory; raises CommandError."""
    found = [path.parent for path in output.glob("*/metadata.yaml")]
    if len(found) != 1:
        raise CommandError(f"{output}: expected one recorded run, found {len(found)}")
    return found[0]


def interrupt_on_signals() -> Callable[[], Any]:
    """Turn SIGTERM and SIGHUP into KeyboardInterrupt, so that the processes are ended.

    Returns a function that restores the previous handlers.
    """

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    old = {number: signal.signal(number, interrupt) for number in (signal.SIGTERM, signal.SIGHUP)}
    return lambda: [signal.signal(number, handler) for number, handler in old.items()]
