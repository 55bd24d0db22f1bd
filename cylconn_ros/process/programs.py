"""Nodes as processes that faults are put upon; none outlives its block."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from cylconn_ros.scene.parameter_file import dump
from cylconn_ros.scene.scene import Scene

_PATIENCE = 30.0  # s for a process to end after a signal


class Program:
    """A running node of ours: ``connector`` or ``plant``."""

    def __init__(self, name: str, scene: Path, rules: Sequence[str], folder: Path) -> None:
        self.name = name
        number = len(list(folder.glob(f"{name}_*.log")))
        self.log = folder / f"{name}_{number}.log"
        arguments = [part for rule in rules for part in ("-p", rule)]
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                [
                    *(sys.executable, "-m", f"cylconn_ros.ros.{name}_node"),
                    *("--ros-args", "--params-file", str(scene), *arguments),
                ],
                cwd=folder,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def said(self) -> str:
        """Everything that it has printed."""
        return self.log.read_text(errors="replace")

    def alive(self) -> bool:
        """Whether it runs."""
        return self.process.poll() is None

    def signal(self, number: int) -> None:
        """Send it a signal."""
        self.process.send_signal(number)

    def wait(self, patience: float = _PATIENCE) -> int | None:
        """Wait for its end; the exit code, or None where it does not end."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            return self.process.wait(patience)
        return None

    def kill(self) -> None:
        """Kill it, as ``kill -9`` does."""
        self.process.kill()
        self.process.wait()

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """Stop it for the length of a block."""
        self.signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self.signal(signal.SIGCONT)

    def resident(self) -> float:
        """Memory that it holds, MB."""
        for line in Path(f"/proc/{self.process.pid}/status").read_text().splitlines():
            if line.startswith("VmRSS"):
                return int(line.split()[1]) / 1024.0
        return float("nan")


@contextlib.contextmanager
def program(name: str, scene: Scene, folder: Path, *rules: str) -> Iterator[Program]:
    """Run a node with a scene and further parameters (``name:=value``) for a block."""
    file = folder / f"scene_{time.monotonic_ns()}.yaml"
    file.write_text(dump(scene), encoding="utf-8")
    running = Program(name, file, rules, folder)
    try:
        yield running
    finally:
        for number in (signal.SIGCONT, signal.SIGINT, signal.SIGKILL):
            if running.process.poll() is None:
                running.signal(number)
            if number != signal.SIGCONT:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    running.process.wait(10.0)
                    break
