"""What a program of ours says, line by line of JSON, while it runs."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

_PATIENCE = 30.0  # s for it to end after a signal


def said(
    module: str, arguments: Sequence[str], environment: Mapping[str, str]
) -> Iterator[dict[str, Any]]:
    """Run a module as a program of its own; what it prints, one line of JSON after the other.

    It is out of the terminal's reach and does not outlive the iteration. Raises RuntimeError with
    its last words where it does not end well.
    """
    clean = {k: v for k, v in environment.items() if k != "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
    with tempfile.TemporaryFile("w+", errors="replace") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", module, *arguments],
            env=clean,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            start_new_session=True,
        )
        assert process.stdout is not None
        try:
            for line in process.stdout:
                yield json.loads(line)
            if process.wait():
                log.seek(0)
                words = log.read().strip().splitlines()
                last = words[-1] if words else "nothing was said"
                raise RuntimeError(f"{module} ended with {process.returncode}: {last}")
        finally:
            for number in (signal.SIGINT, signal.SIGKILL):
                if process.poll() is None:
                    process.send_signal(number)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(_PATIENCE)
                    break
            process.stdout.close()
