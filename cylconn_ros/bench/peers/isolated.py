"""Solvers of one family in a subprocess: a crash or an endless loop ends only that process.

``python -m cylconn_ros.bench.peers.isolated`` reads one JSON request per line and writes one JSON
response per line:

    {"solver", "case", "scene", "duration", "value", "calibration", "repeat"}
    -> {"cpu": s per run, "state": (26,)}  or  {"status": "not installed" | ..., "reason"}

A prepared solver is kept until the scene changes. The request with ``repeat`` 0 runs it once and
returns the end state; later requests time it, with everything compiled and loaded.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from cylconn_ros.bench.common.errors import NotApplicableError, NotInstalledError
from cylconn_ros.bench.common.timing import timed
from cylconn_ros.bench.peers.solver import Problem, Solve
from cylconn_ros.errors import ProcessError
from cylconn_ros.process.child import Child, module_command
from cylconn_ros.scene.scene import Scene, load

TIMEOUT, CRASHED = "timeout", "crashed"


class SolverServer:
    """Child side: prepares, keeps and runs solvers."""

    def __init__(self) -> None:
        self.scene_file = ""
        self.scene: Scene | None = None
        self.prepared: dict[tuple[str, float], Solve] = {}

    def respond(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """The response to one request; errors become a status."""
        try:
            solve = self.solver(request)
            n = request["repeat"]
            if n == 0:
                state = [float(x) for x in solve()()]
                return {"state": [x if math.isfinite(x) else None for x in state]}

            def repeat(times: int) -> None:
                for _ in range(times):
                    solve()

            return {"cpu": timed(repeat)(n) / n}
        except NotInstalledError as reason:
            return {"status": "not installed", "reason": str(reason)}
        except NotApplicableError as reason:
            return {"status": "not applicable", "reason": str(reason)}
        except Exception as error:
            return {"status": "failed", "reason": f"{type(error).__name__}: {error}"}

    def solver(self, request: Mapping[str, Any]) -> Solve:
        """The requested solver, prepared at its first request."""
        from cylconn_ros.bench.peers.registry import SOLVERS

        if request["scene"] != self.scene_file:
            self.prepared.clear()
            self.scene_file, self.scene = request["scene"], load(Path(request["scene"]))
        key = request["solver"], request["value"]
        if key not in self.prepared:
            assert self.scene is not None
            problem = Problem(
                request["case"], self.scene, request["duration"], request["value"],
                request["calibration"],
            )  # fmt: skip
            self.prepared[key] = SOLVERS[request["solver"]].prepare(problem)
        return self.prepared[key]


def main() -> int:
    """Serve until the input ends; output of the libraries goes to standard error."""
    import numpy as np

    responses = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    server = SolverServer()
    for line in sys.stdin:
        with np.errstate(all="ignore"):
            responses.write(json.dumps(server.respond(json.loads(line))) + "\n")
        responses.flush()
    return 0


class SolverProcess:
    """Parent side; a context manager. Restarts the process after a crash or a timeout.

    ``patience``: limit of the CPU time of one response, s; the wall time may be ten times that,
    because the process may wait for a core on a busy machine.
    """

    def __init__(self, patience: float) -> None:
        self.patience = patience
        self._process: Child | None = None

    @property
    def pid(self) -> int | None:
        """Process id; None if the process does not run."""
        return None if self._process is None else self._process.pid

    def request(self, **request: Any) -> dict[str, Any]:
        """The response to a request; its status is TIMEOUT or CRASHED if there is none."""
        process = self._process or self._start()
        try:
            process.write(request)
            response: dict[str, Any] = self._read(process)
        except ProcessError:
            code = self._end()
            return {"status": CRASHED, "reason": f"the process ended with exit code {code}"}
        except TimeoutError:
            process.kill()
            self._end()
            return {"status": TIMEOUT, "reason": f"no result within {self.patience:g} s of CPU"}
        return response

    def close(self) -> None:
        """End the process."""
        self._end()

    def _start(self) -> Child:
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        command = module_command("cylconn_ros.bench.peers.isolated")
        self._process = Child("solver", command, {**os.environ, **threads}, json_lines=True)
        return self._process

    def _read(self, process: Child) -> Any:
        """Wait for a response. Raises TimeoutError after the time limits."""
        start, used = time.monotonic(), process.cpu_time
        while True:
            try:
                return process.read(min(0.5, self.patience))
            except TimeoutError:
                late = time.monotonic() - start > 10.0 * self.patience
                if late or process.cpu_time - used > self.patience:
                    raise

    def _end(self) -> int | None:
        process, self._process = self._process, None
        return None if process is None else process.finish(patience=1.0)

    def __enter__(self) -> SolverProcess:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


if __name__ == "__main__":
    sys.exit(main())
