"""A fresh process that runs a connector: for start-up times, and for Python without the compiler.

``python -m cylconn_ros.bench.step_cost.worker SCENE SAMPLES`` loads a parameter file and samples
(.npy), processes the first sample and writes a line of JSON about it. For each line with a number n
on its input it then processes n samples, one call each, and writes the CPU time (s) of these calls.
It ends when its input ends.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from cylconn_ros.errors import ProcessError
from cylconn_ros.process.child import Child, module_command


def main() -> int:
    """Run the worker."""
    import numpy as np

    from cylconn_ros.bench.common.timing import timed
    from cylconn_ros.connector.connector import Connector
    from cylconn_ros.core import layout
    from cylconn_ros.core.jit import COMPILED
    from cylconn_ros.scene.scene import load

    scene, samples = load(sys.argv[1]), np.load(sys.argv[2])
    connector, out = Connector(scene), np.empty(layout.NOUT)
    connector.step(samples[0], out=out)
    first = {
        "compiled": COMPILED,
        "method": connector.method,
        "status": int(out[layout.STATUS]),
        "cpu": time.process_time(),
    }
    print(json.dumps(first), flush=True)
    rows = list(samples)

    def repeat(n: int) -> None:
        for k in range(n):
            connector.step(rows[k % len(rows)], out=out)

    block = timed(repeat)
    for line in sys.stdin:
        print(block(int(line)), flush=True)
    return 0


class Worker:
    """Parent side of a worker process; a context manager.

    Attributes
    ----------
        first: data of the first step: compiled, method, status, CPU time since the start (s).
        wall: wall time from the start of the process to the end of its first step, s.

    Raises ProcessError if the worker ends before its first step is done.
    """

    def __init__(self, scene: Path, samples: Path, environment: Mapping[str, str]) -> None:
        command = module_command("cylconn_ros.bench.step_cost.worker", str(scene), str(samples))
        started = time.perf_counter()
        self._process = Child(
            "the worker process", command, {**os.environ, **environment}, json_lines=True
        )
        try:
            self.first: dict[str, Any] = self._process.read()
        except ProcessError:
            self._process.finish()
            raise
        self.wall = time.perf_counter() - started

    def block(self, n: int) -> float:
        """CPU time of n steps, s."""
        return float(self._process.request(n))

    def close(self) -> None:
        """End the process."""
        self._process.finish()

    def __enter__(self) -> Worker:
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
