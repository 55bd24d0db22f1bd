"""A family of contestants in a process of its own: what crashes or hangs there ends only itself.

``python -m cylconn_ros.bench.peers.isolated`` reads requests, a line of JSON each, and answers in
one:

    {"contestant", "name", "scene", "duration", "value", "truth", "repeat"}
    -> {"cpu": seconds a run, "state": (26,)}  or  {"status": "absent" | ..., "reason"}

A solver prepared is kept until another scene is asked for. Before the first timed run it has run
once: nothing is compiled or loaded on the clock.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import select
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from cylconn_ros.bench.common.errors import AbsentError, LeftOutError
from cylconn_ros.bench.common.timing import timed
from cylconn_ros.bench.peers.solver import Solve, Task
from cylconn_ros.scene.scene import Scene, load

TIMEOUT, CRASHED = "timeout", "crashed"


class Server:
    """Prepares, keeps and runs solvers."""

    def __init__(self) -> None:
        self.scene_file = ""
        self.scene: Scene | None = None
        self.kept: dict[tuple[str, float], Solve] = {}

    def answer(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """One request's answer; nothing raises."""
        try:
            solve = self.solver(request)
            n = request["repeat"]
            if n == 0:  # the first run, from which the answer is taken
                state = [float(x) for x in solve()()]
                return {"state": [x if math.isfinite(x) else None for x in state]}

            def repeat(times: int) -> None:
                for _ in range(times):
                    solve()

            return {"cpu": timed(repeat)(n) / n}
        except AbsentError as reason:
            return {"status": "absent", "reason": str(reason)}
        except LeftOutError as reason:
            return {"status": "left out", "reason": str(reason)}
        except Exception as error:
            return {"status": "failed", "reason": f"{type(error).__name__}: {error}"}

    def solver(self, request: Mapping[str, Any]) -> Solve:
        """The one asked for, prepared at its first request."""
        from cylconn_ros.bench.peers.registry import CONTESTANTS

        if request["scene"] != self.scene_file:
            self.kept.clear()
            self.scene_file, self.scene = request["scene"], load(Path(request["scene"]))
        key = request["contestant"], request["value"]
        if key not in self.kept:
            assert self.scene is not None
            task = Task(
                request["name"], self.scene, request["duration"], request["value"],
                request["truth"],
            )  # fmt: skip
            self.kept[key] = CONTESTANTS[request["contestant"]].prepare(task)
        return self.kept[key]


def main() -> int:
    """Serve until the input ends; what libraries print goes to the error output."""
    import numpy as np

    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    server = Server()
    for line in sys.stdin:
        with np.errstate(all="ignore"):
            answers.write(json.dumps(server.answer(json.loads(line))) + "\n")
        answers.flush()
    return 0


class Process:
    """The parent's end; a context manager. Ends and starts anew where it crashed or took too long.

    ``patience``: CPU seconds for one answer, and a tenth of the wall seconds: on a busy machine
    nobody is to be late for want of a core.
    """

    def __init__(self, patience: float) -> None:
        self.patience = patience
        self._process: subprocess.Popen[bytes] | None = None
        self._rest = b""

    def ask(self, **request: Any) -> dict[str, Any]:
        """The answer to a request; its status is TIMEOUT or CRASHED where there is none."""
        process = self._process or self._start()
        assert process.stdin is not None
        try:
            process.stdin.write(json.dumps(request).encode() + b"\n")
            process.stdin.flush()
            line = self._line(process)
        except (BrokenPipeError, EOFError):
            code = self._end()
            return {"status": CRASHED, "reason": f"the process ended with {code}"}
        except TimeoutError:
            self._end()
            return {"status": TIMEOUT, "reason": f"no answer within {self.patience:g} s of CPU"}
        answer: dict[str, Any] = json.loads(line)
        return answer

    def close(self) -> None:
        """End the process."""
        self._end()

    def _start(self) -> subprocess.Popen[bytes]:
        clean = {k: v for k, v in os.environ.items() if k != "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "cylconn_ros.bench.peers.isolated"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            env={**clean, **threads},
        )  # fmt: skip
        self._rest = b""
        return self._process

    def _line(self, process: subprocess.Popen[bytes]) -> bytes:
        assert process.stdout is not None
        file, began, used = process.stdout.fileno(), time.monotonic(), _cpu(process.pid)
        while b"\n" not in self._rest:
            ready, _, _ = select.select([file], [], [], min(0.5, self.patience))
            if not ready:
                late = time.monotonic() - began > 10.0 * self.patience
                if late or _cpu(process.pid) - used > self.patience:
                    raise TimeoutError
                continue
            more = os.read(file, 65536)
            if not more:
                raise EOFError
            self._rest += more
        line, _, self._rest = self._rest.partition(b"\n")
        return line

    def _end(self) -> int | None:
        process, self._process = self._process, None
        if process is None:
            return None
        if process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
        try:
            code = process.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait()
        if process.stdout is not None:
            process.stdout.close()
        return code

    def __enter__(self) -> Process:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def _cpu(pid: int) -> float:
    """CPU seconds of a process so far; 0 where the system does not tell."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / float(os.sysconf("SC_CLK_TCK"))


if __name__ == "__main__":
    sys.exit(main())
